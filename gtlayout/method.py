"""The method: seven stages, in order (and the cameras' refinement, on demand). It reads like section 3 of the paper.

"Estimating Generic 3D Room Structures from 2D Annotations", Rozumnyi et al., NeurIPS 2023, with its optimisation recast
as one factor graph.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace

import numpy as np
import trimesh
from threadpoolctl import threadpool_limits

from gtlayout.canonical import canonical
from gtlayout.config import Config
from gtlayout.correspondence.matching import correspond
from gtlayout.edges import ContactEdge, contact_edges
from gtlayout.errors import GtlayoutError
from gtlayout.extent.dimensions import room_dimensions
from gtlayout.extent.extents import compute_extents
from gtlayout.geometry.raster import LabelImage
from gtlayout.geometry.render import DepthImage
from gtlayout.instances import Instance, Plane
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.observer import Observer
from gtlayout.planes.estimation import Estimate, estimate
from gtlayout.quality.assess import Quality, assess
from gtlayout.regrouping.regroup import regroup
from gtlayout.scene import Camera, IntArray, Scene
from gtlayout.tracking.bundle_adjustment import CameraReport, refine_cameras
from gtlayout.tracking.track import track
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate


@dataclass(frozen=True)
class Solution:
    """The layout and what led to it."""

    scene: Scene
    """As given, with what was skipped, joined or split on the way added to its warnings, and with refined cameras where
    ``cameras.refined``.
    """
    layout: Layout
    quality: Quality
    tracks: Tracks
    track_instance: IntArray
    """(N,) instance of each track, -1 = none."""
    edges: tuple[ContactEdge, ...]
    estimate: Estimate
    timings_s: dict[str, float]
    """Seconds of each stage, all restarts together."""
    cameras: CameraReport | None = None
    """What refining the cameras came to; None when that was not asked for."""
    config: Config = field(default_factory=Config)
    """What it was solved with."""

    @property
    def planes(self) -> tuple[Plane, ...]:
        """The layout's: who asks for nothing else may take a solution for its layout."""
        return self.layout.planes

    @property
    def instances(self) -> tuple[Instance, ...]:
        """The layout's."""
        return self.layout.instances

    def mesh(self) -> trimesh.Trimesh:
        """See ``Layout.mesh``."""
        return self.layout.mesh()

    def render(self, camera: Camera) -> tuple[LabelImage, DepthImage]:
        """See ``Layout.render``."""
        return self.layout.render(camera)


@dataclass
class _Stages:
    """Announces stages and adds up the time each takes."""

    observer: Observer
    timings_s: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        self.observer.stage(name)
        start = time.perf_counter()
        yield
        self.timings_s[name] = self.timings_s.get(name, 0.0) + time.perf_counter() - start


def solve(
    scene: Scene, config: Config | None = None, observer: Observer | None = None, restarts: range | None = None
) -> Solution:
    """Reconstruct the room of ``scene``, with the default configuration when none is given.

    ``config.restarts`` solves are made from the same tracks and the one with the best reprojection IoU is kept
    (paper 3.5). The first takes all tracks, each further one a random ``config.restart_share`` of them. Where the
    planes of the first show that instances are one or two, these are joined or split and solved again; the warnings
    say so.

    ``restarts`` are those of them to make here, all when not given: parts of one scene can be solved apart, and the
    best of their solutions, the first of equals, is that of all.

    Raises ``GtlayoutError`` when the scene cannot be solved. Deterministic in ``scene`` and ``config`` on one kind of
    processor; between those with AVX2 planes differ by less than 1e-9, and nothing is decided otherwise.
    """
    if not scene.key_frames:
        raise GtlayoutError(f"{scene.root}: no frame is annotated, so there is nothing to reconstruct")
    config = config or Config()
    restarts = range(config.restarts) if restarts is None else restarts
    # OpenBLAS adds up in another order with each number of threads: the same bytes need just one.
    with threadpool_limits(limits=1, user_api="blas"):
        return _solve(scene, config, observer or Observer(), restarts)


