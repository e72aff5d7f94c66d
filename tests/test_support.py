"""What is counted of a plane's support after a solve, against what went into it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simulated.simulated_edges import true_edges
from simulated.simulated_room import make_room, orbit
from simulated.simulation import chosen, make_tracks, solve, true_instance

KEY_FRAMES = [2, 10, 18]


def test_support_counts_what_went_in() -> None:
    room = make_room(orbit(), KEY_FRAMES)
    floor, wall = room.index("floor"), room.index("wall")
    tracks = make_tracks(room, np.random.default_rng(0), sigma_px=0.1, without=[wall])
    owner = true_instance(room, tracks)
    # Every fourth track of the floor survives; every third of those is 60 px off everywhere but in its key frame.
    kept = chosen(tracks, np.nonzero((owner != floor) | (np.cumsum(owner == floor) % 4 == 0))[0])
    owner = true_instance(room, kept)
    off = (owner == floor) & (np.cumsum(owner == floor) % 3 == 0)
    elsewhere = kept.frame != np.array(KEY_FRAMES)[kept.key_frame[kept.track]]
    slide = np.where((off[kept.track] & elsewhere)[:, None], [60.0, 0.0], 0.0)
    edges = true_edges(room)
    shifted = [
        replace(edge, points_px=edge.points_px + np.array([0.0, 3.0])) if set(edge.instances) == {floor, wall} else edge
        for edge in edges
    ]
    planes = solve(room, replace(kept, points_px=kept.points_px + slide), shifted).planes
    support = planes[floor].support
    assert support.tracks == np.count_nonzero(owner == floor)
    assert support.survived == pytest.approx(0.25, abs=0.02)
    assert support.outvoted == pytest.approx(off[owner == floor].mean(), abs=0.1)
    assert support.contact_edges == sum(floor in edge.instances for edge in edges)
    assert support.edge_px < 3.0
    assert support.parallax_deg > 5.0
    bare = planes[wall].support
    assert bare.dominant_evidence == "contact edges"
    assert bare.tracks == 0
    assert np.isnan([bare.survived, bare.parallax_deg, bare.outvoted]).all()
    assert bare.contact_edges == sum(wall in edge.instances for edge in edges) > 0
