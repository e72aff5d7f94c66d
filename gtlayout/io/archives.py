"""Zip files as tools hand them out, read like folders: ``export.zip/annotations.xml`` is a path, nothing is unpacked.

Only what is asked for is read, into memory, and no more of it than ``MAX_BYTES``. What a member is called decides
nothing about where anything is written, for nothing is.
"""

from __future__ import annotations

import lzma
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from gtlayout.errors import GtlayoutError
from gtlayout.limits import FILE_MB

MAX_BYTES = 1 << 28
"""Of a file in a zip: 256 MiB, more than any drawing takes; a zip of a few kilobytes can claim any size."""
UNREADABLE = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, RuntimeError, ValueError)
"""What the library raises for damage (the first four), a password or a compression it does not know (RuntimeError), and
a damaged name (ValueError). Whoever names such a zip reads which one it is, and why it cannot be read."""
MAX_NAME = 1000
"""Signs; a longer one is no name."""


def is_archive(path: Path) -> bool:
    """Whether it is a zip file, whatever it is called."""
    try:
        return path.is_file() and zipfile.is_zipfile(path)
    except OSError:
        return False


def archive_of(path: Path) -> Path | None:
    """The zip file that ``path`` is, or leads into; None where it is a path like others."""
    if path.exists():
        return path if is_archive(path) else None
    return next((above for above in path.parents if is_archive(above)), None)


def members(archive: Path) -> list[Path]:
    """The files in a zip, at any depth, sorted, as paths that ``read_bytes`` takes.

    Hidden ones are not among them (macOS adds some), nor names that lead out of it. Raises GtlayoutError.
    """
    with _opened(archive) as content:
        return sorted(archive / name for name in _names(content))


@contextmanager
def open_bytes(path: Path) -> Iterator[IO[bytes]]:
    """A file, or one in a zip, to read from. Raises GtlayoutError naming it when it cannot be read."""
    archive = None if path.exists() else archive_of(path)
    if archive is None:
        try:
            with path.open("rb") as file:
                yield file
        except OSError as error:
            raise GtlayoutError(f"cannot read {path}: {error.strerror or error}") from error
        return
    with _opened(archive) as content:
        name = _names(content).get(path.relative_to(archive).as_posix())
        if name is None:
            raise GtlayoutError(f"cannot read {path}: no such file in {archive.name}")
        if content.getinfo(name).file_size > MAX_BYTES:
            raise GtlayoutError(f"cannot read {path}: it unpacks to more than {MAX_BYTES >> 20} MiB; unpack it by hand")
        with content.open(name) as file:
            yield file


def read_bytes(path: Path) -> bytes:
    """The content of a file, or of one in a zip.

    Raises GtlayoutError naming it when it cannot be read, or is too large.
    """
    parts, size = [], 0
    with open_bytes(path) as file:
        # In pieces: a device has no end, and reading so many bytes at once makes room for all of them.
        while part := file.read(1 << 20):
            parts.append(part)
            size += len(part)
            FILE_MB.check(size / 1e6, f"cannot read {path}")
    return b"".join(parts)


@contextmanager
def _opened(archive: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(archive) as content:
            yield content
    except OSError as error:
        raise GtlayoutError(f"cannot read {archive}: {error.strerror or error}") from error
    except UNREADABLE as error:
        raise GtlayoutError(f"cannot read {archive}: {error}") from error


def _names(content: zipfile.ZipFile) -> dict[str, str]:
    """What a file in it is called here, with forward slashes → how the zip spells it."""
    names = {}
    for info in content.infolist():
        parts = [part for part in info.filename.replace("\\", "/").split("/") if part not in ("", ".")]
        hidden = any(part.startswith((".", "__MACOSX")) for part in parts)
        if parts and not hidden and not info.is_dir() and len(info.filename) <= MAX_NAME:
            names["/".join(parts)] = info.filename
    return names
