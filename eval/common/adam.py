"""The paper's own optimiser as a baseline: Adam on distances of unprojections (Rozumnyi et al., NeurIPS 2023, 3.3).

A pixel seen from camera centre ``c`` along ray ``r`` is unprojected onto plane ``(n, d)`` at
``X = c + z r, z = -(n·c + d) / (n·r)``. The loss is ``L_T + 0.1 L_E + 0.1 L_P``:

* ``L_T``: the points of a track, unprojected onto its plane, should be one point: their mean distance from their mean,
  averaged over tracks;
* ``L_E``: an edge point, unprojected onto both of its planes: the distance of the two, averaged over edge points;
* ``L_P``: ``|n_wall · n_level|``, averaged over all pairs of a wall with a floor or ceiling.

No norm is squared. Adam starts from planes of ones and stops after 500 iterations without improvement, or 100 000 in
all. Each of R runs (3.5) takes its own random subset of the tracks; its planes are the best it passed through.

The rest is what did best for this optimiser where its description was not at hand, measured on two real clips:

* Only tracks on visible parts count where a plane has any, as the paper samples no others (3.2). With those that
  gtlayout also samples on furniture, the lowest loss of redkitchen is at ε .97 m instead of .05; office has none.
* A plane is four numbers of any scale, all 1 at the start. What plane that is depends on the world's axes, which for
  RealEstate10k are a camera's. Here they are the middle camera's, with the mean camera centre as origin, in the
  scene's unit: 4 of 10 runs arrive (ε below .15 m) on office, 5 of 6 on redkitchen; with the axes of the clips' own
  worlds 1 of 10 and 1 of 6.
* A run draws 80 % of each plane's tracks; of as many runs with half of them 3 and 4 arrive.

Speed: an edge point is stored as an observation of both its planes and observations are sorted by plane, so that one
matrix product per plane gives what is needed of all its rays. Distances are taken within the plane, where a point is
one complex number. All is done in buffers in single precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gtlayout.edges import ContactEdge
from gtlayout.instances import Instance
from gtlayout.planes.evidence import prefer_visible
from gtlayout.scene import BoolArray, FloatArray, IntArray, Scene
from gtlayout.tracking.tracks import Tracks

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
    track_share: float = 0.8
    """Share of each plane's tracks, at least one, that a run draws."""


@dataclass(frozen=True)
class Problem:
    """What all runs share: S instances, T tracks with M observations, E edge points, in a local world."""

    surface: IntArray
    """(S,) the instance whose plane each one has: its host's for doors and windows (paper 3.4), else its own."""
    origin: FloatArray
    """(3,) mean camera centre: the local origin."""
    axes: FloatArray
    """(3, 3) local axes in the scene's world, one a row: those of the middle frame's camera."""
    views: FloatArray
    """(7, M) camera centre, 1, and ray of each observation; sorted by (surface, track)."""
    track_length: IntArray
    """(T,) observations of each track."""
    track_instance: IntArray
    """(T,) ascending."""
    edge_views: FloatArray
    """(7, E) camera centre, 1, and ray of each edge point."""
    edge_instances: IntArray
    """(2, E) the planes that meet there."""
    perpendicular: FloatArray
    """(S, S) symmetric, 1 where two planes should be at right angles: walls and floors or ceilings."""


