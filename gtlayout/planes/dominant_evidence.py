"""Which kind of evidence a plane rests on."""

from __future__ import annotations

import gtsam
import numpy as np

from gtlayout.instances import EvidenceKind
from gtlayout.planes.linear_system import EDGE, JOINT, SHARED_DEPTH, TRACK, LinearSystem
from gtlayout.planes.views import Views
from gtlayout.scene import FloatArray

_KINDS: dict[EvidenceKind, int] = {"right angles": JOINT, "contact edges": EDGE, "tracks": TRACK}
"""The kinds of evidence that a plane may rest on, weakest first."""
_KNOWN = 0.5
"""A plane whose σ is more than this share of what priors alone leave is unknown."""
_CLEARLY = 2.0
"""A plane rests on a weaker kind when its loss hurts this many times as much as that of the next stronger one."""


def offset_gradient(plane: FloatArray, views: Views) -> FloatArray:
    """(3,) derivative, by the tangent, of a plane's offset at the middle of its elements."""
    points, _ = views.seen_on(plane)
    middle = np.median(points, axis=0) if len(points) else -plane[3] * plane[:3]
    return np.append(middle @ gtsam.OrientedPlane3(plane).normal().basis(), 1.0)


def dominant_evidence(linear: LinearSystem, row_weight: FloatArray, by_offset: FloatArray) -> list[EvidenceKind]:
    """Per plane the weakest kind of evidence without which it is unknown, else the kind whose loss hurts most.

    Args:
        row_weight: (R,) weights of the rows.
        by_offset: (P, 3) derivative of each plane's offset by its tangent.
    """
    width = by_offset.size
    family = np.repeat(linear.family, np.diff(np.append(linear.first, len(linear.target))))
    rows = np.sqrt(row_weight)[:, None] * linear.jacobian
    tracked = np.isin(family, [TRACK, SHARED_DEPTH])
    information = rows[tracked].T @ rows[tracked]
    by_bias = information[:width, width:]
    # Without the biases, the information of tracks is of one plane each: blocks on the diagonal.
    tracks = information[:width, :width] - by_bias @ np.linalg.solve(information[width:, width:], by_bias.T)
    others, other_family = rows[~tracked, :width], family[~tracked]

    def sigmas(i: int, *dropped: int) -> FloatArray:
        """(2,) of the normal, radians, and of the offset, without these families' measurements of plane ``i``."""
        own = slice(3 * i, 3 * i + 3)
        kept = others[~(np.isin(other_family, dropped) & others[:, own].any(axis=1))]
        of_tracks = tracks.copy()
        if TRACK in dropped:
            of_tracks[own] = 0.0
        covariance = np.linalg.inv(of_tracks + kept.T @ kept)[own, own]
        offset = by_offset[i] @ covariance @ by_offset[i]
        return np.sqrt(np.array([np.linalg.eigvalsh(covariance[:2, :2])[-1], offset]))

    held: list[EvidenceKind] = []
    for i in range(len(by_offset)):
        unknown = _KNOWN * sigmas(i, *_KINDS.values())
        best = sigmas(i)
        without = {kind: sigmas(i, dropped) for kind, dropped in _KINDS.items()}
        needed = [kind for kind in _KINDS if (without[kind] > unknown).any()]
        hurts = [float((without[kind] / best).max()) * _CLEARLY**rank for rank, kind in enumerate(_KINDS)]
        missed = list(_KINDS)[int(np.argmax(hurts))]
        held.append("priors" if (best > unknown).any() else [*needed, missed][0])
    return held
