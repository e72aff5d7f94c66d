"""The paper's own optimiser as a baseline: Adam on distances of unprojections (Rozumnyi et al., NeurIPS 2023, 3.3).

A pixel seen from camera centre ``c`` along ray ``r`` is unprojected onto plane ``(n, d)`` at
``X = c + z r, z = -(n·c + d) / (n·r)``. The loss is ``L_T + 0.1 L_E + 0.1 L_P``:

* ``L_T``: the points of a track, unprojected onto its plane, should be one point: their mean distance from their mean,
  averaged over the tracks of a plane, then over planes;
* ``L_E``: an edge point, unprojected onto both of its planes: the mean distance of the two;
* ``L_P``: the sum of ``|n_wall · n_level|`` over all pairs of a wall with a floor or ceiling.

All norms are unsquared. Adam with learning rate 0.1 starts from planes of ones and stops after 500 iterations without
improvement, or 100 000 in all. Each of R runs (3.5) takes its own random subset of the tracks.

What is a sum and what a mean, and over what, decides how the three weigh against each other. Of 144 readings, judged by
where descents that start at the truth end on two real clips, this one was the best for the paper; averaged over all
tracks alike, for example, edges weigh so little that planes with mirror images leave: redkitchen .81 instead of .09 m.

In NumPy an iteration costs passes over arrays and calls. Observations (at most six a track, as gtlayout takes) are
sorted by plane, so that one matrix product per plane gives what is needed of all its rays; all distances are taken
within the plane, where a point has two coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.config import EstimationConfig
from gtlayout.edges import ContactEdge
from gtlayout.graph import spread_observations
from gtlayout.layout import Instance
from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking import Tracks

BETA_MEAN, BETA_SQUARE, EPSILON = 0.9, 0.999, 1e-8
"""Adam's usual constants."""
TINY = 1e-30
"""Where a norm is zero its gradient is taken to be so, too."""


@dataclass(frozen=True)
class AdamConfig:
    """The paper's settings; a weight of 0 leaves its loss out."""

    learning_rate: float = 0.1
    track_weight: float = 1.0
    edge_weight: float = 0.1
    perpendicularity_weight: float = 0.1
    max_iterations: int = 100_000
    patience: int = 500
    """Iterations without improvement after which a run stops."""
    track_share: float = 0.5
    """Share of each plane's tracks, at least one, that a run draws."""


@dataclass(frozen=True)
class Problem:
    """What all runs share. S instances, M observations, E edge points. The world's origin is the mean camera centre."""

    surface: IntArray
    """(S,) the instance whose plane each one has: its host's for doors and windows (paper 3.4), else its own."""
    origin: FloatArray
    """(3,) of the local world."""
    views: FloatArray
    """(7, M) camera centre, 1, and ray of each observation; sorted by (surface, track)."""
    track_length: IntArray
    """(T,) observations of each track."""
    track_surface: IntArray
    """(T,) ascending."""
    edge_centers: FloatArray
    """(4, E) camera centre and 1 of each edge point."""
    edge_rays: FloatArray
    """(3, E) its ray."""
    edge_surfaces: IntArray
    """(2, E) the planes that meet there."""
    perpendicular: FloatArray
    """(S, S) symmetric, 1 where two planes should be at right angles: walls and floors or ceilings."""


@dataclass(frozen=True)
class Run:
    """One descent."""

    planes: FloatArray
    """(S, 4) unit normal, turned towards the cameras, and d in the scene's world; NaN for a plane without evidence."""
    loss: float
    """The lowest reached, on the run's own tracks."""
    iterations: int


