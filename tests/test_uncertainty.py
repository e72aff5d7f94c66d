"""Covariances against truth that is drawn from the model: scales of errors are found, ellipsoids hold what they should.

Evidence is made directly: inverse depths with biases of key frames and surfaces, edges as a hand draws them. Planes are
linearised at the truth, so that the step of the linear system is the error of an estimate.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
import pytest
from dense_rows import dense

from common.consistency import coverage, nees
from gtlayout.edges import ContactEdge
from gtlayout.instances import EvidenceKind
from gtlayout.planes import uncertainty
from gtlayout.planes.config import EstimationConfig, UncertaintyConfig
from gtlayout.planes.evidence import Evidence, gather
from gtlayout.planes.linearisation import linearise
from gtlayout.planes.starts import polish
from gtlayout.planes.uncertainty import error_scales, plane_uncertainty
from gtlayout.scene import FloatArray
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_edges import jitter, true_edges
from simulated.simulated_room import Room, box_faces, make_room, orbit
from simulated.simulation import make_tracks, measurements, true_instance

RELATIVE_SIGMA = 0.003
"""σ of a track's depth as a share of depth."""
PLAIN = EstimationConfig(uncertainty=UncertaintyConfig(prior_measurements=0.0, rounds=20, student_freedom=1e6))
"""Scales are what residuals say, nothing else."""


@dataclass(frozen=True)
class Truth:
    """A room with exact evidence, to draw errors for."""

    room: Room
    tracks: Tracks
    edges: tuple[ContactEdge, ...]
    local: Normalisation
    planes: FloatArray
    """(S, 4) local."""

    def evidence(self, edges: Sequence[ContactEdge], config: EstimationConfig) -> Evidence:
        owner = true_instance(self.room, self.tracks)
        found = gather(measurements(self.room, self.tracks, edges), self.local, config)
        rho = -np.sum(self.planes[owner, :3] * found.rays.ray, axis=1) / (
            np.sum(self.planes[owner, :3] * found.rays.center, axis=1) + self.planes[owner, 3]
        )
        exact = replace(found.rays, rho=rho, sigma_rho=RELATIVE_SIGMA * rho)
        return replace(found, rays=exact, track_weight=np.ones(len(owner)))


@pytest.fixture(scope="module")
def truth() -> Truth:
    # Right angles would be exact, and better than the model takes them to be.
    faces = [replace(face, label="slanted") for face in box_faces()]
    room = make_room(orbit(), [1, 4, 7, 10, 13, 16, 19], faces)
    return exact(room)


def exact(room: Room) -> Truth:
    """Exact tracks, edges and planes of a room."""
    tracks = make_tracks(room, np.random.default_rng(0), per_element=20, sigma_px=0.0)
    rays = triangulate(room.scene, tracks, TriangulationConfig())
    local = Normalisation.of(rays)
    planes = room.planes.copy()
    planes[:, 3] = local.scale * (planes[:, 3] + planes[:, :3] @ local.origin)
    return Truth(room, tracks, true_edges(room), local, planes)


def drawn(
    truth: Truth,
    seed: int,
    surface: float = 1.0,
    edge: float = 1.0,
    offset: float = 1.0,
    config: EstimationConfig = PLAIN,
) -> Evidence:
    """Errors of surfaces, edges and contacts so many times as large as the model expects them."""
    rng = np.random.default_rng(seed)
    sigma_offset = offset * config.sigma_contact_offset / truth.local.scale
    offsets = {pair: sigma_offset * rng.normal(size=3) for pair in sorted({edge.instances for edge in truth.edges})}
    edges = jitter(
        true_edges(truth.room, offsets), rng, edge * config.sigma_edge_shift_px, edge * config.sigma_edge_tilt_px
    )
    evidence = truth.evidence(edges, config)
    rays, owner, expected = evidence.rays, evidence.track_instance, config.uncertainty
    rho = rays.rho.copy()
    observations = np.bincount(truth.tracks.track)
    for s, plane in enumerate(truth.planes):
        own = np.nonzero(owner == s)[0]
        points = rays.center[own] + rays.ray[own] / rays.rho[own, None]
        uv = (points - np.median(points, axis=0)) @ gtsam.Unit3(plane[:3]).basis()
        over = np.column_stack([np.ones(len(own)), uv / np.sqrt(np.mean(np.sum(uv**2, axis=1)))])
        shared = surface * expected.shared_bias_ratio * expected.relative_depth * rng.normal(size=3)
        for k in np.unique(truth.tracks.key_frame[own]):
            here = truth.tracks.key_frame[own] == k
            of_frame = surface * np.hypot(expected.relative_depth, expected.share_of_track_sigma * RELATIVE_SIGMA)
            rho[own[here]] *= 1 + over[here] @ (shared + of_frame * rng.normal(size=3))
        many = np.sqrt(np.maximum(observations[own] / config.independent_observations, 1.0))
        relief = config.sigma_relief * np.median(rays.rho[own])
        rho[own] += rays.rho[own] * np.hypot(RELATIVE_SIGMA * many, relief) * rng.normal(size=len(own))
    return replace(evidence, rays=replace(rays, rho=rho))


