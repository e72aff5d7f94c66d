"""The metric scale from one measured distance: two points of the room, marked in several frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.importing.metric_scale import Scale
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.files import read_json
from gtlayout.io.image_names import NameIndex
from gtlayout.scene import Camera, FloatArray, Frame, Scene

SIGMA_MARK_PX = 1.0
"""σ of a mark."""
MAX_RESIDUAL_PX = 5.0
"""A mark that is further from where the others place the point is of another point."""
MIN_ANGLE_DEG = 2.0
"""Between the two most different rays to a point; below, its depth is not determined."""
MAX_SIGMA_SHARE = 0.1
"""A scale with a larger σ does not make a scene metric."""
MAX_METRES = 1000.0
STEPS = 20
FORM = '{"metres": 2.03, "points": [{"IMAGE": [x, y], "IMAGE": [x, y]}, {…}]}'


@dataclass(frozen=True)
class _Mark:
    frame: str
    camera: Camera
    px: FloatArray
    """(2,) in the pinhole image."""


def scale_from_distance(scene: Scene, path: Path) -> Scale:
    """The scale at which two points are as far apart as the file ``path`` says.

    The file is ``{"metres": 2.03, "points": [{"a.jpg": [x, y], "b.jpg": [x, y]}, {…}]}``: per point its pixels in two
    or more frames, in the image as a viewer shows it, (0, 0) the top-left corner of the top-left pixel. σ follows
    from marks good to 1 px. Raises GtlayoutError naming file, point and frame when the content is not valid, the
    frames see a point from nearly the same place, the marks of a point disagree, or the scale would be known to less
    than 10 %.
    """
    data = read_json(path)
    metres, points = data.get("metres"), data.get("points")
    if not isinstance(metres, int | float) or isinstance(metres, bool) or not 0 < metres <= MAX_METRES:
        raise GtlayoutError(f"{path}: metres must be a positive number up to {MAX_METRES:.0f}, not {metres!r}")
    if not isinstance(points, list) or len(points) != 2:
        raise GtlayoutError(f"{path}: points must be a list of two: {FORM}")
    names = NameIndex([frame.name for frame in scene.frames])
    (first, cov_first), (second, cov_second) = (
        _triangulated(_marks(point, scene.frames, names, f"{path}, point {i}"), f"{path}, point {i}")
        for i, point in enumerate(points, start=1)
    )
    between = second - first
    distance = float(np.linalg.norm(between))
    sigma = math.sqrt(float(between @ (cov_first + cov_second) @ between)) / distance if distance > 0 else math.inf
    if sigma > MAX_SIGMA_SHARE * distance:
        raise GtlayoutError(
            f"{path}: the points' distance is {distance:.3g} ± {sigma:.3g} units of the scene, too uncertain; "
            "take points further apart, and mark them in frames from more different places"
        )
    return Scale(metres / distance, sigma / distance, f"a known distance of {metres:g} m")


def _marks(point: Any, frames: Sequence[Frame], names: NameIndex, where: str) -> list[_Mark]:
    if not isinstance(point, dict) or len(point) < 2:
        raise GtlayoutError(f"{where} must be marked in two or more frames: {FORM}")
    marks = []
    for name, value in point.items():
        match = names.find(name)
        if match is None or len(match.places) > 1:
            no = "no frame" if match is None else "more than one frame"
            raise GtlayoutError(f"{where}: {no} {name} in the scene; its frames are called {frames[0].name} and so on")
        frame = frames[match.places[0]]
        if not isinstance(value, list) or len(value) != 2 or not all(map(_is_number, value)):
            raise GtlayoutError(f"{where}, frame {name}: must be [x, y] in pixels, not {value!r}")
        lens = frame.undistort if isinstance(frame.undistort, Undistortion | Upright) else None
        image = lens or frame.camera
        width, height = image.shown_size if isinstance(image, Upright) else (image.width, image.height)
        if not (0 <= value[0] <= width and 0 <= value[1] <= height):
            raise GtlayoutError(f"{where}, frame {name}: {value} lies off its {width}x{height} px")
        marked = np.array([value], dtype=np.float64)
        if isinstance(lens, Upright):
            marked = lens.from_shown(marked)
        px = (lens.points(marked) if lens else marked)[0]
        if not np.all(np.isfinite(px)):
            raise GtlayoutError(f"{where}, frame {name}: the lens model has no inverse at {value}")
        marks.append(_Mark(name, frame.camera, px))
    return marks


def _triangulated(marks: list[_Mark], where: str) -> tuple[FloatArray, FloatArray]:
    """(3,) the world point with the least squared reprojection error, and its (3, 3) covariance for 1 px."""
    rays = np.array([mark.camera.rays_world(mark.px[None])[0] for mark in marks])
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    cosine = min(float(a @ b) for a, b in combinations(directions, 2))
    angle_deg = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
    centers = np.array([mark.camera.center_world for mark in marks])
    # The point nearest to all rays; the projector onto what is across a ray is I - d dᵀ.
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    point = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, centers), rcond=None)[0]
    if angle_deg < MIN_ANGLE_DEG:
        raise GtlayoutError(
            f"{where}: its frames see it from directions only {angle_deg:.1f}° apart; "
            "mark it in frames from more different places"
        )
    for _ in range(STEPS):
        residual, jacobian = _reprojection(marks, point)
        point = point - np.linalg.lstsq(jacobian, residual.ravel(), rcond=None)[0]
    residual, jacobian = _reprojection(marks, point)
    errors_px = np.linalg.norm(residual, axis=1)
    worst = int(np.argmax(errors_px)) if np.all(np.isfinite(errors_px)) else 0
    depths = [float(mark.camera.project(point[None])[1][0]) for mark in marks]
    if not errors_px[worst] <= MAX_RESIDUAL_PX or min(depths) <= 0:
        raise GtlayoutError(
            f"{where}: its marks are not of one point, worst in frame {marks[worst].frame} "
            f"({errors_px[worst]:.1f} px off); mark the same point in every frame"
        )
    return point, np.asarray(SIGMA_MARK_PX**2 * np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)


def _reprojection(marks: list[_Mark], point_world: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, 2) projected minus marked, px, and its (2N, 3) derivative."""
    residuals, jacobians = [], []
    for mark in marks:
        camera = mark.camera
        M = camera.K @ camera.R_cam_from_world
        x, y, z = M @ point_world + camera.K @ camera.t_cam_from_world
        residuals.append(np.array([x / z, y / z]) - mark.px)
        jacobians.append((M[:2] - np.outer([x / z, y / z], M[2])) / z)
    return np.array(residuals), np.concatenate(jacobians)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < math.inf
