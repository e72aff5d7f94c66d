"""Which frames to annotate: sharp ones, that overlap and cover the path of the camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.overlap import at_inverse_depth, image_motion, share_seen
from gtlayout.importing.frame_extraction import sharpness
from gtlayout.io.pixels.images import read_bgr
from gtlayout.scene import FloatArray, Frame, Scene

if TYPE_CHECKING:
    import pycolmap

COUNT, MOST = 8, 12
"""So many, as the real clips have; more where neighbours would overlap too little."""
SECOND_OVERLAP = 0.6
"""The second frame shows at least so much of what the first shows: the planes of one are found again in the other."""
MIN_OVERLAP = 0.3
"""Neighbours that share less are not connected by what they show."""
WINDOW = 0.25
"""Of the way from one key frame to the next: so far from its place the sharpest frame is looked for."""
CANDIDATES = 9
"""At most so many are decoded for a place."""
STANDING = 1e-4
"""Share of the image that things move by, at least, from one frame to the next: a camera that stands moves on, too."""
ROOM_DEPTH_M = 2.5
"""How far away a room's surfaces are, where nothing says it."""
PATH_DEPTH = 2.0
"""… and where the unit is not known: so many times the median distance of the cameras from their middle."""
POINTS_ENOUGH = 20
"""With fewer points in a frame its overlap is that of its whole image."""


@dataclass(frozen=True)
class Choice:
    """A frame to annotate."""

    frame: int
    """Index into ``Scene.frames``."""
    shared: float | None
    """Share of what it shows that the one before shows, too; None for the first."""
    sharpest_of: int
    """Frames around its place that were compared."""


def choose_key_frames(scene: Scene, points_world: Mapping[str, FloatArray]) -> list[Choice]:
    """About eight frames of a scene, in order of the video; all where there are no more.

    Even along the path, which is measured by how far things move in the image from frame to frame; the second follows
    the first closely; each is the sharpest around its place. ``points_world``: (N, 3) points that a frame sees, by its
    name; what frames without have in common follows from poses, fields of view and a usual depth. Frames that cannot
    be read are not chosen.
    """
    frames, rho = scene.frames, _usual_inverse_depth(scene)

    def seen(index: int) -> tuple[FloatArray, float]:
        points = points_world.get(frames[index].name)
        if points is not None and len(points) >= POINTS_ENOUGH:
            return points, 1.0
        return at_inverse_depth(frames[index].camera, rho), rho

    @cache
    def share(a: int, b: int) -> float:
        points, scale = seen(a)
        return share_seen(points, frames[b].camera, scale)

    sharp = cache(lambda index: _sharpness(frames[index]))
    moved = []
    for before, after in pairwise(range(len(frames))):
        points, scale = seen(before)
        moved.append(image_motion(points, frames[before].camera, frames[after].camera, scale) + STANDING)
    path = np.concatenate([np.zeros(1), np.cumsum(moved)])
    chosen: list[Choice] = []
    for count in range(min(COUNT, len(path)), min(MOST, len(path)) + 1):
        chosen = _choose(path, count, share, sharp)
        if all(each.shared is None or each.shared >= MIN_OVERLAP for each in chosen):
            break
    return chosen


def _choose(
    path: FloatArray, count: int, share: Callable[[int, int], float], sharp: Callable[[int], float | None]
) -> list[Choice]:
    step = path[-1] / max(count - 1, 1)
    chosen = [each for each in [_best(path, 0.0, WINDOW * step, None, share, sharp)] if each]
    if not chosen or count == 1:
        return chosen
    first = chosen[0].frame
    furthest = _second(path, first, step, share)
    # So that the sharpest around it is no further on.
    reach = min(WINDOW * step, (furthest - path[first]) / 2)
    places = [(furthest - reach, reach)]
    places += [(float(place), WINDOW * step) for place in np.linspace(furthest, path[-1], count - 1)[1:]]
    for place, reach in places:
        best = _best(path, place, reach, chosen[-1].frame, share, sharp)
        chosen += [best] if best else []
    return chosen


def _best(
    path: FloatArray,
    place: float,
    reach: float,
    before: int | None,
    share: Callable[[int, int], float],
    sharp: Callable[[int], float | None],
) -> Choice | None:
    """The sharpest frame near a place on the path and after frame ``before``; None when none can be read."""
    distance = np.abs(path - place)
    order = [int(index) for index in np.argsort(distance, kind="stable") if before is None or index > before]
    near = [index for index in order if distance[index] <= reach][:CANDIDATES]
    found = [(value, -index) for index in near if (value := sharp(index)) is not None]
    if not found:
        found = [(value, -index) for index in order if (value := sharp(index)) is not None][:1]
    if not found:
        return None
    best = -max(found)[1]
    return Choice(best, None if before is None else share(best, before), len(found))


def _second(path: FloatArray, first: int, step: float, share: Callable[[int, int], float]) -> float:
    """How far on the second frame may be: as far as it still overlaps the first well, no further than evenly."""
    place = path[min(first + 1, len(path) - 1)]
    for index in range(first + 1, len(path)):
        if path[index] > path[first] + step or share(index, first) < SECOND_OVERLAP:
            break
        place = path[index]
    return float(place)


def _usual_inverse_depth(scene: Scene) -> float:
    if scene.metric:
        return 1 / ROOM_DEPTH_M
    centers = np.array([frame.camera.center_world for frame in scene.frames])
    radius = float(np.median(np.linalg.norm(centers - np.median(centers, axis=0), axis=1)))
    return 1 / (PATH_DEPTH * radius) if radius > 0 else 0.0


def _sharpness(frame: Frame) -> float | None:
    """None when the image cannot be read."""
    try:
        return sharpness(read_bgr(frame))
    except GtlayoutError:
        return None


def points_by_image(model: pycolmap.Reconstruction) -> dict[str, FloatArray]:
    """(N, 3) triangulated points that each image of a COLMAP model sees, by its name."""
    seen: dict[int, list[FloatArray]] = {image_id: [] for image_id in sorted(model.images)}
    for point_id in sorted(model.points3D):
        point = model.points3D[point_id]
        for image_id in sorted({element.image_id for element in point.track.elements}):
            seen[image_id].append(np.asarray(point.xyz, dtype=np.float64))
    return {model.images[i].name: np.array(points, dtype=np.float64).reshape(-1, 3) for i, points in seen.items()}