def sigmas(truth: Truth, evidence: Evidence, config: EstimationConfig | None = None) -> FloatArray:
    """(S,) σ of each plane's offset amid what is seen of it."""
    found = plane_uncertainty(truth.tracks, evidence, truth.planes, config or EstimationConfig())
    variances = []
    for i in range(len(truth.planes)):
        at = np.append(truth.local.scale * (truth.room.seen_center(i) - truth.local.origin), 1.0)
        variances.append(at @ found.covariance[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] @ at)
    return np.sqrt(variances)


@pytest.mark.parametrize("scale", [1 / 3, 1.0, 3.0])
def test_scales_of_errors_are_found(truth: Truth, scale: float) -> None:
    """Both at once, and neither is taken for the other."""
    found = [
        error_scales(truth.tracks, drawn(truth, seed, scale, 1 / scale, scale), truth.planes, PLAIN)
        for seed in range(3)
    ]
    assert np.mean([one.offset for one in found]) == pytest.approx(scale, rel=0.35)
    assert np.mean([one.shared_depth for one in found]) == pytest.approx(scale, rel=0.3)
    assert np.mean([one.edge for one in found]) == pytest.approx(1 / scale, rel=0.3)


def test_what_is_expected_pulls_scales_but_does_not_hold_them(truth: Truth) -> None:
    small, usual, large = (
        error_scales(truth.tracks, drawn(truth, 0, scale, scale), truth.planes, EstimationConfig())
        for scale in (1 / 3, 1.0, 3.0)
    )
    for found, low, high in ((small, 1 / 3, 0.7), (usual, 0.7, 1.3), (large, 2.0, 3.0)):
        assert low < found.shared_depth < high
        assert low < found.edge < high


def test_ellipsoids_hold_what_they_should(truth: Truth) -> None:
    """Of the optimal estimate as many as they say; of one with other weights, at twice the σ, at least that."""
    at_optimum, polished = [], []
    count = len(truth.planes)
    for seed in range(30):
        evidence = drawn(truth, seed)
        linear = linearise(truth.tracks, evidence, truth.planes, np.arange(count), PLAIN)
        covariance, _, row_weight = uncertainty.robust_scales(linear, PLAIN.uncertainty)
        jacobian = dense(linear.rows)
        gradient = jacobian.T @ (row_weight * linear.target)
        step = np.asarray(np.linalg.solve(jacobian.T @ (row_weight[:, None] * jacobian), gradient))
        planes = polish(evidence, truth.planes, PLAIN)
        for s in range(count):
            own = slice(3 * s, 3 * s + 3)
            at_optimum.append(nees(step[own], covariance[own, own]))
            error = gtsam.OrientedPlane3(truth.planes[s]).errorVector(gtsam.OrientedPlane3(planes[s]))
            polished.append(nees(error, 2**2 * covariance[own, own]))
    share = coverage(np.array(at_optimum), 0.95)
    assert share.low < 0.95 < share.high
    assert 2.3 < np.mean(at_optimum) < 3.7, "3 is expected"
    assert coverage(np.array(polished), 0.95).value >= 0.95


def test_more_errors_mean_less_certainty(truth: Truth) -> None:
    usual = sigmas(truth, drawn(truth, 0))
    assert (sigmas(truth, drawn(truth, 0, surface=3.0)) > 1.5 * usual).all()
    # What all key frames share limits what edges say in any case: it is small here.
    exact = sigmas(truth, drawn(truth, 0, offset=0.1))
    assert np.mean(sigmas(truth, drawn(truth, 0, edge=3.0, offset=0.1)) / exact) > 1.01
    assert np.mean(sigmas(truth, drawn(truth, 0, offset=3.0)) / usual) > 1.02


def test_fewer_points_and_points_that_hardly_survive_mean_less_certainty(truth: Truth) -> None:
    evidence = replace(drawn(truth, 0), edges=())
    usual, owner = sigmas(truth, evidence), evidence.track_instance
    dropped = (owner == 0) & (np.arange(len(owner)) % 50 > 0)
    few = sigmas(truth, replace(evidence, track_instance=np.where(dropped, -1, owner)))
    assert few[0] > 1.2 * usual[0]
    glossy = sigmas(truth, replace(evidence, track_weight=np.where(owner == 0, 0.05, 1.0)))
    assert glossy[0] > 2 * usual[0]


def test_gross_errors_hardly_matter_and_never_make_sure(truth: Truth) -> None:
    evidence = drawn(truth, 0)
    usual = sigmas(truth, evidence)
    cluster = (evidence.track_instance == 0) & (truth.tracks.key_frame == 3)
    rho = np.where(cluster, 0.7 * evidence.rays.rho, evidence.rays.rho)
    edges = list(evidence.edges)
    edges[5] = replace(edges[5], points_px=edges[5].points_px + 60.0)
    for wrong in (
        replace(evidence, rays=replace(evidence.rays, rho=rho)),
        replace(evidence, edges=tuple(edges)),
    ):
        ratio = sigmas(truth, wrong) / usual
        assert (ratio > 0.95).all() and (ratio < 1.15).all()


