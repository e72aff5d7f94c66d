"""Which frames are worth drawing next."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.overlap import overlap
from gtlayout.scene import Scene

Order = Literal["spread", "video"]
MIN_OVERLAP = 0.3
"""Share of the first drawing's pixels that the second must show, too: two that do not overlap give bad depth."""


def next_frames(
    scene: Scene,
    count: int,
    order: Order = "spread",
    *,
    step: int | None = None,
    inverse_depth: float | None = None,
) -> tuple[int, ...]:
    """The next ``count`` frames to draw, best first; fewer when the scene has no more.

    The first is a quarter into the video, the second as near to three quarters as still overlaps it, and then the
    middles of the largest gaps: even spacing gives the best geometry. With ``video`` they follow in time, ``step``
    frames apart, so that each drawing is most like the one before: it leaves the least to correct.

    Args:
        scene: Its key frames are drawn already.
        count: How many.
        order: ``spread`` or ``video``.
        step: For ``video``; as far apart as the key frames that are drawn, or a tenth of the video, when not given.
        inverse_depth: Of what the cameras see, 1 / world unit, to tell what overlaps; 0 (directions only) when None.

    Raises GtlayoutError for another order.
    """
    if order not in get_args(Order):
        raise GtlayoutError(f"no order {order!r}; there are: {', '.join(get_args(Order))}")
    drawn = [key_frame.frame for key_frame in scene.key_frames]
    chosen: list[int] = []
    while len(chosen) < count and len({*drawn, *chosen}) < len(scene.frames):
        taken = sorted({*drawn, *chosen})
        if order == "video":
            chosen.append(_following(taken, len(scene.frames), step))
        else:
            chosen.append(_spread(scene, taken, inverse_depth or 0.0))
    return tuple(chosen)


def _following(taken: list[int], frames: int, step: int | None) -> int:
    """The frame one step after the last that is taken; at the end of the video the one after the first large gap."""
    if step is None:
        step = int(np.median(np.diff(taken))) if len(taken) > 1 else max(frames // 10, 1)
    if not taken:
        return 0
    if taken[-1] + 1 < frames:
        return min(taken[-1] + step, frames - 1)
    return _middle_of_largest_gap(taken, frames)


def _spread(scene: Scene, taken: list[int], inverse_depth: float) -> int:
    frames = len(scene.frames)
    if not taken:
        return frames // 4
    if len(taken) > 1:
        return _middle_of_largest_gap(taken, frames)
    first = taken[0]
    target = 3 * frames // 4 if first < frames / 2 else frames // 4
    # From there towards the first drawing, until the two have enough in common.
    for frame in range(target, first, -1 if target > first else 1):
        if overlap(scene.frames[first].camera, scene.frames[frame].camera, inverse_depth) >= MIN_OVERLAP:
            return frame
    return first + (1 if target > first else -1)


def _middle_of_largest_gap(taken: list[int], frames: int) -> int:
    """The frame farthest from all that are taken; the first of equals."""
    free = np.setdiff1d(np.arange(frames), taken)
    distance = np.abs(free[:, None] - np.array(taken)[None]).min(axis=1)
    return int(free[np.argmax(distance)])
