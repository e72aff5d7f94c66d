"""Extents end where the σ of depth says that the surface may be anywhere: strips and circles in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
from shapely import MultiPolygon, Point, box

from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.extents import compute_extents
from gtlayout.extent.known_part import known_part
from gtlayout.instances import Extent, Plane, PlaneFrame
from gtlayout.quality.assess import assess
from gtlayout.quality.config import QualityConfig
from gtlayout.scene import Camera, FloatArray

FRAME = PlaneFrame(np.zeros(3), np.eye(3)[:2])
"""u and v are x and y on the floor."""
CAMERA = rooms.level_camera([2.0, 1.0, 1.25])
"""1.25 m above the floor: half of that is the limit of σ."""
LIMIT_M = 0.625
FLOOR = MultiPolygon([box(0, 0, 4, 5)])


def floor(covariance: FloatArray) -> Plane:
    return replace(rooms.FLOOR.plane, covariance=covariance)


def tilting(slope: float, at_y: float, least: float = 0.0) -> Plane:
    """σ² = least² + (slope · (y − at_y))²: the floor may tilt about a line across the room."""
    gradient = np.array([0.0, slope, 0.0, -slope * at_y])
    return floor(np.outer(gradient, gradient) + np.diag([0, 0, 0, least**2]))


def nodding(slope: float, at: tuple[float, float]) -> Plane:
    """σ = slope · distance from a point: the floor may tilt about it in every direction."""
    x, y = at
    rows = slope * np.array([[1.0, 0, 0, -x], [0, 1.0, 0, -y]])
    return floor(rows.T @ rows)


def known(plane: Plane, cameras: Sequence[Camera] = (CAMERA,), region: MultiPolygon = FLOOR) -> MultiPolygon:
    part = known_part(region, plane, FRAME, cameras, ExtentConfig())
    assert isinstance(part, MultiPolygon) or part.geom_type == "Polygon"
    return MultiPolygon([part]) if part.geom_type == "Polygon" else part


@pytest.mark.parametrize("least", [0.0, 0.3])
def test_extent_ends_where_sigma_is_half_the_depth(least: float) -> None:
    """σ grows by .5 m a metre from y = 3 on (and before), from ``least`` there."""
    reach = np.sqrt(LIMIT_M**2 - least**2) / 0.5
    expected = box(0, 3 - reach, 4, 3 + reach)
    assert known(tilting(0.5, 3.0, least)).symmetric_difference(expected).area < 0.01 * expected.area


def test_ellipse_is_kept_all_but_its_rim_and_no_more() -> None:
    """σ = .5 m a metre away from (2, 3): a circle of 1.25 m."""
    circle = Point(2, 3).buffer(LIMIT_M / 0.5, quad_segs=256)
    part = known(nodding(0.5, (2.0, 3.0)))
    assert part.difference(circle).area < 1e-9
    assert part.area == pytest.approx(circle.area, rel=0.002)


def test_best_known_point_may_lie_outside_of_the_element() -> None:
    circle = Point(-1, 2).buffer(LIMIT_M / 0.25, quad_segs=256)
    expected = FLOOR.intersection(circle)
    assert known(nodding(0.25, (-1.0, 2.0))).symmetric_difference(expected).area < 0.01 * expected.area


def test_camera_farthest_off_the_plane_knows_best() -> None:
    high = rooms.level_camera([2.0, 1.0, 2.0])
    expected = box(0, 1, 4, 5)
    for cameras in ((CAMERA, high), (high, CAMERA)):
        assert known(tilting(0.5, 3.0), cameras).symmetric_difference(expected).area < 0.01 * expected.area


@pytest.mark.parametrize(
    "plane",
    [
        floor(np.zeros((4, 4))),
        floor(np.full((4, 4), np.nan)),
        tilting(0.2, 3.0),
        floor(np.diag([0, 0, 0, 1e4])),
        tilting(2.0, -6.0),
    ],
    ids=["exact", "nothing known of sigma", "within the limit", "known nowhere", "known nowhere, by up to twice"],
)
def test_what_is_known_or_known_nowhere_stays_as_drawn(plane: Plane) -> None:
    assert known_part(FLOOR, plane, FRAME, [CAMERA], ExtentConfig()) is FLOOR


def test_known_nowhere_ends_at_twice_its_least() -> None:
    """σ is 4 m at y = 0 and 14 m at y = 5: 8 m at y = 2."""
    expected = box(0, 0, 4, 2)
    assert known(tilting(2.0, -2.0)).symmetric_difference(expected).area < 0.01 * expected.area


def test_nothing_stays_nothing() -> None:
    assert known(tilting(0.5, 3.0), region=rooms.NOTHING).is_empty
    assert known_part(FLOOR, tilting(0.5, 3.0), FRAME, [], ExtentConfig()) is FLOOR


def _cut(covariance: FloatArray) -> tuple[Extent, str, str]:
    """The floor's extent as its camera sees it beyond y = 3, its verdict and the reason."""
    surfaces = (rooms.FLOOR, rooms.FAR)
    scene = rooms.seen_from([CAMERA], surfaces)
    planes = [floor(covariance), rooms.FAR.plane]
    instances = rooms.instances_of(surfaces, 1)
    extents = compute_extents(scene, instances, planes, [], ExtentConfig())
    judged = assess(scene, instances, planes, extents, QualityConfig()).instances[0]
    assert extents[1].unknown_area == 0.0
    return extents[0], judged.verdict, judged.reason


def test_layout_says_that_an_extent_ends_and_how_much_is_left() -> None:
    """Seen are 4 m x 2 m; σ passes the limit in their middle."""
    extent, verdict, reason = _cut(tilting(0.625, 3.0).covariance)
    assert extent.region.area == pytest.approx(4.0, rel=0.01)
    assert extent.unknown_area == pytest.approx(4.0, rel=0.01)
    assert extent.region.area + extent.unknown_area == pytest.approx(8.0)
    assert verdict == "weak"
    assert "its extent ends where its depth is unknown: 4 of 8 m² left" in reason


def test_layout_says_nothing_where_nothing_is_left_out() -> None:
    extent, verdict, reason = _cut(tilting(0.01, 3.0).covariance)
    assert extent.unknown_area == 0.0
    assert extent.region.area == pytest.approx(8.0)
    assert (verdict, reason) == ("ok", "")
