"""Where rays meet planes: ``center + depth ray`` lies on ``normal · X + d = 0``.

Every stage asks for it in a shape of its own (one plane for all rays, one plane a ray, all planes for all rays), so
the two scalar products come from outside: the clearance ``normal · center + d`` of the ray's start, and
``normal · ray``. With rays that have z = 1 in a camera, depth is along the camera's z.
"""

from __future__ import annotations

import numpy as np

from gtlayout.scene import FloatArray

_LEAST = 1e-12
"""Nearer to zero than this is zero but for rounding: planes that hold the ray, or its start."""


def depth_on_plane(clearance: FloatArray, normal_dot_ray: FloatArray) -> FloatArray:
    """(...) depths at which rays meet planes; negative behind the start, huge along the plane."""
    depth: FloatArray = -clearance / nonzero(normal_dot_ray)
    return depth


def inverse_depth_on_plane(clearance: FloatArray, normal_dot_ray: FloatArray) -> FloatArray:
    """(...) the inverse of ``depth_on_plane``: zero along the plane, huge for a start on it."""
    inverse: FloatArray = -normal_dot_ray / nonzero(clearance)
    return inverse


def nonzero(values: FloatArray) -> FloatArray:
    """(...) the values, with what is zero but for rounding moved off it so that it can be divided by."""
    return np.where(np.abs(values) < _LEAST, _LEAST, values)
