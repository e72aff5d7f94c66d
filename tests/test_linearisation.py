"""The noise that the linear system behind σ is whitened with, read off its rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.evidence import Evidence, gather
from gtlayout.planes.linear_system import SHARED_DEPTH, TRACK, LinearSystem
from gtlayout.planes.linearisation import linearise
from gtlayout.scene import FloatArray
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import make_tracks, measurements

CONFIG = EstimationConfig()
WALL = 2


@pytest.fixture(scope="module")
def room() -> Room:
    return make_room(orbit(), [3, 10, 17])


@pytest.fixture(scope="module")
def tracks(room: Room) -> Tracks:
    return make_tracks(room, np.random.default_rng(0))


def system_of_one_wall(
    room: Room, tracks: Tracks, config: EstimationConfig = CONFIG, weight: float | None = None
) -> tuple[LinearSystem, Evidence, FloatArray]:
    """The system with the tracks of one wall only, its evidence, and (n,) the depths of its tracks."""
    measured = measurements(room, tracks)
    local = Normalisation.of(measured.rays)
    evidence = gather(measured, local, config)
    if weight is not None:
        evidence = replace(evidence, track_weight=np.where(evidence.track_weight > 0, weight, 0.0))
    planes = np.full((len(room.instances), 4), np.nan)
    planes[WALL] = room.planes[WALL]
    planes[WALL, 3] = local.scale * (planes[WALL, 3] + planes[WALL, :3] @ local.origin)
    index = np.nonzero((evidence.track_instance == WALL) & (evidence.track_weight > 0))[0]
    _, depth = evidence.on_planes(index, planes[WALL])
    return linearise(tracks, evidence, planes, np.array([WALL]), config), evidence, depth


def track_sigmas(linear: LinearSystem) -> FloatArray:
    """(n,) relative σ of depth of each track: the bias is added to it one to one."""
    family = np.repeat(linear.family, linear.size)
    sigmas: FloatArray = 1 / np.abs(linear.rows.jacobian[family == TRACK, 1, 0])
    return sigmas


def bias_sigmas(linear: LinearSystem) -> tuple[float, FloatArray]:
    """σ of the bias that all key frames share, and of what is added to it in each."""
    family = np.repeat(linear.family, linear.size)
    diagonal = np.abs(linear.rows.jacobian[family == SHARED_DEPTH])
    sigmas = 1 / diagonal.max(axis=(1, 2))
    return float(sigmas[0]), sigmas[3::3]


def test_a_track_has_its_own_error_as_far_as_its_observations_are_independent_and_the_relief(
    room: Room, tracks: Tracks
) -> None:
    linear, evidence, depth = system_of_one_wall(room, tracks)
    index = np.nonzero((evidence.track_instance == WALL) & (evidence.track_weight > 0))[0]
    observations = np.bincount(tracks.track)[index]
    assert observations.min() < 3 * CONFIG.independent_observations < observations.max()
    own = evidence.rays.sigma_rho[index] * depth * np.sqrt(np.maximum(observations / 3.0, 1.0))
    expected = np.hypot(own, 0.01 / np.median(depth))
    np.testing.assert_allclose(np.sort(track_sigmas(linear)), np.sort(expected), rtol=1e-6)
    # Both parts count: neither is what is left of the other.
    assert (own < 0.9 * expected).any() and (own > 0.5 * expected).any()


@pytest.mark.parametrize(("weight", "trust"), [(0.36, 0.6), (1e-6, 0.1)])
def test_biases_are_larger_the_less_an_instance_is_trusted_down_to_a_limit(
    room: Room, tracks: Tracks, weight: float, trust: float
) -> None:
    linear, evidence, depth = system_of_one_wall(room, tracks, weight=weight)
    index = np.nonzero(evidence.track_instance == WALL)[0]
    raw, key_frame = evidence.rays.sigma_rho[index] * depth, evidence.track_key_frame[index]
    shared, own = bias_sigmas(linear)
    assert shared == pytest.approx(1.4 * 0.006 / trust)
    expected = [np.hypot(0.006, 0.3 * np.median(raw[key_frame == k])) / trust for k in range(3)]
    np.testing.assert_allclose(own, expected)


def test_rows_of_tracks_are_relative_errors_of_depth(room: Room, tracks: Tracks) -> None:
    """Target: how much deeper than its plane a track is, as a share of the depth, in σ."""
    linear, evidence, depth = system_of_one_wall(room, tracks)
    family = np.repeat(linear.family, linear.size)
    index = np.nonzero((evidence.track_instance == WALL) & (evidence.track_weight > 0))[0]
    by_key_frame = np.argsort(evidence.track_key_frame[index], kind="stable")
    relative = (evidence.rays.rho[index] * depth - 1)[by_key_frame]
    np.testing.assert_allclose(-linear.target[family == TRACK] * track_sigmas(linear), relative, rtol=1e-6, atol=1e-9)


def test_biases_vary_over_the_plane_from_its_middle_in_units_of_the_spread(room: Room, tracks: Tracks) -> None:
    linear, _, _ = system_of_one_wall(room, tracks)
    family = np.repeat(linear.family, linear.size)
    over = linear.rows.jacobian[family == TRACK, 1] * track_sigmas(linear)[:, None]
    over *= np.sign(over[:, :1])
    np.testing.assert_allclose(over[:, 0], 1.0)
    np.testing.assert_allclose(np.median(over[:, 1:], axis=0), 0.0, atol=0.05)
    assert np.mean(np.sum(over[:, 1:] ** 2, axis=1)) == pytest.approx(1.0)
