"""Polygons and planes of any kind: what stages make of them is valid, bounded, and the same every time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import rooms
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, MultiPolygon, Polygon
from solved_rooms import solved

from gtlayout.closing.close import close
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.consensus import tidy
from gtlayout.extent.extents import compute_extents
from gtlayout.extent.refine import Neighbour, refine
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.polygons import grid_for, polygons
from gtlayout.instances import Instance, Plane, PlaneFrame
from gtlayout.io.annotations.outlines import Repairs, View, region
from gtlayout.scene import Camera, Frame

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")
CONFIG = ExtentConfig()
GRID = grid_for(10.0)
CAMERA = rooms.level_camera([2.0, 1.0, 1.25], focal=200.0, width=320, height=240)


def few(examples: int) -> settings:
    return settings(max_examples=examples, derandomize=True, deadline=None, database=None)


def rings(low: float, high: float) -> st.SearchStrategy[list[tuple[float, float]]]:
    """Of any shape: crossing themselves, with points that coincide or lie on a line, without area."""
    number = st.one_of(st.floats(low, high, width=32), st.integers(int(low), int(high)).map(float))
    return st.lists(st.tuples(number, number), min_size=3, max_size=9)


def unit(vector: Sequence[float]) -> Any:
    return np.array(vector) / np.linalg.norm(vector)


DIRECTIONS = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1).map(unit)


def assert_good(found: MultiPolygon, bounds: tuple[float, float, float, float]) -> None:
    """A valid region within bounds, of parts with an area."""
    assert found.is_valid
    assert all(isinstance(part, Polygon) and part.area > 0 for part in found.geoms)
    assert found.is_empty or shapely.box(*bounds).covers(shapely.box(*found.bounds))


@few(60)
@given(drawn=st.lists(rings(-5, 5), min_size=1, max_size=3))
def test_the_polygonal_part_of_anything(drawn: list[list[tuple[float, float]]]) -> None:
    shape = MultiPolygon([Polygon(ring) for ring in drawn])
    found = polygons(shape)
    assert_good(found, (-5, -5, 5, 5))
    assert polygons(found).equals(found)
    assert polygons(shape).wkb == found.wkb
    # What lies inside an odd number of times is there, whatever else is.
    first, *others = (polygons(Polygon(ring)).area for ring in drawn)
    assert found.area >= first - sum(others) - 1e-9
    assert_good(tidy(shape, GRID, CONFIG), (-5.001, -5.001, 5.001, 5.001))


@few(50)
@given(drawn=st.lists(rings(-40, 360), min_size=1, max_size=4))
def test_the_union_of_what_is_drawn(drawn: list[list[tuple[float, float]]]) -> None:
    view = View.of("a.png", Frame("a.png", rooms.make_scene([CAMERA], [[]]).frames[0].image_path, CAMERA), (320, 240))
    outlines = [np.array(ring) for ring in drawn]
    found = region(outlines, view, "a", Repairs())
    assert_good(found, (0, 0, 320, 240))
    assert region(outlines, view, "a", Repairs()).wkb == found.wkb
    # No outline takes anything from the others but needles, of which pieces below a pixel may be left.
    for outline in outlines:
        assert region([outline], view, "a", Repairs()).difference(found).buffer(-0.25).is_empty


@few(40)
@given(
    ring=rings(-3, 3),
    normals=st.lists(DIRECTIONS, min_size=1, max_size=3),
    offsets=st.lists(st.floats(-2, 2), min_size=3, max_size=3),
    contacts=st.lists(st.lists(st.tuples(*[st.floats(-3, 3)] * 2), min_size=2, max_size=4), min_size=3, max_size=3),
)
def test_refining_keeps_to_its_ten_percent(
    ring: list[tuple[float, float]],
    normals: list[Any],
    offsets: list[float],
    contacts: list[list[tuple[float, float]]],
) -> None:
    frame = PlaneFrame(np.zeros(3), np.eye(3)[:2])
    before = tidy(Polygon(ring), GRID, CONFIG)
    neighbours = [
        Neighbour(Plane(normal, d, np.zeros((4, 4)), observable=True), LineString(contact), 0.0)
        for normal, d, contact in zip(normals, offsets, contacts, strict=False)
        if LineString(contact).length > 0
    ]
    found = refine(before, frame, neighbours, GRID, CONFIG)
    assert found.is_valid
    assert refine(before, frame, neighbours, GRID, CONFIG).wkb == found.wkb
    growth, cut = CONFIG.max_growth * len(neighbours), CONFIG.max_cut * len(neighbours)
    assert before.area * (1 - cut) - 1e-6 <= found.area <= before.area * (1 + growth) + 1e-6


def drawing(polygon_px: list[tuple[float, float]]) -> MultiPolygon:
    """As it would be read."""
    view = View.of("a.png", Frame("a.png", rooms.make_scene([CAMERA], [[]]).frames[0].image_path, CAMERA), (320, 240))
    return region([np.array(polygon_px)], view, "a", Repairs())


def placed(camera: Camera, x: float, y: float) -> Camera:
    return camera.placed(camera.R_cam_from_world, np.array([x, y, 1.25]))


@few(25)
@given(
    first=rings(0, 320),
    second=rings(0, 320),
    normal=DIRECTIONS,
    distance=st.one_of(st.floats(-20, 20), st.sampled_from((0.0, 1e-9, 1e5))),
    step=st.floats(-1, 1),
)
def test_extents_of_any_plane(
    first: list[tuple[float, float]], second: list[tuple[float, float]], normal: Any, distance: float, step: float
) -> None:
    """Edge on, behind the cameras, through them, or far off: what it covers lies in front of them, and not too far."""
    drawn = [drawing(first), drawing(second)]
    cameras = [CAMERA, placed(CAMERA, 2.0 + step, 1.3)]
    floor = [rooms.draw(rooms.FLOOR.corners, camera) for camera in cameras]
    seen: list[list[rooms.Drawing]] = [[("wall", drawn[k]), ("floor", floor[k])] for k in range(2)]
    scene = rooms.make_scene(cameras, seen)
    d = distance - float(normal @ cameras[0].center_world)
    planes = [Plane(normal, d, np.zeros((4, 4)), observable=True), rooms.FLOOR.plane]
    instances = [Instance("w", "wall", ((0, 0), (1, 0))), Instance("f", "floor", ((0, 1), (1, 1)))]
    found = compute_extents(scene, instances, planes, (), CONFIG)
    again = compute_extents(scene, instances, planes, (), CONFIG)
    most = CONFIG.max_depth_ratio * median_depth(scene, instances, planes)
    for extent, other in zip(found, again, strict=True):
        assert extent.region.is_valid
        assert np.isfinite(extent.unknown_area)
        assert extent.region.wkb == other.region.wkb
        points = extent.frame.to_world(shapely.get_coordinates(extent.region))
        assert np.isfinite(points).all()
        depths = np.array([(points - camera.center_world) @ camera.R_cam_from_world[2] for camera in cameras])
        if len(points):
            assert (depths.max(axis=0) > 0).all()
            assert depths.min() <= most * (1 + 1e-6)


@few(6)
@given(
    rings_px=st.lists(rings(0, 320), min_size=2, max_size=2),
    which=st.lists(st.integers(0, 4), min_size=2, max_size=2),
    places=st.lists(st.tuples(st.floats(0.5, 3.5), st.floats(0.5, 3.0)), min_size=2, max_size=2),
)
def test_closing_of_any_drawings(
    rings_px: list[list[tuple[float, float]]], which: list[int], places: list[tuple[float, float]]
) -> None:
    surfaces = rooms.BOX[:5]
    cameras = [placed(CAMERA, *place) for place in places]
    scene = rooms.seen_from(cameras, surfaces)
    for k, (element, ring) in enumerate(zip(which, rings_px, strict=True)):
        scene = rooms.redraw(scene, k, element, drawing(ring))
    solution = solved(cameras, [], surfaces, scene=scene)
    found, again = close(solution), close(solution)
    assert found.layout.extents == solution.layout.extents
    reach = CONFIG.max_depth_ratio * median_depth(scene, found.layout.instances, found.layout.planes)
    for extent, inferred in zip(found.layout.extents, found.layout.inferred, strict=True):
        assert inferred.region.is_valid
        assert inferred.region.intersection(extent.region).area < 1e-6
        points = extent.frame.to_world(shapely.get_coordinates(inferred.region))
        assert (np.linalg.norm(points - cameras[0].center_world, axis=1) < 2 * reach).all()
    for one, other in zip(found.layout.inferred, again.layout.inferred, strict=True):
        assert one.region.wkb == other.region.wkb
