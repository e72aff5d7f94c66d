"""Which instances are one plane: their planes agree within their covariance, and no annotation contradicts it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely

from gtlayout.extent.config import ExtentConfig
from gtlayout.geometry.depth import median_depth
from gtlayout.instances import Instance, PlaneFrame, propagated_sigma
from gtlayout.planes.estimate import Estimate
from gtlayout.regrouping.config import RegroupingConfig
from gtlayout.regrouping.on_plane import UnprojectedElements, unproject_elements, visibility_votes
from gtlayout.scene import OPENINGS, FloatArray, Label, Scene


@dataclass(frozen=True)
class Join:
    """Two instances that are one plane."""

    instances: tuple[int, int]
    chi2: float
    """Squared difference of the two planes in its own σ; 3 degrees of freedom."""


@dataclass(frozen=True)
class Difference:
    """One plane minus another."""

    coefficients: FloatArray
    """(4,) of (normal, d)."""
    covariance: FloatArray
    """(4, 4)."""
    chi2: float
    """Squared, in its own σ; 3 degrees of freedom. NaN when one of the planes has no covariance."""

    def at(self, points_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(P,) distance of the two planes at (P, 3) points of one of them, along the normal, and its σ."""
        homogeneous = np.column_stack([points_world, np.ones(len(points_world))])
        return homogeneous @ self.coefficients, propagated_sigma(homogeneous, self.covariance)


def plane_difference(solved: Estimate, pair: tuple[int, int]) -> Difference:
    """The difference of two planes by their joint covariance, in which the errors they share cancel."""
    a, b = (solved.planes[i] for i in pair)
    (aa, ab), (ba, bb) = [[solved.covariance[4 * i : 4 * i + 4, 4 * j : 4 * j + 4] for j in pair] for i in pair]
    covariance = aa + bb - ab - ba
    coefficients = np.append(a.normal - b.normal, a.d - b.d)
    # Unit normals differ across the normal only: two angles and the offset are left.
    tangent = np.eye(4)[1:]
    tangent[:2, :3], tangent[:2, 3] = PlaneFrame.across(a.normal, a.normal).axes, 0.0
    reduced, difference = tangent @ covariance @ tangent.T, tangent @ coefficients
    known = bool(np.isfinite(reduced).all())
    chi2 = float(difference @ np.linalg.solve(reduced, difference)) if known else np.nan
    return Difference(coefficients, covariance, chi2)


def find_joins(
    scene: Scene, instances: Sequence[Instance], solved: Estimate, config: RegroupingConfig, extent: ExtentConfig
) -> tuple[Join, ...]:
    """The pairs to join, the most certain first. Each instance is in at most one of them."""
    max_depth = extent.max_depth_ratio * median_depth(scene, instances, solved.planes)
    found = []
    for pair in combinations(range(len(instances)), 2):
        if _allowed(*(instances[i] for i in pair)) and all(solved.planes[i].observable for i in pair):
            difference = plane_difference(solved, pair)
            if _one_plane(scene, instances, solved, pair, difference, max_depth, config, extent):
                found.append(Join(pair, difference.chi2))
    joins: list[Join] = []
    for join in sorted(found, key=lambda join: (join.chi2, join.instances)):
        if not any(set(join.instances) & set(other.instances) for other in joins):
            joins.append(join)
    return tuple(joins)


def _allowed(a: Instance, b: Instance) -> bool:
    """Whether two instances may be one. Two elements of one key frame are always two instances."""
    return a.label == b.label and a.host == b.host and not {k for k, _ in a.members} & {k for k, _ in b.members}


def _one_plane(
    scene: Scene,
    instances: Sequence[Instance],
    solved: Estimate,
    pair: tuple[int, int],
    difference: Difference,
    max_depth: float,
    config: RegroupingConfig,
    extent: ExtentConfig,
) -> bool:
    a, b = (solved.planes[i] for i in pair)
    angle_deg = np.rad2deg(np.arccos(np.clip(a.normal @ b.normal, -1.0, 1.0)))
    if not difference.chi2 <= config.max_chi2 or angle_deg > config.max_angle_deg:
        return False
    common = a if a.support.tracks >= b.support.tracks else b
    drawn = [unproject_elements(scene, instances[i].members, common, max_depth, extent) for i in pair]
    if any(one.region.is_empty for one in drawn):
        return False
    gap, sigma = difference.at(np.concatenate([one.points for one in drawn]))
    depth = np.concatenate([one.depth for one in drawn])
    # With a large σ every difference is within σ, and σ may be too large.
    if np.median(sigma / depth) > config.max_sigma_share or np.median(np.abs(gap) / depth) > config.max_gap_share:
        return False
    if not _continue_each_other(drawn[0], drawn[1], instances[pair[0]].label, config):
        return False
    for i, j, there in zip(pair, pair[::-1], drawn[::-1], strict=True):
        same, contradicted = visibility_votes(scene, instances, solved.planes, i, j, there.points, extent)
        if contradicted > config.max_contradicted * (same + contradicted):
            return False
    return True


def _continue_each_other(
    a: UnprojectedElements, b: UnprojectedElements, label: Label, config: RegroupingConfig
) -> bool:
    """Whether two regions of one plane overlap or nearly touch; doors and windows may lie side by side."""
    if label in OPENINGS:
        shared = a.region.intersection(b.region).area
        return bool(shared >= config.min_opening_overlap * min(a.region.area, b.region.area))
    reach = config.max_reach_share * float(np.median(np.concatenate([a.depth, b.depth])))
    return bool(shapely.distance(a.region, b.region) <= reach)
