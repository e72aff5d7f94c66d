"""Mirror images among the tracks of a surface: behind it, and as many as there are."""

from __future__ import annotations

import numpy as np

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.reflections import reflected
from gtlayout.scene import FloatArray

CONFIG = EstimationConfig()
RELATIVE_SIGMA = 0.05
"""A mirror image lies 0 to 20 σ behind."""


def probabilities(residual: FloatArray) -> FloatArray:
    return reflected(residual, np.full(len(residual), RELATIVE_SIGMA), 1.0, CONFIG)


def drawn(mirrored: int, seed: int = 0) -> FloatArray:
    """100 tracks on the surface, then mirror images."""
    rng = np.random.default_rng(seed)
    return np.append(rng.normal(size=100), -rng.uniform(0, 1 / RELATIVE_SIGMA, mirrored))


def test_what_is_far_behind_is_a_mirror_image_and_what_is_before_is_none() -> None:
    probability = probabilities(np.append(drawn(30), [-8.0, 8.0, 0.0]))
    assert probability[-3] > 0.9
    assert probability[-2] < 1e-6
    assert probability[-1] < 0.1


def test_as_many_are_found_as_there_are() -> None:
    for mirrored in (0, 50, 200):
        found = np.mean([probabilities(drawn(mirrored, seed)).sum() for seed in range(5)])
        assert abs(found - mirrored) < 8 + 0.1 * mirrored


def test_on_a_surface_with_many_the_same_residual_is_more_likely_one() -> None:
    matte, glossy = (probabilities(np.append(-3.0, drawn(mirrored)))[0] for mirrored in (0, 200))
    assert matte < glossy - 0.1
