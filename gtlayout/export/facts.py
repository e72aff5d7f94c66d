"""The facts of a layout about its instances and the room, as names and plain values, for formats with properties."""

from __future__ import annotations

import numpy as np

from gtlayout.export import unit
from gtlayout.export.upright import z_up_from_world
from gtlayout.figures import is_known
from gtlayout.geometry.depth import depth_at_centroid
from gtlayout.geometry.strip import StripFrame, strip_of
from gtlayout.instances import Plane
from gtlayout.io.files import printable
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

NOT_METRIC = "NOT METRIC: the scene's unit is unknown; every length is in that unit, whatever unit this file names"
"""The note in a file whose format requires a unit."""
Fact = bool | float | str


def facts(scene: Scene, layout: Layout, index: int) -> dict[str, Fact]:
    """The facts about one observable instance. What is not known is left out.

    ``sigma_normal_deg``; ``sigma_depth``, as layout.json has it, in the world unit; the plane n·X + d = 0 and the
    ``covariance_world`` of (n, d), by rows, in the world frame of the input cameras. Of a curved wall, in place of the
    plane, ``radius``, ``sigma_radius``, ``axis_point_world`` and ``axis_world``.
    """
    instance, plane, extent = layout.instances[index], layout.planes[index], layout.extents[index]
    strip = strip_of(extent)
    sigma_depth, _ = depth_at_centroid(scene, instance, plane, strip)
    numbers = {
        "sigma_normal_deg": plane.sigma_normal_deg if strip is None else strip.cylinder.sigma_normal_deg,
        "sigma_depth": sigma_depth,
        "area": float(extent.region.area),
    }
    if strip is not None:
        numbers |= {"radius": strip.cylinder.radius, "sigma_radius": strip.cylinder.sigma_radius}
    words = {
        "name": instance.name,
        "label": instance.label,
        "note": plane.note,
        "dominant_evidence": plane.support.dominant_evidence,
        **_plane(plane, strip),
    }
    return {
        **{name: value for name, value in numbers.items() if np.isfinite(value)},
        **{name: printable(value) for name, value in words.items() if value},
        "metric": layout.metric,
    }


def _plane(plane: Plane, strip: StripFrame | None) -> dict[str, str]:
    """Of a curved wall its cylinder."""
    if strip is not None:
        on = strip.cylinder
        return {"axis_point_world": _row(on.axis_point_world), "axis_world": _row(on.axis_world)}
    return {
        "normal_world": _row(plane.normal),
        "d_world": repr(float(plane.d)),
        "covariance_world": "; ".join(_row(row) for row in plane.covariance_world),
    }


def scene_facts(scene: Scene, layout: Layout) -> dict[str, Fact]:
    """The facts about the room: its dimensions with σ, instances that are not placed, and the frame of its files."""
    measured = {}
    for d in layout.dimensions:
        known = f" ± {d.sigma:.2g}" if is_known(d.sigma, d.length) else ""
        between = f"{layout.instances[d.first].name} {layout.instances[d.second].name}"
        measured[printable(f"{d.kind} {between}")] = f"{d.length:.4g}{known} {unit(layout.metric)}"
    missing = ", ".join(layout.instances[i].name for i, e in enumerate(layout.extents) if e.region.is_empty)
    return {
        "metric": layout.metric,
        **measured,
        **({"not_placed": printable(missing)} if missing else {}),
        "z_up_from_world": "; ".join(_row(row) for row in z_up_from_world(scene, layout)),
    }


def _row(values: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)
