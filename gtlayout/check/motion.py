"""Does the camera move enough to see depth, and little enough from frame to frame to follow points?"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gtlayout.check.images import Matches
from gtlayout.check.two_views import middle_inverse_depth
from gtlayout.geometry.overlap import overlap
from gtlayout.quality.config import QualityConfig
from gtlayout.scene import FloatArray, Scene
from gtlayout.tracking.config import TrackingConfig

MIN_OVERLAP = 0.5
"""Two neighbouring frames must show so much of the same."""


def motion_suspicions(scene: Scene, matches: list[Matches]) -> list[str]:
    """Too little motion, jumps, and key frames without neighbours."""
    return [*_parallax(scene, matches), *_jumps(scene, middle_inverse_depth(scene, matches))]


def median_parallax_deg(scene: Scene, matches: list[Matches]) -> float:
    """Angle at which a point of median depth is seen from within reach of the tracker; the median key frame's."""
    return float(np.median(_parallax_deg(scene, matches)))


def _parallax_deg(scene: Scene, matches: list[Matches]) -> FloatArray:
    """(K,) one per key frame."""
    rho = middle_inverse_depth(scene, matches)
    centers = np.array([frame.camera.center_world for frame in scene.frames])
    reach = TrackingConfig().max_frames
    found = []
    for key_frame in scene.key_frames:
        near = centers[max(key_frame.frame - reach, 0) : key_frame.frame + reach + 1]
        baseline = np.linalg.norm(near - centers[key_frame.frame], axis=1).max()
        found.append(np.rad2deg(np.arctan(baseline * rho)))
    return np.array(found)


def _parallax(scene: Scene, matches: list[Matches]) -> list[str]:
    least = QualityConfig().low_parallax_deg
    angles = _parallax_deg(scene, matches)
    low = [scene.frame_of(k).name for k, angle in enumerate(angles) if angle < least]
    if not low:
        return []
    some = f"{len(low)} of {len(angles)} key frames ({', '.join(low)})"
    where = "all key frames" if len(low) == len(angles) else some
    return [
        f"too little motion round {where}: points are seen under {np.median(angles[angles < least]):.1f}° "
        f"(median) and {least:g}° is the least that tells their depth; walk sideways, do not only turn"
    ]


def _jumps(scene: Scene, rho: float) -> list[str]:
    cameras = [frame.camera for frame in scene.frames]
    apart = np.array([overlap(a, b, rho) < MIN_OVERLAP for a, b in pairwise(cameras)])
    lines = []
    if apart.any():
        first = int(np.argmax(apart))
        lines.append(
            f"{np.count_nonzero(apart)} of {len(apart)} steps from one frame to the next show less than "
            f"{MIN_OVERLAP:.0%} of the same, first {scene.frames[first].name} to {scene.frames[first + 1].name}: "
            "take more frames a second, or leave out what does not belong together"
        )
    before, after = np.append(True, apart), np.append(apart, True)
    alone = [scene.frames[k.frame].name for k in scene.key_frames if before[k.frame] and after[k.frame]]
    if alone:
        lines.append(f"no frame next to {', '.join(alone)} shows the same: annotate frames with neighbours")
    return lines
