"""Wrong contacts that agree with each other: what many tracks say of a plane is not outvoted by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gtlayout.edges import ContactEdge
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.evidence import Evidence, gather
from gtlayout.planes.objective import contact_costs, cost_of, wrong_contact_prices
from gtlayout.planes.outvoted import planes_of_tracks, without_outvoting
from gtlayout.planes.starts import best_start
from gtlayout.scene import FloatArray
from gtlayout.tracking.normalisation import Normalisation
from simulated.simulated_edges import edges_along, jitter, shifted, true_edges
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import make_tracks, measurements

CONFIG = EstimationConfig()
FAR, FLOOR, CEILING = "wall_5", "floor_0", "ceiling_1"


@pytest.fixture(scope="module")
def room() -> Room:
    return make_room(orbit(), [2, 6, 10, 14, 18])


def number(room: Room, name: str) -> int:
    return [instance.name for instance in room.instances].index(name)


def as_if_turned(room: Room, frames: Sequence[int]) -> list[ContactEdge]:
    """The true edges, but the far wall's: in these key frames it is drawn to touch floor and ceiling 40° off."""
    far = number(room, FAR)
    along = np.array([np.cos(np.deg2rad(40)), np.sin(np.deg2rad(40)), 0.0])
    wrong: list[ContactEdge] = []
    for name, height in ((FLOOR, 0.0), (CEILING, 2.5)):
        other, middle = number(room, name), np.array([2.0, 4.4, height])
        pair = (min(far, other), max(far, other))
        wrong += edges_along(room, pair, middle - 0.9 * along, middle + 0.9 * along)
    right = [edge for edge in true_edges(room) if far not in edge.instances]
    return [*right, *(edge for edge in wrong if edge.key_frame in frames)]


def gathered(room: Room, edges: Sequence[ContactEdge]) -> tuple[Evidence, Normalisation]:
    rng = np.random.default_rng(0)
    drawn = jitter(edges, rng, CONFIG.sigma_edge_shift_px, CONFIG.sigma_edge_tilt_px)
    measured = measurements(room, make_tracks(room, rng), drawn)
    local = Normalisation.of(measured.rays)
    return gather(measured, local, CONFIG), local


def off_m(room: Room, planes_local: FloatArray, local: Normalisation) -> float:
    """How far the far wall is off where it is seen."""
    far = number(room, FAR)
    plane = local.planes_to_world(planes_local)[0][far]
    return float(abs(plane[:3] @ room.seen_center(far) + plane[3]))


def wrong_pairs(room: Room) -> set[tuple[int, int]]:
    far = number(room, FAR)
    return {(min(far, other), max(far, other)) for other in (number(room, FLOOR), number(room, CEILING))}


def pairs(evidence: Evidence) -> set[tuple[int, int]]:
    return {group.instances for group in evidence.edges}


def test_contacts_that_agree_do_not_turn_a_well_tracked_wall(room: Room) -> None:
    evidence, local = gathered(room, as_if_turned(room, [1, 3]))
    planes = best_start(evidence, CONFIG, 0)
    kept, better = without_outvoting(evidence, frozenset(), planes, CONFIG, 0)
    assert off_m(room, planes, local) > 0.3
    assert off_m(room, better, local) < 0.02
    assert pairs(evidence) - pairs(kept) == wrong_pairs(room)


def test_right_contacts_and_planes_stay(room: Room) -> None:
    evidence, _ = gathered(room, true_edges(room))
    planes = best_start(evidence, CONFIG, 0)
    kept, same = without_outvoting(evidence, frozenset(), planes, CONFIG, 0)
    assert kept.edges == evidence.edges
    np.testing.assert_array_equal(same, planes)


def test_tracks_of_which_half_are_mirror_images_turn_nothing(room: Room) -> None:
    evidence, _ = gathered(room, as_if_turned(room, [1, 3]))
    far = number(room, FAR)
    of_far = np.nonzero(evidence.track_instance == far)[0]
    rho = evidence.rays.rho.copy()
    rho[of_far[::2]] *= np.linspace(0.5, 0.9, len(of_far[::2]))
    mirrored = replace(evidence, rays=replace(evidence.rays, rho=rho))
    assert np.isnan(planes_of_tracks(mirrored, CONFIG, 0)[far]).all()
    assert np.isfinite(planes_of_tracks(evidence, CONFIG, 0)).all()
    planes = best_start(mirrored, CONFIG, 0)
    kept, _ = without_outvoting(mirrored, frozenset(), planes, CONFIG, 0)
    assert not (pairs(mirrored) - pairs(kept)) & wrong_pairs(room)


@pytest.mark.parametrize(("off_px", "frames", "wrong"), [(9.0, 5, True), (4.0, 5, False), (9.0, 1, False)])
def test_a_contact_goes_where_all_else_fits_better_without_it(
    room: Room, off_px: float, frames: int, wrong: bool
) -> None:
    """An edge drawn less than 10 px beside its place in every key frame; in one alone it is a slip of the hand."""
    far, floor = number(room, FAR), number(room, FLOOR)
    edges = [
        shifted(edge, off_px) if set(edge.instances) == {far, floor} and edge.key_frame < frames else edge
        for edge in true_edges(room)
    ]
    # Without offsets: an edge that is off in the same way in all key frames would be one.
    exact = replace(CONFIG, sigma_contact_offset=1e-6)
    evidence, _ = gathered(room, edges)
    planes = best_start(evidence, exact, 0)
    kept, _ = without_outvoting(evidence, frozenset(), planes, exact, 0)
    assert pairs(evidence) - pairs(kept) == ({(min(far, floor), max(far, floor))} if wrong else set())


def test_no_contact_costs_more_than_its_price(room: Room) -> None:
    evidence, _ = gathered(room, as_if_turned(room, [1, 3]))
    planes = planes_of_tracks(evidence, CONFIG, 0)
    costs, prices = contact_costs(evidence, planes, CONFIG), wrong_contact_prices(evidence, CONFIG)
    for pair in wrong_pairs(room):
        assert prices[pair] == CONFIG.wrong_contact_price + 2 * CONFIG.usual_edge_cost
        assert costs[pair] > prices[pair]
    assert np.isinf(prices[number(room, FAR), number(room, FAR)])
    free, bounded = cost_of(evidence, planes, CONFIG), cost_of(evidence, planes, CONFIG, prices)
    saved = np.maximum(costs - np.where(np.isinf(prices), costs, prices), 0.0).sum()
    assert free.total - bounded.total == pytest.approx(saved)
