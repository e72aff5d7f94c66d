"""What the planes of a solution are made of, as the key frames show it: tracks by residual, contact edges, and what
each kind of evidence says alone. Plain data, small enough to be kept beside a layout.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.planes.edge_group import EdgeGroup
from gtlayout.planes.trail import PlaneTrail
from gtlayout.scene import FloatArray
from gtlayout.solution import Solution

MAX_TRACKS = 40
"""Most tracks that are kept of an instance in a key frame, evenly over their residuals: enough to see what they do."""


@dataclass(frozen=True)
class TracksSeen:
    """Tracks of one instance that were sampled in one key frame."""

    key_frame: int
    instance: int
    points_px: FloatArray
    """(N, 2) where they are in the key frame."""
    weight: FloatArray
    """(N,) robust weight in [0, 1]: near 1 = on the plane, near 0 = outvoted."""


@dataclass(frozen=True)
class EdgeSeen:
    """A contact edge in one key frame, and where the planes of its two instances meet."""

    key_frame: int
    instances: tuple[int, int]
    drawn_px: FloatArray
    """(2, 2) its ends, as drawn."""
    expected_px: FloatArray
    """(2, 2) the points nearest to them on the line in which the planes meet."""
    misfit_px: float
    """Median distance of what is drawn from that line."""
    used: bool
    """False when the solve took it for no contact."""


@dataclass(frozen=True)
class EvidenceSeen:
    """The evidence of a solution; ``trails`` in the order of its instances."""

    trails: tuple[PlaneTrail, ...]
    tracks: tuple[TracksSeen, ...]
    edges: tuple[EdgeSeen, ...]


def evidence_of(solution: Solution) -> EvidenceSeen:
    """What is kept of a solution's evidence, by key frame and instance."""
    return EvidenceSeen(solution.estimate.trails, _tracks(solution), _edges(solution))


def _tracks(solution: Solution) -> tuple[TracksSeen, ...]:
    scene, tracks, estimate = solution.scene, solution.tracks, solution.estimate
    drawn_in = np.array([key_frame.frame for key_frame in scene.key_frames])[tracks.key_frame]
    at_start = tracks.frame == drawn_in[tracks.track]
    points_px = np.full((len(tracks), 2), np.nan)
    points_px[tracks.track[at_start]] = tracks.points_px[at_start]
    shown = (estimate.landmark_instance >= 0) & np.isfinite(points_px[:, 0])
    found = []
    for k, i in np.unique(np.column_stack([tracks.key_frame, estimate.landmark_instance])[shown], axis=0).tolist():
        own = np.nonzero(shown & (tracks.key_frame == k) & (estimate.landmark_instance == i))[0]
        own = own[np.argsort(estimate.landmark_weight[own], kind="stable")]
        own = own[np.unique(np.linspace(0, len(own) - 1, min(MAX_TRACKS, len(own))).round().astype(int))]
        found.append(TracksSeen(k, i, points_px[own].round(1), estimate.landmark_weight[own].round(2)))
    return tuple(found)


def _edges(solution: Solution) -> tuple[EdgeSeen, ...]:
    scene, planes = solution.scene, np.array([[*plane.normal, plane.d] for plane in solution.planes])
    found = []
    for edge in solution.edges:
        pair = min(edge.instances), max(edge.instances)
        if not np.isfinite(planes[list(pair)]).all():
            continue
        group = EdgeGroup(scene.frame_of(edge.key_frame).camera, pair, edge.points_px, key_frame=edge.key_frame)
        misfit_px = float(np.median(np.abs(group.misfits_px(planes))))
        # A door and its wall have one plane: no line to compare with.
        if np.isfinite(misfit_px):
            expected_px = group.feet_px(planes, np.zeros(3))[[0, -1]].round(1)
            used = pair in solution.estimate.contact_offsets
            drawn_px = edge.points_px[[0, -1]].round(1)
            found.append(EdgeSeen(edge.key_frame, pair, drawn_px, expected_px, round(misfit_px, 2), used))
    return tuple(found)
