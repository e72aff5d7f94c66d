"""What cases begin with: scenes as small as can be, made once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from faulty.case import Room
from gtlayout.api import load, save
from gtlayout.method import solve
from gtlayout.results.names import FOLDER
from gtlayout.synth import SynthConfig, synthesize

_SMALL = SynthConfig(frames=7, key_every=3, width=96, height=72, oversample=1, hfov_deg=80.0)
_ROOM = replace(_SMALL, frames=9, key_every=4, width=160, height=120)
CONFIGS: dict[Room, SynthConfig] = {
    "small": _SMALL,
    "room": _ROOM,
    "turning": replace(_ROOM, camera="rotation"),
    "colmap": replace(_SMALL, camera_format="colmap"),
    "solved": _ROOM,
}
"""Room → how it is made: one to be read, one to be solved, one whose camera only turns, one with the cameras of COLMAP,
and one that is solved."""


def make_room(room: Room, folder: Path) -> Path:
    """Make a room in ``folder``, which is new."""
    synthesize(folder, CONFIGS[room])
    if room == "solved":
        save(solve(load(folder)), folder / FOLDER, findings=())
    return folder
