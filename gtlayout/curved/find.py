"""Which walls are round: each is weighed, as a plane and as an upright cylinder, by its own evidence."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from gtlayout.curved.config import CurvedConfig
from gtlayout.curved.evidence import WallEvidence, evidence_of
from gtlayout.curved.fit import fit
from gtlayout.curved.profile import Profile, profile_of
from gtlayout.cylinder import CurvedWall, Cylinder
from gtlayout.edges import EdgeConfig
from gtlayout.geometry.depth import median_depth
from gtlayout.instances import Instance, Plane, PlaneFrame
from gtlayout.planes.evidence import prefer_visible
from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks

_LENGTHS_IN_DEPTH = 2.5
_INLIER = 3.0
"""Points further off, in multiples of the relief or a hundredth of their depth, say nothing of how far a wall goes."""
_ENDS = 0.01
"""Share of the points beyond each end of an arc: some are of the neighbours."""


def curved_walls(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    tracks: Tracks,
    rays: TriangulatedTracks,
    track_instance: IntArray,
    edges: EdgeConfig,
    config: CurvedConfig,
    drawn: Collection[int] = (),
    only: Collection[int] | None = None,
) -> tuple[CurvedWall, ...]:
    """The walls that are upright cylinders, by their index among the ``instances``; planes stay as they are solved.

    A wall ``drawn`` as curved is one if its evidence is likelier on a cylinder than on a plane by more than the price
    of one more variable (BIC). Others must gain ``config.min_gain``, and ``config.min_gain_each`` by their tracks and
    by their feet, each alone, and most of the feet must agree: furniture bends tracks, and a wall drawn through a
    corner bends its foot.

    Only some are looked at where ``only`` names them. Everything is in one world. Nothing is found where no floor or
    ceiling says what is upright.
    """
    up = _upright(instances, planes)
    unit = unit_of_length(scene, instances, planes)
    if up is None or not np.isfinite(unit):
        return ()
    track_instance = prefer_visible(scene, tracks, track_instance)
    found = []
    for index, instance in enumerate(instances):
        own = np.nonzero(track_instance == index)[0]
        asked = instance.label == "wall" and (only is None or index in only)
        if not asked or not planes[index].observable or len(own) < config.min_tracks:
            continue
        evidence = evidence_of(scene, instances, planes, index, rays, own, tracks.key_frame, edges, config)
        origin = np.median(evidence.points, axis=0)
        axes = np.vstack([PlaneFrame.across(up, origin).axes, up])
        least = () if index in drawn else (config.min_gain, config.min_gain_each)
        profile = profile_of(evidence.thinned(config.judged_tracks), origin, axes[:2], unit, config, *least)
        if profile is None or not _is_round(profile, index in drawn, config):
            continue
        cylinder = fit(evidence, planes, profile, origin, axes, unit, config)
        wall = _wall(index, cylinder, evidence, profile, unit, config)
        if np.rad2deg(wall.arc_rad[1] - wall.arc_rad[0]) >= config.min_arc_deg:
            found.append(wall)
    return tuple(found)


def unit_of_length(scene: Scene, instances: Sequence[Instance], planes: Sequence[Plane]) -> float:
    """The unit of ``CurvedConfig``, as in stage 4: a share of the median depth, about a metre in a room."""
    return median_depth(scene, instances, planes) / _LENGTHS_IN_DEPTH


def _upright(instances: Sequence[Instance], planes: Sequence[Plane]) -> FloatArray | None:
    """(3,) unit vector upwards: the normal of the floor, or against that of the ceiling, whichever is known best."""
    known = [
        (plane.sigma_normal_deg, index)
        for index, (instance, plane) in enumerate(zip(instances, planes, strict=True))
        if instance.label in ("floor", "ceiling") and plane.observable
    ]
    if not known:
        return None
    _, best = min(known)
    return planes[best].normal if instances[best].label == "floor" else -planes[best].normal


def _is_round(profile: Profile, drawn: bool, config: CurvedConfig) -> bool:
    gain = profile.gain_tracks + profile.gain_edges
    if drawn:
        return gain > profile.price
    each = min(profile.gain_tracks, profile.gain_edges)
    return gain > config.min_gain and each > config.min_gain_each and profile.bent_feet >= config.min_bent_feet


def _wall(
    index: int, cylinder: Cylinder, evidence: WallEvidence, profile: Profile, unit: float, config: CurvedConfig
) -> CurvedWall:
    points = np.concatenate([evidence.points, *(foot.points for foot in evidence.feet)])
    angles, heights, off = cylinder.unrolled(points)
    near = np.abs(off) < _INLIER * np.maximum(config.sigma_relief * unit, 0.01 * np.median(evidence.depth))
    tracks_near = near[: len(evidence.points)]
    centre, axis = cylinder.axis_point_world, cylinder.axes
    outwards = (evidence.points - centre) @ axis[:2].T
    facing = np.sum(outwards * (evidence.rays @ axis[:2].T), axis=1)
    return CurvedWall(
        instance=index,
        cylinder=cylinder,
        arc_rad=_arc(angles[near]),
        height=(float(heights[near].min()), float(heights[near].max())) if near.any() else (0.0, 0.0),
        concave=bool(np.median(facing[tracks_near]) > 0) if tracks_near.any() else True,
        gain_tracks=profile.gain_tracks,
        gain_edges=profile.gain_edges,
    )


def _arc(angles: FloatArray) -> tuple[float, float]:
    """Between which angles some lie, but for a few at the ends: from the end of the widest gap to its beginning."""
    if len(angles) < 2:
        return 0.0, 0.0
    ordered = np.sort(angles)
    gaps = np.diff(ordered, append=ordered[0] + 2 * np.pi)
    first = (int(np.argmax(gaps)) + 1) % len(ordered)
    onwards = np.unwrap(np.roll(ordered, -first))
    low, high = np.quantile(onwards, [_ENDS, 1 - _ENDS])
    return float(low), float(high)
