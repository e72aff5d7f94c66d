"""What holds for every factor and every map on a manifold: one suite that each inherits.

A case is built in a world, or in the same world turned and shifted; values are drawn first, so that both are the same
case. Each has its Jacobian against numeric differences, errors that do not depend on the world, and finite errors and
Jacobians at the extremes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import gtsam
import numpy as np
import numpy.typing as npt
import pytest
from gtsam.symbol_shorthand import B, C, L, O, P
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gtlayout.factors import (
    EdgeView,
    biased_depth_factor,
    coplanarity_factor,
    cylinder_edge_factor,
    cylinder_track_factor,
    depth_factor,
    edge_factor,
    perpendicularity_factor,
    plane_prior_factor,
    track_factor,
)
from gtlayout.geometry.similarity import Similarity

FloatArray = npt.NDArray[np.float64]
STEP = 1e-6
K = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])


@dataclass(frozen=True)
class Motion:
    """X_moved = R X + t."""

    R: FloatArray = field(default_factory=lambda: np.eye(3))
    t: FloatArray = field(default_factory=lambda: np.zeros(3))

    def points(self, points: FloatArray) -> FloatArray:
        return points @ self.R.T + self.t

    def plane(self, plane: FloatArray) -> FloatArray:
        normal = self.R @ plane[:3]
        return np.append(normal, plane[3] - normal @ self.t)

    def projection(self, R_cam_from_world: FloatArray, center: FloatArray) -> FloatArray:
        R = R_cam_from_world @ self.R.T
        return K @ np.column_stack([R, -R @ self.points(center)])


STAY = Motion()
MOVE = Motion(gtsam.Rot3.RzRyRx(0.4, -1.1, 2.0).matrix(), np.array([3.0, -7.0, 11.0]))


def unit(rng: np.random.Generator) -> FloatArray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def values_of(planes: list[FloatArray], points: dict[int, FloatArray] | None = None) -> gtsam.Values:
    values = gtsam.Values()
    for i, plane in enumerate(planes):
        values.insert(P(i), gtsam.OrientedPlane3(plane))
    for key, point in (points or {}).items():
        values.insertPoint3(key, point)
    return values


LENGTHS = st.one_of(st.just(0.0), st.builds(lambda e, s: s * 10.0**e, st.integers(-12, 8), st.sampled_from((-1, 1))))
"""World units, of any order."""
NORMALS = st.tuples(*[st.one_of(st.sampled_from((0.0, 1.0, -1.0, 1e-9)), st.floats(-1, 1))] * 3).filter(
    lambda normal: np.linalg.norm(normal) > 1e-6
)
POINTS = st.sampled_from([(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (-0.3, -0.3, -0.3), (0.3, -0.2, 0.5)])
"""The origin, and where ``Same`` puts points and camera centres."""


def plane_through(normal: tuple[float, ...], point: tuple[float, ...], beside: float) -> FloatArray:
    n = np.array(normal) / np.linalg.norm(normal)
    return np.append(n, beside - n @ point)


PLANES = st.builds(plane_through, NORMALS, POINTS, LENGTHS)


class Same(np.random.Generator):
    """All that is drawn is the same: points coincide."""

    def normal(self, *_: Any, size: Any = None, **__: Any) -> Any:
        return np.ones(size or ())

    def uniform(self, low: Any = 0.0, _: Any = 1.0, size: Any = None) -> Any:
        return np.full(size or (), low)


class FactorSuite(ABC):
    """``build`` gives a factor, and values with so many ``planes``.

    ``groups`` are the rows whose norm does not depend on the axes of the world.
    """

    planes: ClassVar[int] = 1
    groups: ClassVar[tuple[slice, ...]] = (slice(None),)
    extremes: ClassVar[tuple[tuple[float, ...], ...]] = (
        (0.0, 0.0, 1.0, 0.0),  # through the origin, where cameras are
        (0.0, 0.0, 1.0, 1e6),
        (0.0, 0.0, -1.0, 1e-9),
        (1.0, 0.0, 0.0, -1e6),
    )

    sizes: ClassVar[dict[int, int]] = {}
    """Of variables that are not 3-D."""

    def step(self, other: int, key: int, sign: int, axis: int) -> FloatArray:
        step = np.zeros(self.sizes.get(other, 3))
        step[axis if other == key else 0] = sign * STEP * (other == key)
        return step

    @abstractmethod
    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        """The case that these draws make, in the world so moved."""

    def at(
        self, rng: np.random.Generator, planes: list[FloatArray], motion: Motion = STAY
    ) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        """The same factor at other planes."""
        factor, values = self.build(rng, motion)
        for i, plane in enumerate(planes):
            values.update(P(i), gtsam.OrientedPlane3(plane))
        return factor, values

    @pytest.mark.parametrize("seed", range(5))
    def test_jacobian_is_the_numeric_one(self, seed: int) -> None:
        factor, values = self.build(np.random.default_rng(seed), STAY)
        jacobian, _ = factor.linearize(values).jacobian()
        keys = list(factor.keys())
        columns = []
        for key in keys:
            size = self.sizes.get(key, 3)
            for axis in range(size):
                errors = []
                for sign in (1, -1):
                    delta = gtsam.VectorValues()
                    for other in keys:
                        delta.insert(other, self.step(other, key, sign, axis))
                    errors.append(factor.whitenedError(values.retract(delta)))
                columns.append((errors[0] - errors[1]) / (2 * STEP))
        np.testing.assert_allclose(jacobian, np.array(columns).T, rtol=1e-6, atol=1e-6 * np.abs(jacobian).max())

    @pytest.mark.parametrize("seed", range(5))
    def test_the_world_does_not_matter(self, seed: int) -> None:
        here, there = (self.build(np.random.default_rng(seed), motion) for motion in (STAY, MOVE))
        errors = [factor.whitenedError(values) for factor, values in (here, there)]
        for group in self.groups:
            np.testing.assert_allclose(
                np.linalg.norm(errors[0][group]), np.linalg.norm(errors[1][group]), rtol=1e-7, atol=1e-9
            )

    def test_it_is_finite_at_the_extremes(self) -> None:
        for plane in self.extremes:
            for other in self.extremes:
                factor, values = self.at(np.random.default_rng(0), [np.array(plane), np.array(other)][: self.planes])
                jacobian, right = factor.linearize(values).jacobian()
                assert np.isfinite(factor.whitenedError(values)).all(), (plane, other)
                assert np.isfinite(jacobian).all() and np.isfinite(right).all(), (plane, other)

    @settings(
        max_examples=60,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=[HealthCheck.differing_executors],
    )
    @given(seed=st.none() | st.integers(0, 99), first=PLANES, second=PLANES, away=LENGTHS, parallel=st.booleans())
    def test_it_is_finite_wherever_the_planes_are(
        self, seed: int | None, first: FloatArray, second: FloatArray, away: float, parallel: bool
    ) -> None:
        """Up to 1e8 m from the origin, parallel, through camera centres, and the wrong way round."""
        planes = [first, np.append(first[:3], second[3]) if parallel else second]
        motion = Motion(t=away * np.array([0.6, 0.0, 0.8]))
        for moved in ([motion.plane(plane) for plane in planes], planes):
            rng = Same(np.random.PCG64()) if seed is None else np.random.default_rng(seed)
            factor, values = self.at(rng, moved[: self.planes], motion)
            jacobian, right = factor.linearize(values).jacobian()
            assert np.isfinite(factor.whitenedError(values)).all()
            assert np.isfinite(jacobian).all() and np.isfinite(right).all()


def far_plane(rng: np.random.Generator) -> FloatArray:
    return np.append(unit(rng), rng.uniform(1, 3))


def rays(rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Starts, directions and inverse depths."""
    directions = np.column_stack([rng.uniform(-0.5, 0.5, (5, 2)), np.ones(5)])
    return rng.uniform(-0.3, 0.3, (5, 3)), directions, rng.uniform(0.2, 1, 5)


