"""Which findings of a review still stand while somebody draws on."""

from __future__ import annotations

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.geometry.polygons import polygons
from gtlayout.review.findings import Finding
from gtlayout.scene import Element, KeyFrame


def is_outdated(finding: Finding, before: KeyFrame | None, now: KeyFrame | None) -> bool:
    """Whether a finding is of something that has been drawn anew since.

    That is so when its element is another one, when what has changed of others lies where the finding is, or, of
    findings about occlusion edges, when those are others. What is left blank counts as drawn.

    Args:
        finding: Of a review.
        before: Its key frame as it was reviewed.
        now: The same as it is drawn now; None, as before, when nothing is.
    """
    old, new = _elements(before), _elements(now)
    changed = [name for name in old.keys() | new.keys() if not _same(old.get(name), new.get(name))]
    if finding.element_id in changed:
        return True
    if finding.kind == "occlusion edge missing" and _occlusion_edges(before) != _occlusion_edges(now):
        return True
    moved = [_region(old.get(name)).symmetric_difference(_region(new.get(name))) for name in changed]
    moved.append(_blank(before).symmetric_difference(_blank(now)))
    place = _place(finding)
    return any(region.intersects(place) for region in moved)


def _elements(key_frame: KeyFrame | None) -> dict[str, Element]:
    return {} if key_frame is None else {element.id: element for element in key_frame.elements}


def _same(one: Element | None, other: Element | None) -> bool:
    if one is None or other is None:
        return False
    return one.label == other.label and bool(shapely.equals_exact(one.amodal, other.amodal))


def _occlusion_edges(key_frame: KeyFrame | None) -> list[list[list[float]]]:
    return [] if key_frame is None else [line.tolist() for line in key_frame.occlusion_edges]


def _region(element: Element | None) -> BaseGeometry:
    return Polygon() if element is None else element.amodal


def _blank(key_frame: KeyFrame | None) -> BaseGeometry:
    return Polygon() if key_frame is None else key_frame.blank


def _place(finding: Finding) -> BaseGeometry:
    """What a finding marks: a region where its line is closed."""
    where = finding.where_px
    closed = len(where) > 3 and (where[0] == where[-1]).all()
    return polygons(Polygon(where)) if closed else shapely.linestrings(where)
