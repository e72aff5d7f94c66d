"""Curved walls in layout.json, written and read."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtlayout.cylinder import Cylinder
from gtlayout.geometry.strip import StripFrame, strip_of
from gtlayout.instances import Extent
from gtlayout.io.numbers import real, reals
from gtlayout.results.layout_format import CylinderRow


def cylinder_row(extent: Extent) -> CylinderRow | None:
    """The cylinder that an extent lies on; None for one on a plane."""
    strip = strip_of(extent)
    if strip is None:
        return None
    cylinder = strip.cylinder
    return {
        "axis_point": cylinder.axis_point_world,
        "axis": cylinder.axis_world,
        "radius": cylinder.radius,
        "sigma_radius": cylinder.sigma_radius,
        "angles": np.array(strip.arc_rad(extent.region)),
        "concave": strip.concave,
        "origin": cylinder.origin,
        "axes": cylinder.axes,
        "values": cylinder.values,
        "covariance": cylinder.covariance,
        "middle": strip.middle_rad,
        "facet": strip.step,
    }


def read_strip(row: dict[str, Any] | None) -> StripFrame | None:
    """The strip of a curved wall; None for others, and in files from before there were any.

    Raises ValueError, TypeError or KeyError when it is damaged.
    """
    if row is None:
        return None
    cylinder = Cylinder(
        reals(row["origin"], (3,)),
        reals(row["axes"], (3, 3)),
        reals(row["values"], (5,)),
        reals(row["covariance"], (5, 5)),
    )
    step = real(row["facet"])
    if cylinder.radius <= 0 or step <= 0:
        raise ValueError("a cylinder has no radius or no facets")
    return StripFrame.about(cylinder, real(row["middle"]), bool(row["concave"]), step)
