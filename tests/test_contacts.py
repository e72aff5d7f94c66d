"""Contacts that are none: a partition that hides the far wall, drawn as if it touched that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gtlayout.edges import ContactEdge
from gtlayout.planes import contacts
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_misfits_px
from gtlayout.planes.contacts import _disagreeing, start_without_wrong_contacts
from gtlayout.planes.evidence import Evidence, gather
from gtlayout.scene import FloatArray
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_edges import edges_along, jitter, shifted, true_edges
from simulated.simulated_room import Face, Room, box_faces, make_room, orbit
from simulated.simulation import make_tracks, measurements

CONFIG = EstimationConfig()
BOTTOM_LEFT, TOP_LEFT, TOP_RIGHT, BOTTOM_RIGHT = np.array(
    [[1.9, 3.6, 0.0], [1.9, 3.6, 2.5], [3.1, 3.6, 2.5], [3.1, 3.6, 0.0]]
)
"""A partition from floor to ceiling, 1.4 m before the far wall."""


@pytest.fixture(scope="module")
def room() -> Room:
    partition = Face("wall", np.array([BOTTOM_LEFT, TOP_LEFT, TOP_RIGHT, BOTTOM_RIGHT]))
    return make_room(orbit(), [2, 6, 10, 14, 18], [*box_faces(), partition])


def named(room: Room, *names: str) -> tuple[int, ...]:
    """Indices of instances; walls by the number of their face."""
    return tuple([instance.name for instance in room.instances].index(name) for name in names)


def right_edges(room: Room) -> list[ContactEdge]:
    partition, floor, ceiling = named(room, "wall_6", "floor_0", "ceiling_1")
    return [
        *true_edges(room),
        *edges_along(room, (partition, floor), BOTTOM_LEFT, BOTTOM_RIGHT),
        *edges_along(room, (partition, ceiling), TOP_LEFT, TOP_RIGHT),
    ]


def sides(room: Room, left: str, right: str) -> list[ContactEdge]:
    """The partition's sides, drawn as touching these walls."""
    partition, one, other = named(room, "wall_6", left, right)
    return [
        *edges_along(room, (partition, one), BOTTOM_LEFT, TOP_LEFT),
        *edges_along(room, (partition, other), BOTTOM_RIGHT, TOP_RIGHT),
    ]


def start(
    room: Room, edges: Sequence[ContactEdge], seed: int, without: Sequence[int] = ()
) -> tuple[Evidence, Evidence, FloatArray]:
    """All evidence, what was kept of it, and (S,) how far the starting planes are off where they are seen, metres."""
    rng = np.random.default_rng(seed)
    tracks = make_tracks(room, rng, drifting=0.1, without=without)
    drawn = jitter(edges, rng, CONFIG.sigma_edge_shift_px, CONFIG.sigma_edge_tilt_px)
    measured = measurements(room, tracks, drawn)
    local = Normalisation.of(measured.rays)
    evidence = gather(measured, local, CONFIG)
    kept, planes_local = start_without_wrong_contacts(evidence, CONFIG, seed)
    planes, _ = local.planes_to_world(planes_local)
    centers = np.array([room.seen_center(i) for i in range(len(planes))])
    return evidence, kept, np.abs(np.sum(planes[:, :3] * centers, axis=1) + planes[:, 3])


def pairs(evidence: Evidence) -> set[tuple[int, ...]]:
    return {tuple(sorted(group.instances)) for group in evidence.edges}


def test_right_contacts_are_all_kept(room: Room) -> None:
    evidence, kept, off = start(room, right_edges(room), 1)
    assert kept.edges == evidence.edges
    assert off.max() < 0.03


@pytest.mark.parametrize("blank", [("wall_6",), ("wall_5",)])
def test_a_partition_does_not_touch_what_it_hides(room: Room, blank: tuple[str, ...]) -> None:
    """One of the two has no tracks, so that only its other contacts contradict."""
    edges = right_edges(room) + sides(room, "wall_5", "wall_5")
    evidence, kept, off = start(room, edges, 0, without=named(room, *blank))
    partition, far = named(room, "wall_6", "wall_5")
    assert pairs(evidence) - pairs(kept) == {(partition, far)}
    assert off.max() < 0.05


def test_two_wrong_pairs_hide_neither_each_other_nor_right_ones(room: Room) -> None:
    evidence, kept, off = start(room, right_edges(room) + sides(room, "wall_5", "wall_3"), 0)
    partition, far, right = named(room, "wall_6", "wall_5", "wall_3")
    wrong = {tuple(sorted((partition, wall))) for wall in (far, right)}
    assert pairs(evidence) - pairs(kept) == wrong
    assert off.max() < 0.05