def _solve(given: Scene, config: Config, observer: Observer, restarts: range) -> Solution:
    stage = _Stages(observer)
    observer.scene(given)
    form = canonical(given)
    scene, warnings = form.scene, list(given.warnings)
    with stage("tracking"):
        tracks = track(scene, config.tracking, config.seed, observer.progress)
        rays = triangulate(scene, tracks, config.triangulation)
    if tracks.unreadable:
        warnings.append(f"{len(tracks.unreadable)} unreadable image(s) skipped: {', '.join(tracks.unreadable)}")
    own_tracks = form.tracks(tracks)
    observer.tracks(own_tracks)

    cameras = None
    if config.refine_cameras:
        with stage("cameras"):
            scene, cameras = refine_cameras(
                scene, tracks, rays, config.camera_refinement, config.triangulation, config.seed
            )
        cameras = replace(cameras, shift=cameras.shift / form.similarity.scale)
        if cameras.refined:
            rays = triangulate(scene, tracks, config.triangulation)
            given = form.cameras(scene)
            observer.cameras(given)

    with stage("correspondence"):
        instances, track_instance = correspond(scene, tracks, rays, config.correspondence)

    def planes_of(chosen: IntArray, restart: int = 0) -> Estimate:
        with stage("estimation"):
            return estimate(scene, tracks, rays, chosen, instances, edges, config.estimation, config.seed + restart)

    for rounds_left in reversed(range(config.regrouping.rounds + 1)):
        with stage("edges"):
            edges = contact_edges(scene, instances, config.edges)
        solved = planes_of(track_instance)
        with stage("regrouping"):
            change = regroup(scene, tracks, rays, track_instance, instances, solved, config) if rounds_left else None
        if change is None:
            break
        instances, track_instance = change.instances, change.track_instance
        warnings += change.said
    own_instances = form.instances(instances)
    observer.instances(own_instances, track_instance)
    observer.edges(edges)

    def run(restart: int) -> Solution:
        chosen = restart_tracks(track_instance, config, restart)
        estimated = form.estimate(planes_of(chosen, restart) if restart else solved)
        with stage("extents"):
            extents = compute_extents(given, own_instances, estimated.planes, edges, config.extent)
        with stage("mesh"):
            mesh = build_mesh(own_instances, extents)
        with stage("quality"):
            quality = assess(given, own_instances, estimated.planes, extents, config.quality)
        dimensions = room_dimensions(own_instances, estimated.planes, extents, estimated.covariance)
        planes = with_sigma_depth(estimated.planes, quality, given.metric)
        layout = Layout(own_instances, planes, extents, mesh, given.metric, dimensions)
        told = replace(given, warnings=(*warnings, *estimated.warnings))
        return Solution(told, layout, quality, own_tracks, chosen, edges, estimated, stage.timings_s, cameras, config)

    return _shown(_best(run, restarts), observer)


def _best(run: Callable[[int], Solution], restarts: range) -> Solution:
    """The first of those with the highest IoU. Raises GtlayoutError when there is none."""
    best: Solution | None = None
    for restart in restarts:
        # A random share of the tracks may be too few; the solve from all of them stands.
        with suppress(GtlayoutError) if restart else nullcontext():
            solution = run(restart)
            best = solution if best is None or solution.quality.iou > best.quality.iou else best
    if best is None:
        raise GtlayoutError(f"too few tracks in each of the restarts {restarts.start} to {restarts.stop - 1}")
    return best


def with_sigma_depth(planes: Sequence[Plane], quality: Quality, metric: bool) -> tuple[Plane, ...]:
    """The planes with the σ of depth that the quality has of each, where the scene's unit is the metre."""
    if not metric:
        return tuple(planes)
    judged = zip(planes, quality.instances, strict=True)
    return tuple(replace(plane, sigma_depth_m=instance.sigma_depth) for plane, instance in judged)


def _shown(solution: Solution, observer: Observer) -> Solution:
    """The solution, once the observer has it."""
    observer.estimate(solution.estimate)
    observer.extents(solution.layout.extents)
    observer.mesh(solution.layout.triangles)
    observer.quality(solution.layout, solution.quality)
    return solution


def restart_tracks(track_instance: IntArray, config: Config, restart: int) -> IntArray:
    """``track_instance`` with the tracks that this restart leaves out set to -1."""
    if restart == 0:
        return track_instance
    left_out = np.random.default_rng(config.seed + restart).random(len(track_instance)) >= config.restart_share
    return np.where(left_out, -1, track_instance)
