"""Stage 3: where the polygons of two instances run along each other, their planes meet (paper 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

from gtlayout.scene import FloatArray


@dataclass(frozen=True)
class ContactEdge:
    """A piece of boundary in one key frame on which two instances touch in 3D."""

    key_frame: int
    instances: tuple[int, int]
    points_px: FloatArray
    """(N, 2) samples along it."""
