"""Data sets in which some scenes are broken, and what a run is to say of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from gtlayout.batch.record import Failure, Record
from gtlayout.io.files import write_atomic

FAULTS = Path(__file__).parents[2] / "tests/faults"
"""To be on PYTHONPATH, so that solver processes do what ``misbehave`` asks for."""


def link_scene(scene: Path, folder: Path) -> None:
    """Make ``folder`` the same scene as ``scene``, by links to what is in it: it can then be broken without harm."""
    folder.mkdir(parents=True)
    for path in scene.iterdir():
        (folder / path.name).symlink_to(path.resolve())


def remove(name: str, folder: Path) -> None:
    """Of a linked scene."""
    (folder / name).unlink()


def garble_annotations(folder: Path) -> None:
    """No text, nor JSON. The link is taken away first: what is written to it goes where it leads."""
    (folder / "annotations.json").unlink()
    write_atomic(folder / "annotations.json", bytes(range(256)))


def misbehave(fault: str, folder: Path, once: bool = False) -> None:
    """Ask for a fault of ``tests/faults`` whenever the scene is solved, or only the first time."""
    write_atomic(folder / ".fault", f"{fault} once" if once else fault)


BROKEN: dict[str, tuple[Callable[[Path], None], Failure]] = {
    "no cameras": (partial(remove, "transforms.json"), "input"),
    "no images": (partial(remove, "images"), "input"),
    "garbage annotations": (garble_annotations, "input"),
    "hangs": (partial(misbehave, "hang"), "timeout"),
    "eats memory": (partial(misbehave, "memory"), "memory"),
    "crashes": (partial(misbehave, "segfault"), "died"),
}
"""How → what is done to a linked synthetic scene, and as what it is to be recorded."""


def make_data_set(scenes: Mapping[str, Path], out: Path, every: int) -> dict[str, str]:
    """Link all ``scenes`` (name → folder) into ``out`` and break one in ``every``, in all ways in turn.

    Returns how each of these was broken.
    """
    ways = list(BROKEN)
    broken = {}
    for number, (name, scene) in enumerate(scenes.items()):
        link_scene(scene, out / name)
        if number % every == every // 2:
            how = ways[number // every % len(ways)]
            BROKEN[how][0](out / name)
            broken[name] = how
    return broken


def wrongly_recorded(scenes: Mapping[str, Path], broken: Mapping[str, str], records: Mapping[str, Record]) -> list[str]:
    """A line for each of the ``scenes`` that is not recorded as it is to be: broken ones as such, all others solved."""
    wrong = []
    for name in scenes:
        to_be = BROKEN[broken[name]][1] if name in broken else None
        record = records.get(name)
        if record is None:
            wrong.append(f"{name}: no record")
        elif record.failure != to_be or (to_be is not None and not record.reason):
            wrong.append(f"{name}: {record.failure or 'solved'} ({record.reason}), not {to_be or 'solved'}")
    return wrong
