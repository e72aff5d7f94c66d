"""The synthetic rooms that gtlayout is measured on: every kind of room and camera path, from clean to poor."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import get_args

from rich.progress import track

from command_line import Jobs, exit_status, new_app
from gtlayout.errors import GtlayoutError
from gtlayout.synth import SynthConfig, synthesize
from gtlayout.synth.errors import AnnotatorErrors, CameraErrors
from gtlayout.synth.room import RoomKind

CLEAN = SynthConfig(frames=30, key_every=6, width=400, height=300)
TYPICAL = replace(
    CLEAN,
    texture=0.5,
    shutter_share=0.3,
    exposure_sigma_ev=0.2,
    annotator=AnnotatorErrors(corner_sigma_px=2.0, edge_sigma_px=2.0, missing_occlusion_share=0.1),
    camera_errors=CameraErrors(rotation_sigma_deg=0.05, position_sigma_m=0.003),
)
POOR = replace(
    CLEAN,
    texture=0.2,
    noise_sigma=4.0,
    shutter_share=0.5,
    exposure_sigma_ev=0.4,
    annotator=AnnotatorErrors(
        corner_sigma_px=2.5,
        edge_sigma_px=4.0,
        missing_share=0.05,
        swapped_share=0.05,
        missing_occlusion_share=0.3,
        no_visible_share=0.1,
    ),
    camera_errors=CameraErrors(rotation_sigma_deg=0.15, position_sigma_m=0.01),
)
LEVELS = {"clean": CLEAN, "typical": TYPICAL, "poor": POOR}
"""A careful annotator and exact cameras; what one may hope for; what also comes in."""
SEEDS = 2
"""Rooms of each kind, path and level."""

app = new_app("benchmark_rooms", __doc__)


@app.default
def make(out: Path, /, *, paths: Path | None = None, jobs: Jobs = 1) -> None:
    """Make the rooms: a folder for each camera path and level, in it a scene for each kind of room and seed.

    Rooms that are there already are left as they are, so that a run that was cut short can go on.

    Parameters
    ----------
    out
        Where the folders go.
    paths
        Folder of RealEstate10k camera files; each is replayed in one more room.
    jobs
        Rooms at a time.
    """
    configs = dict(rooms())
    if paths is not None:
        recorded = sorted(paths.glob("*.txt"))
        if not recorded:
            raise GtlayoutError(f"no camera file (*.txt) in {paths}")
        configs |= replays(recorded)
    todo = {out / name: config for name, config in configs.items() if not (out / name).exists()}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        running = [pool.submit(synthesize, folder, config) for folder, config in todo.items()]
        for done in track(as_completed(running), "rooms", total=len(running), disable=not sys.stderr.isatty()):
            done.result()
    print(f"{len(todo)} rooms made, {len(configs) - len(todo)} were there: {out}")


def rooms() -> Iterator[tuple[str, SynthConfig]]:
    """``camera-level/kind-seed`` → its parameters."""
    kinds: tuple[RoomKind, ...] = get_args(RoomKind)
    for number, kind in enumerate(kinds):
        for seed in range(SEEDS):
            for level, config in LEVELS.items():
                room = replace(config, room=kind, seed=100 * number + seed)
                yield f"orbit-{level}/{kind}-{seed}", replace(room, camera="orbit")
                yield f"dolly-{level}/{kind}-{seed}", replace(room, camera="dolly")
        yield f"rotation/{kind}-0", replace(CLEAN, room=kind, seed=100 * number, camera="rotation")


def replays(recorded: list[Path]) -> Iterator[tuple[str, SynthConfig]]:
    """``re10k-typical/file`` → the parameters of a room of each kind in turn."""
    kinds: tuple[RoomKind, ...] = get_args(RoomKind)
    for number, path in enumerate(recorded):
        kind = kinds[number % len(kinds)]
        yield f"re10k-typical/{path.stem}", replace(TYPICAL, room=kind, seed=500 + number, camera="dolly", replay=path)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