def test_one_slip_of_the_hand_does_not_part_two_surfaces(room: Room) -> None:
    """An edge 40 px off in one key frame of five is for the robust kernels."""
    edges = right_edges(room)
    edges[0] = shifted(edges[0], 40.0)
    evidence, kept, off = start(room, edges, 0)
    assert pairs(kept) == pairs(evidence)
    assert off.max() < 0.05


@pytest.mark.parametrize("hosted", [False, True])
def test_a_contact_is_only_kept_blindly_where_it_is_all_there_is(room: Room, hosted: bool) -> None:
    """The partition has no tracks and touches the floor alone, but starts in the floor's own plane, 100 px off.

    With a door of its own in it, or as a door in a wall, it would have more to go by.
    """
    partition, floor, far = named(room, "wall_6", "floor_0", "wall_5")
    edges = [*true_edges(room), *edges_along(room, (partition, floor), BOTTOM_LEFT, BOTTOM_RIGHT)]
    _, kept, _ = start(room, edges, 0, without=[partition])
    instances = list(room.instances)
    if hosted:
        instances[far] = replace(instances[far], host=partition)
    evidence, _, _ = start(replace(room, instances=tuple(instances)), edges, 0, without=[partition])
    planes = room.planes.copy()
    tracks = make_tracks(room, np.random.default_rng(0), drifting=0.1, without=[partition])
    local = Normalisation.of(triangulate(room.scene, tracks, TriangulationConfig()))
    planes[:, 3] = local.scale * (planes[:, 3] + planes[:, :3] @ local.origin)
    planes[partition] = planes[floor]
    dropped = _disagreeing(evidence, planes, CONFIG)
    assert ((min(partition, floor), max(partition, floor)) in dropped) == hosted
    assert pairs(kept) == pairs(evidence)


def test_a_contact_comes_back_once_it_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first start has a wall 1 m off, so that all its contacts go. In the next, its edge with the floor is 3 px off
    and comes back; that with the ceiling is 8 px off: not wrong by itself, but not good enough to be taken back.
    """
    room = make_room(orbit(), [2, 6, 10, 14, 18])
    floor, ceiling, wall = named(room, "floor_0", "ceiling_1", "wall_5")
    off_px = {frozenset({floor, wall}): 3.0, frozenset({ceiling, wall}): 8.0}
    edges = [shifted(edge, off_px.get(frozenset(edge.instances), 0.0)) for edge in true_edges(room)]
    measured = measurements(room, make_tracks(room, np.random.default_rng(0)), edges)
    local = Normalisation.of(measured.rays)
    evidence = gather(measured, local, CONFIG)
    right = room.planes.copy()
    right[:, 3] = local.scale * (right[:, 3] + right[:, :3] @ local.origin)
    wrong = right.copy()
    wrong[wall, 3] += local.scale
    starts = [wrong, right, right]
    monkeypatch.setattr(contacts, "best_start", lambda *_: starts.pop(0))
    monkeypatch.setattr(contacts, "polish", lambda _, planes, __: planes)
    # Without offsets: an edge that is off in the same way in all key frames would be one.
    exact = replace(CONFIG, sigma_contact_offset=1e-6)
    kept, _ = start_without_wrong_contacts(evidence, exact, 0)
    gone = {frozenset(edge.instances) for edge in evidence.edges} - {frozenset(edge.instances) for edge in kept.edges}
    assert gone == {frozenset({ceiling, wall})}
    assert not starts


def test_nothing_is_said_of_pairs_without_a_plane(room: Room) -> None:
    measured = measurements(room, make_tracks(room, np.random.default_rng(0)))
    local = Normalisation.of(measured.rays)
    evidence = gather(measured, local, CONFIG)
    planes = room.planes.copy()
    planes[:, 3] = local.scale * (planes[:, 3] + planes[:, :3] @ local.origin)
    for nowhere in (0, 2):
        some = planes.copy()
        some[nowhere] = np.nan
        pairs = contact_misfits_px(evidence, some, CONFIG)
        assert pairs
        assert not any(nowhere in pair for pair in pairs)
        assert max(pairs.values()) < 1e-6


def test_tracks_that_weigh_nothing_are_no_evidence(room: Room) -> None:
    measured = measurements(room, make_tracks(room, np.random.default_rng(0)))
    evidence = gather(measured, Normalisation.of(measured.rays), CONFIG)
    (first, *_) = evidence.edges
    alone = replace(evidence, edges=(first,))
    assert not contacts._all_there_is(alone, first.instances)
    assert contacts._all_there_is(replace(alone, track_weight=np.zeros_like(alone.track_weight)), first.instances)
