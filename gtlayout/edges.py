"""Stage 3: where the polygons of two instances run along each other, their planes meet (paper 3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import partial
from itertools import combinations

import numpy as np
import shapely
from shapely import LineString, MultiLineString
from shapely.geometry.base import BaseGeometry

from gtlayout.instances import Instance
from gtlayout.memory import Memory
from gtlayout.scene import SAME_BORDER_PX, Camera, Element, FloatArray, KeyFrame, Scene

_MOST_CANDIDATES = 64
"""Number of points of an edge whose pairs are tried as its line. All pairs of a long edge would be too many."""
_ROUNDING_PX = 1e-6
"""Corners are drawn on whole pixels, so lengths may be a whole number of steps up to rounding."""
_DECIMALS = 6
"""Of a pixel."""


@dataclass(frozen=True)
class EdgeConfig:
    """Stage 3. Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others."""

    max_gap_px: float = SAME_BORDER_PX
    """Two boundaries that are closer than this run along each other."""
    step_px: float = 4.0
    """Distance of the samples on a contact edge."""
    min_length_px: float = 20.0
    """Shorter contacts are not used: they do not determine a line."""
    straightness_px: float = 6.0
    """Points of a pair further than this from their common line are not part of the contact."""
    occlusion_px: float = 6.0
    """Boundaries this close to an annotated occlusion edge are not contacts."""
    border_px: float = 3.0
    """Boundaries this close to the image border are cut by the image, not by a neighbour."""


@dataclass(frozen=True)
class ContactEdge:
    """A piece of boundary in one key frame on which two instances touch in 3D."""

    key_frame: int
    instances: tuple[int, int]
    points_px: FloatArray
    """(N, 2) samples in order along it; a part that is hidden leaves a gap."""


def contact_edges(
    scene: Scene, instances: Sequence[Instance], config: EdgeConfig, memory: Memory | None = None
) -> tuple[ContactEdge, ...]:
    """All contact edges of all key frames, one per (key frame, pair of instances).

    Boundaries within reach of an occlusion edge or of the image border are left out, and pairs that only touch at a
    point. ``memory`` keeps those of each key frame.
    """
    memory, edges = memory or Memory(), []
    for k, key_frame in enumerate(scene.key_frames):
        members = {
            element: i for i, instance in enumerate(instances) for frame, element in instance.members if frame == k
        }
        camera = scene.frame_of(k).camera
        drawn = key_frame.elements, key_frame.occlusion_edges, camera.width, camera.height, config
        contacts = memory.of("contacts of a key frame", drawn, partial(_contacts, key_frame, camera, config))
        edges += [
            ContactEdge(k, (members[a], members[b]), points_px)
            for a, b, points_px in contacts
            if a in members and b in members
        ]
    return tuple(edges)


def touching_points(key_frame: KeyFrame, camera: Camera, elements: tuple[int, int], config: EdgeConfig) -> FloatArray:
    """(N, 2) samples of the border of two elements of a key frame, px, straight or not; ``config`` in its pixels."""
    first, second = (key_frame.elements[element] for element in elements)
    return _shared_boundary(first, second, _no_contact(key_frame, camera, config), config)


def _contacts(key_frame: KeyFrame, camera: Camera, config: EdgeConfig) -> list[tuple[int, int, FloatArray]]:
    """Two elements of a key frame and the (N, 2) samples of the line on which they touch, px, for all that do."""
    own = EdgeConfig(*(value * camera.annotation_scale for value in astuple(config)))
    excluded = _no_contact(key_frame, camera, own)
    found = []
    for a, b in combinations(range(len(key_frame.elements)), 2):
        points_px = _shared_boundary(key_frame.elements[a], key_frame.elements[b], excluded, own)
        points_px = _on_one_line(points_px, own.straightness_px)
        if len(points_px) >= own.min_length_px / own.step_px:
            found.append((a, b, points_px))
    return found


def _no_contact(key_frame: KeyFrame, camera: Camera, config: EdgeConfig) -> BaseGeometry:
    """The part of the image in which no boundary counts: round occlusion edges and along the image border."""
    border = shapely.box(0, 0, camera.width, camera.height).exterior.buffer(config.border_px)
    occluding = MultiLineString([LineString(line) for line in key_frame.occlusion_edges if len(line) > 1])
    return shapely.union(border, occluding.buffer(config.occlusion_px))


def _shared_boundary(a: Element, b: Element, excluded: BaseGeometry, config: EdgeConfig) -> FloatArray:
    """(N, 2) points midway between the two boundaries, where these run along each other."""
    boundary_a, boundary_b = a.amodal.boundary, b.amodal.boundary
    shapely.prepare(boundary_b)
    if not shapely.dwithin(boundary_b, boundary_a, config.max_gap_px):
        return np.empty((0, 2))
    near = boundary_a.intersection(boundary_b.buffer(config.max_gap_px)).difference(excluded)
    # Where boundaries only cross, the intersection holds single points too.
    lines = [part for part in shapely.get_parts(near) if part.geom_type == "LineString" and part.length > 0]
    pieces = shapely.get_parts(shapely.line_merge(MultiLineString(lines)))
    samples = [
        shapely.line_interpolate_point(line, np.arange(config.step_px / 2, line.length - _ROUNDING_PX, config.step_px))
        for line in pieces
        if line.length >= 2 * config.max_gap_px - _ROUNDING_PX
    ]
    if not samples:
        return np.empty((0, 2))
    points = np.concatenate(samples)
    # The two hands' lines differ by a pixel or two: the truth is as likely on either, so take the middle.
    opposite = shapely.line_interpolate_point(boundary_b, shapely.line_locate_point(boundary_b, points))
    middle: FloatArray = (shapely.get_coordinates(points) + shapely.get_coordinates(opposite)) / 2
    return middle


def _on_one_line(points_px: FloatArray, tolerance_px: float) -> FloatArray:
    """The points near the line that most of them share, in order along it: two planes meet in one line, and only there.

    Points elsewhere (the side of a cabinet in front of the floor) are an occlusion edge that nobody drew.
    """
    if len(points_px) < 3:
        return points_px
    candidates = points_px[:: -(-len(points_px) // _MOST_CANDIDATES)]
    first, second = np.triu_indices(len(candidates), k=1)
    along = candidates[second] - candidates[first]
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    offset = np.sum(normal * candidates[first], axis=1)
    distance = np.abs(points_px @ normal.T - offset)
    # Truncated absolute distance: the count decides, closeness breaks its ties.
    # Rounded: of the many lines through corners drawn on one line, the first is taken.
    best = np.argmin(np.minimum(distance, tolerance_px).sum(axis=0).round(_DECIMALS))
    kept: FloatArray = points_px[distance[:, best] < tolerance_px]
    return kept[np.argsort(kept @ along[best], kind="stable")]
