"""One objective for all planes: who is wrong pays, a solve that leads away from the evidence is noticed and undone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import O, P

import gtlayout.planes.estimation
import gtlayout.planes.graph
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.estimation import led_astray
from gtlayout.planes.evidence import Evidence, gather
from gtlayout.planes.graph import optimise_graph
from gtlayout.planes.objective import cauchy_loss, cost_of
from gtlayout.planes.structural_factors import edge_factors, offset_priors
from gtlayout.scene import BoolArray, FloatArray, IntArray
from gtlayout.tracking.follow import infinite_homography
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from simulated.simulated_edges import true_edges
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import errors, make_tracks, measurements, solve

KEY_FRAMES = [2, 6, 10, 14, 18]
CONFIG = EstimationConfig()


@pytest.fixture(scope="module")
def room() -> Room:
    return make_room(orbit(), KEY_FRAMES)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def known(room: Room, tracks: Tracks) -> tuple[Evidence, FloatArray, Normalisation]:
    """Evidence, and (S, 4) the true planes, in the local world."""
    measured = measurements(room, tracks)
    local = Normalisation.of(measured.rays)
    evidence = gather(measured, local, CONFIG)
    truth = room.planes.copy()
    truth[:, 3] = local.scale * (truth[:, 3] + truth[:, :3] @ local.origin)
    return evidence, truth, local


def turned(planes: FloatArray, surface: int, angle_deg: float, views_center: FloatArray) -> FloatArray:
    """One plane turned about the vertical through where it is seen."""
    angle = np.deg2rad(angle_deg)
    about_z = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    changed = planes.copy()
    middle = views_center - (planes[surface, :3] @ views_center + planes[surface, 3]) * planes[surface, :3]
    changed[surface, :3] = about_z @ planes[surface, :3]
    changed[surface, 3] = -changed[surface, :3] @ middle
    return changed


def walls(room: Room) -> list[int]:
    return [i for i, instance in enumerate(room.instances) if instance.label == "wall"]


def test_the_truth_is_cheapest_and_every_term_counts_for_its_surfaces(room: Room) -> None:
    evidence, truth, local = known(room, make_tracks(room, rng(), sigma_px=0.0))
    best = cost_of(evidence, truth, CONFIG)
    assert best.total < 1e-3
    wall = walls(room)[0]
    center = local.scale * (room.seen_center(wall) - local.origin)
    worse = cost_of(evidence, turned(truth, wall, 8.0, center), CONFIG)
    assert worse.total > best.total + 20
    assert np.argmax(worse.by_instance) == wall
    # Terms of two surfaces count for both, others for one: so the sum of all is no less than the total, nor its double.
    assert worse.total < worse.by_instance.sum() < 2 * worse.total
    none = cost_of(evidence, np.where(np.arange(len(truth))[:, None] == wall, np.nan, truth), CONFIG)
    assert np.isnan(none.by_instance[wall]) and np.isfinite(np.delete(none.by_instance, wall)).all()


def test_a_wrong_odd_angle_is_not_free(room: Room) -> None:
    """A pair of walls without tracks and edges: .24 from a right angle, .26, and 45° cost more and more, never less."""
    evidence, truth, local = known(room, make_tracks(room, rng(), sigma_px=0.0))
    nothing = replace(evidence, edges=(), track_instance=np.full_like(evidence.track_instance, -1))
    wall = walls(room)[0]
    center = local.scale * (room.seen_center(wall) - local.origin)
    sines = [0.0, 0.1, 0.24, 0.26, np.sin(np.pi / 4)]
    cost = [
        cost_of(nothing, turned(truth, wall, float(np.rad2deg(np.arcsin(sine))), center), CONFIG).total
        for sine in sines
    ]
    assert np.all(np.diff(cost) >= -1e-9)
    assert cost[3] > cost[0] + 1.0
    assert cost[4] == pytest.approx(cost[3], rel=0.01), "an angle that is odd anyway may be any"


def test_planes_that_coincide_do_not_meet_for_free() -> None:
    """Two walls drawn as touching: put into one plane, their edge costs as much as one that is 100 px off, and parallel
    as they are they cost as much as at any other odd angle.
    """
    room = make_room(orbit(), KEY_FRAMES)
    evidence, truth, _ = known(room, make_tracks(room, rng(), sigma_px=0.0))
    group = next(g for g in evidence.edges if {room.instances[i].label for i in g.instances} == {"wall"})
    a, b = group.instances
    only = replace(evidence, edges=(group,), track_instance=np.full_like(evidence.track_instance, -1))
    flat = truth.copy()
    flat[b] = truth[a]
    odd = (CONFIG.right_angle_reach / CONFIG.sigma_perpendicularity) ** 2
    expected = float(cauchy_loss(np.array((100 / CONFIG.sigma_edge_shift_px) ** 2), CONFIG.edge_cauchy))
    expected += 2 / (len(walls(room)) - 1) * float(cauchy_loss(np.array(odd), CONFIG.right_angle_cauchy))
    without = replace(only, edges=())
    assert cost_of(only, flat, CONFIG).total - cost_of(without, flat, CONFIG).total == pytest.approx(expected)


def test_edges_cost_what_their_factors_do(room: Room) -> None:
    evidence, truth, local = known(room, make_tracks(room, rng(), sigma_px=0.0))
    wall = walls(room)[0]
    planes = turned(truth, wall, 2.0, local.scale * (room.seen_center(wall) - local.origin))
    values = gtsam.Values()
    for s, plane in enumerate(planes):
        values.insert(P(s), gtsam.OrientedPlane3(plane))
    for c, offset in enumerate(contact_offsets(evidence, planes, CONFIG)):
        values.insertPoint3(O(c), offset)
    both = [*edge_factors(evidence, planes, CONFIG), *offset_priors(evidence, planes, CONFIG)]
    factors = sum(factor.error(values) for factor in both)
    without = replace(evidence, edges=())
    # Touching changes what right angles between walls cost: by nothing here, where all are right but one.
    edges = cost_of(evidence, planes, CONFIG).total - cost_of(without, planes, CONFIG).total
    assert edges == pytest.approx(factors, rel=1e-6)


def test_a_solve_that_throws_a_plane_is_noticed_and_its_start_kept(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    tracks = make_tracks(room, rng())
    good = solve(room, tracks, true_edges(room))
    assert good.warnings == ()
    wall = walls(room)[1]
    honest = gtlayout.planes.estimation.optimise

    def astray(*arguments):  # type: ignore[no-untyped-def]
        solution, uncertainty = honest(*arguments)
        planes = solution.planes.copy()
        planes[wall, 3] *= 2.0
        return replace(solution, planes=planes), uncertainty

    monkeypatch.setattr(gtlayout.planes.estimation, "optimise", astray)
    kept = solve(room, tracks, true_edges(room))
    assert len(kept.warnings) == 1 and room.instances[wall].name in kept.warnings[0]
    angles_deg, offsets = errors(room, kept.planes)
    assert angles_deg.max() < 0.5 and np.abs(offsets).max() < 0.02
    # Either of the two may be wrong: σ reaches from one to the other, for this plane only.
    grown = [
        plane.sigma_offset(room.seen_center(s)) / good.planes[s].sigma_offset(room.seen_center(s))
        for s, plane in enumerate(kept.planes)
    ]
    assert grown[wall] > 20
    assert max(growth for s, growth in enumerate(grown) if s != wall) < 1.5
    # All that is said of a plane is said of the start as well.
    assert all(plane.observable and plane.support.tracks for plane in kept.planes)
    used = np.isfinite(kept.landmarks[:, 0])
    np.testing.assert_array_equal(used, kept.landmark_instance >= 0)
    for n in np.nonzero(used)[0]:
        plane = kept.planes[kept.landmark_instance[n]]
        assert abs(plane.normal @ kept.landmarks[n] + plane.d) < 1e-6
    assert np.median(kept.landmark_weight[used]) > 0.5


def test_an_ordinary_solve_is_not_led_astray(room: Room) -> None:
    evidence, truth, local = known(room, make_tracks(room, rng(), drifting=0.1))
    wall = walls(room)[0]
    center = local.scale * (room.seen_center(wall) - local.origin)
    assert led_astray(evidence, truth, truth, CONFIG) == ()
    assert led_astray(evidence, truth, turned(truth, wall, 0.3, center), CONFIG) == ()
    assert led_astray(evidence, truth, turned(truth, wall, 40.0, center), CONFIG) == (wall,)
    # The other way round it is a rescue.
    assert led_astray(evidence, turned(truth, wall, 40.0, center), truth, CONFIG) == ()


def test_landmarks_start_on_their_planes_whatever_they_were_triangulated_at(room: Room) -> None:
    """Tracks at infinity, which every plane contradicts by a little only: the graph starts near its optimum."""
    tracks = make_tracks(room, rng())
    far = np.arange(len(tracks)) % 7 == 0
    evidence, truth, local = known(room, replace(tracks, points_px=at_infinity(room, tracks, far)))
    cameras = [local.camera(frame.camera) for frame in room.scene.frames]
    weightless = replace(evidence, sigma_rho=np.where(far, 5 * evidence.rays.rho.max(), evidence.sigma_rho))
    found = optimise_graph(
        cameras, replace(tracks, points_px=at_infinity(room, tracks, far)), weightless, truth, CONFIG
    )
    assert found.costs[0] < 30 * found.costs[-1]
    assert np.abs(found.planes - truth).max() < 0.03


def test_landmarks_that_miss_their_planes_start_no_farther_than_elements_may_be(room: Room) -> None:
    tracks = make_tracks(room, rng())
    evidence, truth, _ = known(room, tracks)
    behind = face_away(truth, evidence)
    far = replace(evidence, rays=replace(evidence.rays, rho=np.full(len(tracks), 1e-6)))
    used = np.arange(len(tracks))
    points = gtlayout.planes.graph._on_plane(far, behind, used, CONFIG)
    depth = np.linalg.norm(points - evidence.rays.center, axis=1) / np.linalg.norm(evidence.rays.ray, axis=1)
    np.testing.assert_allclose(depth, CONFIG.depth_range[1])


def face_away(planes: FloatArray, evidence: Evidence) -> FloatArray:
    """(S, 4) planes mirrored at a camera: all of them behind it."""
    center = evidence.rays.center[0]
    mirrored = planes.copy()
    mirrored[:, 3] = -planes[:, 3] - 2 * planes[:, :3] @ center
    return mirrored


def test_the_fault_that_scenes_without_a_unit_had_would_be_noticed(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    """Landmarks of tracks that know no depth, started where they used to be: hundreds of metres off their planes."""
    tracks = make_tracks(room, rng())
    far = np.arange(len(tracks)) % 3 == 0
    tracks = replace(tracks, sigma_px=np.where(far, 100.0, tracks.sigma_px))
    assert solve(room, tracks, true_edges(room)).warnings == ()
    honest = gtlayout.planes.graph._on_plane

    def triangulated_anywhere(evidence: Evidence, planes: FloatArray, used: IntArray, *others: Any) -> FloatArray:
        anywhere = evidence.rays.center[used] + 1000.0 * evidence.rays.ray[used]
        return np.where(far[used, None], anywhere, honest(evidence, planes, used, *others))

    monkeypatch.setattr(gtlayout.planes.graph, "_on_plane", triangulated_anywhere)
    kept = solve(room, tracks, true_edges(room))
    assert len(kept.warnings) == 1 and "its start is kept" in kept.warnings[0]
    angles_deg, offsets = errors(room, kept.planes)
    assert angles_deg.max() < 0.5 and np.abs(offsets).max() < 0.02


@pytest.mark.parametrize("push_px", [10.0, 1e3, 1e5])
def test_no_track_moves_a_plane_without_bound(room: Room, push_px: float) -> None:
    """One track in a hundred anywhere: the planes stay where they are, however far that is."""
    tracks = make_tracks(room, rng())
    before, _ = errors(room, solve(room, tracks).planes)
    key = np.array(KEY_FRAMES)[tracks.key_frame][tracks.track]
    wrong = (tracks.track % 100 == 0) & (tracks.frame != key)
    points_px = tracks.points_px.copy()
    points_px[wrong] += push_px * rng(1).normal(size=(np.count_nonzero(wrong), 2))
    angles_deg, offsets = errors(room, solve(room, replace(tracks, points_px=points_px)).planes)
    assert np.abs(angles_deg - before).max() < 0.1
    assert np.abs(offsets).max() < 0.01


def at_infinity(room: Room, tracks: Tracks, far: BoolArray) -> FloatArray:
    """(M, 2) positions, those of tracks ``far`` as if their points were infinitely far away."""
    cameras = [frame.camera for frame in room.scene.frames]
    points_px = tracks.points_px.copy()
    for n in np.nonzero(far)[0]:
        own = np.nonzero(tracks.track == n)[0]
        key = KEY_FRAMES[tracks.key_frame[n]]
        start = np.append(points_px[own[tracks.frame[own] == key][0]], 1.0)
        turns = [infinite_homography(cameras[key], cameras[f]) @ start for f in tracks.frame[own]]
        points_px[own] = [turn[:2] / turn[2] for turn in turns]
    return points_px


@pytest.mark.parametrize("count", [2, 4])
def test_however_many_walls_there_are_the_others_count_as_one(count: int) -> None:
    """One wall is turned by .1 radians: the sum over its pairs is that of two pairs, shared among the others."""
    room = make_room(orbit(), KEY_FRAMES)
    evidence, truth, _ = known(room, make_tracks(room, rng(), sigma_px=0.0))
    some = [i for i, instance in enumerate(room.instances) if instance.label == "wall"][:count]
    wall = np.isin(np.arange(len(room.instances)), some)
    bare = replace(
        evidence,
        edges=(),
        track_instance=np.full_like(evidence.track_instance, -1),
        wall=wall,
        perpendicular=np.zeros_like(evidence.perpendicular),
    )
    turned_planes = turned(truth, some[0], np.rad2deg(0.1), np.zeros(3))
    before, after = (cost_of(bare, planes, CONFIG).total for planes in (truth, turned_planes))
    odd = (np.sin(0.1) / CONFIG.sigma_perpendicularity) ** 2
    assert after - before == pytest.approx(2 * float(cauchy_loss(np.array(odd), CONFIG.right_angle_cauchy)), rel=1e-3)
