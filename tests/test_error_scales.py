"""How scales of errors are estimated, and what holds a plane: on systems small enough to be worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dense_rows import dense

from gtlayout.camera_errors.camera_response import CameraResponse
from gtlayout.instances import EvidenceKind
from gtlayout.planes import uncertainty
from gtlayout.planes.arrow import Tree
from gtlayout.planes.arrow_rows import Rows
from gtlayout.planes.config import EstimationConfig, UncertaintyConfig
from gtlayout.planes.dominant_evidence import dominant_evidence
from gtlayout.planes.evidence import gather
from gtlayout.planes.linear_system import EDGE, JOINT, PRIOR, LinearSystem
from gtlayout.scene import FloatArray
from gtlayout.tracking.normalisation import Normalisation
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import make_tracks, measurements

NONE = np.empty(0, dtype=np.int64)


def system(planes: int, measurements: list[tuple[int, int, FloatArray, FloatArray]]) -> LinearSystem:
    """Measurements of single planes: (family, plane, (m, 3) derivative, (m,) target)."""
    plane = np.concatenate([np.full(len(target), p) for _, p, _, target in measurements])
    by_plane = np.concatenate([derivative for _, _, derivative, _ in measurements])
    jacobian = np.stack([by_plane, np.zeros_like(by_plane)], axis=1)
    sizes = [len(target) for _, _, _, target in measurements]
    return LinearSystem(
        Rows(
            Tree(planes, NONE, NONE, NONE.reshape(0, 2)),
            np.column_stack([plane, plane]),
            jacobian,
            NONE,
            NONE,
            np.empty((0, 3)),
        ),
        np.concatenate([target for _, _, _, target in measurements]),
        np.array([family for family, _, _, _ in measurements]),
        np.cumsum([0, *sizes[:-1]]),
        np.full(len(plane), -1),
        np.full(len(plane), np.nan),
    )


def test_a_measurement_weighs_as_the_student_t_of_its_size_has_it() -> None:
    """At the fixed point its weight is (ν + m) / (ν + |r|² / s²) / s² for its m rows together, s their scale."""
    rng = np.random.default_rng(0)
    edges = [(EDGE, 0, rng.normal(size=(m, 3)), 3 * rng.normal(size=m)) for m in [1, 2, 3] * 20]
    prior = (PRIOR, 0, np.eye(3) / 100, np.zeros(3))
    linear, config = system(1, [*edges, prior]), replace(UncertaintyConfig(), rounds=300)
    covariance, scale, row_weight = uncertainty.robust_scales(linear, config)
    jacobian = dense(linear.rows)
    residual = jacobian @ covariance @ jacobian.T @ (row_weight * linear.target) - linear.target
    errors = np.add.reduceat(residual**2, linear.first)[:-1]
    sizes = np.diff(linear.first)
    expected = (8 + sizes) / (8 + errors / scale[EDGE] ** 2) / scale[EDGE] ** 2
    np.testing.assert_allclose(row_weight[linear.first[:-1]], expected, rtol=1e-9)
    assert row_weight[-1] == 1.0
    assert 2.0 < scale[EDGE] < 4.0


def test_few_residuals_hardly_move_a_scale_from_what_is_expected() -> None:
    one = system(1, [(EDGE, 0, np.zeros((1, 3)), np.array([10.0])), (PRIOR, 0, np.eye(3), np.zeros(3))])
    config = replace(UncertaintyConfig(), rounds=1)
    _, scale, _ = uncertainty.robust_scales(one, config)
    # One residual of ten, weighed (8 + 1) / (8 + 100), and six of the expected size.
    assert scale[EDGE] == pytest.approx(np.sqrt((9 / 108 * 100 + 6) / (1 + 6)))


def test_cameras_that_are_off_move_all_planes_together() -> None:
    """Every depth 2 % larger about a camera that does not move: the room grows, and no residual shows it."""
    room = make_room(orbit(), [3, 10, 17])
    tracks = make_tracks(room, np.random.default_rng(0))
    measured = measurements(room, tracks)
    shrunk = CameraResponse(np.full((len(tracks), 1), -0.02), np.zeros((3, 1, 3)), np.zeros((3, 1, 3)))
    local, config = Normalisation.of(measured.rays), EstimationConfig()
    planes = room.planes.copy()
    planes[:, 3] = local.scale * (planes[:, 3] + planes[:, :3] @ local.origin)
    plain, moved = (
        uncertainty.plane_uncertainty(tracks, gather(case, local, config), planes, config).covariance
        for case in (measured, replace(measured, camera_response=shrunk))
    )
    added = moved - plain
    assert np.linalg.matrix_rank(added, tol=1e-6 * np.abs(added).max()) == 1
    sigma_d = np.sqrt(np.diag(added)[3::4])
    # From cameras within some decimetres of the middle, each wall moves by 2 % of its distance from them.
    distance = np.abs(planes[:, :3] @ (local.scale * (center_of(room) - local.origin)) + planes[:, 3])
    np.testing.assert_allclose(sigma_d, 0.02 * distance, rtol=0.35)


@pytest.mark.parametrize(("left", "holds"), [(0.3, "contact edges"), (0.45, "contact edges"), (0.6, "priors")])
def test_a_plane_is_known_when_measurements_halve_what_priors_leave(left: float, holds: EvidenceKind) -> None:
    edge = (EDGE, 0, np.eye(3) * np.sqrt(1 / left**2 - 1), np.zeros(3))
    linear = system(1, [edge, (PRIOR, 0, np.eye(3), np.zeros(3))])
    found = dominant_evidence(linear, np.ones(len(linear.target)), np.array([[0.0, 0.0, 1.0]]))
    assert found == [holds]


@pytest.mark.parametrize(("angles", "holds"), [(3.0, "right angles"), (1.2, "contact edges")])
def test_a_plane_rests_on_the_weaker_kind_when_its_loss_hurts_clearly_more(angles: float, holds: EvidenceKind) -> None:
    """Neither kind is needed to know the plane; what counts is how much larger σ is without one."""
    families = [(EDGE, 0, 10 * np.eye(3), np.zeros(3)), (JOINT, 0, 10 * angles * np.eye(3), np.zeros(3))]
    linear = system(1, [*families, (PRIOR, 0, np.eye(3), np.zeros(3))])
    found = dominant_evidence(linear, np.ones(len(linear.target)), np.array([[0.0, 0.0, 1.0]]))
    assert found == [holds]


def center_of(room: Room) -> FloatArray:
    """(3,) amid the cameras of the key frames."""
    key_frames = range(len(room.scene.key_frames))
    return np.mean([room.scene.frame_of(k).camera.center_world for k in key_frames], axis=0)
