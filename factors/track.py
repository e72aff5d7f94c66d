"""Landmarks that lie on their plane."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np

from gtlayout.factors.batching import FloatArray, custom_factor, plane_parts


def track_factor(plane_key: int, landmark_keys: Sequence[int], sigma: FloatArray) -> gtsam.CustomFactor:
    """``r_i = n · X_i + d``: signed distance of each landmark from the plane, world unit.

    One factor holds a batch of landmarks of one plane: GTSAM calls Python once per factor, and copies all values to
    do so. About 32 landmarks a batch is fastest; many more make a dense clique.

    Args:
        plane_key: an ``OrientedPlane3`` variable.
        landmark_keys: m ``Point3`` variables.
        sigma: (m,) σ of each distance (relief of the surface, annotator's tolerance), world unit.
    """
    landmarks = list(landmark_keys)

    def residual(values: gtsam.Values, want_jacobians: bool) -> tuple[FloatArray, list[FloatArray]]:
        normal, d, basis = plane_parts(values, plane_key)
        points = np.array([values.atPoint3(key) for key in landmarks])
        error = points @ normal + d
        if not want_jacobians:
            return error, []
        by_plane = np.column_stack([points @ basis, np.ones(len(points))])
        by_landmark = np.zeros((len(points), len(points), 3))
        rows = np.arange(len(points))
        by_landmark[rows, rows] = normal
        return error, [by_plane, *by_landmark]

    return custom_factor(gtsam.noiseModel.Diagonal.Sigmas(sigma), [plane_key, *landmarks], residual)
