"""Instances and what is found of each: plane with uncertainty, extent, mesh, dimensions. Plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.accuracy import Accuracy
from gtlayout.scene import FloatArray, IntArray, Label

Member = tuple[int, int]
"""(key frame index, element index)."""
Members = tuple[Member, ...]


@dataclass(frozen=True)
class Instance:
    """One physical wall, floor, ceiling, slanted surface, door or window, with all elements that show it."""

    name: str
    """``wall_0``, ``floor_0`` …: label and a running number, unique in the layout."""
    label: Label
    members: Members
    """At most one per key frame."""
    host: int | None = None
    """For doors and windows: index of the instance whose plane they lie in; None when they have none."""


EvidenceKind = Literal["", "tracks", "contact edges", "right angles", "priors"]


@dataclass(frozen=True)
class Support:
    """What a plane is solved from, in figures. It shows why a plane is weak."""

    tracks: int = 0
    """Point tracks that took part."""
    survived: float = np.nan
    """Share of the points sampled on it that could be followed; NaN when none was sampled."""
    parallax_deg: float = np.nan
    """Median over its tracks of the largest angle between two rays to the point; NaN without tracks."""
    outvoted: float = np.nan
    """Share of its tracks that lie off the plane and have lost their weight; NaN without tracks or plane."""
    contact_edges: int = 0
    """Contact edges with other placed planes, counted in each key frame."""
    edge_px: float = np.nan
    """Median distance of its contact edges, as drawn, from the lines in which the planes meet; NaN without edges."""
    dominant_evidence: EvidenceKind = ""
    """The weakest kind of evidence without which the plane would be unknown; if there is none, the kind whose loss
    would hurt most. Empty when the plane is not placed."""


def propagated_sigma(gradient: FloatArray, covariance: FloatArray) -> FloatArray:
    """(...) σ of what has (..., n) ``gradient`` by variables with (n, n) ``covariance``: √(gᵀ C g)."""
    variance = np.einsum("...a,ab,...b->...", gradient, covariance, gradient)
    # Rounding can make the variance of what is known exactly negative.
    return np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class Plane:
    """``normal · X + d = 0`` in the world, normal turned towards the cameras."""

    normal: FloatArray
    """(3,) unit normal."""
    d: float
    covariance: FloatArray
    """(4, 4) covariance of (normal, normal · anchor + d) in the world frame; rank 3. With the usual anchor that is
    (normal, d)."""
    observable: bool
    """False when nothing but priors determines the plane: its numbers then mean nothing."""
    note: str = ""
    """Why the plane is unobservable, in words; empty when it is not."""
    support: Support = Support()
    """What it is solved from."""
    sigma_depth_m: float = np.nan
    """σ of its depth at the centroid of its largest element, metres; NaN where it is not known, and in scenes that are
    not metric (``sigma_depth`` gives it in the world's unit)."""
    anchor: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) world point that the covariance refers to: the world's origin, unless that is so far from the cameras that d
    would lose the digits that σ is made of."""

    @property
    def covariance_world(self) -> FloatArray:
        """(4, 4) covariance of (normal, d) itself."""
        from_anchor = np.eye(4)
        from_anchor[3, :3] = -self.anchor
        return from_anchor @ self.covariance @ from_anchor.T

    @property
    def sigma_normal_deg(self) -> float:
        """σ of the normal's direction, degrees: the larger of its two principal axes; NaN when nothing is known."""
        if not np.isfinite(self.covariance).all():
            return np.nan
        return float(np.rad2deg(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1])))

    def sigma_offset(self, points_world: FloatArray) -> FloatArray:
        """(...) σ of the plane's position along its normal at points (..., 3) on it, world unit."""
        gradient = np.concatenate([points_world - self.anchor, np.ones((*points_world.shape[:-1], 1))], axis=-1)
        return propagated_sigma(gradient, self.covariance)

    def sigma_depth(self, points_world: FloatArray, rays_world: FloatArray) -> FloatArray:
        """(...) σ of the depths at which the plane is hit by rays through points (..., 3) on it.

        ``rays_world`` (..., 3) have z = 1 in the camera, so the result is along the camera's z, world unit.
        """
        return self.sigma_offset(points_world) / np.abs(rays_world @ self.normal)


ContactOffsets = Mapping[tuple[int, int], FloatArray]
"""For pairs of touching instances the (3,) offset, world unit, of the line drawn between them from that in which their
planes meet."""


