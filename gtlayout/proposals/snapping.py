"""Edges of proposals moved to lines of the image: a suggestion, for planes place a line to a few pixels only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set

import cv2
import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.geometry.polygons import homogeneous
from gtlayout.proposals.config import SnapConfig
from gtlayout.proposals.outlines import GRID_PX, segments
from gtlayout.scene import Camera, FloatArray, ImageArray

Point = tuple[float, float]
Edge = tuple[Point, Point]
"""px, in order."""
_ON_BORDER_PX = 0.5
_HOLD = 1e-3
"""Weight of where a corner was, against the lines that should meet in it."""
_STRAIGHT = 0.05
"""Weight of an edge that was not moved, against those that were."""
_FARTHEST = 2.0
"""Corners go no further than so many times the reach of edges: lines that hardly cross do so anywhere."""


def image_lines(image: ImageArray) -> FloatArray:
    """(N, 2, 2) line segments of an (H, W, 3) BGR image by LSD (Grompone von Gioi and others, PAMI 2010), px."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    found = cv2.createLineSegmentDetector().detect(gray)[0]
    # OpenCV counts from the centre of the first pixel.
    return np.zeros((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(np.float64) + 0.5


def snap(
    outlines: Mapping[int, MultiPolygon],
    camera: Camera,
    lines: FloatArray,
    config: SnapConfig,
) -> dict[int, MultiPolygon]:
    """Move edges to the lines beside them, and corners to where their edges meet then. No corner comes or goes.

    Args:
        outlines: px, by instance; neighbours have the very same corners.
        camera: The edges on the border of its image stay there.
        lines: (N, 2, 2) of the image, px.
        config: How far an edge may move.
    """
    edges = sorted({_sorted(points) for region in outlines.values() for points in segments(region)})
    fixed = {edge for edge in edges if on_border(np.array(edge), camera)}
    beside = {edge: line_beside(np.array(edge), lines, config) for edge in edges if edge not in fixed}
    targets = {edge: line for edge, line in beside.items() if line is not None}
    while targets:
        corners = _corners(edges, fixed, targets, _FARTHEST * config.reach_px)
        moved = {i: _with_corners(region, corners) for i, region in outlines.items()}
        crossed = [i for i, region in moved.items() if not region.is_valid]
        if not crossed:
            return moved
        # An outline that would cross itself stays as it was; a neighbour's corner may still do it: then all stays.
        spoiled = {_sorted(points) for i in crossed for points in segments(outlines[i])}
        kept = {edge: line for edge, line in targets.items() if edge not in spoiled}
        targets = kept if len(kept) < len(targets) else {}
    return dict(outlines)


def on_border(points: FloatArray, camera: Camera, within_px: float = _ON_BORDER_PX) -> bool:
    """Whether an edge (N, 2) px runs along the border of the image."""
    distances = np.abs(np.column_stack([points, points - [camera.width, camera.height]]))
    return bool((distances.max(axis=0) <= within_px).any())


def line_beside(edge: FloatArray, lines: FloatArray, config: SnapConfig) -> FloatArray | None:
    """(3,) coefficients of the image's line beside an edge (2, 2), a x + b y + c = 0 with a unit normal; None = none.

    Segments in the direction of the edge that lie within reach are grouped by their distance from it. The group that
    covers most of the edge, and is near, wins, when it covers enough.
    """
    along = edge[1] - edge[0]
    length = float(np.hypot(*along))
    if length < config.min_length_px or len(lines) == 0:
        return None
    along = along / length
    normal = np.array([-along[1], along[0]])
    offset, place = (lines - edge[0]) @ normal, (lines - edge[0]) @ along
    step = lines[:, 1] - lines[:, 0]
    size = np.hypot(step[:, 0], step[:, 1])
    angle = np.arcsin(np.clip(np.abs(step @ normal) / np.maximum(size, 1e-9), 0, 1))
    first, last = np.clip(place.min(axis=1), 0, length), np.clip(place.max(axis=1), 0, length)
    near = (np.abs(offset).max(axis=1) <= config.reach_px) & (angle <= np.deg2rad(config.angle_deg))
    chosen = np.nonzero(near & (last > first))[0]
    middle = offset.mean(axis=1)
    best, best_score = None, 0.0
    for centre in chosen:
        group = chosen[np.abs(middle[chosen] - middle[centre]) <= config.group_px]
        covered = shapely.union_all([shapely.LineString([(first[g], 0), (last[g], 0)]) for g in group]).length / length
        distance = float(np.average(middle[group], weights=size[group])) / config.near_px
        score = covered * np.exp(-(distance**2) / 2)
        if covered >= config.min_coverage and score > best_score + 1e-9:
            best, best_score = group, score
    return None if best is None else _fitted(lines[best], size[best])


def _fitted(segments: FloatArray, weights: FloatArray) -> FloatArray:
    """The line through (N, 2, 2) segments, by least squares of their ends' distances, weighted by (N,)."""
    points, each = segments.reshape(-1, 2), np.repeat(weights, 2)
    centre = np.average(points, axis=0, weights=each)
    offset = points - centre
    _, vectors = np.linalg.eigh((offset * each[:, None]).T @ offset)
    return np.append(vectors[:, 0], -float(vectors[:, 0] @ centre))


def _corners(
    edges: Sequence[Edge],
    fixed: Set[Edge],
    targets: Mapping[Edge, FloatArray],
    furthest: float,
) -> dict[Point, Point]:
    """Where each corner goes: to where its lines meet, by weighted least squares of its distances from them."""
    by_corner: dict[Point, list[tuple[FloatArray, float]]] = {}
    touched: set[Point] = set()
    for edge in edges:
        line = targets.get(edge)
        weight = 1.0 if line is not None else 1 / _HOLD if edge in fixed else _STRAIGHT
        line = _through(edge) if line is None else line
        for corner in edge:
            by_corner.setdefault(corner, []).append((line, weight))
            if edge in targets:
                touched.add(corner)
    moved = {}
    for corner in touched:
        at = np.array(corner)
        lines, weights = map(np.array, zip(*by_corner[corner], strict=True))
        distance = homogeneous(at[None]) @ lines.T
        normals = lines[:, :2] * weights[:, None]
        step = -np.linalg.solve(lines[:, :2].T @ normals + _HOLD * np.eye(2), normals.T @ distance[0])
        if np.hypot(*step) <= furthest:
            x, y = np.round((at + step) / GRID_PX).tolist()
            moved[corner] = (x / round(1 / GRID_PX), y / round(1 / GRID_PX))
    return moved


def _through(edge: Edge) -> FloatArray:
    start, end = np.array(edge)
    along = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
    normal = np.array([-along[1], along[0]])
    return np.append(normal, -float(normal @ start))


def _sorted(points: FloatArray) -> Edge:
    """An edge (2, 2), the same from both of its sides."""
    first, second = sorted((float(x), float(y)) for x, y in points)
    return first, second


def _with_corners(region: MultiPolygon, corners: Mapping[Point, Point]) -> MultiPolygon:
    return shapely.transform(
        region, lambda points: np.array([corners.get((float(x), float(y)), (x, y)) for x, y in points])
    )
