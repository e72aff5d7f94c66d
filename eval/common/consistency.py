"""Are predicted covariances right? Squared errors in their own σ, coverage of ellipsoids, and rank correlation.

NEES (normalised estimation error squared) is ``eᵀ C⁻¹ e``: χ² with as many degrees of freedom as e has, when errors are
Gaussian with the covariance C. See Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation
(2001), 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, chi2, spearmanr

from gtlayout.instances import Plane, PlaneFrame
from gtlayout.scene import FloatArray

PLANE_DOF = 3
"""Two tilts and an offset."""


@dataclass(frozen=True)
class Share:
    """A share of so many, with the interval that holds the true one in 95 % of cases (Wilson's, draws independent)."""

    value: float
    low: float
    high: float


def plane_error_at(
    plane: Plane, true_normal: FloatArray, true_d: float, point_world: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What is wrong with a plane, and what its covariance says of that: two tilts, and the offset at a point.

    Tilts are the angle between the normals along two directions across the estimated one. At a point amid the element
    normal and offset are hardly coupled, which keeps the covariance's inverse harmless; NEES is the same at any point.

    Args:
        true_normal: (3,) unit.
        point_world: (3,) amid the element.

    Returns:
        (3,) error in radians, radians and world unit, and its (3, 3) covariance.
    """
    across = PlaneFrame.across(plane.normal, point_world).axes
    turned = across @ true_normal
    sine = float(np.linalg.norm(turned))
    tilts = turned * (np.arctan2(sine, plane.normal @ true_normal) / sine if sine > 0 else 1.0)
    to_point = np.zeros((PLANE_DOF, 4))
    to_point[:2, :3] = across
    to_point[2] = np.append(point_world - plane.anchor, 1.0)
    error = np.append(tilts, (true_normal - plane.normal) @ point_world + true_d - plane.d)
    return error, to_point @ plane.covariance @ to_point.T


def nees(error: FloatArray, covariance: FloatArray) -> float:
    """``eᵀ C⁻¹ e``; NaN when nothing is known of the error."""
    if not np.isfinite(covariance).all():
        return np.nan
    return float(error @ np.linalg.solve(covariance, error))


def coverage(values: FloatArray, nominal: float) -> Share:
    """Share of planes whose true one lies in the ellipsoid that should hold it with probability ``nominal``.

    Args:
        values: (N,) NEES of planes; NaN is left out.
    """
    known = values[np.isfinite(values)]
    return share_of(int(np.count_nonzero(known <= chi2.ppf(nominal, PLANE_DOF))), len(known))


def share_of(count: int, total: int) -> Share:
    """``count`` of ``total``; NaN of none."""
    if total == 0:
        return Share(np.nan, np.nan, np.nan)
    interval = binomtest(count, total).proportion_ci(0.95, method="wilson")
    return Share(count / total, float(interval.low), float(interval.high))


def rank_correlation(sigma: FloatArray, error: FloatArray) -> float:
    """Spearman's correlation of σ with absolute errors, over pairs that have both; NaN where ranks say nothing."""
    known = np.isfinite(sigma) & np.isfinite(error)
    if len(np.unique(sigma[known])) < 2 or len(np.unique(error[known])) < 2:
        return np.nan
    return float(spearmanr(sigma[known], error[known]).statistic)
