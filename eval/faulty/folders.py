"""What cases begin with: scenes as small as can be, made once."""

from __future__ import annotations

from pathlib import Path

from faulty.case import Room
from gtlayout.cli.app import main
from gtlayout.synth import SynthConfig, synthesize

_SMALL = {"oversample": 1, "hfov_deg": 80.0}
CONFIGS: dict[Room, SynthConfig] = {
    "small": SynthConfig(frames=7, key_every=3, width=96, height=72, **_SMALL),
    "room": SynthConfig(frames=9, key_every=4, width=160, height=120, **_SMALL),
    "colmap": SynthConfig(frames=7, key_every=3, width=96, height=72, camera_format="colmap", **_SMALL),
    "turning": SynthConfig(frames=9, key_every=4, width=160, height=120, camera="rotation", **_SMALL),
    "solved": SynthConfig(frames=9, key_every=4, width=160, height=120, **_SMALL),
}
"""Room → how it is made: one to be read, one to be solved, one with the cameras of COLMAP, one that is solved."""


def make_room(room: Room, folder: Path) -> Path:
    """Make a room in ``folder``, which is new."""
    synthesize(folder, CONFIGS[room])
    if room == "solved":
        assert main(["solve", str(folder), "--json"]) == 0
    return folder
