"""The feet of curved walls in the floor plan: arcs, in steps so short that one sees none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtlayout.accuracy import SIGMAS_95, UPPER_ENDS_M
from gtlayout.export.plan_walls import BAND_SIGMAS, WEAK_SHARE, Footprint, minus
from gtlayout.geometry.strip import StripFrame, on_surface, strip_of
from gtlayout.instances import Plane, PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray

_LABELLED_RAD = 0.3
"""A name stands beside so much of the arc, about its middle."""


@dataclass(frozen=True)
class Curve:
    """The arc in which a curved wall meets the floor plane."""

    name: str
    points: FloatArray
    """(N, 2) in the plan: all of it that was seen."""
    drawn: tuple[FloatArray, ...]
    """(N, 2) each: without openings."""
    band: FloatArray
    """(N, 2) corners of the area within two σ of it; none where the wall is weak."""
    radius: float
    """World unit."""
    weak: bool
    """Its place is not known well enough to build from."""
    accuracy_level: int
    """The level of accuracy that it reaches; 0 for none, and where nobody asked."""
    middle: Footprint
    """A short line that touches it in its middle, for its name."""


def curve(layout: Layout, i: int, frame: PlaneFrame, size: float) -> Curve | None:
    """Where a curved wall meets the floor plane; None for other instances. ``size`` is the plan's, world unit."""
    strip, instance = strip_of(layout.extents[i]), layout.instances[i]
    if strip is None or layout.extents[i].region.is_empty:
        return None
    low, _, high, _ = layout.extents[i].region.bounds
    points = _foot(strip, low, high, frame)
    center = frame.to_plane(strip.cylinder.axis_point_world[None])
    outwards = (points - center) / np.linalg.norm(points - center, axis=1)[:, None]
    sigma = strip.cylinder.sigma_offset(frame.to_world(points))
    level = layout.accuracies[i].level if layout.accuracies else 0
    limit = UPPER_ENDS_M[10] if layout.metric else WEAK_SHARE * size
    weak = level == 0 if layout.metric and layout.accuracies else bool(SIGMAS_95 * sigma.max() > limit)
    reach = BAND_SIGMAS * sigma[:, None] * outwards
    gaps = [
        strip.to_plane(on_surface(extent.region, extent.frame))[:, 0]
        for one, extent in zip(layout.instances, layout.extents, strict=True)
        if one.host == i and not extent.region.is_empty
    ]
    drawn = minus(np.array([[low, high]]), [np.array([gap.min(), gap.max()]) for gap in gaps])
    half = min(_LABELLED_RAD * strip.cylinder.radius, (high - low) / 2)
    about = (low + high) / 2
    ends = _foot(strip, about - half, about + half, frame)[[0, -1]]
    across = frame.axes @ strip.normal_at(np.array([about, 0.0]))
    return Curve(
        instance.name,
        points,
        tuple(_foot(strip, first, last, frame) for first, last in drawn),
        np.empty((0, 2)) if weak else np.concatenate([points + reach, (points - reach)[::-1]]),
        strip.cylinder.radius,
        weak,
        level,
        Footprint(instance.name, "wall", ends, across / np.linalg.norm(across), np.empty((0, 2))),
    )


def _foot(strip: StripFrame, low: float, high: float, frame: PlaneFrame) -> FloatArray:
    """(N, 2) in the plan, from one place along the arc to another: an end, the borders of facets between, an end."""
    up = np.cross(*frame.axes)
    floor = Plane(up, -float(up @ frame.origin), np.full((4, 4), np.nan), observable=True)
    u: Sequence[float] = [low, *strip.borders(low, high).tolist(), high]
    return frame.to_plane(strip.to_world(np.array([[each, strip.onto(floor, np.array([each, 0.0]))[1]] for each in u])))
