"""A hash of everything that a result depends on: the scene's files, the settings and the program."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import gtlayout
from gtlayout.errors import GtlayoutError
from gtlayout.io.cad_estate.reader import image_folder
from gtlayout.results.layout_files import package_versions
from gtlayout.results.names import FOLDER

SETTLED_S = 2.0
"""A file changed more recently than this before it was read may change again within one tick of its file system's
clock, and then look the same.
"""


@dataclass(frozen=True)
class Inputs:
    """The files of a scene."""

    root: Path
    files: tuple[Path, ...]
    """Sorted, through links; without results and hidden files."""
    look: str
    """Hash of names, sizes, times and configuration."""
    settled: bool
    """No file has changed so recently that it may change again and look the same."""

    @property
    def stamp(self) -> str:
        """While it does not change, the files need not be read again. Empty while they are not settled."""
        return self.look if self.settled else ""


def program() -> str:
    """Version and hash of the code and of the libraries that decide what comes out, released or not."""
    digest = hashlib.sha256(repr(sorted(package_versions().items())).encode())
    package = Path(gtlayout.__file__).parent
    for path in sorted(_walk([package], set())):
        if path.suffix in (".py", ".html", ".css", ".js"):
            digest.update(repr((path.relative_to(package).as_posix(), sha256(path))).encode())
    return f"{gtlayout.version.__version__}+{digest.hexdigest()[:12]}"


def inputs_of(scene: Path, configuration: str, leave_out: Iterable[Path] = ()) -> Inputs:
    """The files in the folder ``scene``, and those its cameras refer to elsewhere.

    Raises GtlayoutError when the folder is not there, or the status of a file cannot be read.
    """
    if not scene.is_dir():
        raise GtlayoutError(f"no folder {scene}")
    # CAD-Estate keeps the images of all clips of a video outside their folders.
    roots = [scene, *([folder] if (folder := image_folder(scene)) else [])]
    left_out = {(scene / FOLDER).resolve(), *(path.resolve() for path in leave_out)}
    files = sorted(set(_walk(roots, left_out)))
    digest, changed_ns = hashlib.sha256(configuration.encode()), 0
    for path in files:
        try:
            status = path.stat()
        except OSError as error:
            raise GtlayoutError(f"cannot read {path}: {error.strerror or error}") from error
        changed_ns = max(changed_ns, status.st_mtime_ns, status.st_ctime_ns)
        digest.update(repr((str(path), status.st_size, status.st_mtime_ns, status.st_ctime_ns)).encode())
    settled = time.time() - changed_ns / 1e9 > SETTLED_S
    return Inputs(scene, tuple(files), digest.hexdigest(), settled)


def fingerprint(inputs: Inputs, configuration: str) -> str:
    """SHA-256 of the content of all ``inputs``, their names in the scene folder, and ``configuration``.

    Raises GtlayoutError when a file cannot be read.
    """
    digest = hashlib.sha256(configuration.encode())
    for path in inputs.files:
        try:
            content = sha256(path)
        except OSError as error:
            raise GtlayoutError(f"cannot read {path}: {error.strerror or error}") from error
        digest.update(repr((os.path.relpath(path, inputs.root), content)).encode())
    return digest.hexdigest()


def sha256(path: Path) -> str:
    """Of a file's content. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _walk(roots: Iterable[Path], left_out: set[Path]) -> Iterable[Path]:
    """Files below ``roots``, through links, each folder once; hidden ones and ``left_out`` are passed over."""
    seen = set(left_out)
    for walked, below, names in chain.from_iterable(os.walk(root, followlinks=True) for root in roots):
        if (real := Path(walked).resolve()) in seen:
            below.clear()
            continue
        seen.add(real)
        below[:] = [name for name in below if not name.startswith(".")]
        files = (Path(walked, name) for name in names if not name.startswith("."))
        yield from (path for path in files if path.is_file())
