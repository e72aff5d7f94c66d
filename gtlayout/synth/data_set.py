"""Many different synthetic rooms: the settings of each, and making them all."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.re10k import read_cameras
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.processes import in_processes
from gtlayout.synth.config import SynthConfig
from gtlayout.synth.errors import AnnotatorErrors, CameraErrors
from gtlayout.synth.levels import LEVELS
from gtlayout.synth.paths import CameraKind
from gtlayout.synth.room import ROOM_KINDS
from gtlayout.synth.scene import synthesize
from gtlayout.synth.trim import Trim
from gtlayout.version import __version__

FORMAT = "gtlayout-data-set/1"
FILE = "data_set.json"
"""The settings of the rooms beside it, so that no rooms with other settings are added."""
CAMERA_KINDS: tuple[CameraKind, ...] = ("orbit", "dolly")
"""Not a camera that only turns: it shows no depth, so that there is no right answer."""

Part = TypeVar("Part", SynthConfig, AnnotatorErrors, CameraErrors, Trim)


def varied(number: int, config: SynthConfig, given: Collection[str]) -> SynthConfig:
    """The settings of room ``number`` (from 0) of a data set, which do not depend on the other rooms.

    Ten rooms in a row show each kind of room with each kind of camera path. Images, annotator, cameras and trim each
    lie somewhere between the levels clean and poor, independently: a good film may be badly annotated. Each room has a
    seed of its own, drawn from ``number`` and the seed of ``config``. All that does not vary is as in ``config``, and
    so are the fields that ``given`` names, those of the annotator, the cameras and the trim among them.
    """
    rng = np.random.default_rng([config.seed, number])
    seed = int(rng.integers(2**53))
    shares = rng.random(4)
    levels = [*LEVELS.values()]
    annotators, cameras = [level.annotator for level in levels], [level.camera_errors for level in levels]
    trims = [level.trim for level in levels]
    room, camera = ROOM_KINDS[number % len(ROOM_KINDS)], CAMERA_KINDS[number % len(CAMERA_KINDS)]
    return replace(
        _between(levels, shares[0], config, given),
        seed=seed,
        room=config.room if "room" in given else room,
        camera=config.camera if "camera" in given else camera,
        annotator=_between(annotators, shares[1], config.annotator, given),
        trim=_between(trims, shares[3], config.trim, given),
        camera_errors=_between(cameras, shares[2], config.camera_errors, given),
    )


def make_data_set(
    out: Path,
    count: int,
    config: SynthConfig,
    given: Collection[str],
    processes: int,
    progress: Callable[[int, int], None],
) -> int:
    """Make the rooms ``out/room_0000`` … as ``varied`` describes them, except those that exist; returns how many.

    ``progress`` is called with (rooms done, rooms in all). Raises GtlayoutError when ``out`` holds something else, or
    rooms made with other settings, and when ``synthesize`` does.
    """
    if config.replay is not None:
        read_cameras(config.replay)  # while nothing is written yet
    _claim(out, config, given)
    rooms = {out / f"room_{number:04d}": varied(number, config, given) for number in range(count)}
    return make_rooms(rooms, processes, progress)


def make_rooms(rooms: Mapping[Path, SynthConfig], processes: int, progress: Callable[[int, int], None]) -> int:
    """Make those of the rooms whose folder is not there or empty; returns how many, and raises as ``synthesize`` does.

    ``progress`` is called with (rooms done, rooms in all).
    """
    todo = [room for room in rooms.items() if not (room[0].is_dir() and any(room[0].iterdir()))]
    there = len(rooms) - len(todo)
    in_processes(_make, todo, processes, lambda done, _todo: progress(there + done, len(rooms)))
    return len(todo)


def _make(room: tuple[Path, SynthConfig]) -> None:
    folder, config = room
    try:
        synthesize(folder, config)
    except GtlayoutError as error:
        raise GtlayoutError(f"{folder.name}: {error}") from error


def _between(levels: list[Part], share: float, config: Part, given: Collection[str]) -> Part:
    """``config``, with the numbers in which the levels differ moved to ``share`` of the way from the first to the last.

    But for those that are ``given``.
    """
    at = np.linspace(0, 1, len(levels))
    steps = {name: [getattr(level, name) for level in levels] for name in _varying(levels) if name not in given}
    moved: dict[str, Any] = {name: float(np.interp(share, at, values)) for name, values in steps.items()}
    return replace(config, **moved)


def _varying(levels: list[Part]) -> list[str]:
    """Names of the numbers in which the levels differ."""
    numbers = [one.name for one in fields(levels[0]) if isinstance(getattr(levels[0], one.name), float)]
    return [name for name in numbers if len({getattr(level, name) for level in levels}) > 1]


def _claim(out: Path, config: SynthConfig, given: Collection[str]) -> None:
    """Write data_set.json to ``out``, or see that it is the same."""
    wanted = {"format": FORMAT, "version": __version__, **_settings(config, given)}
    if out.exists() and (not out.is_dir() or {path.name for path in out.iterdir()} - {FILE}):
        if not (out / FILE).is_file():
            raise GtlayoutError(f"{out} exists and holds no data set made by synth ({FILE}): name a new folder")
        found = read_json(out / FILE)
        other = sorted(name for name in {*found, *wanted} if found.get(name) != wanted.get(name))
        if other:
            raise GtlayoutError(
                f"{out / FILE}: the rooms here were made with another {', '.join(other)}: "
                "give the same flags to go on, or name a new folder"
            )
    else:
        write_json_atomic(out / FILE, wanted)


def _settings(config: SynthConfig, given: Collection[str]) -> dict[str, Any]:
    """What is the same for all rooms, apart from the seed, which each derives its own from."""
    levels = [*LEVELS.values()]
    vary = {"room", "camera", *_varying(levels)}
    vary |= {*_varying([level.annotator for level in levels]), *_varying([level.camera_errors for level in levels])}
    vary |= {*_varying([level.trim for level in levels])}
    flat = asdict(config)
    flat |= flat.pop("annotator") | flat.pop("camera_errors") | flat.pop("trim")
    flat["replay"] = None if config.replay is None else str(config.replay)
    return {name: value for name, value in flat.items() if name in given or name not in vary}
