"""Names of images as different tools and systems spell them: one rule for cameras, files on disk and annotations.

What tools add is from their code or their exports: Label Studio's ``upload_name_generator`` puts eight hexadecimal
digits before a name, and Django's ``get_valid_filename``, which it calls, makes ``_`` of blanks and drops other signs;
Roboflow makes ``name_jpg.rf.<hash>.jpg`` of ``name.jpg``; macOS decomposes letters with accents (Unicode's NFD).
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qs, unquote, urlsplit

ENDINGS = "jpe?g|png|bmp|gif|webp|tiff?|heic|heif"
ENDING = re.compile(rf"\.(?:{ENDINGS})\Z", re.IGNORECASE)
UPLOADED = re.compile(r"[0-9a-f]{8}-(.+)")
"""Label Studio's name of what was uploaded as group 1."""
RESIZED = re.compile(rf"(.+)_({ENDINGS})\.rf\.[0-9A-Za-z]+(?:\.\w+)?", re.IGNORECASE)
"""Roboflow's name of what was called ``<group 1>.<group 2>``."""
TWO_ENDINGS = re.compile(rf"(.+\.(?:{ENDINGS}))\.\w{{2,5}}", re.IGNORECASE)
"""A file about an image, or a converted one, that keeps the image's ending."""
ADDRESS = re.compile(r"[a-z][a-z0-9+-]+://|/?data/(?:upload|local-files)\b|[^?]*\?(?:[^?]*&)?d=", re.IGNORECASE)
"""What is no plain path: an address, or what Label Studio has for one."""
MAX_FIELDS = 100


@dataclass(frozen=True)
class NameMatch:
    """The names that answer best to a wanted one."""

    places: tuple[int, ...]
    """Of equally good names, ascending; usually one."""
    exact: bool
    """Whether the file name is the same with its ending, apart from what a tool added to it."""
    other_folder: bool
    """Whether both names have folders, and the nearest folder that is left to compare differs."""


def parts_of(name: str) -> tuple[str, ...]:
    """Folders and file name of a path or an address, however it is written; empty when it names nothing.

    Slashes run either way; drive letters, ``.``, leading slashes and leading ``..`` go; other ``..`` are followed.
    """
    parts: list[str] = []
    for part in re.sub(r"\A[A-Za-z]:(?=[/\\])", "", path_of_address(name)).replace("\\", "/").split("/"):
        if part == "..":
            parts = parts[:-1]
        elif part.strip() not in ("", "."):
            parts.append(part)
    return tuple(parts)


def path_of_address(name: str) -> str:
    """The path in an address, as far as it has one; any other name as it is.

    ``/data/local-files/?d=images/1.jpg`` → ``images/1.jpg``; ``https://host/images/1%20a.jpg?x=y`` →
    ``/images/1 a.jpg``; ``s3://bucket/1.jpg`` → ``/1.jpg``.
    """
    if not ADDRESS.match(name):
        return name
    try:
        parts = urlsplit(name)
        local = parse_qs(parts.query, max_num_fields=MAX_FIELDS).get("d", [""])[-1]
    except ValueError:
        return name
    if local:
        return local
    # Keys of buckets are written as they are, not percent-encoded.
    return parts.path if parts.scheme not in ("", "http", "https") else unquote(parts.path)


def stem(name: str) -> str:
    """A file name without the ending of an image; other dots belong to the name."""
    return ENDING.sub("", name)


def _unchanged(_file: str) -> list[str]:
    return []


def originals(file: str) -> list[str]:
    """What a file may have been called before a tool got it, the most likely first."""
    decoded = unquote(file)
    found = [decoded] if decoded != file else []
    if match := RESIZED.fullmatch(decoded):
        found.append(f"{match[1]}.{match[2]}")
    return [*found, *(match[1] for pattern in (UPLOADED, TWO_ENDINGS) if (match := pattern.fullmatch(decoded)))]


def composed(name: str) -> str:
    """Letters with accents as one character each (NFC)."""
    return unicodedata.normalize("NFC", name)


def _folded(name: str) -> str:
    return composed(composed(name).casefold())


def _spaced(name: str) -> str:
    """Runs of blanks and signs as one ``_``, none at either end of the name or its ending; empty without any letter."""
    if not re.search(r"[^\W_]", stem(name)):
        return ""
    return re.sub(r"_?\._?", ".", re.sub(r"[^\w.]+|_+", "_", re.sub(r"[^\w.]|_", "_", _folded(name)))).strip("_.")


def _squeezed(name: str) -> str:
    """Letters and digits of the stem; signs count only where they keep two numbers apart."""
    return re.sub(r"[\W_]+", "", re.sub(r"(?<=\d)[\W_]+(?=\d)", "x", _folded(stem(name))))


