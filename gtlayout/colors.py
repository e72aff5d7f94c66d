"""One colour a label, the same in meshes, plans and pictures."""

from __future__ import annotations

from gtlayout.scene import Label

LABEL_COLORS: dict[Label, tuple[int, int, int]] = {
    "floor": (201, 148, 86),
    "ceiling": (150, 150, 160),
    "wall": (86, 150, 201),
    "slanted": (160, 110, 200),
    "door": (214, 90, 80),
    "window": (90, 200, 190),
}
"""RGB."""