@dataclass(frozen=True)
class PlaneFrame:
    """A right-handed 2D frame on a plane: ``X = origin + u e_u + v e_v``, ``e_u × e_v = normal``."""

    origin: FloatArray
    """(3,) a point on the plane."""
    axes: FloatArray
    """(2, 3) unit vectors e_u and e_v."""

    @classmethod
    def across(cls, normal: FloatArray, origin: FloatArray) -> PlaneFrame:
        """A frame on the plane through ``origin`` with that unit normal."""
        # Rounded: the frame of a floor must not turn by 90° with the sign of a value that is zero up to rounding.
        e_u = np.cross(np.eye(3)[np.argmin(np.abs(normal).round(9))], normal)
        e_u /= np.linalg.norm(e_u)
        return cls(origin, np.stack([e_u, np.cross(normal, e_u)]))

    def to_world(self, points_uv: FloatArray) -> FloatArray:
        """(N, 2) → (N, 3)."""
        return self.origin + points_uv @ self.axes

    def to_plane(self, points_world: FloatArray) -> FloatArray:
        """(N, 3) → (N, 2): orthogonal projection."""
        return (points_world - self.origin) @ self.axes.T

    def rings_to_world(self, region: MultiPolygon) -> list[list[FloatArray]]:
        """Per polygon its outer ring and its holes as (N, 3) world points, without the repeated last point."""
        return [
            [self.to_world(shapely.get_coordinates(ring)[:-1]) for ring in (polygon.exterior, *polygon.interiors)]
            for polygon in region.geoms
        ]

    def region(self, rings_world: Sequence[Sequence[FloatArray]]) -> MultiPolygon:
        """The inverse of ``rings_to_world``; rings beside the plane are projected on it orthogonally."""
        return MultiPolygon(
            [Polygon(outer, holes) for outer, *holes in ([self.to_plane(r) for r in rings] for rings in rings_world)]
        )


@dataclass(frozen=True)
class Extent:
    """The finite part of a plane that an instance covers."""

    frame: PlaneFrame
    region: MultiPolygon
    """In ``frame``'s coordinates, world unit; may be empty."""
    unrefined: MultiPolygon
    """The same before refinement: what the key frames' unprojected elements agree on, by vote."""
    unknown_area: float = 0.0
    """Area that is drawn where the depth is not known, and is left out; square world units."""


@dataclass(frozen=True)
class Mesh:
    """Labelled triangles. Vertices are shared along contact edges."""

    vertices: FloatArray
    """(V, 3) world."""
    faces: IntArray
    """(F, 3) indices, counter-clockwise seen from the cameras."""
    face_instance: IntArray
    """(F,) index of the instance each triangle belongs to."""

    @classmethod
    def empty(cls) -> Mesh:
        """No triangles."""
        return cls(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64))


DimensionKind = Literal["height", "width", "opening width", "opening height", "sill"]


@dataclass(frozen=True)
class Dimension:
    """A length in the room: of two instances that face each other, or of a door or window."""

    first: int
    """Index of an instance: the floor, of a height or a sill; the door or window, of its own width and height."""
    second: int
    """Index of the instance opposite; the window, of a sill; the same as ``first`` of a width or height of its own."""
    kind: DimensionKind
    """Floor to ceiling, wall to wall, of a door or window, or of a window's lower edge over the floor."""
    length: float
    """World unit."""
    sigma: float
    """σ of the length, world unit; from the joint covariance of all planes, and what drawing leaves."""
    ends_world: FloatArray
    """(2, 3) where it is measured: a point on each."""
    accuracy: Accuracy | None = None
    """Its level of accuracy; None where nobody asked."""


@dataclass(frozen=True)
class NextMeasurement:
    """The dimension to measure by hand next."""

    dimension: int
    """Index of the dimension."""
    within: int
    """Dimensions that are as accurate as wanted now."""
    reached: int
    """… and would be then. Both are 0 where the scene has no unit yet, which the measurement gives it."""
    of: int
    """Dimensions in all."""


QuantityKind = Literal["floor area", "net wall area", "volume"]


@dataclass(frozen=True)
class Quantity:
    """An area or a volume."""

    kind: QuantityKind
    """Wall area is without doors and windows; volume is floor area times the height to the ceiling."""
    instances: tuple[int, ...]
    """Indices of the floors or walls that it is of; of a volume the floor and its ceiling."""
    amount: float
    """World units, squared or cubed. Of what was seen."""
    sigma: float
    """Its σ, in the same unit."""
    closed: bool
    """Whether the outline ends at other surfaces all around; if not, the amount is of what was seen, and at least so
    much."""
