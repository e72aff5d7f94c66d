"""A scene at a glance: its worst key frame, small."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from gtlayout.colors import instance_colors
from gtlayout.geometry.raster import rings_of
from gtlayout.geometry.render import render
from gtlayout.io.pixels.images import encoded
from gtlayout.layout import Layout
from gtlayout.quality.assess import Quality
from gtlayout.report.frames import JPEG_QUALITY, painted, photo
from gtlayout.scene import OPENINGS, Scene

WIDTH_PX = 320
_NO_PHOTO = 96
"""Grey where the photo cannot be read."""
_SUBPIXEL_BITS = 4
_HALO, _LINE = 3, 1
"""Widths of an outline, px: white, and the instance's colour on top."""


def thumbnail(scene: Scene, layout: Layout, quality: Quality) -> bytes:
    """JPEG, 320 px wide, of the worst key frame: photo, rendering over it and the annotation's outlines on top.

    Where the photo cannot be read, the rendering lies on grey.
    """
    full = scene.frame_of(quality.worst_frame).camera
    size = (WIDTH_PX, max(1, round(full.height * WIDTH_PX / full.width)))
    scale = np.array(size) / (full.width, full.height)
    camera = replace(full, K=np.diag([*scale, 1.0]) @ full.K, width=size[0], height=size[1])
    rgba = painted(render(layout.planes, layout.extents, layout.instances, camera)[0])

    rgb = photo(scene, quality.worst_frame)
    if rgb is None:
        rgb = np.full((size[1], size[0], 3), _NO_PHOTO, dtype=np.uint8)
    alpha = rgba[..., 3:] / np.float32(255)
    image = (cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) * (1 - alpha) + rgba[..., :3] * alpha).astype(np.uint8)

    drawn = [
        (instance.label in OPENINGS, i, scene.key_frames[k].elements[e].amodal)
        for i, instance in enumerate(layout.instances)
        for k, e in instance.members
        if k == quality.worst_frame
    ]
    for _, i, region in sorted(drawn, key=lambda one: one[0]):  # doors and windows last: on top of their walls
        # OpenCV's pixel (0, 0) is a pixel's centre.
        rings = [np.rint((ring * scale - 0.5) * 2**_SUBPIXEL_BITS).astype(np.int32) for ring in rings_of(region)]
        for color, width in (((255, 255, 255), _HALO), (tuple(instance_colors(i).tolist()), _LINE)):
            cv2.polylines(image, rings, True, color, width, cv2.LINE_AA, shift=_SUBPIXEL_BITS)
    return encoded(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
