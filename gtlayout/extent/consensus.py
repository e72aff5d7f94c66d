"""The region that an instance covers, by a vote of the key frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.extent.config import ExtentConfig
from gtlayout.geometry.plane_image import clip_to_plane, inverse_depth, unproject
from gtlayout.geometry.polygons import cut, polygons
from gtlayout.instances import Instance, Member, Plane, PlaneFrame
from gtlayout.scene import BoolArray, Camera, FloatArray, Scene

_GRID_PX = 1e-9
_STRAIGHT_STEPS = 1e3
"""A corner so near to the line through its neighbours (some micrometres in a room) is none."""


@dataclass(frozen=True)
class Faces:
    """The faces into which the outlines of all K key frames cut a plane, and what each key frame says of them."""

    faces: npt.NDArray[np.object_]
    """(F,) polygons in the plane's frame."""
    seen: BoolArray
    """(K, F) whether a key frame shows the instance there."""
    contradicted: BoolArray
    """(K, F) whether it shows something else there, on or behind the plane."""
    grid: float
    """Step of the grid on which the faces lie, world unit."""

    def agreed(self) -> BaseGeometry:
        """The faces that belong to the instance, as one region on the grid."""
        # Joined first along the sides they share: a fraction of the time that all of them take on the grid.
        covered = shapely.coverage_union_all(self._covered(np.ones(len(self.seen), dtype=bool)))
        return shapely.union_all(covered, grid_size=self.grid)

    def agreed_without(self, key_frame: int) -> BaseGeometry:
        """The faces that belong to the instance when ``key_frame`` has no say, joined along the sides they share.

        That takes a tenth of the time, and is asked for every key frame.
        """
        return shapely.coverage_union_all(self._covered(np.arange(len(self.seen)) != key_frame))

    def by_weight(self, weights: FloatArray) -> BaseGeometry:
        """The faces that belong to the instance when key frames have (K,) weights, joined as above; 0 = no say."""
        votes, against = weights @ self.seen, weights @ self.contradicted
        return shapely.coverage_union_all(self.faces[(votes > 0) & (votes >= against)])

    def _covered(self, says: BoolArray) -> npt.NDArray[np.object_]:
        """The faces that the key frames in (K,) ``says`` give to the instance."""
        votes, against = self.seen[says].sum(axis=0), self.contradicted[says].sum(axis=0)
        return self.faces[(votes > 0) & (votes >= against)]


def faces_of(
    scene: Scene,
    instances: Sequence[Instance],
    index: int,
    planes: Sequence[Plane],
    frame: PlaneFrame,
    max_depth: float,
    grid: float,
    config: ExtentConfig,
) -> Faces:
    """The faces of an instance's plane, in its frame, on which key frames vote: some of them are what it covers.

    The paper takes the union of the polygons of all key frames, to which every error of a hand or a camera adds. Here
    the boundaries of all polygons cut the plane into faces. A face belongs to the instance unless more key frames see
    something else there, on or behind the plane, than see the instance. Something in front of the plane may hide the
    instance, and gives no vote; neither does an instance whose plane is unobservable, but for the host of an opening.
    """
    own = own_members(instances, index)
    seen: list[list[MultiPolygon]] = []
    contradicted: list[list[MultiPolygon]] = []
    for k, key_frame in enumerate(scene.key_frames):
        camera = scene.frame_of(k).camera
        mine = shapely.union_all([element.amodal for e, element in enumerate(key_frame.elements) if (k, e) in own])
        seen.append([lift(mine, planes[index], camera, frame, max_depth, config)])
        contradicted.append(contradicting(scene, instances, index, planes, k, frame, max_depth, config))
    if all(region.is_empty for (region,) in seen):
        none = np.zeros((len(seen), 0), dtype=bool)
        return Faces(np.empty(0, dtype=object), none, none, grid)
    # Two frames' boundaries may run on top of each other: on a grid they cross cleanly, and no face is lost.
    boundaries = [region.boundary for regions in seen + contradicted for region in regions]
    lines = shapely.union_all(boundaries, grid_size=grid)
    faces = shapely.get_parts(shapely.polygonize([lines]))
    inside = shapely.get_coordinates(shapely.point_on_surface(faces))
    return Faces(faces, _within(seen, inside), _within(contradicted, inside), grid)


def own_members(instances: Sequence[Instance], index: int) -> set[Member]:
    """The elements of an instance, and of the openings in it."""
    return {member for i, one in enumerate(instances) if index in (i, one.host) for member in one.members}


def contradicting(
    scene: Scene,
    instances: Sequence[Instance],
    index: int,
    planes: Sequence[Plane],
    key_frame: int,
    frame: PlaneFrame,
    max_depth: float,
    config: ExtentConfig,
) -> list[MultiPolygon]:
    """Where one key frame shows something else than an instance, on or behind its plane; in its frame."""
    plane, host, camera = planes[index], instances[index].host, scene.frame_of(key_frame).camera
    own = own_members(instances, index)
    elements = scene.key_frames[key_frame].elements
    mine = shapely.union_all([element.amodal for e, element in enumerate(elements) if (key_frame, e) in own])
    instance_of = {member: i for i, one in enumerate(instances) for member in one.members}
    nearest = inverse_depth(plane, camera) / (1 - config.occluder_margin)
    found = []
    for e, element in enumerate(elements):
        other = instance_of.get((key_frame, e))
        if other is None or (key_frame, e) in own or not (planes[other].observable or other == host):
            continue
        # On a fine grid, and repaired: neighbours drawn with the same corners leave needles that GEOS trips over.
        region = polygons(shapely.difference(element.amodal, mine, grid_size=_GRID_PX))
        if other != host and not region.is_empty:
            region = cut(region, nearest - inverse_depth(planes[other], camera))
        if not region.is_empty:
            found.append(lift(region, plane, camera, frame, max_depth, config))
    return found


def lift(
    region_px: BaseGeometry, plane: Plane, camera: Camera, frame: PlaneFrame, max_depth: float, config: ExtentConfig
) -> MultiPolygon:
    """An image region on the plane, in its frame."""
    clipped = clip_to_plane(region_px, plane, camera, max_depth, config.min_horizon_px)
    return polygons(shapely.transform(clipped, lambda px: frame.to_plane(unproject(px, plane, camera))))


def _within(by_key_frame: Sequence[Sequence[MultiPolygon]], points: FloatArray) -> BoolArray:
    """(K, N) whether any region of a key frame contains each point."""
    inside = np.zeros((len(by_key_frame), len(points)), dtype=bool)
    for k, regions in enumerate(by_key_frame):
        for region in regions:
            inside[k] |= shapely.contains_xy(region, points)
    return inside


def straight(geometry: BaseGeometry, grid: float) -> MultiPolygon:
    """The polygonal part of a geometry without corners on straight lines, its corners in an order of their own.

    Overlays leave such corners by chance. Without them the later steps get the same input on every processor.
    """
    return polygons(shapely.normalize(shapely.simplify(polygons(geometry), _STRAIGHT_STEPS * grid)))


def tidy(geometry: BaseGeometry, grid: float, config: ExtentConfig) -> MultiPolygon:
    """Without the tiny pieces and holes that hand-drawn neighbours leave."""
    parts = straight(geometry, grid)
    least = config.min_piece * parts.area
    return MultiPolygon(
        [
            Polygon(part.exterior, [hole for hole in part.interiors if Polygon(hole).area >= least])
            for part in parts.geoms
            if part.area >= least
        ]
    )
