"""Which images of a folder COLMAP is to find cameras for, and what is left out and why."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.frames import natural
from gtlayout.io.files import printable
from gtlayout.io.pixels.heif import SUFFIXES as HEIF_SUFFIXES
from gtlayout.io.pixels.images import decode
from gtlayout.io.pixels.video import EXTENSIONS as VIDEO_SUFFIXES

READ = (
    *(".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".tif", ".tiff", ".webp", ".bmp", ".avif", ".jp2"),
    *(".ppm", ".pgm", ".pnm", *HEIF_SUFFIXES),
)
"""What OpenCV reads, and HEIC."""
NOT_READ = {
    **dict.fromkeys((".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2", ".pef", ".srw"), "raw images"),
    **dict.fromkeys((".gif", ".jxl", ".psd", ".exr", ".hdr", ".svg", ".insp"), "of a kind that is not read"),
    **dict.fromkeys(VIDEO_SUFFIXES, "videos; import them on their own"),
}
"""What people have beside their images, and why it is left out."""
NO_IMAGES = ("__MACOSX", "depth")
"""Folders that hold none: copies of names that macOS packs, and depth maps."""


def list_images(source: Path) -> tuple[Path, tuple[str, ...], tuple[str, ...]]:
    """The image folder, the names of the images in it, in natural order, and a line per reason to leave some out.

    The folder is ``images/`` in ``source`` where there is one, else ``source``. Images in folders below it are taken
    where it holds none itself. Every image is decoded once. All have one size, that of most. Raises GtlayoutError,
    with these lines, when none is left.
    """
    folder = source / "images" if (source / "images").is_dir() else source
    try:
        files = sorted(
            (path for path in folder.rglob("*") if path.is_file() and not _is_hidden(path, folder)),
            key=lambda path: natural(path.relative_to(folder).as_posix()),
        )
    except OSError as error:
        raise GtlayoutError(f"cannot read {folder}: {error.strerror or error}") from error
    left_out: dict[str, list[str]] = defaultdict(list)
    images = [path for path in files if path.suffix.lower() in READ]
    for path in files:
        if path.suffix.lower() in NOT_READ:
            left_out[NOT_READ[path.suffix.lower()]].append(_name(path, folder))
    if any(path.parent == folder for path in images):
        below = Counter(_name(path.parent, folder) for path in images if path.parent != folder)
        left_out["in folders below the others"] += [f"{name}/ ({count} images)" for name, count in below.items()]
        images = [path for path in images if path.parent == folder]
    sizes: dict[Path, tuple[int, int]] = {}
    for path in images:
        try:
            height, width = decode(path, cv2.IMREAD_COLOR).shape[:2]
        except GtlayoutError as error:
            why = str(error).removeprefix(f"cannot read image {path}: ")
            left_out[why].append(_name(path, folder))
            continue
        sizes[path] = (width, height)
    size = _most_common(sizes.values())
    taken = [path for path in sizes if sizes[path] == size]
    for path, (width, height) in sizes.items():
        if size is not None and (width, height) != size:
            why = f"{width}x{height} px, but most have {size[0]}x{size[1]}, and all must be of one camera"
            left_out[why].append(_name(path, folder))
    lines = tuple(_line(why, names) for why, names in left_out.items() if names)
    if not taken:
        raise GtlayoutError(f"{folder} holds no image that can be read" + "".join(f"; {line}" for line in lines))
    return folder, tuple(path.relative_to(folder).as_posix() for path in taken), lines


def _is_hidden(path: Path, folder: Path) -> bool:
    """Whether the path has a part like ``.Trash``, or lies in a folder that holds no images."""
    return any(part.startswith(".") or part in NO_IMAGES for part in path.relative_to(folder).parts)


def _name(path: Path, folder: Path) -> str:
    return printable(path.relative_to(folder).as_posix())


def _most_common(sizes: Iterable[tuple[int, int]]) -> tuple[int, int] | None:
    """The first of those that occur most often; None without any."""
    found = Counter(sizes).most_common(1)
    return found[0][0] if found else None


def _line(why: str, names: Sequence[str]) -> str:
    return f"left out ({why}): {', '.join(names)}"
