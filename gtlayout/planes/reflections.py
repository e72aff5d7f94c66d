"""Which tracks of a surface are mirror images: these lie behind it, and nothing else does."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from gtlayout.planes.config import EstimationConfig
from gtlayout.scene import FloatArray

_ROUNDS = 20
"""Iterations of expectation maximisation for one share."""
_ELSEWHERE = 1e-3
"""Density, per σ, of tracks that are neither on the surface nor mirrored in it: on furniture before it, or lost."""


def reflected(residual: FloatArray, relative_sigma: FloatArray, scale: float, config: EstimationConfig) -> FloatArray:
    """(n,) probability that each track of one surface is a mirror image.

    A mixture: tracks on the surface are normally distributed about it, mirror images lie anywhere behind it, their
    inverse depths evenly between zero and the surface's. How many there are is learned for each surface. A symmetric
    robust kernel lets them pull: without the mixture, glossy cabinet fronts came out 6 % too deep.

    Args:
        residual: (n,) inverse depth less that of the surface, in σ; negative is behind it.
        relative_sigma: (n,) σ as a share of the surface's inverse depth.
        scale: standard deviation of the residuals of tracks on the surface.
    """
    on_surface = np.exp(-0.5 * (residual / scale) ** 2) / (np.sqrt(2 * np.pi) * scale) + _ELSEWHERE
    behind = relative_sigma * ndtr(-residual / scale)
    share, prior = config.reflected_share, config.reflected_prior_tracks
    probability = np.zeros(len(residual))
    for _ in range(_ROUNDS):
        probability = share * behind / (share * behind + (1 - share) * on_surface)
        share = (probability.sum() + config.reflected_share * prior) / (len(residual) + prior)
    return probability
