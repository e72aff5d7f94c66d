"""A world of the size of a room, for any unit of the cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtlayout.geometry.similarity import Similarity
from gtlayout.tracking.triangulation import TriangulatedTracks

TYPICAL_DEPTH = 2.5
"""Median depth to which every scene is scaled, so that the noise model's metres mean the same with and without a
unit."""


class Normalisation(Similarity):
    """Keeps a plane's n and d uncoupled, and gives every scene a room's size; its axes stay."""

    @classmethod
    def of(cls, rays: TriangulatedTracks) -> Normalisation:
        """Origin amid the points, and their median depth as unit."""
        origin = np.median(rays.points_world(), axis=0)
        return cls(np.eye(3), origin, TYPICAL_DEPTH * float(np.median(rays.rho)))

    def rays(self, rays: TriangulatedTracks) -> TriangulatedTracks:
        """The same rays in the local world."""
        center = self.scale * (rays.center - self.origin)
        return replace(rays, center=center, rho=rays.rho / self.scale, sigma_rho=rays.sigma_rho / self.scale)