def test_covariances_are_of_planes_and_absent_ones_have_none(truth: Truth) -> None:
    planes = truth.planes.copy()
    planes[1] = np.nan
    evidence = drawn(truth, 0)
    found = plane_uncertainty(truth.tracks, evidence, planes, EstimationConfig())
    blocks = found.covariance.reshape(len(planes), 4, len(planes), 4)
    assert np.isnan(blocks[1]).all() and np.isnan(blocks[:, :, 1]).all()
    present = np.repeat(np.arange(len(planes)) != 1, 4)
    joint = found.covariance[np.ix_(present, present)]
    np.testing.assert_allclose(joint, joint.T, rtol=1e-9, atol=1e-15)
    assert np.linalg.eigvalsh(joint).min() > -1e-12
    for s in (0, 2, 3):
        np.testing.assert_allclose(blocks[s, :3, s, :3] @ planes[s, :3], 0, atol=1e-12)
        assert np.linalg.matrix_rank(blocks[s, :, s], tol=1e-10) == 3
    assert found.dominant_evidence[1] == "" and "" not in np.delete(found.dominant_evidence, 1)


def test_covariances_are_those_of_the_system_written_out(truth: Truth) -> None:
    linear = linearise(truth.tracks, drawn(truth, 0), truth.planes, np.arange(len(truth.planes)), PLAIN)
    covariance, _, row_weight = uncertainty.robust_scales(linear, PLAIN.uncertainty)
    jacobian = dense(linear.rows)
    written = np.linalg.inv(jacobian.T @ (row_weight[:, None] * jacobian))[: len(covariance), : len(covariance)]
    sigma = np.sqrt(np.diag(written))
    np.testing.assert_allclose(covariance / np.outer(sigma, sigma), written / np.outer(sigma, sigma), atol=1e-10)


def test_memory_grows_with_key_frames_and_not_with_their_square() -> None:
    peaks = []
    for count in (10, 20):
        room = exact(make_room(orbit(), np.linspace(0, 20, count).round().astype(int).tolist()))
        evidence = drawn(room, 0)
        tracemalloc.start()
        plane_uncertainty(room.tracks, evidence, room.planes, EstimationConfig())
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2.2 * peaks[0]


def test_the_same_evidence_gives_the_same_bytes(truth: Truth) -> None:
    evidence = drawn(truth, 0)
    a, b = (plane_uncertainty(truth.tracks, evidence, truth.planes, EstimationConfig()) for _ in range(2))
    assert a.covariance.tobytes() == b.covariance.tobytes()
    assert a.dominant_evidence == b.dominant_evidence
    assert repr(a.trails) == repr(b.trails)


@pytest.fixture(scope="module")
def box() -> Truth:
    return exact(make_room(orbit(), [2, 6, 10, 14, 18]))


@pytest.mark.parametrize(
    ("tracks", "neighbours", "expected"),
    [
        (True, ("floor", "ceiling", "wall"), "tracks"),
        (False, ("floor", "ceiling", "wall"), "contact edges"),
        (False, ("floor", "ceiling"), "contact edges"),
        # One edge tells where it stands, but not how far it is turned about that.
        (False, ("floor",), "right angles"),
        (False, ("wall",), "right angles"),
        (False, (), "priors"),
    ],
)
def test_what_a_wall_rests_on(box: Truth, tracks: bool, neighbours: tuple[str, ...], expected: EvidenceKind) -> None:
    labels = [instance.label for instance in box.room.instances]
    wall, *others = range(len(labels))
    evidence = drawn(box, 0)
    edges = [g for g in evidence.edges if wall not in g.instances or labels[g.other(wall)] in neighbours]
    surface = (
        evidence.track_instance if tracks else np.where(evidence.track_instance == wall, -1, evidence.track_instance)
    )
    apart = replace(evidence, track_instance=surface, edges=tuple(edges))
    held = plane_uncertainty(box.tracks, apart, box.planes, EstimationConfig()).dominant_evidence
    assert labels[wall] == "wall"
    assert held[wall] == expected
    assert [held[s] for s in others] == ["tracks"] * len(others)


def test_a_window_in_its_wall_rests_on_what_the_wall_rests_on(box: Truth) -> None:
    evidence = drawn(box, 0)
    one, two = (s for s, instance in enumerate(box.room.instances) if instance.label == "wall")
    # The second wall taken for a window of the first, in its plane and without tracks or edges of its own.
    planes = box.planes.copy()
    planes[two] = planes[one]
    views = list(evidence.views)
    views[two] = views[one]
    host = np.where(np.arange(len(planes)) == two, one, -1)
    inside = replace(
        evidence,
        views=tuple(views),
        host=host,
        wall=evidence.wall & (host < 0),
        perpendicular=evidence.perpendicular & np.outer(host < 0, host < 0),
        edges=tuple(group for group in evidence.edges if two not in group.instances),
        track_instance=np.where(evidence.track_instance == two, -1, evidence.track_instance),
    )
    held = plane_uncertainty(box.tracks, inside, planes, EstimationConfig()).dominant_evidence
    assert held[one] == held[two] == "tracks"
