"""What a camera must see of a layout, in closed form, and which drawn element is which instance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.config import Config
from gtlayout.extent.extents import compute_extents, extents_without
from gtlayout.geometry.polygons import polygons
from gtlayout.prediction.config import PredictionConfig
from gtlayout.prediction.matching import match, overlap
from gtlayout.prediction.predict import OcclusionEdge, Prediction, occlusion_edges, predict
from gtlayout.scene import Camera, Element, Label

CONFIG = PredictionConfig()
CAMERA = rooms.level_camera([1.7, 0.8, 1.1])
FAR, NEAR = 4, 5
"""In the box room."""


def seen(camera: Camera, surfaces: Sequence[rooms.Surface]) -> tuple[Prediction, tuple[OcclusionEdge, ...]]:
    planes, instances = [surface.plane for surface in surfaces], rooms.instances_of(surfaces, 1)
    prediction = predict(planes, [surface.extent for surface in surfaces], instances, camera)
    return prediction, occlusion_edges(prediction, planes, instances, camera, CONFIG)


def check_same(found: BaseGeometry, expected: BaseGeometry) -> None:
    assert found.symmetric_difference(expected).area == pytest.approx(0, abs=1e-6)


# --- predictions ---


def test_a_box_room_is_predicted_as_it_projects() -> None:
    """The camera stands in the room: floor, ceiling and side walls reach behind it, and the near wall is there."""
    found, edges = seen(CAMERA, rooms.BOX)
    for surface, amodal, visible in zip(rooms.BOX, found.amodal, found.visible, strict=True):
        expected = rooms.draw(surface.corners, CAMERA)
        check_same(amodal, expected)
        check_same(visible, expected)
    assert found.visible[NEAR].is_empty
    assert sum(region.area for region in found.visible) == pytest.approx(CAMERA.width * CAMERA.height)
    assert edges == ()


def test_a_wall_stub_hides_what_is_behind_it() -> None:
    stub = rooms.Surface("wall", rooms.rectangle([1.2, 3.0, 0.2], [0.6, 0, 0], [0, 0, 2.1]))
    found, edges = seen(CAMERA, (*rooms.BOX, stub))
    outline = rooms.draw(stub.corners, CAMERA)
    check_same(found.amodal[-1], outline)
    check_same(found.visible[-1], outline)
    for surface, amodal, visible in zip(rooms.BOX, found.amodal, found.visible, strict=False):
        check_same(amodal, rooms.draw(surface.corners, CAMERA))
        check_same(visible, rooms.draw(surface.corners, CAMERA).difference(outline))
    assert {edge.front for edge in edges} == {len(rooms.BOX)}
    # The stub stands free before the far wall: both sides of it, as far as the far wall is seen beside them.
    left, _, right, _ = outline.bounds
    _, top, _, bottom = rooms.draw(rooms.FAR.corners, CAMERA).bounds
    sides = sorted((edge.points_px for edge in edges if edge.behind == FAR), key=lambda points: points[0, 0])
    for points, x in zip(sides, (left, right), strict=True):
        np.testing.assert_allclose(points[:, 0], x)
        # A border that two hands draw differs by up to 4 px, so each side goes on for so far.
        assert np.ptp(points[:, 1]) == pytest.approx(bottom - top, abs=8.1)


def test_only_the_nearer_half_of_two_walls_that_cross_is_seen() -> None:
    facing = rooms.facing(0, 0, 100, 80)
    # Turned about the vertical through the middle of the image: before the other on the left, behind it on the right.
    crossing = rooms.Surface("wall", rooms.rectangle([-3.0, 8.5, -2.0], [6.0, 3.0, 0], [0, 0, 4.0]))
    found, edges = seen(rooms.facing_camera(), (facing, crossing))
    outline = rooms.draw(crossing.corners, rooms.facing_camera())
    nearer = outline.intersection(rooms.pixels(0, 0, 50, 80))
    check_same(found.visible[1], nearer)
    check_same(found.visible[0], rooms.pixels(0, 0, 100, 80).difference(nearer))
    # Where they cross they touch: what is less than 5 % nearer is no occlusion, and that ends at x = -1.
    assert {(edge.front, edge.behind) for edge in edges} == {(1, 0)}
    depth_at_end = 0.95 * rooms.WALL_DEPTH
    x_end = 50 + 100 * (2 * (depth_at_end - 10.0)) / depth_at_end
    assert max(edge.points_px[:, 0].max() for edge in edges) == pytest.approx(x_end)


def test_an_opening_hides_its_host_and_nothing_is_seen_behind_the_camera() -> None:
    # A door whose plane is estimated a little behind that of its wall.
    wall, door = rooms.facing(10, 10, 90, 70), rooms.facing(40, 30, 50, 60, "door", host=0)
    door = replace(door, corners=door.corners * 1.02)
    found, edges = seen(rooms.facing_camera(), (wall, door))
    opening = rooms.pixels(40, 30, 50, 60)
    check_same(found.visible[1], opening)
    check_same(found.visible[0], rooms.pixels(10, 10, 90, 70).difference(opening))
    assert edges == ()
    behind, _ = seen(rooms.level_camera([2.0, 6.0, 1.25]), [rooms.FAR])
    assert behind.amodal[0].is_empty
    assert behind.visible[0].is_empty


def test_a_hole_stays_a_hole() -> None:
    wall = rooms.facing(10, 10, 90, 70)
    hole = wall.extent.frame.to_plane(rooms.facing(30, 30, 50, 60).corners)
    region = polygons(wall.extent.region.difference(MultiPolygon([(hole, [])])))
    extent = replace(wall.extent, region=region)
    found = predict([wall.plane], [extent], rooms.instances_of([wall], 1), rooms.facing_camera())
    check_same(found.visible[0], rooms.pixels(10, 10, 90, 70).difference(rooms.pixels(30, 30, 50, 60)))


def test_a_key_frame_has_no_say_in_what_the_others_see() -> None:
    cameras = [rooms.level_camera([2.0, y, 1.25]) for y in (1.5, 1.0, 0.5)]
    scene = rooms.seen_from(cameras, rooms.BOX)
    # The first key frame draws only the upper half of the far wall.
    whole = rooms.draw(rooms.FAR.corners, cameras[0])
    half = polygons(whole.intersection(rooms.pixels(0, 0, 160, 50)))
    scene = rooms.redraw(scene, 0, FAR, half)
    instances = rooms.instances_of(rooms.BOX[: FAR + 1], 3)
    planes = [surface.plane for surface in rooms.BOX[: FAR + 1]]
    config = Config().extent
    without = extents_without(scene, instances, planes, (0, 1), config)
    everyone = compute_extents(scene, instances, planes, (), config)
    assert without[0][FAR].region.area == pytest.approx(rooms.WIDTH_M * rooms.HEIGHT_M)
    check_same(predict(planes, without[0], instances, cameras[0]).visible[FAR], whole)
    # The others: one draws the lower half of it, none anything else there.
    assert without[1][FAR].region.area == pytest.approx(everyone[FAR].unrefined.area)
    alone = [replace(instance, members=instance.members[:1]) for instance in instances]
    assert all(extent.region.is_empty for extent in extents_without(scene, alone, planes, (0,), config)[0])


# --- matching ---


def drawn(*elements: tuple[Label, MultiPolygon]) -> list[Element]:
    return [Element(f"e{e}", label, amodal, MultiPolygon()) for e, (label, amodal) in enumerate(elements)]


def predicted(*regions: MultiPolygon) -> Prediction:
    return Prediction(regions, regions)


LEFT, RIGHT = rooms.pixels(0, 0, 50, 80), rooms.pixels(50, 0, 100, 80)


def test_only_what_is_both_drawn_and_predicted_is_compared() -> None:
    found = overlap(drawn(("wall", LEFT), ("floor", RIGHT)), predicted(rooms.pixels(0, 0, 25, 80), RIGHT))
    np.testing.assert_allclose(found.iou, [[1, 0], [0, 1]])
    np.testing.assert_allclose(found.known_share, [0.5, 1])
    np.testing.assert_allclose(found.drawn_share, [1, 1])
    # The second is predicted on a tenth of the first.
    found = overlap(
        drawn(("wall", LEFT), ("floor", RIGHT)), predicted(rooms.pixels(0, 0, 45, 80), rooms.pixels(45, 0, 100, 80))
    )
    np.testing.assert_allclose(found.iou, [[45 / 50, 5 / 100], [0, 50 / 55]])
    found = overlap(drawn(("wall", LEFT)), predicted(rooms.pixels(0, 0, 100, 80), MultiPolygon()))
    np.testing.assert_allclose(found.drawn_share, [0.5, 0])


def test_openings_lie_on_top_of_their_walls() -> None:
    door = rooms.pixels(10, 20, 20, 60)
    wall = polygons(LEFT.difference(door))
    found = overlap(drawn(("door", door), ("wall", LEFT)), predicted(wall, door))
    np.testing.assert_allclose(found.iou, [[0, 1], [1, 0]])


def test_labels_that_are_exchanged_do_not_hide_what_is_what() -> None:
    found = overlap(drawn(("floor", LEFT), ("wall", RIGHT)), predicted(LEFT, RIGHT))
    assert match(found, ["floor", "wall"], ["wall", "floor"], CONFIG) == [0, 1]


@pytest.mark.parametrize("labels", [("window", "door"), ("door", "window")])
def test_of_two_that_fit_alike_the_one_with_the_same_label_is_taken(labels: tuple[Label, Label]) -> None:
    found = overlap(drawn(("door", LEFT)), predicted(LEFT, LEFT))
    assert found.iou[0, 0] == found.iou[0, 1] == 0.5
    assert match(found, ["door"], labels, CONFIG) == [labels.index("door")]


def test_what_fits_nothing_is_not_matched() -> None:
    found = overlap(drawn(("wall", LEFT), ("wall", RIGHT)), predicted(rooms.pixels(10, 0, 55, 80)))
    assert match(found, ["wall", "wall"], ["wall"], CONFIG) == [0, None]
    found = overlap(drawn(("wall", LEFT)), predicted(MultiPolygon()))
    assert match(found, ["wall"], ["wall"], CONFIG) == [None]
    assert found.known_share.tolist() == [0.0]
