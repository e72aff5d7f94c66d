"""Colours that pictures of a layout have in common: one a label, one an instance, and a scale for σ."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from gtlayout.scene import FloatArray, Label

Colors = npt.NDArray[np.uint8]

SIGMA_FULL_M = 0.1
"""σ of a plane's position at which the colour scale ends in a metric scene."""
SIGMA_FULL_SHARE = 0.05
"""The same in other scenes, as a share of the scene's median depth."""
LABEL_COLORS: dict[Label, tuple[int, int, int]] = {
    "floor": (201, 148, 86),
    "ceiling": (150, 150, 160),
    "wall": (86, 150, 201),
    "slanted": (160, 110, 200),
    "door": (214, 90, 80),
    "window": (90, 200, 190),
}
"""RGB of each label, the same in meshes, plans and pictures."""
_INSTANCE_COLORS: Colors = np.array(
    [
        (86, 150, 201), (201, 148, 86), (110, 190, 100), (190, 110, 200), (230, 200, 80), (90, 200, 190),
        (214, 90, 80), (150, 150, 160), (120, 110, 220), (170, 120, 90), (240, 150, 190), (150, 200, 60),
    ],
    dtype=np.uint8,
)  # fmt: skip


def instance_colors(index: npt.ArrayLike) -> Colors:
    """(..., 3) RGB of instances by their index in the layout; they repeat after twelve."""
    return _INSTANCE_COLORS[np.asarray(index, dtype=np.int64) % len(_INSTANCE_COLORS)]


def sigma_full(metric: bool, median_depth: float) -> float:
    """σ at which the colour scale ends, world unit."""
    return SIGMA_FULL_M if metric else SIGMA_FULL_SHARE * median_depth


def sigma_colors(share: FloatArray) -> Colors:
    """(N, 3) RGB of σ as a share of the scale's end: turbo from blue at 0 to red from 1 on (and where σ is unknown)."""
    levels = np.round(255 * np.clip(np.nan_to_num(share, nan=1.0), 0.0, 1.0)).astype(np.uint8)
    bgr = cv2.applyColorMap(levels.reshape(-1, 1), cv2.COLORMAP_TURBO).reshape(-1, 3)
    return bgr[:, ::-1].astype(np.uint8)
