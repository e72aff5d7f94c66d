"""The factor graph of stage 4: GTSAM's of planes and offsets, and the landmarks, which are eliminated one by one."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import P

from gtlayout.planes.arrow import by_blocks
from gtlayout.planes.landmarks import Landmarks, Linearised
from gtlayout.scene import FloatArray, IntArray


@dataclass(frozen=True)
class Problem:
    """Factors on planes and offsets, and landmarks that lie on the planes."""

    graph: gtsam.NonlinearFactorGraph
    landmarks: Landmarks
    placed: IntArray
    """The instances that have a plane."""
    count: int
    """S."""

    def error(self, values: gtsam.Values, points: FloatArray) -> float:
        """Negative log-likelihood, up to a constant."""
        return float(self.graph.error(values)) + self.landmarks.error(self.planes(values), points)

    def planes(self, values: gtsam.Values) -> FloatArray:
        """(S, 4), NaN = not placed."""
        planes = np.full((self.count, 4), np.nan)
        for s in self.placed.tolist():
            planes[s] = values.atOrientedPlane3(P(s)).planeCoefficients()
        return planes

    def linearise(self, values: gtsam.Values, points: FloatArray) -> LinearProblem:
        """At values and (n, 3) landmarks."""
        ordering = gtsam.Ordering()
        offsets = [key for key in values.keys() if gtsam.Symbol(key).chr() == ord("o")]  # noqa: SIM118 no dict
        keys = [*(P(s) for s in self.placed.tolist()), *offsets]
        for key in keys:
            ordering.push_back(key)
        information, gradient = self.graph.linearize(values).hessian(ordering)
        landmarks = self.landmarks.linearise(self.planes(values), points)
        return LinearProblem(np.array(information), np.array(gradient).ravel(), keys, self.placed, landmarks)


@dataclass(frozen=True)
class LinearProblem:
    """All factors, linearised: K keys of three numbers each, planes first, and the landmarks."""

    information: FloatArray
    """(3K, 3K) of planes and offsets."""
    gradient: FloatArray
    """(3K,) towards the optimum."""
    keys: list[int]
    placed: IntArray
    landmarks: Linearised

    def stepped(self, values: gtsam.Values, points: FloatArray, damping: float) -> tuple[gtsam.Values, FloatArray]:
        """Values and (n, 3) landmarks after a step of Levenberg-Marquardt."""
        information = self.information + damping * np.eye(len(self.information))
        gradient = self.gradient.copy().reshape(-1, 3)
        of_landmarks, towards = self.landmarks.eliminated(damping)
        own = np.arange(len(self.placed))
        by_blocks(information)[own, :, own] += of_landmarks[self.placed]
        gradient[own] += towards[self.placed]
        steps = np.linalg.solve(information, gradient.ravel()).reshape(-1, 3)
        delta = gtsam.VectorValues()
        for key, step in zip(self.keys, steps, strict=True):
            delta.insert(key, step)
        of_planes = np.zeros((self.landmarks.planes, 3))
        of_planes[self.placed] = steps[own]
        return values.retract(delta), points + self.landmarks.step(damping, of_planes)
