"""Which of several sources of cameras or annotations a scene is read from.

Several sources of cameras are no error as long as they agree: the one that says most is taken, and a warning names it.
Where they contradict each other one of them is wrong, which nothing here can tell, and a wrong camera makes a wrong
room: that is an error, which the user decides with a path. Several models of one COLMAP run are parts of one
reconstruction, or stages of it, so that the largest is taken. Of annotations only one is meant, always.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from gtlayout.errors import GtlayoutError
from gtlayout.io.agreement import contradiction, there
from gtlayout.io.archives import archive_of
from gtlayout.io.sources import PosedImages, Reader

T = TypeVar("T")


@dataclass(frozen=True)
class Source(Generic[T]):
    """A file or folder of one format."""

    reader: Reader[T]
    path: Path

    def __str__(self) -> str:
        return f"{self.path} ({self.reader.name})"


def sources_in(root: Path, readers: Sequence[Reader[T]]) -> list[Source[T]]:
    """What the readers recognise in the folder ``root``, in their order; those of annotations take files and zips."""
    return [Source(reader, path) for reader in readers for path in reader.detect(root)]


def named_path(root: Path, path: Path, what: str) -> Path:
    """A path from the command line: as it is, or else within the scene folder; it may lead into a zip.

    Raises GtlayoutError when it is not there.
    """
    found = next((each for each in (path, root / path) if each.exists() or archive_of(each)), None)
    if found is None:
        raise GtlayoutError(f"no {what} {path}")
    return found


def named_sources(path: Path, readers: Sequence[Reader[T]]) -> list[Source[T]]:
    """What the readers recognise of a path that was named: in a folder, or of the file alone, whatever it is called."""
    if path.is_dir() and (within := sources_in(path, readers)):
        return within
    beside = sources_in(path.parent, readers)
    itself = [source for source in beside if source.path.resolve() == path.resolve()]
    return itself or [Source(reader, found) for reader in readers for found in reader.recognise(path)]


def the_one(sources: Sequence[Source[T]], place: Path, readers: Sequence[Reader[T]], what: str) -> Source[T]:
    """The only source in ``place``. Raises GtlayoutError, with the option that chooses, for none and for several."""
    require_some(sources, place, readers, what)
    if len(sources) > 1:
        raise GtlayoutError(f"{what} in more than one place: {', '.join(map(str, sources))}; {_choose(what)}")
    return sources[0]


def require_some(sources: Sequence[Source[T]], place: Path, readers: Sequence[Reader[T]], what: str) -> None:
    """Raises GtlayoutError, with all that was looked for, when nothing was found in the file or folder ``place``."""
    if not sources:
        looked_for = "; ".join(f"{reader.looked_for} ({reader.name})" for reader in readers)
        raise GtlayoutError(f"no {what} in {place}; looked for {looked_for}")


def read_richest(root: Path, sources: Sequence[Source[PosedImages]]) -> tuple[Source[PosedImages], PosedImages]:
    """Of at least one source the one with the most images that are there, and what it says.

    Of equals a metric one goes first, then the first. A warning names what was not taken, or could not be read. Raises
    GtlayoutError when none can be read, or another contradicts the one that would be taken.
    """
    if len(sources) == 1:
        return sources[0], sources[0].reader.read(root, sources[0].path)
    read: list[tuple[Source[PosedImages], PosedImages]] = []
    unread: list[GtlayoutError] = []
    for source in sources:
        try:
            read.append((source, source.reader.read(root, source.path)))
        except GtlayoutError as error:
            unread.append(error)
    if not read:
        raise unread[0]
    best, cameras = max(read, key=lambda pair: (len(there(pair[1].images)), pair[1].metric is True))
    others = [(source, other) for source, other in read if source is not best]
    for source, other in others:
        parts_of_one = source.reader is best.reader and best.reader.in_parts
        if not parts_of_one and (why := contradiction(cameras.images, other.images)) is not None:
            raise GtlayoutError(
                f"cameras in more than one place, and they contradict each other: {best}, {source}: {why}; "
                + _choose("cameras")
            )
    lines = [f"{error}: these cameras were left out" for error in unread]
    if others:
        left = ", ".join(f"{source} with {len(there(other.images))}" for source, other in others)
        taken = f"{best} with {len(there(cameras.images))} images was read, not {left}"
        lines.insert(0, f"cameras in more than one place: {taken}; {_choose('cameras')}")
    return best, replace(cameras, warnings=(*lines, *cameras.warnings))


def _choose(what: str) -> str:
    return f"choose with --{what} PATH, or leave one of them in the scene folder"