def problem(
    scene: Scene,
    tracks: Tracks,
    track_instance: IntArray,
    instances: Sequence[Instance],
    edges: Sequence[ContactEdge],
) -> Problem:
    """Arrays for ``run``.

    Tracks and edges of a door or window count for its host; edges within one plane say nothing and are dropped.

    Args:
        track_instance: (N,) instance of each track, -1 = not used.
    """
    surface = np.array([i if x.host is None else x.host for i, x in enumerate(instances)], dtype=np.int64)
    origin = np.mean([frame.camera.center_world for frame in scene.frames], axis=0)
    chosen = spread_observations(tracks, EstimationConfig().max_observations)
    track, observed_in, points_px = tracks.track[chosen], tracks.frame[chosen], tracks.points_px[chosen]
    views = np.ones((7, len(track)))
    for frame in np.unique(observed_in):
        camera, seen = scene.frames[frame].camera, observed_in == frame
        views[:3, seen] = (camera.center_world - origin)[:, None]
        views[4:, seen] = camera.rays_world(points_px[seen]).T
    track_surface = np.where(track_instance >= 0, surface[track_instance], -1)
    order = np.argsort(track_surface[track], kind="stable")
    order = order[track_surface[track[order]] >= 0]
    kept = np.argsort(track_surface, kind="stable")
    kept = kept[track_surface[kept] >= 0]
    contacts = [edge for edge in edges if surface[edge.instances[0]] != surface[edge.instances[1]]]
    cameras = [scene.frame_of(edge.key_frame).camera for edge in contacts]
    counts = [len(edge.points_px) for edge in contacts]
    centers = np.array([np.append(camera.center_world - origin, 1.0) for camera in cameras]).reshape(-1, 4)
    rays = [camera.rays_world(edge.points_px) for camera, edge in zip(cameras, contacts, strict=True)]
    pairs = np.array([surface[list(edge.instances)] for edge in contacts], dtype=np.int64).reshape(-1, 2)
    own = surface == np.arange(len(instances))
    wall = np.array([x.label == "wall" for x in instances]) & own
    level = np.array([x.label in ("floor", "ceiling") for x in instances]) & own
    across = np.outer(wall, level)
    return Problem(
        surface=surface,
        origin=origin,
        views=np.ascontiguousarray(views[:, order]),
        track_length=np.bincount(track, minlength=len(tracks))[kept],
        track_surface=track_surface[kept],
        edge_centers=np.repeat(centers, counts, axis=0).T.copy(),
        edge_rays=np.concatenate([np.empty((0, 3)), *rays]).T.copy(),
        edge_surfaces=np.repeat(pairs, counts, axis=0).T.copy(),
        perpendicular=(across | across.T).astype(np.float64),
    )


def run(problem: Problem, config: AdamConfig, seed: int, number: int) -> Run:
    """One descent on random tracks. Deterministic in ``seed`` and ``number``."""
    rng = np.random.default_rng([seed, number])
    objective = Objective(problem, config, draw(problem, config.track_share, rng))
    planes = np.ones((len(problem.surface), 4))
    mean, square = np.zeros_like(planes), np.zeros_like(planes)
    best, best_planes, best_iteration, iteration = np.inf, planes, 0, 0
    while iteration < config.max_iterations and iteration - best_iteration < config.patience:
        iteration += 1
        loss, gradient = objective(planes)
        if not np.isfinite(loss):
            break
        if loss < best:
            best, best_planes, best_iteration = loss, planes.copy(), iteration
        mean += (1 - BETA_MEAN) * (gradient - mean)
        square += (1 - BETA_SQUARE) * (gradient**2 - square)
        step = config.learning_rate / (1 - BETA_MEAN**iteration)
        planes -= step * mean / (np.sqrt(square / (1 - BETA_SQUARE**iteration)) + EPSILON)
    best_planes = np.where(objective.determined[:, None], best_planes, np.nan)
    return Run(_to_world(problem, best_planes), best, iteration)


def draw(problem: Problem, share: float, rng: np.random.Generator) -> IntArray:
    """(n,) a random ``share`` of each plane's tracks, at least one, ascending."""
    shuffled = rng.permutation(len(problem.track_surface))
    chosen = [np.empty(0, dtype=np.int64)]
    for surface in np.unique(problem.track_surface):
        own = shuffled[problem.track_surface[shuffled] == surface]
        chosen.append(own[: int(np.ceil(share * len(own)))])
    return np.sort(np.concatenate(chosen))


