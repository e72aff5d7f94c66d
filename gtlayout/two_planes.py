"""Which instances are two planes: the tracks of their drawings fall into two clusters that no single plane explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from gtlayout.config import ExtentConfig, RegroupingConfig
from gtlayout.drawings import draw_on, shown_there
from gtlayout.evidence import prefer_visible
from gtlayout.extent import median_depth
from gtlayout.layout import Instance, Plane
from gtlayout.scene import BoolArray, FloatArray, IntArray, Scene
from gtlayout.tracking import Tracks
from gtlayout.triangulation import Rays

_MOST_TRACKS = 100
"""Tracks of a drawing that are looked at, evenly spread over them."""
_MOST_PAIRS = 60
"""Pairs of drawings through which a single plane is tried."""
_ITERATIONS = 15

Members = tuple[tuple[int, int], ...]
"""(key frame, element) pairs."""


@dataclass(frozen=True)
class Split:
    """An instance that is two planes."""

    instance: int
    parts: tuple[Members, Members]
    gain: float
    """How many drawings the best single plane leaves unexplained and two planes do not."""


@dataclass(frozen=True)
class Cluster:
    """The tracks of one drawing."""

    rays: Rays
    sigma_rho: FloatArray
    """(N,) with what all tracks of a key frame share."""

    def lost(self, plane: FloatArray, config: RegroupingConfig) -> float:
        """How much of the drawing ``plane · X = -1`` leaves unexplained, in [0, 1]."""
        return float(np.mean(np.minimum((_residuals(self.rays, self.sigma_rho, plane) / config.track_cutoff) ** 2, 1)))


def find_splits(
    scene: Scene,
    tracks: Tracks,
    rays: Rays,
    track_instance: IntArray,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    config: RegroupingConfig,
    extent: ExtentConfig,
) -> tuple[Split, ...]:
    """The instances whose tracks lie on two planes, where the annotations do not say that these are one surface.

    A key frame with a wrong pose, and a mirror, put tracks of one surface on two planes as well. But then a key frame
    that shows one part shows the same where the other part should be: that forbids the split.
    """
    origin = np.mean([frame.camera.center_world for frame in scene.frames], axis=0)
    max_depth = extent.max_depth_ratio * median_depth(scene, instances, planes)
    used = prefer_visible(scene, tracks, track_instance) >= 0
    splits = []
    for i, instance in enumerate(instances):
        clusters = {
            member: cluster
            for member in instance.members
            if len((cluster := cluster_of(tracks, rays, used, member, origin, config)).sigma_rho) >= config.min_tracks
        }
        two = two_planes(list(clusters.values()), config)
        if two is None:
            continue
        second, through, gain = two
        sides = tuple(_plane(plane, origin) for plane in through)
        parts = tuple(
            tuple(member for member, on in zip(clusters, second, strict=True) if on == side) for side in (False, True)
        )
        if _are_two(scene, instances, planes, i, parts, sides, max_depth, config, extent):
            splits.append(Split(i, _with_the_others(scene, instance, parts, sides, max_depth, extent), gain))
    return tuple(splits)


def two_planes(clusters: Sequence[Cluster], config: RegroupingConfig) -> tuple[BoolArray, FloatArray, float] | None:
    """The best two planes through a few clusters of tracks, when one will not do.

    Every cluster counts the same, however many tracks it has: they share the errors of their key frame's camera.

    Returns:
        (C,) which clusters lie on the second plane, (2, 3) the planes, ``plane · X = -1``, and how many clusters more
        than the best single plane they explain; None when a single plane will do, or two will not.
    """
    if len(clusters) < 2:
        return None

    def lost(planes: Sequence[FloatArray]) -> FloatArray:
        return np.array([[cluster.lost(plane, config) for cluster in clusters] for plane in planes])

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
        own.max() > config.max_lost
        or min(foreign[second].mean(), foreign[~second].mean()) < config.min_lost_on_other
        or gain < config.min_gain
    ):
        return None
    return second, np.array(planes), gain


def fit(clusters: Sequence[Cluster], config: RegroupingConfig) -> FloatArray:
    """(3,) ``plane · X = -1`` through the tracks of some clusters, each with the same weight; Cauchy loss."""
    rays = Rays(
        *(
            np.concatenate([getattr(cluster.rays, name) for cluster in clusters])
            for name in ("center", "ray", "key_px", "rho", "sigma_rho", "parallax_sigmas")
        )
    )
    sigma = np.concatenate([cluster.sigma_rho for cluster in clusters])
    share = np.concatenate([np.full(len(cluster.sigma_rho), 1 / len(cluster.sigma_rho)) for cluster in clusters])
    design = rays.center * rays.rho[:, None] + rays.ray
    weight = share / sigma**2
    plane = np.zeros(3)
    for _ in range(_ITERATIONS):
        root = np.sqrt(weight)
        plane = np.linalg.lstsq(root[:, None] * design, -root * rays.rho, rcond=None)[0]
        robust = 1 / (1 + (_residuals(rays, sigma, plane) / config.track_cauchy) ** 2)
        # The equation's residual is that of inverse depth times the clearance of the ray's start.
        weight = share * robust / (sigma * np.maximum(np.abs(1 + rays.center @ plane), 1e-6)) ** 2
    return plane


def _residuals(rays: Rays, sigma_rho: FloatArray, plane: FloatArray) -> FloatArray:
    """(N,) inverse depths minus those of the plane ``plane · X = -1``, in σ."""
    clearance = 1 + rays.center @ plane
    on_plane = -(rays.ray @ plane) / np.where(np.abs(clearance) < 1e-9, 1e-9, clearance)
    residuals: FloatArray = (rays.rho - on_plane) / sigma_rho
    return residuals


def cluster_of(
    tracks: Tracks, rays: Rays, used: BoolArray, member: tuple[int, int], origin: FloatArray, config: RegroupingConfig
) -> Cluster:
    """The tracks that were sampled on one drawing, seen from an origin amid the cameras: no plane runs through it."""
    index = np.nonzero(used & (tracks.key_frame == member[0]) & (tracks.element == member[1]))[0]
    index = index[np.linspace(0, len(index) - 1, min(len(index), _MOST_TRACKS)).round().astype(int)]
    own = Rays(
        center=rays.center[index] - origin,
        ray=rays.ray[index],
        key_px=rays.key_px[index],
        rho=rays.rho[index],
        sigma_rho=rays.sigma_rho[index],
        parallax_sigmas=rays.parallax_sigmas[index],
    )
    return Cluster(own, np.hypot(own.sigma_rho, config.relative_depth_sigma * own.rho))


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
    """Whether key frames that show one part show something else where the other should be, and never the same."""
    shown = []
    for part, other in ((0, 1), (1, 0)):
        points = draw_on(scene, parts[part], sides[part], max_depth, extent).points
        supposed = [*instances, replace(instances[index], members=parts[other])]
        supposed[index] = replace(instances[index], members=parts[part])
        on = [*planes, sides[other]]
        on[index] = sides[part]
        shown.append(shown_there(scene, supposed, on, len(instances), index, points, extent))
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
    """Both parts with the drawings that have too few tracks to tell: each goes where it overlaps what is there more."""
    regions = [draw_on(scene, part, plane, max_depth, extent).region for part, plane in zip(parts, sides, strict=True)]
    whole = [list(part) for part in parts]
    larger = int(len(parts[1]) > len(parts[0]))
    for member in instance.members:
        if member in parts[0] or member in parts[1]:
            continue
        overlap = []
        for plane, region in zip(sides, regions, strict=True):
            drawn = draw_on(scene, [member], plane, max_depth, extent).region
            overlap.append(drawn.intersection(region).area / drawn.area if drawn.area else 0.0)
        whole[larger if overlap[0] == overlap[1] else int(overlap[1] > overlap[0])].append(member)
    return tuple(sorted(whole[0])), tuple(sorted(whole[1]))