@dataclass(frozen=True)
class Run:
    """One descent."""

    planes: FloatArray
    """(S, 4) unit normal, turned towards the cameras, and d in the scene's world; NaN for a plane without evidence."""
    loss: float
    """Of these planes on all tracks, so that runs compare; world unit. Infinite when no iteration gave a number."""
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
    axes = scene.frames[len(scene.frames) // 2].camera.R_cam_from_world
    views = np.ones((7, len(tracks.track)))
    for frame in np.unique(tracks.frame):
        camera, seen = scene.frames[frame].camera, tracks.frame == frame
        views[:3, seen] = (axes @ (camera.center_world - origin))[:, None]
        views[4:, seen] = axes @ camera.rays_world(tracks.points_px[seen]).T
    track_instance = prefer_visible(scene, tracks, np.where(track_instance >= 0, surface[track_instance], -1))
    kept = np.argsort(track_instance, kind="stable")
    kept = kept[track_instance[kept] >= 0]
    observed = np.argsort(track_instance[tracks.track], kind="stable")
    observed = observed[track_instance[tracks.track[observed]] >= 0]
    edge_views, edge_instances = [np.empty((7, 0))], [np.empty((2, 0), dtype=np.int64)]
    for edge in edges:
        meeting = surface[list(edge.instances)]
        if meeting[0] != meeting[1]:
            camera = scene.frame_of(edge.key_frame).camera
            part = np.ones((7, len(edge.points_px)))
            part[:3] = (axes @ (camera.center_world - origin))[:, None]
            part[4:] = axes @ camera.rays_world(edge.points_px).T
            edge_views.append(part)
            edge_instances.append(np.tile(meeting[:, None], len(edge.points_px)))
    own = surface == np.arange(len(instances))
    wall = np.array([x.label == "wall" for x in instances], dtype=bool) & own
    level = np.array([x.label in ("floor", "ceiling") for x in instances], dtype=bool) & own
    across = np.outer(wall, level)
    return Problem(
        surface=surface,
        origin=origin,
        axes=axes,
        views=views[:, observed],
        track_length=np.bincount(tracks.track, minlength=len(tracks))[kept],
        track_instance=track_instance[kept],
        edge_views=np.hstack(edge_views),
        edge_instances=np.hstack(edge_instances),
        perpendicular=(across | across.T).astype(np.float64),
    )


def run(problem: Problem, config: AdamConfig, seed: int, number: int, start: FloatArray | None = None) -> Run:
    """One descent on random tracks, from ``start`` ((S, 4), local world) or ones. Deterministic."""
    rng = np.random.default_rng([seed, number])
    objective = Objective(problem, config, draw(problem, config.track_share, rng))
    planes = np.ones((len(problem.surface), 4)) if start is None else start.copy()
    mean, square = np.zeros_like(planes), np.zeros_like(planes)
    best, best_planes, best_iteration, iteration = np.inf, np.full_like(planes, np.nan), 0, 0
    with np.errstate(all="ignore"):
        while iteration < config.max_iterations and iteration - best_iteration < config.patience:
            iteration += 1
            loss, gradient = objective(planes)
            if not np.isfinite(loss):
                break
            if loss < best:
                best, best_iteration = loss, iteration
                best_planes[:] = planes
            mean *= BETA_MEAN
            mean += (1 - BETA_MEAN) * gradient
            gradient *= gradient
            square *= BETA_SQUARE
            square += (1 - BETA_SQUARE) * gradient
            step = np.sqrt(square)
            step /= np.sqrt(1 - BETA_SQUARE**iteration)
            step += EPSILON
            np.divide(mean, step, out=step)
            step *= config.learning_rate / (1 - BETA_MEAN**iteration)
            planes -= step
        on_all = Objective(problem, config, np.arange(len(problem.track_length)))(best_planes)[0]
    best_planes[~objective.determined] = np.nan
    return Run(_to_world(problem, best_planes), on_all if np.isfinite(on_all) else np.inf, iteration)


def draw(problem: Problem, share: float, rng: np.random.Generator) -> IntArray:
    """(n,) a random ``share`` of each plane's tracks, at least one, ascending."""
    shuffled = rng.permutation(len(problem.track_instance))
    chosen = [np.empty(0, dtype=np.int64)]
    for surface in np.unique(problem.track_instance):
        own = shuffled[problem.track_instance[shuffled] == surface]
        chosen.append(own[: int(np.ceil(share * len(own)))])
    return np.sort(np.concatenate(chosen))


class Objective:
    """The loss of planes and its gradient, on the tracks ``chosen``.

    Works in buffers of its own, so that no iteration allocates an array of many numbers but two.
    """

    def __init__(
        self, problem: Problem, config: AdamConfig, chosen: IntArray, dtype: npt.DTypeLike = np.float32
    ) -> None:
        surfaces = len(problem.surface)
        used: BoolArray = np.zeros(len(problem.track_length), dtype=bool)
        used[chosen] = config.track_weight > 0
        length, of_track = problem.track_length[used], problem.track_instance[used]
        points = problem.edge_views.shape[1] if config.edge_weight > 0 else 0
        of_edge = problem.edge_instances[:, :points].ravel()
        self.determined = np.isin(np.arange(surfaces), np.append(of_track, of_edge))
        """(S,) whether anything but right angles places the plane."""

        # Behind the tracks of a plane stand its edge points, as one more track of weight 0.
        surface = np.append(np.repeat(of_track, length), of_edge)
        track = np.append(np.repeat(np.arange(len(length)), length), len(length) + of_edge)
        order = np.lexsort((track, surface))
        edge_views = problem.edge_views[:, :points]
        views = np.hstack([problem.views[:, np.repeat(used, problem.track_length)], edge_views, edge_views])
        views = np.ascontiguousarray(views[:, order], dtype=dtype)
        share = np.repeat(config.track_weight / max(len(length), 1) / length, length)
        self._weight = np.append(share, np.zeros(2 * points))[order].astype(dtype)
        self._first = np.nonzero(np.diff(track[order], prepend=-1))[0]
        self._length = np.diff(np.append(self._first, len(order)))
        self._one_over_length = (1 / self._length).astype(dtype)
        self._edge_index = np.argsort(order)[len(order) - 2 * points :].reshape(2, points)
        weight = config.edge_weight / max(points, 1)
        self._edge_weight = (weight * np.linalg.norm(edge_views[4:], axis=0)).astype(dtype)
        self._perpendicular = problem.perpendicular
        pairs = problem.perpendicular.sum() / 2
        self._angle_weight = config.perpendicularity_weight / max(pairs, 1.0)

        size = len(order)
        self._maps = np.zeros((surfaces, 6, 7), dtype=dtype)
        self._parts = np.empty((6, size), dtype=dtype)
        self._depth = np.empty(size, dtype=dtype)
        self._moved = np.empty((2, size), dtype=dtype)
        self._at = np.empty(size, dtype=np.result_type(dtype, np.complex64))
        self._at_uv = self._at.view(dtype).reshape(size, 2).T
        self._mean = np.empty(len(self._first), dtype=self._at.dtype)
        self._distance = np.empty(size, dtype=dtype)
        self._factors = np.empty((2, size), dtype=dtype)
        self._sums = np.zeros((surfaces, 7, 2), dtype=dtype)
        self._edge_depth = np.empty((2, points), dtype=dtype)
        ends = np.searchsorted(surface[order], np.arange(surfaces + 1))
        slices = [(s, slice(*ends[s : s + 2])) for s in range(surfaces) if ends[s] < ends[s + 1]]
        self._forward = [(self._maps[s], views[:, part], self._parts[:, part]) for s, part in slices]
        self._backward = [(views[:, part], self._factors[:, part].T, self._sums[s]) for s, part in slices]

    def __call__(self, planes: FloatArray) -> tuple[float, FloatArray]:
        """Loss and its (S, 4) gradient at (S, 4) planes of any scale."""
        normal = planes[:, :3]
        length = np.sqrt(np.sum(normal * normal, axis=1, keepdims=True))
        unit = normal / length
        loss, gradient = self._angles(unit, length)
        if len(self._first):
            distances, part = self._distances(planes, unit)
            loss += distances
            gradient += part
        return loss, gradient

    def _angles(self, unit: FloatArray, length: FloatArray) -> tuple[float, FloatArray]:
        """``w_P L_P`` and its gradient."""
        cosines = self._perpendicular * (unit @ unit.T)
        per_plane = np.abs(cosines).sum(axis=1)
        gradient = np.zeros((len(unit), 4))
        # The second term takes out what normalisation does: a longer normal is no other plane.
        gradient[:, :3] = (np.sign(cosines) @ unit - unit * per_plane[:, None]) * (self._angle_weight / length)
        return self._angle_weight * float(per_plane.sum()) / 2, gradient

    def _distances(self, planes: FloatArray, unit: FloatArray) -> tuple[float, FloatArray]:
        """``w_T L_T + w_E L_E`` and its gradient: ``∂z/∂(n, d) = -(X, 1) / (n·r)``."""
        _fill_maps(self._maps, planes, unit)
        for to_plane, views, parts in self._forward:
            np.matmul(to_plane, views, out=parts)
        center, clearance, ray, away = self._parts[:2], self._parts[2], self._parts[3:5], self._parts[5]
        depth = np.divide(clearance, away, out=self._depth)
        np.multiply(ray, depth, out=self._moved)
        np.add(self._moved, center, out=self._at_uv)
        self._centre()
        distance = np.abs(self._at, out=self._distance)
        loss = float(self._weight.dot(distance))
        np.maximum(distance, TINY, out=distance)
        np.divide(self._weight, distance, out=distance)
        self._at *= distance
        self._centre()
        np.multiply(self._at_uv, ray, out=self._moved)
        pull = np.add(self._moved[0], self._moved[1], out=self._factors[0])
        if self._edge_index.size:
            on_a, on_b = depth.take(self._edge_index, out=self._edge_depth, mode="clip")
            on_a -= on_b
            np.sign(on_a, out=on_b)
            on_b *= self._edge_weight
            loss += float(on_a.dot(on_b))
            np.negative(on_b, out=on_a)
            pull[self._edge_index] = self._edge_depth[::-1]
        pull /= away
        np.multiply(pull, depth, out=self._factors[1])
        for views, factors, sums in self._backward:
            np.matmul(views, factors, out=sums)
        gradient = self._sums[:, :4, 0].astype(np.float64)
        gradient[:, :3] += self._sums[:, 4:, 1]
        return loss, gradient

    def _centre(self) -> None:
        """Take the mean of its track from each complex number, which is its own adjoint, too."""
        np.add.reduceat(self._at, self._first, out=self._mean)
        self._mean *= self._one_over_length
        self._at -= np.repeat(self._mean, self._length)


def _fill_maps(maps: npt.NDArray[np.floating], planes: FloatArray, unit: FloatArray) -> None:
    """(S, 6, 7) maps of (centre, 1, ray) to: centre along two axes within the plane, n·c + d, ray along them, -n·r.

    The axes are two columns of the reflection that takes the unit normal to ±z.
    """
    mirror = unit.copy()
    mirror[:, 2] += np.copysign(1.0, unit[:, 2])
    axes = mirror[:, :2, None] * mirror[:, None, :] / -np.abs(mirror[:, 2])[:, None, None]
    axes[:, 0, 0] += 1.0
    axes[:, 1, 1] += 1.0
    maps[:, :2, :3] = axes
    maps[:, 2, :4] = planes
    maps[:, 3:5, 4:] = axes
    maps[:, 5, 4:] = -planes[:, :3]


def _to_world(problem: Problem, planes: FloatArray) -> FloatArray:
    """(S, 4) unit normals towards the cameras and d in the scene's world, openings with their host's plane."""
    with np.errstate(all="ignore"):
        planes = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    # The local origin is the mean camera centre, so d is its distance from the plane.
    planes = np.where(planes[:, 3:] < 0, -planes, planes)
    planes[:, :3] = planes[:, :3] @ problem.axes
    planes[:, 3] -= planes[:, :3] @ problem.origin
    planes[~np.isfinite(planes).all(axis=1)] = np.nan
    return planes[problem.surface]
