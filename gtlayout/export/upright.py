"""A layout with z up, and the outlines of openings in their hosts: for formats that describe buildings."""

from __future__ import annotations

import numpy as np
import shapely
import trimesh
from shapely import MultiPolygon

from gtlayout.export.floor_level import up_of_walls
from gtlayout.export.glb import y_up
from gtlayout.geometry.polygons import polygons
from gtlayout.geometry.strip import StripFrame
from gtlayout.instances import Extent, PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

_Z_UP_FROM_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""As readers of glTF turn it, so that both files lie on one another."""


def z_up_from_world(scene: Scene, layout: Layout) -> FloatArray:
    """(3, 3) rotation that turns the floor's normal to +z; without a floor the ceiling's to −z.

    Without either, what the walls have in common; none at all for a layout without walls.
    Raises GtlayoutError when there are only walls, and they and the cameras leave open where up is.
    """
    seen = [i for i, plane in enumerate(layout.planes) if plane.observable]
    labels = {layout.instances[i].label for i in seen}
    if labels.isdisjoint(("floor", "ceiling")) and "wall" in labels:
        up = up_of_walls(scene, layout, seen)
        rotation: FloatArray = trimesh.geometry.align_vectors(up, [0.0, 0.0, 1.0])[:3, :3]
        return rotation
    return _Z_UP_FROM_Y_UP @ y_up(layout)


def turned(extent: Extent, rotation: FloatArray) -> Extent:
    """The same extent in a rotated world."""
    frame = extent.frame
    return Extent(
        frame.moved(rotation=rotation)
        if isinstance(frame, StripFrame)
        else PlaneFrame(rotation @ frame.origin, frame.axes @ rotation.T),
        extent.region,
        extent.unrefined,
    )


def outline_in(host: Extent, opening: Extent) -> MultiPolygon:
    """A door's or window's outline, dropped onto its host's plane, in the host's frame."""
    dropped = shapely.transform(opening.region, lambda uv: host.frame.to_plane(opening.frame.to_world(uv)))
    return polygons(dropped)
