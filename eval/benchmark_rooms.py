"""The synthetic rooms that gtlayout is measured on: every kind of room and camera path, from clean to poor."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from common.command_line import Jobs, exit_status, new_app
from gtlayout.cli.console import progress_bars
from gtlayout.errors import GtlayoutError
from gtlayout.synth import SynthConfig, levels
from gtlayout.synth.data_set import make_rooms
from gtlayout.synth.room import ROOM_KINDS

LEVELS = {
    level: replace(config, frames=30, key_every=6, width=400, height=300) for level, config in levels.LEVELS.items()
}
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
    with progress_bars() as progress:
        progress.stage("rooms")
        made = make_rooms({out / name: config for name, config in configs.items()}, jobs, progress.progress)
    print(f"{made} rooms made, {len(configs) - made} were there: {out}")


def rooms() -> Iterator[tuple[str, SynthConfig]]:
    """``camera-level/kind-seed`` → its parameters."""
    for number, kind in enumerate(ROOM_KINDS):
        for seed in range(SEEDS):
            for level, config in LEVELS.items():
                room = replace(config, room=kind, seed=100 * number + seed)
                yield f"orbit-{level}/{kind}-{seed}", replace(room, camera="orbit")
                yield f"dolly-{level}/{kind}-{seed}", replace(room, camera="dolly")
        yield f"rotation/{kind}-0", replace(LEVELS["clean"], room=kind, seed=100 * number, camera="rotation")


def replays(recorded: list[Path]) -> Iterator[tuple[str, SynthConfig]]:
    """``re10k-typical/file`` → the parameters of a room of each kind in turn."""
    for number, path in enumerate(recorded):
        kind = ROOM_KINDS[number % len(ROOM_KINDS)]
        room = replace(LEVELS["typical"], room=kind, seed=500 + number)
        yield f"re10k-typical/{path.stem}", replace(room, camera="dolly", replay=path)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