def _unpadded(name: str) -> str:
    """Numbers without the zeros before them."""
    return re.sub(r"0*(\d+)", r"\1", _spaced(name))


SPELLINGS: tuple[Callable[[str], str], ...] = (str, composed, _folded, _spaced, _unpadded)
"""What two file names are compared by, the most telling first: the ending belongs to the name."""
LOOSE: tuple[Callable[[str], str], ...] = (
    lambda name: _folded(stem(name)),
    lambda name: _spaced(stem(name)),
    _squeezed,
    lambda name: _unpadded(stem(name)),
)
"""Where the ending does not: a tool may leave it out, or show a converted copy."""


class NameIndex:
    """Finds a name among many: better spellings first, among equals the one with the most last folders in common."""

    def __init__(self, names: Sequence[str], *, of_files: bool = False) -> None:
        """``of_files``: of one folder; endings count, and files that tools made of others are files of their own."""
        self._keys = SPELLINGS if of_files else (*SPELLINGS, *LOOSE)
        self._originals = _unchanged if of_files else originals
        self._folders: list[tuple[str, ...]] = []
        # Of each key: names as they are, and as they were before a tool changed them.
        self._plain: list[dict[str, list[int]]] = [defaultdict(list) for _ in self._keys]
        self._original: list[dict[str, list[int]]] = [defaultdict(list) for _ in self._keys]
        for place, name in enumerate(names):
            *folders, file = parts_of(name) or ("",)
            self._folders.append(tuple(map(_spaced, folders)))
            for key, plain, original in zip(self._keys, self._plain, self._original, strict=True):
                plain[key(file)].append(place)
                for each in dict.fromkeys(map(key, self._originals(file))):
                    original[each].append(place)

    def find(self, wanted: str) -> NameMatch | None:
        """The names that ``wanted`` means; None when no name has anything of it."""
        *folders, file = parts_of(wanted) or ("",)
        if not file:
            return None
        of_wanted = [(each, self._plain) for each in self._originals(file)]
        for form, tables in ((file, self._plain), *of_wanted, (file, self._original)):
            for key, table in zip(self._keys, tables, strict=True):
                # A name of nothing but signs has an empty key, and may be any other of that kind.
                if found := table.get(key(form) or file):
                    return self._nearest(found, tuple(map(_spaced, folders)), key in (str, composed))
        return None

    def _nearest(self, places: Sequence[int], folders: tuple[str, ...], exact: bool) -> NameMatch:
        def closeness(place: int) -> tuple[int, bool]:
            there = self._folders[place]
            common = next((i for i, (a, b) in enumerate(_backwards(there, folders)) if a != b), None)
            common = min(len(there), len(folders)) if common is None else common
            return common, common == len(there)

        best = max(map(closeness, places))
        nearest = tuple(place for place in places if closeness(place) == best)
        common, is_whole = best
        return NameMatch(nearest, exact, not is_whole and common < len(folders))


def _backwards(one: tuple[str, ...], other: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    return zip(reversed(one), reversed(other), strict=False)


class FilesOnDisk:
    """Finds files whose names are spelled otherwise on disk; every folder is listed once."""

    def __init__(self) -> None:
        self._listed: dict[Path, tuple[list[str], NameIndex]] = {}

    def find_each(self, candidates: Sequence[Sequence[Path]]) -> list[Path | None]:
        """(N,) for each of N lists of paths the first that ``find`` finds, as it is spelled first of all.

        No file is given away twice for its spelling, nor where it is in another list as it is spelled.
        """
        spelled = [next((path for path in paths if path.is_file()), None) for paths in candidates]
        meant = [
            exact or next((found for path in paths if (found := self.find(path))), None)
            for exact, paths in zip(spelled, candidates, strict=True)
        ]
        taken = Counter(meant)
        return [exact or (path if taken[path] == 1 else None) for exact, path in zip(spelled, meant, strict=True)]

    def find(self, path: Path) -> Path | None:
        """The file ``path``, or the one that is meant by it: None when there is none, or more than one."""
        if path.is_file():
            return path
        try:
            found = self._meant(path)
        except OSError:  # What cannot be listed cannot be searched.
            return None
        return found if found is not None and found.is_file() else None

    def _meant(self, path: Path) -> Path | None:
        if path.exists() or path.parent == path:
            return path
        folder = self._meant(path.parent)
        if folder is None or not folder.is_dir():
            return None
        if folder not in self._listed:
            names = sorted(each.name for each in folder.iterdir())
            self._listed[folder] = names, NameIndex(names, of_files=True)
        names, index = self._listed[folder]
        match = index.find(path.name)
        return folder / names[match.places[0]] if match is not None and len(match.places) == 1 else None
