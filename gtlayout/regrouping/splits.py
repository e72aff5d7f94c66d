"""Which instances are two planes: the tracks of their elements fall into two clusters that no single plane explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations

import numpy as np

from gtlayout.extent.config import ExtentConfig
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.rays import inverse_depth_on_plane
from gtlayout.instances import Instance, Members, Plane
from gtlayout.planes.evidence import prefer_visible
from gtlayout.prepared.measurements import Measurements
from gtlayout.regrouping.config import RegroupingConfig
from gtlayout.regrouping.on_plane import unproject_elements, visibility_votes
from gtlayout.scene import BoolArray, FloatArray, Scene
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks

_MOST_TRACKS = 100
"""Most tracks of an element that are used, evenly spread over them."""
_MOST_PAIRS = 60
"""Pairs of elements through which a single plane is tried."""
_ITERATIONS = 15
_SAME_SHARE = 1e-6
"""Overlaps that differ by less are equal."""


@dataclass(frozen=True)
class Split:
    """An instance that is two planes."""

    instance: int
    parts: tuple[Members, Members]


@dataclass(frozen=True)
class Cluster:
    """Tracks of an element, each a point at inverse depth ρ on a ray. The origin lies amid the cameras."""

    center: FloatArray
    """(N, 3) where the rays start."""
    ray: FloatArray
    """(N, 3) with z = 1 in the key frame's camera."""
    rho: FloatArray
    """(N,)."""
    sigma_rho: FloatArray
    """(N,) with the errors that all tracks of a key frame share."""

    def residuals(self, plane: FloatArray) -> FloatArray:
        """(N,) inverse depths minus those of the plane ``plane · X = -1``, in σ."""
        on_plane = inverse_depth_on_plane(1 + self.center @ plane, self.ray @ plane)
        residuals: FloatArray = (self.rho - on_plane) / self.sigma_rho
        return residuals

    def truncated_loss(self, plane: FloatArray, config: RegroupingConfig) -> float:
        """The share of the element that the plane leaves unexplained, in [0, 1]."""
        return float(np.mean(np.minimum((self.residuals(plane) / config.track_cutoff) ** 2, 1.0)))


def find_splits(
    measured: Measurements, planes: Sequence[Plane], config: RegroupingConfig, extent: ExtentConfig
) -> tuple[Split, ...]:
    """The instances whose tracks lie on two planes, where the annotations do not contradict a split.

    A key frame with a wrong pose, or a mirror, also puts tracks of one instance on two planes. But then a key frame
    that shows one part shows the same instance where the other part should be. That forbids the split.
    """
    scene, tracks, rays, instances = measured.scene, measured.tracks, measured.rays, measured.instances
    origin = np.mean([frame.camera.center_world for frame in scene.frames], axis=0)
    max_depth = extent.max_depth_ratio * median_depth(scene, instances, planes)
    used = prefer_visible(scene, tracks, measured.track_instance) >= 0
    splits = []
    for i, instance in enumerate(instances):
        clusters = {
            member: cluster
            for member in instance.members
            if len((cluster := cluster_of(tracks, rays, used, member, origin, config)).rho) >= config.min_tracks
        }
        two = two_planes(list(clusters.values()), config)
        if two is None:
            continue
        second, through = two
        sides = tuple(_plane(plane, origin) for plane in through)
        parts = tuple(
            tuple(member for member, on in zip(clusters, second, strict=True) if on == side) for side in (False, True)
        )
        if _are_two(scene, instances, planes, i, parts, sides, max_depth, config, extent):
            splits.append(Split(i, _with_the_others(scene, instance, parts, sides, max_depth, extent)))
    return tuple(splits)


