"""How far the line drawn between two instances lies from where their planes meet, for planes that are given."""

from __future__ import annotations

import numpy as np

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.structural_factors import met
from gtlayout.scene import FloatArray

_ROUNDS = 4
"""Gauss-Newton iterations with robust weights. Offsets are small, so the problem is nearly linear."""


def contact_offsets(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> FloatArray:
    """(C, 3) the likeliest offset of each contact at (S, 4) ``planes``; zero where a plane is not placed."""
    offsets = np.zeros((len(evidence.contacts), 3))
    sigmas_px = np.array([config.sigma_edge_shift_px, config.sigma_edge_tilt_px])
    for c in met(evidence, planes):
        groups = [group for group in evidence.edges if group.instances == evidence.contacts[c]]
        for _ in range(_ROUNDS):
            information, gradient = np.eye(3) / config.sigma_contact_offset**2, np.zeros(3)
            for group in groups:
                px, by_offset = group.shift_and_tilt_px(planes, offsets[c])
                residual, by_offset = px / sigmas_px, by_offset / sigmas_px[:, None]
                weight = 1 / (1 + residual @ residual / config.edge_cauchy**2)
                information += weight * by_offset.T @ by_offset
                gradient += weight * by_offset.T @ (by_offset @ offsets[c] - residual)
            offsets[c] = np.linalg.solve(information, gradient)
    return offsets
