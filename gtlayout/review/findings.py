"""What is found wrong in a drawing, in the annotator's own ids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import shapely
from shapely import LineString, MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import polygons
from gtlayout.scene import Element, FloatArray, Scene

FindingKind = Literal["another place", "label", "missing", "overlap", "edge", "occlusion edge missing", "shape", "gap"]
KINDS: tuple[FindingKind, ...] = get_args(FindingKind)
"""The worst first."""


@dataclass(frozen=True)
class Finding:
    """Something that is probably wrong in one drawing."""

    key_frame: int
    frame_name: str
    element_id: str | None
    """The annotator's id; None when it is no single element: a whole drawing, or what is not drawn."""
    edge: int | None
    """Number of the side, from its first vertex to the next, in the element's outer ring; of an element of several
    polygons their outer rings are counted through. None when it is no single side."""
    kind: FindingKind
    message: str
    """One line: what is wrong and what to do, without the name of the frame."""
    severity: float
    """z of an edge; of all else the share of the image, or of the element, that is concerned. To compare findings of
    one kind."""
    where_px: FloatArray
    """(N, 2) polyline, or closed outline, to draw on the image."""
    expected_px: FloatArray | None = None
    """(N, 2) where it should be; None when that is not known."""

    @property
    def line(self) -> str:
        """The message with the name of its frame."""
        return f"{self.frame_name}: {self.message}"


def worst_first(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """By kind, then by severity; equals in the order of their key frames."""
    return tuple(
        sorted(findings, key=lambda one: (KINDS.index(one.kind), -round(one.severity, 6), one.key_frame, one.message))
    )


def named(element: Element) -> str:
    """An element in words: its label and its id."""
    return f"{element.label} {element.id}"


def side_along(element: Element, points_px: FloatArray) -> int:
    """The number of the element's side that runs nearest to (N, 2) points; see ``Finding.edge``."""
    rings = [shapely.get_coordinates(polygon.exterior) for polygon in element.amodal.geoms]
    sides = [LineString(pair) for ring in rings for pair in np.stack([ring[:-1], ring[1:]], axis=1)]
    distance_px = shapely.distance(np.array(sides, dtype=object)[:, None], shapely.points(points_px)[None])
    return int(np.argmin(distance_px.mean(axis=1).round(6)))


def outline(region: BaseGeometry) -> FloatArray:
    """(N, 2) closed outline of the largest part of a region."""
    largest = max(shapely.get_parts(region), key=lambda part: part.area)
    return np.asarray(shapely.get_coordinates(largest.exterior))


def opened(region: BaseGeometry, radius: float) -> MultiPolygon:
    """A region without what is narrower than twice the radius."""
    return polygons(region.buffer(-radius).buffer(radius))


def image_area(scene: Scene, key_frame: int) -> float:
    """Of a key frame, px²."""
    camera = scene.frame_of(key_frame).camera
    return float(camera.width * camera.height)
