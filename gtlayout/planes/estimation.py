"""Stage 4: initial planes, factor graph, Levenberg-Marquardt, marginals (paper 3.3 as a factor graph).

Variables are an ``OrientedPlane3`` per instance and a ``Point3`` per track.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.similarity import covariance_by
from gtlayout.instances import Plane, propagated_sigma
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.contact_offsets import contact_offsets
from gtlayout.planes.contacts import start_without_wrong_contacts
from gtlayout.planes.estimate import Estimate, Iteration
from gtlayout.planes.evidence import Evidence, gather
from gtlayout.planes.graph import Optimum, optimise_graph, track_weights
from gtlayout.planes.initialization import face_cameras
from gtlayout.planes.objective import cost_of
from gtlayout.planes.structural_factors import met
from gtlayout.planes.support import supports
from gtlayout.planes.uncertainty import Uncertainty, error_scales, plane_uncertainty
from gtlayout.planes.views import Views
from gtlayout.planes.warm import warm_start
from gtlayout.prepared.measurements import Measurements
from gtlayout.scene import Camera, FloatArray
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import camera_path

_IF_IT_MOVED = "film sideways; where that was done, gtlayout check says what is wrong with the poses"


def estimate(
    measured: Measurements,
    config: EstimationConfig,
    seed: int,
    known: FloatArray | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Estimate:
    """Planes of all instances with their covariance, in the world of ``measured.scene``.

    With ``known`` planes of an earlier solve, (S, 4) in that world, NaN = not known, nothing is searched for but the
    others. ``progress`` is called with (steps done, steps in all): the searches for a start, of which there are more
    where contacts are wrong, the solve, and what supports each plane.

    Raises:
        GtlayoutError: no plane at all can be determined (the camera does not move, or nothing was tracked).
    """
    scene, tracks, rays, instances = measured.scene, measured.tracks, measured.rays, measured.instances
    scene.require_elements()
    names = ", ".join(instance.name for instance in instances)
    if camera_path(scene) == 0.0:
        raise GtlayoutError(
            f"{scene.root}: the camera does not move, so all planes are unobservable: {names}; {_IF_IT_MOVED}"
        )
    if len(tracks) == 0:
        raise GtlayoutError(
            f"{scene.root}: no point could be tracked, so all planes are unobservable: {names}; gtlayout check says why"
        )
    if rays.moved_share() < config.min_moved_share:
        raise GtlayoutError(
            f"{scene.root}: the camera hardly moves, so all planes are unobservable: {names}; {_IF_IT_MOVED}"
        )
    local = Normalisation.of(rays)
    evidence = gather(measured, local, config)
    done, expected = count(1), config.starts + 2

    def step() -> None:
        number = next(done)
        progress(number, max(expected, number))

    progress(0, expected)
    if known is None:
        evidence, start = start_without_wrong_contacts(evidence, config, seed, step)
    else:
        evidence, start = warm_start(evidence, local.planes(known), config, seed)
    if not np.isfinite(start).any():
        raise GtlayoutError(f"{scene.root}: too few points could be tracked, so all planes are unobservable: {names}")
    cameras = [local.camera(frame.camera) for frame in scene.frames]
    solution, uncertainty = optimise(cameras, tracks, evidence, start, config)
    step()
    warnings = []
    if lost := led_astray(evidence, start, solution.planes, config):
        solution, uncertainty = keep_start(tracks, evidence, start, solution.planes, lost, config)
        astray = ", ".join(instances[s].name for s in lost)
        warnings.append(f"the solve led away from what tracks and edges say ({astray}): its start is kept")
    world, jacobian = local.planes_to_world(solution.planes)
    covariance = covariance_by(uncertainty.covariance, jacobian)
    held = supports(measured, evidence, solution, uncertainty.dominant_evidence)
    step()
    planes = []
    for s, note in enumerate(_notes(solution.planes, uncertainty.covariance, evidence.views, config)):
        own = slice(4 * s, 4 * s + 4)
        planes.append(Plane(world[s, :3], float(world[s, 3]), covariance[own, own], not note, note, held[s]))
    if not any(plane.observable for plane in planes):
        raise GtlayoutError(f"{scene.root}: no plane is certain enough, so all planes are unobservable: {names}")
    used = np.isfinite(solution.landmarks[:, 0])
    return Estimate(
        planes=tuple(planes),
        covariance=covariance,
        landmarks=local.points_to_world(solution.landmarks),
        landmark_weight=solution.robust_weight,
        landmark_instance=np.where(used, measured.track_instance, -1),
        contact_offsets={pair: local.vectors_to_world(offset) for pair, offset in solution.offsets.items()},
        iterations=tuple(
            Iteration(cost, local.planes_to_world(at)[0])
            for cost, at in zip(solution.costs, solution.history, strict=True)
        ),
        warnings=tuple(warnings),
        trails=tuple(trail.to_world(local) for trail in uncertainty.trails),
    )


def optimise(
    cameras: Sequence[Camera], tracks: Tracks, evidence: Evidence, start: FloatArray, config: EstimationConfig
) -> tuple[Optimum, Uncertainty]:
    """Optimise the planes from (S, 4) ``start`` on, and estimate their uncertainty. Local world.

    The weight of tracks against edges follows from the scales of both, estimated from the residuals at the start.
    """
    scales = error_scales(tracks, evidence, start, config)
    weighed = replace(
        config,
        max_track_weight=config.max_track_weight / scales.shared_depth**2,
        sigma_edge_shift_px=config.sigma_edge_shift_px * scales.edge,
        sigma_edge_tilt_px=config.sigma_edge_tilt_px * scales.edge,
        sigma_contact_offset=config.sigma_contact_offset * scales.offset,
        sigma_perpendicularity=config.sigma_perpendicularity * scales.angle,
    )
    solution = optimise_graph(cameras, tracks, evidence, start, weighed)
    planes = _facing(evidence, solution.planes)
    found = contact_offsets(evidence, planes, weighed)
    solution = replace(solution, planes=planes, offsets={evidence.contacts[c]: found[c] for c in met(evidence, planes)})
    return solution, plane_uncertainty(tracks, evidence, solution.planes, config)


def led_astray(evidence: Evidence, start: FloatArray, planes: FloatArray, config: EstimationConfig) -> tuple[int, ...]:
    """The instances that a solve, from (S, 4) ``start`` to ``planes``, moved away from their evidence; usually none.

    Start and solve have objectives of their own. On the common one a solve ends a little worse than the start, which is
    its optimum. A solve that ends much worse, as a whole or for a plane that moved far, has failed.
    """
    before, after = (cost_of(evidence, at, config) for at in (start, planes))
    growth = after.by_instance - before.by_instance
    moved = np.array([_moved(evidence.views[s], start[s], planes[s]) for s in range(len(planes))])
    thrown = (growth > config.max_plane_cost_growth) & (moved > config.max_moved_share)
    if not thrown.any() and after.total > (1 + config.max_cost_growth) * before.total + config.max_plane_cost_growth:
        thrown = growth == np.nanmax(growth)
    return tuple(np.nonzero(thrown)[0].tolist())


def _moved(views: Views, before: FloatArray, after: FloatArray) -> float:
    """Median share of its depth by which a plane moved where it is drawn; NaN where it was not seen."""
    depths = views.depths(np.stack([before, after]))
    seen = depths[0] > 0
    return float(np.median(np.abs(depths[1, seen] / depths[0, seen] - 1))) if seen.any() else np.nan


def keep_start(
    tracks: Tracks,
    evidence: Evidence,
    start: FloatArray,
    solved: FloatArray,
    astray: Sequence[int],
    config: EstimationConfig,
) -> tuple[Optimum, Uncertainty]:
    """The result of ``optimise`` for planes that stay at (S, 4) ``start``, with landmarks where rays meet planes.

    Where the (S, 4) ``solved`` planes went ``astray``, one of the two is wrong, and nothing tells which: their
    difference is one more error of the plane.
    """
    planes = _facing(evidence, start)
    robust, _ = track_weights(evidence, planes, config)
    index = np.nonzero(robust > 0)[0]
    points, depth = evidence.on_planes(index, planes[evidence.track_instance[index]])
    landmarks = np.full((len(tracks), 3), np.nan)
    landmarks[index[depth > 0]] = points[depth > 0]
    cost = cost_of(evidence, planes, config).total
    uncertainty = plane_uncertainty(tracks, evidence, planes, config)
    covariance = uncertainty.covariance.copy()
    for s in astray:
        own, difference = slice(4 * s, 4 * s + 4), _facing(evidence, solved)[s] - planes[s]
        covariance[own, own] += np.outer(difference, difference)
    optimum = Optimum(planes, landmarks, {}, robust, (cost,), (planes,))
    return optimum, replace(uncertainty, covariance=covariance)


def _facing(evidence: Evidence, planes: FloatArray) -> FloatArray:
    """(S, 4) planes with normals towards the cameras: edges and right angles do not determine a plane's side."""
    pairs = zip(planes, evidence.views, strict=True)
    return np.concatenate([face_cameras(plane[None], views) for plane, views in pairs])


def _relative_depth_sigma(plane: FloatArray, covariance: FloatArray, views: Views) -> float:
    """σ of the depth as a share of the depth, where the instance is drawn: the median over its sampled pixels."""
    depth = views.depths(plane[None])[0]
    seen = depth > 0
    if not seen.any():
        return np.inf
    points = views.center[seen] + depth[seen, None] * views.ray[seen]
    homogeneous = np.column_stack([points, np.ones(len(points))])
    sigma = propagated_sigma(homogeneous, covariance)
    return float(np.median(sigma / np.abs(views.ray[seen] @ plane[:3]) / depth[seen]))


def _notes(planes: FloatArray, covariance: FloatArray, views: Sequence[Views], config: EstimationConfig) -> list[str]:
    """Why each of (S, 4) planes is unobservable; empty when it is not."""
    notes = []
    for s, plane in enumerate(planes):
        own = slice(4 * s, 4 * s + 4)
        if not np.isfinite(plane).all():
            notes.append("no track and no contact edge places it")
        elif not _relative_depth_sigma(plane, covariance[own, own], views[s]) < config.unobservable_sigma_ratio:
            notes.append("nothing but weak priors determines it")
        else:
            notes.append("")
    return notes
