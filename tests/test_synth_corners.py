"""Corners of trim that are drawn as one."""

from __future__ import annotations

import numpy as np
from shapely import MultiPolygon, Polygon

from gtlayout.scene import Camera
from gtlayout.synth.corners import moved_lines, moved_region, one_corner


def test_ends_of_short_edges_are_drawn_as_one_corner() -> None:
    """A wall's foot with a step of a pixel in it: floor and wall keep sharing corners, and the long line its place."""
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), np.eye(3), np.zeros(3), 100, 80)
    foot = [(0.0, 60.0), (60.0, 60.0), (60.0, 59.0), (100.0, 59.0)]
    wall = MultiPolygon([Polygon([*foot, (100, 0), (0, 0)])])
    floor = MultiPolygon([Polygon([*foot, (100, 80), (0, 80)])])
    by_hand = one_corner([wall, floor], camera)
    expected = [(0.0, 60.0), (60.0, 60.0), (100.0, 59.0)]
    for region, rest in ((wall, [(100, 0), (0, 0)]), (floor, [(100, 80), (0, 80)])):
        drawn = moved_region(region, by_hand)
        assert drawn.equals(Polygon([*expected, *rest]))
    (line,) = moved_lines([np.array(foot), np.array(foot[1:3])], by_hand)
    np.testing.assert_array_equal(line, expected)
    unmoved = np.array([(0.0, 60.0), (0.0, 60.5), (30.0, 30.0)])
    np.testing.assert_array_equal(by_hand(unmoved), unmoved)
    beside = MultiPolygon([Polygon([(0, 60), (0, 60.5), (50, 70)])])
    np.testing.assert_array_equal(
        one_corner([beside], camera)(unmoved), unmoved, err_msg="nothing leaves the image border"
    )