def two_planes(clusters: Sequence[Cluster], config: RegroupingConfig) -> tuple[BoolArray, FloatArray] | None:
    """The best two planes through a few clusters of tracks, when one plane does not explain them.

    Every cluster counts the same, however many tracks it has: they share the errors of their key frame's camera.

    Returns:
        (C,) which clusters lie on the second plane, and (2, 3) the planes, ``plane · X = -1``; None when a single one
        explains them, or two do not.
    """
    if len(clusters) < 2:
        return None

    def lost(planes: Sequence[FloatArray]) -> FloatArray:
        return np.array([[cluster.truncated_loss(plane, config) for cluster in clusters] for plane in planes])

    if lost([fit(clusters, config)]).sum() < config.min_gain:
        return None
    starts = [fit([cluster], config) for cluster in clusters]
    alone = lost(starts)
    pairs = list(combinations(range(len(starts)), 2))
    p, q = min(pairs, key=lambda pair: float(np.minimum(alone[pair[0]], alone[pair[1]]).sum()))
    second: BoolArray = alone[q] < alone[p]
    if second.all() or not second.any():
        return None
    planes = [fit([clusters[c] for c in np.nonzero(second == side)[0].tolist()], config) for side in (False, True)]
    by_plane = lost(planes)
    own, foreign = np.where(second, by_plane[::-1], by_plane)
    single = [*starts, *planes, fit(clusters, config)]
    single += [fit([clusters[c] for c in pair], config) for pair in pairs[:: -(-len(pairs) // _MOST_PAIRS)]]
    gain = float(lost(single).sum(axis=1).min() - own.sum())
    if (
        own.max() > config.max_truncated_loss
        or min(foreign[second].mean(), foreign[~second].mean()) < config.min_loss_on_other
        or gain < config.min_gain
    ):
        return None
    return second, np.array(planes)


def fit(clusters: Sequence[Cluster], config: RegroupingConfig) -> FloatArray:
    """(3,) ``plane · X = -1`` through the tracks of some clusters, each with the same weight; Cauchy loss."""
    names = [field.name for field in fields(Cluster)]
    every = Cluster(*(np.concatenate([getattr(cluster, name) for cluster in clusters]) for name in names))
    share = np.concatenate([np.full(len(cluster.rho), 1 / len(cluster.rho)) for cluster in clusters])
    design = every.center * every.rho[:, None] + every.ray
    weight = share / every.sigma_rho**2
    plane: FloatArray = np.zeros(3)
    for _ in range(_ITERATIONS):
        root = np.sqrt(weight)
        plane = np.asarray(np.linalg.lstsq(root[:, None] * design, -root * every.rho)[0], dtype=np.float64)
        robust = 1 / (1 + (every.residuals(plane) / config.track_cauchy) ** 2)
        # The equation's residual is that of inverse depth times the clearance of the ray's start.
        clearance = np.maximum(np.abs(1 + every.center @ plane), 1e-6)
        weight = share * robust / (every.sigma_rho * clearance) ** 2
    return plane


def cluster_of(
    tracks: Tracks,
    rays: TriangulatedTracks,
    used: BoolArray,
    member: tuple[int, int],
    origin: FloatArray,
    config: RegroupingConfig,
) -> Cluster:
    """The tracks that were sampled on one element. No plane may run through the world point ``origin``."""
    index = np.nonzero(used & (tracks.key_frame == member[0]) & (tracks.element == member[1]))[0]
    index = index[np.linspace(0, len(index) - 1, min(len(index), _MOST_TRACKS)).round().astype(int)]
    rho = rays.rho[index]
    sigma = np.hypot(rays.sigma_rho[index], config.relative_depth_sigma * rho)
    return Cluster(rays.center[index] - origin, rays.ray[index], rho, sigma)


def _plane(plane: FloatArray, origin: FloatArray) -> Plane:
    """``plane · (X - origin) = -1`` as a plane of the world; its covariance is not known."""
    length = float(np.linalg.norm(plane))
    return Plane(plane / length, float(1 - plane @ origin) / length, np.full((4, 4), np.nan), observable=True)


def _are_two(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    index: int,
    parts: tuple[Members, ...],
    sides: tuple[Plane, ...],
    max_depth: float,
    config: RegroupingConfig,
    extent: ExtentConfig,
) -> bool:
    """Whether key frames that show one part mostly show something else where the other should be, and some do."""
    shown = []
    for part, other in ((0, 1), (1, 0)):
        points = unproject_elements(scene, parts[part], sides[part], max_depth, extent).points
        supposed = [*instances, replace(instances[index], members=parts[other])]
        supposed[index] = replace(instances[index], members=parts[part])
        on = [*planes, sides[other]]
        on[index] = sides[part]
        shown.append(visibility_votes(scene, supposed, on, len(instances), index, points, extent))
    return all(same <= config.max_shown_as_one * (same + else_) for same, else_ in shown) and any(
        else_ for _, else_ in shown
    )


def _with_the_others(
    scene: Scene,
    instance: Instance,
    parts: tuple[Members, ...],
    sides: tuple[Plane, ...],
    max_depth: float,
    extent: ExtentConfig,
) -> tuple[Members, Members]:
    """Both parts with the elements that have too few tracks. Each of these goes to the part that it overlaps more."""
    regions = [
        unproject_elements(scene, part, plane, max_depth, extent).region
        for part, plane in zip(parts, sides, strict=True)
    ]
    whole = [list(part) for part in parts]
    larger = int(len(parts[1]) > len(parts[0]))
    for member in instance.members:
        if member in parts[0] or member in parts[1]:
            continue
        overlap = []
        for plane, region in zip(sides, regions, strict=True):
            drawn = unproject_elements(scene, [member], plane, max_depth, extent).region
            overlap.append(drawn.intersection(region).area / drawn.area if drawn.area else 0.0)
        # An element that lies within both parts overlaps both equally, up to rounding.
        tied = abs(overlap[1] - overlap[0]) < _SAME_SHARE
        whole[larger if tied else int(overlap[1] > overlap[0])].append(member)
    return tuple(sorted(whole[0])), tuple(sorted(whole[1]))
