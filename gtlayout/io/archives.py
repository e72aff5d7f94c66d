"""Zip files as tools hand them out, read like folders: ``export.zip/annotations.xml`` is a path, nothing is unpacked.

Only what is asked for is read, into memory, and no more of it than ``FILE_MB``. What a member is called decides
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
def open_bytes(path: Path, cannot: str = "") -> Iterator[IO[bytes]]:
    """A file, or one in a zip, to read from.

    Raises GtlayoutError that begins with ``cannot``, or as it seems fit, when it cannot be read.
    """
    cannot = cannot or f"cannot read {path}"
    archive = None if path.exists() else archive_of(path)
    if archive is None:
        if path.is_fifo():
            raise GtlayoutError(f"{cannot}: it is a pipe, on which one may wait for ever")
        try:
            with path.open("rb") as file:
                yield file
        except OSError as error:
            raise GtlayoutError(f"{cannot}: {error.strerror or error}") from error
        return
    with _opened(archive) as content:
        name = _names(content).get(path.relative_to(archive).as_posix())
        if name is None:
            raise GtlayoutError(f"cannot read {path}: no such file in {archive.name}")
        # No more than a zip says is unpacked, and a few kilobytes can say anything.
        FILE_MB.check(content.getinfo(name).file_size / 1e6, cannot)
        with content.open(name) as file:
            yield file


def read_bytes(path: Path, cannot: str = "") -> bytes:
    """The content of a file, or of one in a zip.

    Raises GtlayoutError as ``open_bytes`` does, and when it is too large.
    """
    parts, size = [], 0
    if path.is_file():
        FILE_MB.check(path.stat().st_size / 1e6, cannot or f"cannot read {path}")
    with open_bytes(path, cannot) as file:
        # In pieces: a device has no end, and reading so many bytes at once makes room for all of them.
        while part := file.read(1 << 20):
            parts.append(part)
            size += len(part)
            FILE_MB.check(size / 1e6, cannot or f"cannot read {path}")
    return b"".join(parts)


def read_text(path: Path, errors: str = "strict") -> str:
    """A text file in UTF-8, with a byte-order mark or without, or one in a zip; line ends are those of Unix.

    ``errors``: what to do with bytes that are no UTF-8, as in ``bytes.decode``. Raises GtlayoutError as ``read_bytes``
    does, and where it is no text.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise GtlayoutError(f"{path} is not a text file") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


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