class TestTrack(FactorSuite):
    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        plane, points = motion.plane(far_plane(rng)), motion.points(rng.normal(size=(5, 3)))
        factor = track_factor(P(0), [L(i) for i in range(5)], rng.uniform(0.01, 0.1, 5))
        return factor, values_of([plane], {L(i): point for i, point in enumerate(points)})


class TestDepth(FactorSuite):
    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        plane, (starts, directions, rho) = motion.plane(far_plane(rng)), rays(rng)
        noise = gtsam.noiseModel.Diagonal.Sigmas(rng.uniform(0.01, 0.1, 5))
        factor = depth_factor(P(0), motion.points(starts), directions @ motion.R.T, rho, noise)
        return factor, values_of([plane])


class TestBiasedDepth(FactorSuite):
    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        plane, (starts, directions, rho) = motion.plane(far_plane(rng)), rays(rng)
        noise = gtsam.noiseModel.Diagonal.Sigmas(rng.uniform(0.01, 0.1, 5))
        bias_by = rng.normal(size=(5, 3))
        factor = biased_depth_factor((P(0), B(0)), motion.points(starts), directions @ motion.R.T, rho, bias_by, noise)
        return factor, values_of([plane], {B(0): rng.normal(size=3)})


def cylinder(rng: np.random.Generator) -> FloatArray:
    return np.concatenate([rng.normal(size=2), rng.uniform(0.5, 2, 1), rng.uniform(-0.05, 0.05, 2)])


