"""How far the line drawn between two instances lies from where their planes meet, for planes that are given."""

from __future__ import annotations

import numpy as np

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.edge_group import FARTHEST_PX, MIN_DIHEDRAL, EdgeGroup
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.structural_factors import met
from gtlayout.scene import FloatArray

Pair = tuple[int, int]
"""Two instances that touch, the smaller number first."""

_ROUNDS = 4
"""Gauss-Newton iterations with robust weights. Offsets are small, so the problem is nearly linear."""


def contact_offsets(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> FloatArray:
    """(C, 3) the likeliest offset of each contact at (S, 4) ``planes``; zero where a plane is not placed."""
    offsets: FloatArray = np.zeros((len(evidence.contacts), 3))
    placed = {evidence.contacts[c]: c for c in met(evidence, planes)}
    groups = [group for group in evidence.edges if group.instances in placed]
    if not groups:
        return offsets
    contact = np.array([placed[group.instances] for group in groups])
    sigmas_px = np.array([config.sigma_edge_shift_px, config.sigma_edge_tilt_px])
    for _ in range(_ROUNDS):
        px, by_offset = shifts_and_tilts_px(groups, planes, offsets[contact])
        residual, by_offset = px / sigmas_px, by_offset / sigmas_px[:, None]
        weight = 1 / (1 + np.sum(residual**2, axis=1) / config.edge_cauchy**2)
        weighted = weight[:, None, None] * by_offset
        information = np.tile(np.eye(3) / config.sigma_contact_offset**2, (len(offsets), 1, 1))
        gradient = np.zeros_like(offsets)
        target = np.einsum("gij,gj->gi", by_offset, offsets[contact]) - residual
        np.add.at(information, contact, np.einsum("gij,gik->gjk", weighted, by_offset))
        np.add.at(gradient, contact, np.einsum("gij,gi->gj", weighted, target))
        offsets = np.asarray(np.linalg.solve(information, gradient[:, :, None])[:, :, 0], np.float64)
    return offsets


def contact_misfits_px(evidence: Evidence, planes: FloatArray, config: EstimationConfig) -> dict[Pair, float]:
    """Of each pair whose planes are known the root mean square distance of its edge from their line, moved by their
    offset, as of an image of 640x480: the median over the key frames.
    """
    offsets = dict(zip(evidence.contacts, contact_offsets(evidence, planes, config), strict=True))
    found: dict[Pair, list[float]] = {}
    for group in evidence.edges:
        if np.isfinite(planes[list(group.instances), 0]).all():
            distance_px = group.annotation_px(group.misfits_px(planes, offsets[group.instances]))
            found.setdefault(group.instances, []).append(float(np.sqrt(np.mean(distance_px**2))))
    return {pair: float(np.median(distances)) for pair, distances in found.items()}


def shifts_and_tilts_px(
    groups: list[EdgeGroup], planes: FloatArray, offsets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(G, 2) half-sum and half-difference of the distances of each group's representatives from the line in which its
    two of (S, 4) ``planes`` meet, moved by its one of (G, 3) ``offsets``, and their (G, 2, 3) derivative by that.

    As of an image of 640x480; zero for planes that coincide.
    """
    a, b = (planes[[group.instances[side] for group in groups]] for side in (0, 1))
    center = np.array([group.center for group in groups]) - offsets
    line_by_normal = np.array([group.line_by_normal for group in groups])
    u = np.array([group.seen.points_px for group in groups])
    scale = np.array([group.camera.annotation_scale for group in groups])
    clearance_a, clearance_b = (np.sum(one[:, :3] * center, axis=1) + one[:, 3] for one in (a, b))
    through = clearance_a[:, None] * b[:, :3] - clearance_b[:, None] * a[:, :3]
    nearest = MIN_DIHEDRAL * np.maximum(np.abs(clearance_a), np.abs(clearance_b))
    meet = np.linalg.norm(through, axis=1) > nearest
    line = np.einsum("gj,gjk->gk", through, line_by_normal)
    length = np.where(meet, np.hypot(line[:, 0], line[:, 1]), 1.0)[:, None]
    px = np.einsum("grk,gk->gr", u, line) / length
    across = line * np.array([1.0, 1.0, 0.0])
    by_line = (u - px[:, :, None] * across[:, None, :] / length[:, :, None]) / length[:, :, None]
    g = np.einsum("grk,gjk->grj", by_line, line_by_normal)
    by_offset = (
        np.einsum("grj,gj->gr", g, a[:, :3])[:, :, None] * b[:, None, :3]
        - np.einsum("grj,gj->gr", g, b[:, :3])[:, :, None] * a[:, None, :3]
    )
    mix = np.array([[0.5, 0.5], [0.5, -0.5]]) * meet[:, None, None] / scale[:, None, None]
    mixed_px = np.einsum("gij,gj->gi", mix, px)
    return np.clip(mixed_px, -FARTHEST_PX, FARTHEST_PX), mix @ by_offset
