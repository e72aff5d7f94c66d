"""Label and depth images of a layout: planar polygons, projected, filled at pixel centres, z-tested."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.raster import LabelImage, fill, rings_of
from gtlayout.geometry.strip import flat_parts
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.scene import Camera, FloatArray

DepthImage = npt.NDArray[np.float32]

_NEAR = 1e-6
"""Depth of the near plane as a share of the polygon's farthest vertex: only keeps the projection finite."""


def project_rings(extent: Extent, camera: Camera) -> list[FloatArray]:
    """The extent's rings in the image, (N, 2) px, cut at the camera plane; empty when all of it lies behind the camera.

    A cut ring stays one closed ring whose extra edges run along the cut and cancel under even-odd filling.
    """
    rings = []
    for ring in rings_of(extent.region):
        points = extent.frame.to_world(ring) @ camera.R_cam_from_world.T + camera.t_cam_from_world
        points = _cut_near(points, _NEAR * float(np.abs(points).max()))
        if len(points):
            homogeneous = points @ camera.K.T
            rings.append(homogeneous[:, :2] / homogeneous[:, 2:])
    return rings


def render(
    planes: Sequence[Plane], extents: Sequence[Extent], instances: Sequence[Instance], camera: Camera
) -> tuple[LabelImage, DepthImage]:
    """What the camera sees of a layout.

    Returns (H, W) instance indices, -1 where there is nothing, and (H, W) depths along the camera's z, world unit, NaN
    where there is nothing. The nearest plane wins; an opening wins over its host, in which it sits.
    """
    labels: LabelImage = np.full((camera.height, camera.width), -1, dtype=np.int32)
    depth: DepthImage = np.full((camera.height, camera.width), np.inf, dtype=np.float32)
    x, y = np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5
    order = sorted(range(len(instances)), key=lambda i: instances[i].host is not None)
    for index, plane, extent in ((i, *part) for i in order for part in flat_parts(planes[i], extents[i])):
        rings = project_rings(extent, camera)
        if not rings:
            continue
        window = _window(rings, camera)
        mask = fill([ring - (window[1].start, window[0].start) for ring in rings], *labels[window].shape)
        # 1/z is linear in the image.
        a, b, c = inverse_depth(plane, camera)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            plane_depth = (1 / (a * x[window[1]] + (b * y[window[0]] + c)[:, None])).astype(np.float32)
        wins = plane_depth < depth[window]
        if (host := instances[index].host) is not None:
            wins |= labels[window] == host
        mask &= wins
        labels[window][mask] = index
        depth[window][mask] = plane_depth[mask]
    depth[labels < 0] = np.nan
    return labels, depth


def _cut_near(points_cam: FloatArray, near: float) -> FloatArray:
    """Sutherland-Hodgman: the part of a closed (N, 3) ring with z >= near."""
    following = np.roll(points_cam, -1, axis=0)
    z, z_next = points_cam[:, 2], following[:, 2]
    keep, crosses = z >= near, (z >= near) != (z_next >= near)
    if not crosses.any():
        return points_cam if keep.all() else points_cam[:0]
    step = np.where(crosses, z_next - z, 1.0)
    cut = points_cam + ((near - z) / step)[:, None] * (following - points_cam)
    return np.stack([points_cam, cut], axis=1)[np.column_stack([keep, crosses])]


def _window(rings: Sequence[FloatArray], camera: Camera) -> tuple[slice, slice]:
    """Rows and columns of the image that the rings reach."""
    corners = np.concatenate(rings)
    limit = (camera.width, camera.height)
    low = np.clip(np.floor(corners.min(axis=0)), 0, limit).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)), 0, limit).astype(int)
    return slice(low[1], high[1]), slice(low[0], high[0])