class TestCylinderTrack(FactorSuite):
    planes = 0
    sizes: ClassVar[dict[int, int]] = {C(0): 5}

    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        axes, noise = gtsam.Rot3.RzRyRx(*rng.normal(size=3)).matrix(), gtsam.noiseModel.Isotropic.Sigma(5, 0.1)
        values = gtsam.Values()
        values.insert(C(0), cylinder(rng))
        origin, points = rng.normal(size=3), rng.normal(size=(5, 3))
        factor = cylinder_track_factor(C(0), motion.points(origin), axes @ motion.R.T, motion.points(points), noise)
        return factor, values


class TestCylinderEdge(FactorSuite):
    sizes: ClassVar[dict[int, int]] = {C(0): 5}

    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        values = values_of([motion.plane(far_plane(rng))])
        axes, noise = gtsam.Rot3.RzRyRx(*rng.normal(size=3)).matrix(), gtsam.noiseModel.Isotropic.Sigma(5, 0.1)
        values.insert(C(0), cylinder(rng))
        origin, (starts, directions, _) = rng.normal(size=3), rays(rng)
        frame = motion.points(origin), axes @ motion.R.T
        factor = cylinder_edge_factor((C(0), P(0)), *frame, motion.points(starts), directions @ motion.R.T, noise)
        return factor, values


class TestEdge(FactorSuite):
    planes = 2

    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([5.0, 2.0]))
        points_px = rng.uniform(0, 480, (2, 2))
        R, center = gtsam.Rot3.RzRyRx(0.2, -0.3, 0.1).matrix(), np.array([0.3, -0.2, 0.5])
        pair = [motion.plane(far_plane(rng)), motion.plane(far_plane(rng))]
        offset = {O(0): motion.R @ rng.uniform(-0.1, 0.1, 3)}
        return edge_factor((P(0), P(1)), O(0), EdgeView.of(points_px, motion.projection(R, center)), noise), values_of(
            pair, offset
        )


class TestPerpendicularity(FactorSuite):
    planes = 2

    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        pair = [motion.plane(far_plane(rng)), motion.plane(far_plane(rng))]
        return perpendicularity_factor((P(0), P(1)), gtsam.noiseModel.Isotropic.Sigma(1, 0.1)), values_of(pair)


class TestCoplanarity(FactorSuite):
    planes = 2
    groups = (slice(3), slice(3, 4))

    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        point = motion.points(rng.normal(size=3))
        pair = [motion.plane(far_plane(rng)), motion.plane(far_plane(rng))]
        return coplanarity_factor((P(0), P(1)), point, gtsam.noiseModel.Unit.Create(4)), values_of(pair)


class TestPrior(FactorSuite):
    # d is about the origin of the world, and so is its prior: only what turns it may change.
    groups = (slice(2),)

    def build(self, rng: np.random.Generator, motion: Motion) -> tuple[gtsam.NoiseModelFactor, gtsam.Values]:
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, 1.0, 100.0]))
        return plane_prior_factor(P(0), motion.plane(far_plane(rng)), noise), values_of([motion.plane(far_plane(rng))])


@pytest.mark.parametrize("seed", range(5))
def test_planes_go_there_and_back_on_their_manifold(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plane, step = gtsam.OrientedPlane3(far_plane(rng)), rng.normal(size=3) * [0.5, 0.5, 2.0]
    moved = plane.retract(step)
    np.testing.assert_allclose(plane.localCoordinates(moved), step, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(moved.planeCoefficients()[:3]), 1.0)


@pytest.mark.parametrize("anchored", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_the_derivative_of_a_similarity_is_the_numeric_one(seed: int, anchored: bool) -> None:
    rng = np.random.default_rng(seed)
    local = Similarity(gtsam.Rot3.RzRyRx(*rng.normal(size=3)).matrix(), rng.normal(size=3), rng.uniform(0.1, 10))
    anchor: Any = rng.normal(size=3) if anchored else None
    plane = far_plane(rng)

    def about_the_anchor(coefficients: FloatArray) -> FloatArray:
        world = local.planes_to_world(coefficients[None], anchor)[0][0]
        return np.append(world[:3], world[3] + (0.0 if anchor is None else world[:3] @ anchor))

    _, jacobian = local.planes_to_world(plane[None], anchor)
    numeric = [
        (about_the_anchor(plane + STEP * axis) - about_the_anchor(plane - STEP * axis)) / (2 * STEP)
        for axis in np.eye(4)
    ]
    np.testing.assert_allclose(jacobian, np.array(numeric).T, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_a_similarity_leads_there_and_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    local = Similarity(gtsam.Rot3.RzRyRx(*rng.normal(size=3)).matrix(), rng.normal(size=3), rng.uniform(0.1, 10))
    points, plane = rng.normal(size=(4, 3)), far_plane(rng)
    points -= np.outer(points @ plane[:3] + plane[3], plane[:3])
    world = local.planes_to_world(plane[None])[0][0]
    np.testing.assert_allclose(local.points_to_world(points) @ world[:3] + world[3], 0.0, atol=1e-9)