class Objective:
    """The loss and its gradient with respect to planes, on some of the tracks. Works in buffers of its own."""

    def __init__(self, problem: Problem, config: AdamConfig, chosen: IntArray) -> None:
        surfaces = len(problem.surface)
        index = np.arange(surfaces)
        tracked = np.isin(index, problem.track_surface[chosen]) & (config.track_weight > 0)
        on_edge = np.isin(index, problem.edge_surfaces) & (config.edge_weight > 0)
        self.determined = tracked | on_edge
        """(S,) whether anything but right angles places the plane."""
        if config.track_weight == 0:
            chosen = chosen[:0]
        used = np.zeros(len(problem.track_length), dtype=bool)
        used[chosen] = True
        self._views = np.ascontiguousarray(problem.views[:, np.repeat(used, problem.track_length)])
        self._length = problem.track_length[used]
        self._first = np.cumsum(self._length) - self._length
        ends = np.cumsum(np.bincount(np.repeat(problem.track_surface[used], self._length), minlength=surfaces))
        self._slices = [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]
        of_plane = np.bincount(problem.track_surface[used], minlength=surfaces)
        share = config.track_weight / max(int((of_plane > 0).sum()), 1) / of_plane[problem.track_surface[used]]
        share /= np.maximum(self._length, 1)
        self._weight = np.repeat(share, self._length)
        self._share = 1 / np.maximum(self._length, 1)
        self._track = np.repeat(np.arange(len(self._length)), self._length)
        self._products = np.empty((6, self._views.shape[1]))
        self._problem = problem
        self._edge_weight = (
            config.edge_weight / max(problem.edge_rays.shape[1], 1) * np.linalg.norm(problem.edge_rays, axis=0)
        )
        self._angle_weight = config.perpendicularity_weight

    def __call__(self, planes: FloatArray) -> tuple[float, FloatArray]:
        """Loss and its (S, 4) gradient at (S, 4) planes of any scale."""
        total, gradient = 0.0, np.zeros_like(planes)
        with np.errstate(all="ignore"):
            for term in (self.track_loss, self.edge_loss, self.perpendicularity_loss):
                loss, part = term(planes)
                total += loss
                gradient += part
        return total, gradient

    def track_loss(self, planes: FloatArray) -> tuple[float, FloatArray]:
        """``w_T L_T`` and its gradient."""
        gradient = np.zeros_like(planes)
        if len(self._length) == 0:
            return 0.0, gradient
        products = self._products
        for in_plane, part in zip(_in_plane(planes), self._slices, strict=True):
            if part.start < part.stop:
                np.matmul(in_plane, self._views[:, part], out=products[:, part])
        center, clearance, ray, facing = products[:2], products[2], products[3:5], products[5]
        depth = -clearance / facing
        off = center + depth * ray
        off -= self._mean(off)
        distance = np.sqrt(off[0] * off[0] + off[1] * off[1])
        loss = float(self._weight @ distance)
        pull = off
        pull *= self._weight / np.maximum(distance, TINY)
        pull -= self._mean(pull)
        pull *= ray
        factors = np.empty_like(pull)
        np.divide(pull[0] + pull[1], -facing, out=factors[0])
        np.multiply(factors[0], depth, out=factors[1])
        for s, part in enumerate(self._slices):
            if part.start < part.stop:
                sums = self._views[:, part] @ factors[:, part].T
                gradient[s] = sums[:4, 0]
                gradient[s, :3] += sums[4:, 1]
        return loss, gradient

    def _mean(self, values: FloatArray) -> FloatArray:
        """(2, M) values of observations → the mean over the track of each."""
        return np.take(np.add.reduceat(values, self._first, axis=1) * self._share, self._track, axis=1)

    def edge_loss(self, planes: FloatArray) -> tuple[float, FloatArray]:
        """``w_E L_E`` and its gradient."""
        p = self._problem
        if p.edge_rays.shape[1] == 0 or not self._edge_weight.any():
            return 0.0, np.zeros_like(planes)
        points = np.arange(p.edge_rays.shape[1])
        facing = (planes[:, :3] @ p.edge_rays)[p.edge_surfaces, points]
        depth = -(planes @ p.edge_centers)[p.edge_surfaces, points] / facing
        gap = depth[0] - depth[1]
        pull = np.sign(gap) * self._edge_weight
        factors = np.zeros((2, len(planes), len(points)))
        factors[0][p.edge_surfaces, points] = np.stack([-pull, pull]) / facing
        factors[1][p.edge_surfaces, points] = np.stack([-pull, pull]) / facing * depth
        gradient = factors[0] @ p.edge_centers.T
        gradient[:, :3] += factors[1] @ p.edge_rays.T
        return float(self._edge_weight @ np.abs(gap)), gradient

    def perpendicularity_loss(self, planes: FloatArray) -> tuple[float, FloatArray]:
        """``w_P L_P`` and its gradient."""
        length = np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        unit = planes[:, :3] / length
        cosines = self._problem.perpendicular * (unit @ unit.T)
        pull = np.sign(cosines) @ unit
        gradient = np.zeros_like(planes)
        gradient[:, :3] = self._angle_weight * (pull - unit * np.sum(pull * unit, axis=1, keepdims=True)) / length
        return self._angle_weight * float(np.abs(cosines).sum()) / 2, gradient


def _in_plane(planes: FloatArray) -> FloatArray:
    """(S, 6, 7) maps of (camera centre, 1, ray) to their parts along two axes within each plane, and across it.

    The axes are those of Duff et al., "Building an Orthonormal Basis, Revisited" (JCGT 2017).
    """
    x, y, z = (planes[:, :3] / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)).T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    product = np.zeros((len(planes), 6, 7))
    product[:, 0, :3] = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    product[:, 1, :3] = np.stack([b, sign + y * y * a, -y], axis=1)
    product[:, 2, :3] = planes[:, :3]
    product[:, 3:, 4:] = product[:, :3, :3]
    product[:, 2, 3] = planes[:, 3]
    return product


def _to_world(problem: Problem, planes: FloatArray) -> FloatArray:
    """(S, 4) unit normals towards the cameras and d in the scene's world, openings with their host's plane."""
    with np.errstate(all="ignore"):
        planes = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    # The local origin is the mean camera centre, so d is its distance from the plane.
    planes = np.where(planes[:, 3:] < 0, -planes, planes)
    planes[:, 3] -= planes[:, :3] @ problem.origin
    planes[~np.isfinite(planes).all(axis=1)] = np.nan
    return planes[problem.surface]
