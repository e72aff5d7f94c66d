"""The method: seven stages in order, as in section 3 of the paper; cameras are looked at before anything rests on them.

"Estimating Generic 3D Room Structures from 2D Annotations", Rozumnyi et al., NeurIPS 2023, with its optimisation recast
as one factor graph.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from threadpoolctl import threadpool_limits

from gtlayout.camera_errors.find import find_camera_errors
from gtlayout.camera_errors.propagate import camera_response
from gtlayout.camera_errors.wording import camera_error_lines
from gtlayout.config import Config
from gtlayout.correspondence.matching import correspond
from gtlayout.curved.strips import find_curved, strips_of
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.edges import contact_edges
from gtlayout.flatness.bends import bends
from gtlayout.flatness.din18202 import flatness_of
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Extent
from gtlayout.layout_stages import Found, laid_out
from gtlayout.measured.fuse import as_measured, fuse
from gtlayout.memory import Memory
from gtlayout.observer import Observer, Stages
from gtlayout.planes.estimate import Estimate
from gtlayout.planes.estimation import estimate
from gtlayout.prepared.canonical import canonical
from gtlayout.prepared.measurements import Prepared
from gtlayout.regrouping.regroup import regroup
from gtlayout.scene import Camera, Scene
from gtlayout.solution import Solution, best_of
from gtlayout.tracking.bundle_adjustment import CameraReport, refine_cameras
from gtlayout.tracking.features import VideoFeatures
from gtlayout.tracking.image_matches import camera_evidence
from gtlayout.tracking.track import track
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate
from gtlayout.tracking.wide_baseline import with_wide_baselines


def solve(
    scene: Scene, config: Config | None = None, observer: Observer | None = None, restarts: range | None = None
) -> Solution:
    """Reconstruct the room of ``scene``, with the default configuration when none is given.

    ``config.restarts`` solves are made from the same tracks, and the one with the best reprojection IoU is kept
    (paper 3.5). The first solve uses all tracks, each further one a random ``config.restart_share`` of them. The planes
    of the first may show that two instances are one, or one is two. These are joined or split, the planes are solved
    again, and the warnings name them.

    ``restarts`` are the numbers of the restarts to make, all when not given. So the restarts of one scene can be made
    in parts. The best of all their solutions, the first of equals, is the solution of the scene.

    Raises ``GtlayoutError`` when the scene cannot be solved. The result is deterministic in ``scene`` and ``config`` on
    one kind of processor. Between processors with AVX2 planes differ by less than 1e-9, and all decisions are the same.
    """
    config, stage = config or Config(), Stages(observer or Observer())
    with threadpool_limits(limits=1, user_api="blas"):
        solution = with_measurements(solve_with_memory(scene, config, Memory(), stage, restarts).solution, stage)
    stage.observer.solved(solution.layout, solution.quality, solution.estimate)
    return solution


@dataclass(frozen=True)
class Solved:
    """A solution, and what its planes were solved from."""

    prepared: Prepared
    solution: Solution


def solve_with_memory(
    scene: Scene, config: Config, memory: Memory, stage: Stages, restarts: range | None = None
) -> Solved:
    """As ``solve``, from the video alone: with what ``memory`` keeps of earlier solves of the scene, and with what is
    needed to go on.
    """
    # OpenBLAS sums in another order with each number of threads. The same bytes need one thread.
    with threadpool_limits(limits=1, user_api="blas"):
        prepared, first = regrouped(prepare(scene, config, stage, memory), config, stage)
        run = partial(_run, prepared, first, config, stage)
        solution = best_of(run, range(config.restarts) if restarts is None else restarts)
        solution = _with_flatness(prepared, solution, config, stage)
    return Solved(prepared, solution)


def prepare(scene: Scene, config: Config, stage: Stages | None = None, memory: Memory | None = None) -> Prepared:
    """Stages 1 to 3: everything that planes are solved from, with what ``memory`` keeps of earlier solves.

    ``solve`` calls this and the other stages with one BLAS thread. The last digits depend on the number of threads.

    Raises ``GtlayoutError`` when no element is annotated, or an annotated image cannot be read.
    """
    scene.require_elements()
    stage, memory = stage or Stages(), memory or Memory()
    stage.observer.scene(scene)
    form, cameras = canonical(scene), None
    scene = form.scene
    with stage("tracking"):
        tracks = track(scene, config.tracking, config.seed, stage.observer.progress, memory=memory)
        features = VideoFeatures.of(scene, config.features, memory=memory, progress=stage.observer.progress)
    with stage("cameras"):
        stage.observer.progress(0, 3)
        evidence = camera_evidence(scene, features, tracks, config.tracking.sigma_px, config.image_matches, memory)
        stage.observer.progress(1, 3)
        looked_at = _views(scene), evidence.judges, config.camera_errors, config.triangulation, config.seed
        doubt = memory.of(
            "camera errors",
            looked_at,
            partial(
                find_camera_errors, scene, evidence.judges, config.camera_errors, config.triangulation, config.seed
            ),
        )
        stage.observer.progress(2, 3)
        wrong = camera_error_lines(scene, doubt)
        given = scene = doubt.correct(scene)
        if config.refine_cameras:
            poses, cameras = memory.of(
                "refined cameras",
                (_views(scene), evidence.every, config.camera_refinement, config.triangulation, config.seed),
                partial(_refined, scene, evidence.every, config),
            )
            if cameras.refined:
                frames = zip(scene.frames, poses, strict=True)
                scene = replace(scene, frames=tuple(replace(frame, camera=camera) for frame, camera in frames))
            cameras = replace(cameras, shift=cameras.shift / form.similarity.scale)
        stage.observer.progress(3, 3)
    with stage("tracking"):
        # Features are matched along epipolar lines, which wrong cameras put elsewhere.
        tracks = with_wide_baselines(
            scene, tracks, features, config.tracking, config.wide_baseline, memory, stage.observer.progress
        )
        rays = memory.of(
            "depths",
            (_views(scene), tracks, config.triangulation),
            lambda: triangulate(scene, tracks, config.triangulation),
        )
    with stage("cameras"):
        response = memory.of(
            "camera response",
            (looked_at, _views(scene), tracks),
            partial(
                camera_response,
                given,
                scene,
                evidence.judges,
                tracks,
                rays,
                doubt,
                config.triangulation,
                config.camera_errors,
                config.seed,
            ),
        )
    stage.observer.tracks(form.given_tracks(tracks))
    if doubt.corrected or (cameras is not None and cameras.refined):
        stage.observer.cameras(form.given_cameras(scene))
    with stage("correspondence"):
        instances, track_instance = correspond(scene, tracks, rays, config.correspondence)
    with stage("edges"):
        edges = contact_edges(scene, instances, config.edges, memory)
    warnings = (*tracks.warnings, *wrong)
    return Prepared(
        scene,
        tracks,
        rays,
        instances,
        track_instance,
        edges,
        form,
        doubt,
        cameras,
        warnings,
        camera_response=response,
    )


def _views(scene: Scene) -> tuple[object, ...]:
    """All of a scene that is not drawn: cameras, and which frames are annotated."""
    return [frame.camera for frame in scene.frames], [key_frame.frame for key_frame in scene.key_frames]


def _refined(scene: Scene, tracks: Tracks, config: Config) -> tuple[tuple[Camera, ...], CameraReport]:
    """The cameras of a scene after bundle adjustment, and its report."""
    rays = triangulate(scene, tracks, config.triangulation)
    refined, report = refine_cameras(scene, tracks, rays, config.camera_refinement, config.triangulation, config.seed)
    return tuple(frame.camera for frame in refined.frames), report


def solve_planes(prepared: Prepared, config: Config, stage: Stages | None = None, restart: int = 0) -> Estimate:
    """Stage 4: the plane of every instance with its covariance, in the canonical world.

    ``lay_out`` moves the planes to the given world.

    Raises ``GtlayoutError`` when no plane at all can be determined.
    """
    stage = stage or Stages()
    with stage("estimation"):
        return estimate(prepared.flat, config.estimation, config.seed + restart, progress=stage.observer.progress)


def lay_out(
    prepared: Prepared,
    solved: Estimate,
    config: Config,
    stage: Stages | None = None,
    known: Mapping[int, Extent] | None = None,
    drawn_before: Mapping[int, Extent] | None = None,
    shrink: float = 1.0,
) -> Solution:
    """Stages 5 to 7, in the given world: extents, mesh and quality of solved planes.

    Extents that are ``known``, by the index of their instance, stay, and of those ``drawn_before`` what is drawn.
    Quality is judged on images that are smaller by the factor ``shrink``.
    """
    scene = prepared.given_scene
    estimated = solved.to_world(prepared.form.similarity, prepared.form.anchor)
    stage = stage or Stages()
    strips = strips_of(prepared, solved.planes, config.curved)
    found = Found(prepared.given_instances, prepared.edges, estimated, strips)
    layout, quality = laid_out(scene, found, config, stage, known, drawn_before, shrink)
    return Solution(
        scene=replace(scene, warnings=(*scene.warnings, *prepared.warnings, *estimated.warnings)),
        layout=layout,
        quality=quality,
        tracks=prepared.given_tracks,
        track_instance=prepared.track_instance,
        edges=prepared.edges,
        estimate=estimated,
        timings_s=stage.timings_s,
        camera_doubt=prepared.camera_doubt,
        cameras=prepared.cameras,
        config=config,
    )


def _with_flatness(prepared: Prepared, solution: Solution, config: Config, stage: Stages) -> Solution:
    local, layout = prepared.form.similarity, solution.layout
    with stage("flatness"):
        planes = local.planes(np.array([[*plane.normal, plane.d] for plane in layout.planes]))
        found = bends(
            prepared.scene,
            prepared.instances,
            planes,
            prepared.tracks,
            prepared.rays,
            prepared.track_instance,
            config.flatness,
        )
        found = tuple(tuple(one.scaled(1 / local.scale) for one in of_one) for of_one in found)
    flatness = flatness_of(layout.instances, found, layout.metric, layout.curved)
    return replace(solution, bends=found, layout=replace(layout, flatness=flatness))


def with_measurements(solution: Solution, stage: Stages | None = None) -> Solution:
    """The solution with what was measured in the room by hand, and with the σ of its scale: see ``gtlayout.measured``.

    The same when nothing was measured and nobody doubts the scale.
    """
    stage, layout = stage or Stages(), solution.layout
    with stage("measurements"):
        room = SolvedRoom(solution.scene, layout.instances, layout.planes, layout.extents)
        fused, warnings = fuse(room, solution.estimate)
    if fused is not None:
        on = {i: strip for i, extent in enumerate(layout.extents) if (strip := strip_of(extent))}
        strips = {i: strip.moved(fused.scale.factor) for i, strip in on.items()}
        found = Found(layout.instances, solution.edges, fused.estimate, strips)
        layout, quality = laid_out(fused.scene, found, solution.config, stage)
        in_metres = tuple(tuple(one.scaled(fused.scale.factor) for one in of_one) for of_one in solution.bends)
        solution = replace(
            solution,
            scene=fused.scene,
            bends=in_metres,
            layout=replace(
                layout,
                flatness=flatness_of(layout.instances, in_metres, layout.metric, layout.curved) if in_metres else (),
                dimensions=as_measured(layout.instances, layout.dimensions, fused.checked, solution.config.loa),
                scale=fused.scale,
                measurements=fused.checked,
            ),
            quality=quality,
            estimate=fused.estimate,
        )
        if solution.new_cameras:
            stage.observer.cameras(fused.scene)
    return replace(solution, scene=replace(solution.scene, warnings=(*solution.scene.warnings, *warnings)))


def regrouped(prepared: Prepared, config: Config, stage: Stages) -> tuple[Prepared, Estimate]:
    """Solve planes, join or split instances by them, and solve again, until they stay the same.

    At most ``config.regrouping.rounds`` times. Then walls that are curved are told from flat ones: without their
    contacts the planes are solved once more.
    """
    solved = solve_planes(prepared, config, stage)
    for _ in range(config.regrouping.rounds):
        with stage("regrouping"):
            is_curved = cache(partial(_is_curved, prepared, solved, config))
            change = regroup(prepared, solved, config.regrouping, config.extent, is_curved)
        if change is None:
            break
        with stage("edges"):
            out = {i for i, one in enumerate(change.instances) if set(one.members) & set(change.left_out)}
            edges = contact_edges(prepared.scene, change.instances, config.edges)
            edges = tuple(edge for edge in edges if not out & set(edge.instances))
        prepared = replace(
            prepared,
            instances=change.instances,
            track_instance=change.track_instance,
            edges=edges,
            left_out=change.left_out,
            warnings=(*prepared.warnings, *change.messages),
        )
        solved = solve_planes(prepared, config, stage)
    with stage("curved walls"):
        prepared = replace(prepared, curved=find_curved(prepared, solved.planes, config.edges, config.curved))
    if prepared.curved:
        solved = solve_planes(prepared, config, stage)
    stage.observer.instances(prepared.given_instances, prepared.track_instance)
    stage.observer.edges(prepared.edges)
    return prepared, solved


def _is_curved(prepared: Prepared, solved: Estimate, config: Config, index: int) -> bool:
    return bool(find_curved(prepared, solved.planes, config.edges, config.curved, (index,)))


def _run(prepared: Prepared, first: Estimate, config: Config, stage: Stages, restart: int) -> Solution:
    """One restart. The planes of the first are already solved."""
    if restart == 0:
        return lay_out(prepared, first, config, stage)
    part = prepared.restarted(config.restart_share, config.seed + restart)
    return lay_out(part, solve_planes(part, config, stage, restart), config, stage)
