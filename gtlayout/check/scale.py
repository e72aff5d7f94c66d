"""Is the unit the metre, and do depth maps and cameras have the same?"""

from __future__ import annotations

import numpy as np

from gtlayout.check.images import Matches
from gtlayout.check.motion import median_parallax_deg
from gtlayout.check.two_views import middle_inverse_depth, triangulate_pair
from gtlayout.errors import GtlayoutError
from gtlayout.figures import short
from gtlayout.io.pixels.images import read_depth
from gtlayout.quality.config import QualityConfig
from gtlayout.quality.unit import MEND, depth_doubt
from gtlayout.scene import Scene

MAX_DISAGREEMENT = 1.25
"""Factor between depth maps and triangulated points: 1.00 in both real clips, and no two units are that close."""


def scale_suspicions(scene: Scene, matches: list[Matches]) -> list[str]:
    """Depths no room has in metres, and depth maps of another scale than the cameras.

    None where the camera moves too little to determine a depth.
    """
    if median_parallax_deg(scene, matches) < QualityConfig().low_parallax_deg:
        return []
    return [*_unit(scene, matches), *_depth_maps(scene, matches)]


def _unit(scene: Scene, matches: list[Matches]) -> list[str]:
    why = depth_doubt(1.0 / middle_inverse_depth(scene, matches), QualityConfig()) if scene.metric else None
    return [f"the scene counts as metric, but its points are {why}; {MEND}"] if why else []


def _depth_maps(scene: Scene, matches: list[Matches]) -> list[str]:
    lines, ratios = [], []
    for m in matches:
        frame, target = scene.frames[m.source], scene.frames[m.target]
        if frame.depth_path is None:
            continue
        try:
            depth = read_depth(frame)
        except GtlayoutError as error:
            lines.append(str(error))
            continue
        column, row = np.floor(m.source_px).astype(int).T
        _, rho = triangulate_pair(m, frame.camera, target.camera)
        ratio = depth[row, column] * rho
        if np.isfinite(ratio).any():
            ratios.append(float(np.nanmedian(ratio)))
    factor = float(np.median(ratios)) if ratios else 1.0
    if 1 / MAX_DISAGREEMENT <= factor <= MAX_DISAGREEMENT:
        return lines
    how = f"{short(factor)} times as far as" if factor > 1 else f"1/{short(1 / max(factor, 1e-9))} as far as"
    return [
        *lines,
        f"depth maps and cameras disagree: the maps put points {how} the cameras do "
        f"(median of {len(ratios)} frames); bring both to one unit (maps hold thousandths of the cameras' unit)",
    ]
