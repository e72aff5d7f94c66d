"""Which kind of evidence a plane rests on."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from gtlayout.instances import EvidenceKind
from gtlayout.planes.arrow import eliminate, summed
from gtlayout.planes.arrow_rows import Rows
from gtlayout.planes.linear_system import ANGLE, EDGE, JOINT, OFFSET, PRIOR, SHARED_DEPTH, TRACK, LinearSystem
from gtlayout.planes.views import Views
from gtlayout.scene import FloatArray

_KINDS: dict[EvidenceKind, int] = {"right angles": JOINT, "contact edges": EDGE, "tracks": TRACK}
"""The kinds of evidence that a plane may rest on, weakest first."""
_KNOWN = 0.5
"""A plane whose σ is more than this share of what priors alone leave is unknown."""
_MISSED = 1 + 1e-9
"""σ grows by more than this, which is rounding, when a kind that is there is left out."""
_CLEARLY = 2.0
"""A plane rests on a weaker kind when its loss hurts this many times as much as that of the next stronger one."""


@dataclass(frozen=True)
class Joints:
    """What measurements say of P planes, by the pairs that they join; a pair may be one plane twice."""

    own: FloatArray
    """(P, P, 3, 3) information on plane a, of what joins it with b."""
    across: FloatArray
    """(P, P, 3, 3) rows of plane a, columns of b."""

    @staticmethod
    def of(rows: Rows, weight: FloatArray) -> Joints:
        """Sums over rows that touch planes and links, with (R,) weights; the links are eliminated."""
        planes = rows.tree.roots
        of_planes = (rows.unknown < planes).all(axis=1)
        pair = rows.unknown[of_planes] @ np.array([planes, 1])
        # (R, 2, 3, 2, 3) of both planes of each row with both.
        jacobian = rows.jacobian[of_planes]
        outer = np.einsum("r,rai,rbj->raibj", weight[of_planes], jacobian, jacobian)
        sums = summed(outer, pair, planes**2).reshape(planes, planes, 2, 3, 2, 3)
        if len(rows.linked):
            links = rows.information(weight)
            between = np.concatenate([links.link_roots[:, 0], links.link_roots[:, 1]], axis=2)
            taken = between.transpose(0, 2, 1) @ np.linalg.solve(links.link, between)
            sums[*rows.tree.link.T] -= taken.reshape(-1, 2, 3, 2, 3)
        turned = sums.transpose(1, 0, 2, 3, 4, 5)
        return Joints(sums[:, :, 0, :, 0] + turned[:, :, 1, :, 1], sums[:, :, 0, :, 1] + turned[:, :, 1, :, 0])

    def information(self, without: int) -> FloatArray:
        """(3P, 3P) of all planes; measurements of plane ``without`` are left out (-1: of none)."""
        index = np.arange(len(self.own))
        kept = (index != without).astype(float)
        blocks = np.einsum("abij,a,b->aibj", self.across, kept, kept)
        blocks[index, :, index] += np.einsum("abij,a,b->aij", self.own, kept, kept)
        return blocks.reshape(3 * len(index), 3 * len(index))


def middle_on(plane: FloatArray, views: Views) -> FloatArray:
    """(3,) point on a plane at the middle of its elements, or the foot of the origin where it is not seen."""
    points, _ = views.seen_on(plane)
    middle: FloatArray = np.median(points, axis=0) if len(points) else -plane[3] * plane[:3]
    return middle - (middle @ plane[:3] + plane[3]) * plane[:3]


def offset_gradient(plane: FloatArray, views: Views) -> FloatArray:
    """(3,) derivative, by the tangent, of a plane's offset at the middle of its elements."""
    middle = middle_on(plane, views)
    return np.append(middle @ gtsam.OrientedPlane3(plane).normal().basis(), 1.0)


def dominant_evidence(linear: LinearSystem, row_weight: FloatArray, by_offset: FloatArray) -> list[EvidenceKind]:
    """Per plane the weakest kind of evidence without which it is unknown, else the kind whose loss hurts most.

    Args:
        row_weight: (R,) weights of the rows.
        by_offset: (P, 3) derivative of each plane's offset by its tangent.
    """
    rows, family = linear.rows, np.repeat(linear.family, linear.size)
    # Priors on offsets touch no plane, but without them the links are not regular.
    tracked = np.isin(family, [TRACK, SHARED_DEPTH, OFFSET])
    # Without its biases, what tracks say is of one plane each: blocks on the diagonal.
    tracks = eliminate(rows.tree, rows.only(tracked).information(row_weight[tracked])).root
    joints = {
        of: Joints.of(rows.only(own), row_weight[own])
        for of, own in (
            (EDGE, np.isin(family, [EDGE, OFFSET])),
            (JOINT, np.isin(family, [ANGLE, JOINT])),
            (PRIOR, family == PRIOR),
        )
    }

    def sigmas(i: int, *dropped: int) -> FloatArray:
        """(2,) of the normal, radians, and of the offset, without these families' measurements of plane ``i``."""
        own = slice(3 * i, 3 * i + 3)
        information = tracks.copy()
        if TRACK in dropped:
            information[own] = 0.0
        for of, joint in joints.items():
            information += joint.information(i if of in dropped else -1)
        covariance = np.linalg.solve(information, np.eye(len(information))[:, own])[own]
        offset = by_offset[i] @ covariance @ by_offset[i]
        return np.sqrt(np.array([np.linalg.eigvalsh(covariance[:2, :2])[-1], offset]))

    held: list[EvidenceKind] = []
    for i in range(len(by_offset)):
        unknown = _KNOWN * sigmas(i, *_KINDS.values())
        best = sigmas(i)
        without = {kind: sigmas(i, dropped) for kind, dropped in _KINDS.items()}
        needed = [kind for kind in _KINDS if (without[kind] > unknown).any()]
        hurts = [
            # What is not there cannot be missed.
            float((without[kind] / best).max()) * _CLEARLY**rank * (without[kind] > _MISSED * best).any()
            for rank, kind in enumerate(_KINDS)
        ]
        missed = list(_KINDS)[int(np.argmax(hurts))]
        held.append("priors" if (best > unknown).any() else [*needed, missed][0])
    return held
