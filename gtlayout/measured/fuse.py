"""A solved room and what was measured in it, together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtlayout.accuracy import accuracy_of
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.instances import Dimension, Instance
from gtlayout.measured.conditioning import Posterior, condition
from gtlayout.measured.measurables import NotMeasurableError, measurable_of
from gtlayout.measurement import Checked, Scale
from gtlayout.planes.estimate import Estimate, Iteration
from gtlayout.scene import FloatArray, Scene, scaled


@dataclass(frozen=True)
class Fused:
    """What changes when measurements join."""

    scene: Scene
    """In metres, where the measurements or the scene tell them."""
    estimate: Estimate
    scale: Scale
    checked: tuple[Checked, ...]


def fuse(room: SolvedRoom, estimate: Estimate) -> tuple[Fused | None, tuple[str, ...]]:
    """The room with its scene's measurements and the σ of its scale; None when there are none. And warnings.

    The planes move, and all σ shrink together. The scale has its σ about the cameras: what is far from them is known
    worse.
    """
    scene = room.scene
    usable, measurables, warnings = [], [], []
    for one in scene.measurements:
        try:
            measurables.append(measurable_of(room, one))
            usable.append(one)
        except NotMeasurableError as reason:
            warnings.append(f"measurement {one.name} left out: {reason}")
    if not usable and not scene.scale_sigma_share:
        return None, tuple(warnings)
    share = (scene.scale_sigma_share or 0.0) if scene.metric else None
    posterior = condition(estimate.covariance, usable, measurables, share)
    if posterior is None:
        contradicting = "the measured lengths contradict one another: measure one more, and look for the wrong one"
        return None, (*warnings, *([contradicting] if usable else []))
    warnings += [_contradiction(one) for one in posterior.checked if not one.used]
    factor = posterior.scale
    scale = Scale(factor, float(np.sqrt(posterior.covariance[-1, -1])), not scene.metric)
    in_metres = scene if factor == 1.0 else scaled(scene, factor)
    return Fused(in_metres, _moved(room, estimate, posterior), scale, posterior.checked), tuple(warnings)


def as_measured(
    instances: Sequence[Instance], dimensions: Sequence[Dimension], checked: Sequence[Checked], wanted_loa: int
) -> tuple[Dimension, ...]:
    """The dimensions of a room, where those of doors and windows that were measured are what the measurement says.

    No plane follows from them alone: their ends are drawn, and stay where they were drawn. What a hand has measured to
    is no longer inferred.
    """
    by_hand = {name for one in checked if one.used for name in one.measurement.instances}
    known: dict[tuple[str, str], Checked] = {
        (one.measurement.kind, one.measurement.instances[0]): one
        for one in checked
        if one.used and one.measurement.kind in ("width", "height", "sill") and np.isfinite(one.predicted)
    }
    found = []
    for dimension in dimensions:
        kind = dimension.kind.removeprefix("opening ") if dimension.kind != "width" else ""
        one = known.get((kind, instances[dimension.second].name))
        if one is not None:
            by_tape, by_video = one.measurement.sigma**-2, one.predicted_sigma**-2
            length = (by_tape * one.measurement.value + by_video * one.predicted) / (by_tape + by_video)
            sigma = float((by_tape + by_video) ** -0.5)
            found.append(replace(dimension, length=length, sigma=sigma, accuracy=accuracy_of(sigma, wanted_loa)))
        elif by_hand & {instances[i].name for i in (dimension.first, dimension.second)} and _is_inferred(dimension):
            found.append(replace(dimension, accuracy=accuracy_of(dimension.sigma, wanted_loa)))
        else:
            found.append(dimension)
    return tuple(found)


def _is_inferred(dimension: Dimension) -> bool:
    return dimension.accuracy is not None and dimension.accuracy.status == "inferred"


def _contradiction(one: Checked) -> str:
    measured, unit = one.measurement, one.measurement.unit
    digits = 1 if unit == "°" else 3
    return (
        f"measurement {measured.name} = {measured.value:.{digits}f} {unit} is not used: everything else says "
        f"{one.predicted:.{digits}f} ± {one.predicted_sigma:.{digits}f} {unit}; measure it again"
    )


def _moved(room: SolvedRoom, estimate: Estimate, posterior: Posterior) -> Estimate:
    """The estimate in metres, with planes and covariances as the posterior has them."""
    factor, count = posterior.scale, len(estimate.planes)
    moved = posterior.moved.reshape(count, 4)
    jacobian = np.zeros((4 * count, 4 * count + 1))
    eye = factor * room.eye_world
    planes = []
    for s, plane in enumerate(estimate.planes):
        placed = np.isfinite(plane.d)
        step = moved[s] if placed else np.zeros(4)
        normal = (plane.normal + step[:3]) / np.linalg.norm(plane.normal + step[:3])
        anchor = factor * plane.anchor
        clearance = factor * (float(plane.normal @ plane.anchor) + plane.d + step[3])
        d = clearance - float(normal @ anchor)
        at = slice(4 * s, 4 * s + 4)
        jacobian[at, at] = np.diag([1.0, 1.0, 1.0, factor])
        jacobian[4 * s + 3, -1] = float(normal @ eye) + d if placed else 0.0
        planes.append(replace(plane, normal=normal, d=d, anchor=anchor))
    covariance = _propagated(jacobian, posterior.covariance)
    of_plane = covariance.reshape(count, 4, count, 4)
    return replace(
        estimate,
        planes=tuple(replace(plane, covariance=of_plane[s, :, s]) for s, plane in enumerate(planes)),
        covariance=covariance,
        landmarks=factor * estimate.landmarks,
        contact_offsets={pair: factor * offset for pair, offset in estimate.contact_offsets.items()},
        # Empty where nobody asked what each kind of evidence says.
        trails=tuple(trail.measured(factor, plane) for trail, plane in zip(estimate.trails, planes, strict=False)),
        iterations=tuple(
            Iteration(one.cost, one.planes * np.array([1.0, 1.0, 1.0, factor])) for one in estimate.iterations
        ),
    )


def _propagated(jacobian: FloatArray, covariance: FloatArray) -> FloatArray:
    """J C Jᵀ, in which what is unknown of one plane stays with it."""
    unknown = ~np.isfinite(np.diag(covariance))
    known = np.where(unknown[:, None] | unknown, 0.0, covariance)
    propagated = jacobian @ known @ jacobian.T
    propagated[unknown[:-1]] = propagated[:, unknown[:-1]] = np.nan
    return propagated
