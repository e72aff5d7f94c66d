"""Annotated frames: the photo, the annotation over it as vectors, the rendering and its differences as clear images.

All layers of a frame are images of one size that the page lays over one another and switches on and off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from shapely import MultiPolygon

from gtlayout.colors import instance_colors
from gtlayout.errors import GtlayoutError
from gtlayout.geometry.raster import LabelImage, annotated_labels, rings_of
from gtlayout.geometry.render import render
from gtlayout.io.pixels.images import encoded, read_rgb
from gtlayout.layout import Layout
from gtlayout.quality.assess import Quality
from gtlayout.report.plain import data_uri, finite
from gtlayout.review.findings import Finding
from gtlayout.scene import OPENINGS, ImageArray, Scene

MAX_WIDTH_PX = 960
FULL_SIZE_FRAMES = 40
"""More key frames than these are shown smaller, so that the page does not grow with their number."""
JPEG_QUALITY = 80
_FILL_ALPHA, _DIFFERENCE_ALPHA = 110, 220
_DIFFERENCE = (255, 0, 200)
"""A colour that no instance has."""


def key_frame_data(
    scene: Scene, layout: Layout, quality: Quality, number: int, photo: ImageArray | None, colors: Sequence[str]
) -> dict[str, Any]:
    """The layers of key frame ``number`` and its IoUs; ``photo`` (H, W, 3) RGB or None, ``colors`` one per instance."""
    key_frame, camera = scene.key_frames[number], scene.frame_of(number).camera
    instance_of = {e: i for i, instance in enumerate(layout.instances) for k, e in instance.members if k == number}
    rendered, _ = render(layout.planes, layout.extents, layout.instances, camera)
    annotated = annotated_labels(scene, layout.instances, number)
    width = shown_width(camera.width, len(scene.key_frames))
    size = (width, max(1, round(camera.height * width / camera.width)))
    drawn = [
        {
            "name": layout.instances[instance_of[e]].name,
            "id": element.id,
            "color": colors[instance_of[e]],
            "opening": element.label in OPENINGS,
            "path": path_of(element.amodal),
            "at": _label_point(element.amodal),
        }
        for e, element in enumerate(key_frame.elements)
        if not element.amodal.is_empty
    ]
    return {
        "name": scene.frame_of(number).name,
        "number": number,
        "iou": finite(quality.frames[number]),
        "order": sum(iou < quality.frames[number] for iou in quality.frames),
        "width": camera.width,
        "height": camera.height,
        "photo": None if photo is None else _jpeg(photo, size),
        "rendering": _png(painted(_shrunk(rendered, size))),
        "differences": _png(_differing(_shrunk(rendered, size), _shrunk(annotated, size))),
        # Doors and windows last: on top of their walls.
        "drawn": sorted(drawn, key=lambda one: bool(one["opening"])),
        "occlusion_edges": [_points(edge) for edge in key_frame.occlusion_edges],
        "elements": [
            {"instance": one.instance, "id": key_frame.elements[one.element].id, "iou": one.iou}
            for one in quality.elements
            if one.key_frame == number
        ],
    }


def finding_lines(findings: Sequence[Finding], number: int) -> list[dict[str, Any]]:
    """Where the findings of key frame ``number`` are, and where what is wrong should be, as points of polylines."""
    return [
        {
            "where": _points(finding.where_px),
            "expected": None if finding.expected_px is None else _points(finding.expected_px),
            "title": f"{finding.kind}: {finding.message}",
        }
        for finding in findings
        if finding.key_frame == number
    ]


def photo(scene: Scene, number: int) -> ImageArray | None:
    """(H, W, 3) RGB of key frame ``number``; None when it cannot be read."""
    try:
        return read_rgb(scene.frame_of(number))
    except GtlayoutError:
        return None


def shown_width(width_px: int, key_frames: int) -> int:
    """Width of an image in the page: at most 960 px, less where there are many."""
    most = MAX_WIDTH_PX * min(1.0, math.sqrt(FULL_SIZE_FRAMES / max(key_frames, 1)))
    return max(1, min(width_px, round(most)))


def _shrunk(labels: LabelImage, size: tuple[int, int]) -> LabelImage:
    return cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST).astype(np.int32, copy=False)


def painted(labels: LabelImage) -> npt.NDArray[np.uint8]:
    """(H, W, 4) RGBA: instances in their colours, white where two of them meet."""
    palette = np.zeros((labels.max() + 2, 4), dtype=np.uint8)  # the last, of -1, is clear
    palette[:-1, :3] = instance_colors(range(len(palette) - 1))
    palette[:-1, 3] = _FILL_ALPHA
    image = palette[labels]
    border = np.zeros(labels.shape, dtype=bool)
    border[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    border[1:] |= labels[1:] != labels[:-1]
    image[border] = 255
    return image


def _differing(rendered: LabelImage, annotated: LabelImage) -> npt.NDArray[np.uint8]:
    image = np.zeros((*rendered.shape, 4), dtype=np.uint8)
    image[rendered != annotated] = (*_DIFFERENCE, _DIFFERENCE_ALPHA)
    return image


def path_of(region: MultiPolygon) -> str:
    """The SVG path (even-odd) of all rings, px of the full image."""
    return "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in ring) + "Z" for ring in rings_of(region))


def _points(polyline: npt.NDArray[np.float64]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in polyline)


def _label_point(region: MultiPolygon) -> tuple[float, float]:
    """Where the name is written: inside the largest polygon."""
    point = max(region.geoms, key=lambda polygon: polygon.area).representative_point()
    return round(point.x, 1), round(point.y, 1)


def _jpeg(rgb: ImageArray, size: tuple[int, int]) -> str:
    smaller = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    jpeg = encoded(".jpg", cv2.cvtColor(smaller, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data_uri("image/jpeg", jpeg)


def _png(rgba: npt.NDArray[np.uint8]) -> str:
    png = encoded(".png", cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA), [cv2.IMWRITE_PNG_COMPRESSION, 6])
    return data_uri("image/png", png)
