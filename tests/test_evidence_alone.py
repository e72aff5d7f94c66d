"""What each kind of evidence says alone: the rows written out, its calibration, and evidence that contradicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dense_rows import dense
from test_uncertainty import PLAIN, Truth, drawn, exact

from gtlayout.geometry.similarity import Similarity
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.dominant_evidence import offset_gradient
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.evidence_alone import evidence_alone
from gtlayout.planes.linear_system import EDGE, OFFSET, PRIOR, SHARED_DEPTH, TRACK
from gtlayout.planes.linearisation import linearise
from gtlayout.planes.trail import EvidenceAlone, PlaneTrail
from gtlayout.planes.uncertainty import plane_uncertainty, robust_scales
from gtlayout.scene import FloatArray
from simulated.simulated_room import box_faces, make_room, orbit

TRACKS, EDGES, ANGLES = "tracks", "contact edges", "right angles"


@pytest.fixture(scope="module")
def truth() -> Truth:
    # Without right angles, which would be exact.
    return exact(
        make_room(orbit(), [1, 4, 7, 10, 13, 16, 19], [replace(face, label="slanted") for face in box_faces()])
    )


def trails(
    truth: Truth, evidence: Evidence, config: EstimationConfig | None = None, planes: FloatArray | None = None
) -> tuple[PlaneTrail, ...]:
    at = truth.planes if planes is None else planes
    return plane_uncertainty(truth.tracks, evidence, at, config or EstimationConfig()).trails


def of_kind(trail: PlaneTrail, kind: str) -> EvidenceAlone:
    return next(one for one in trail.alone if one.kind == kind)


@pytest.mark.parametrize(("kind", "families"), [(TRACKS, [TRACK, SHARED_DEPTH]), (EDGES, [EDGE, OFFSET])])
def test_a_kind_alone_is_its_rows_written_out(truth: Truth, kind: str, families: list[int]) -> None:
    """Plane 2 by the rows of one kind and its prior, and what one σ of the others and of the cameras adds."""
    plane, count = 2, len(truth.planes)
    linear = linearise(truth.tracks, drawn(truth, 0), truth.planes, np.arange(count), PLAIN)
    covariance, scale, _ = robust_scales(linear, PLAIN.uncertainty)
    family = np.repeat(linear.family, linear.size)
    cameras = np.where(family == TRACK, 0.5, 0.0)[:, None]
    by_offset = np.array([offset_gradient(truth.planes[s], drawn(truth, 0).views[s]) for s in range(count)])
    alone = evidence_alone(linear, scale, covariance, cameras, by_offset, PLAIN.uncertainty)[plane]
    found = next(one for one in alone if one.kind == kind)

    own, others = np.arange(3 * plane, 3 * plane + 3), np.delete(np.arange(3 * count), np.s_[3 * plane : 3 * plane + 3])
    rows = dense(linear.rows)
    kept = np.isin(family, families) | (family == PRIOR)
    weight = np.where(kept, scale[family] ** -2.0, 0.0)
    # Rows between other planes only would pin biases of theirs: they say nothing of this one.
    free = np.concatenate([own, np.arange(3 * count, rows.shape[1])])
    free = free[(np.abs(rows[kept][:, free]) > 0).any(axis=0)]
    gain = np.linalg.solve(rows[:, free].T @ (weight[:, None] * rows[:, free]), rows[:, free].T * weight)[:3]
    spread = gain @ np.diag(np.where(weight > 0, 1 / np.maximum(weight, 1e-12), 0)) @ gain.T
    by_others = gain @ rows[:, others]
    spread += by_others @ covariance[np.ix_(others, others)] @ by_others.T + (gain @ cameras) @ (gain @ cameras).T
    assert found.sigma_offset == pytest.approx(float(np.sqrt(by_offset[plane] @ spread @ by_offset[plane])), rel=1e-4)
    sigma_normal = np.rad2deg(np.sqrt(np.linalg.eigvalsh(spread[:2, :2])[-1]))
    assert found.sigma_normal_deg == pytest.approx(float(sigma_normal), rel=1e-4)
    step = gain @ linear.target
    assert found.offset == pytest.approx(float(-by_offset[plane] @ step), rel=1e-3, abs=1e-6)
    assert found.tilt_deg == pytest.approx(float(np.rad2deg(np.linalg.norm(step[:2]))), rel=1e-3)
    main = linear.first[linear.family == families[0]]
    touches = np.abs(rows[:, own]).sum(axis=1) > 0
    assert found.measurements == np.count_nonzero(touches[main])


def test_evidence_that_is_as_good_as_it_says_agrees(truth: Truth) -> None:
    alone = [one for seed in range(12) for trail in trails(truth, drawn(truth, seed)) for one in trail.alone]
    assert {one.kind for one in alone} == {TRACKS, EDGES}
    assert all(one.freedom == 3 for one in alone)
    assert 2 < np.mean([one.chi2 for one in alone]) < 4, "3 is expected"
    # Scales are estimated, so that a little more than 1 in 100 differ.
    assert np.mean([bool(one.agrees) for one in alone]) > 0.9


def test_tracks_that_lie_nearer_are_told_with_where_they_lie(truth: Truth) -> None:
    """All tracks of one plane by an eighth nearer: a mirror, or a scale that drifts."""
    evidence, plane = drawn(truth, 0), 1
    rho = np.where(evidence.track_instance == plane, 1.14 * evidence.rays.rho, evidence.rays.rho)
    nearer = trails(truth, replace(evidence, rays=replace(evidence.rays, rho=rho)))
    usual, found = of_kind(trails(truth, evidence)[plane], TRACKS), of_kind(nearer[plane], TRACKS)
    center = evidence.views[plane].center
    distance = float(np.median(np.abs(center @ truth.planes[plane, :3] + truth.planes[plane, 3])))
    assert found.offset - usual.offset == pytest.approx(0.12 * distance, rel=0.5), "towards the cameras"
    assert usual.agrees is True
    assert found.agrees is False
    # Two kinds: either may be wrong, and both are said to differ. The other planes are not blamed.
    assert of_kind(nearer[plane], EDGES).agrees is False
    assert abs(of_kind(nearer[plane], EDGES).offset) < 0.4 * found.offset
    others = [bool(one.agrees) for s, trail in enumerate(nearer) if s != plane for one in trail.alone]
    assert np.mean(others) > 0.8
    middle = nearer[plane].middle
    assert truth.planes[plane, :3] @ middle + truth.planes[plane, 3] == pytest.approx(0, abs=1e-9)


def test_what_the_solution_outvotes_speaks_alone(truth: Truth) -> None:
    """A third of the tracks far off: alone they still put the plane where most lie."""
    evidence, plane = drawn(truth, 0), 0
    own = np.nonzero(evidence.track_instance == plane)[0]
    rho = evidence.rays.rho.copy()
    rho[own[::3]] *= 1.5
    usual = of_kind(trails(truth, evidence)[plane], TRACKS)
    found = of_kind(trails(truth, replace(evidence, rays=replace(evidence.rays, rho=rho)))[plane], TRACKS)
    distance = 1 / float(np.median(evidence.rays.rho[own]))
    assert abs(found.offset - usual.offset) < 0.1 * distance
    assert found.measurements <= usual.measurements


def test_one_edge_does_not_place_a_plane(truth: Truth) -> None:
    evidence = drawn(truth, 0)
    pair = next(group.instances for group in evidence.edges if 3 in group.instances)
    single = evidence.without({group.instances for group in evidence.edges if 3 in group.instances} - {pair})
    found = of_kind(trails(truth, single)[3], EDGES)
    assert np.isnan(found.tilt_deg) and np.isnan(found.sigma_normal_deg)
    assert found.freedom == 2, "it may turn about the edge"


def test_nothing_to_compare_with_is_said(truth: Truth) -> None:
    bare = replace(drawn(truth, 0), edges=())
    for trail in trails(truth, bare):
        (only,) = trail.alone
        assert (only.kind, only.freedom, only.agrees) == (TRACKS, 0, None)
        assert np.isnan(only.chi2)
        assert np.isfinite(only.offset)
    planes = truth.planes.copy()
    planes[1] = np.nan
    absent = trails(truth, drawn(truth, 0), planes=planes)[1]
    assert absent.alone == ()
    assert np.isnan(absent.middle).all()


@pytest.mark.parametrize(("freedom", "limit"), [(1, 6.635), (2, 9.21), (3, 11.345)])
def test_agreement_is_at_99_percent(freedom: int, limit: float) -> None:
    one = EvidenceAlone(TRACKS, 1, 0.0, 1.0, 0.0, 1.0, limit - 0.01, freedom)
    assert one.agrees is True
    assert replace(one, chi2=limit + 0.01).agrees is False


def test_in_another_unit_lengths_are_others_and_angles_the_same() -> None:
    local = Similarity(np.eye(3), np.array([1.0, 2.0, 3.0]), 4.0)
    one = EvidenceAlone(TRACKS, 7, 0.4, 0.8, 1.0, 2.0, 3.0, 3)
    world = PlaneTrail(np.array([4.0, 0.0, 8.0]), (one,)).to_world(local)
    np.testing.assert_allclose(world.middle, [2, 2, 5])
    assert world.alone == (replace(one, offset=0.1, sigma_offset=0.2),)
