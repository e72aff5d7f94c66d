"""Proposals of undrawn frames: in closed form in a box room, then on lines of an image, and what each edge is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest
import rooms
import shapely
from shapely import MultiPolygon, Polygon
from solved_rooms import NARROW, SEEN, WIDE, solved

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Plane
from gtlayout.proposals.config import FillConfig, ProposalConfig, SnapConfig
from gtlayout.proposals.cover import cover
from gtlayout.proposals.edges import LEFT_SNAPPED
from gtlayout.proposals.fill import filled, wedges_over_open
from gtlayout.proposals.line_sigma import contact_sigma, drawn_sigma, probability_within
from gtlayout.proposals.order import next_frames
from gtlayout.proposals.outlines import segments
from gtlayout.proposals.proposal import Proposal, ProposedElement
from gtlayout.proposals.propose import propose
from gtlayout.proposals.seen import seen_instances
from gtlayout.proposals.snapping import image_lines, line_beside, snap
from gtlayout.scene import Frame, ImageArray, KeyFrame, Scene


def by_name(proposal: Proposal) -> dict[str, ProposedElement]:
    return {proposed.element.id: proposed for proposed in proposal.elements}


def off(found: MultiPolygon, expected: MultiPolygon) -> float:
    """Px between the outlines: their difference as a strip along the expected one."""
    return float(found.symmetric_difference(expected).area / expected.length)


# --- what is proposed ---


def test_what_nobody_saw_continues_what_was_drawn() -> None:
    """The wide image shows 160 px on each side that no drawing does, and has the drawn lines straight on."""
    proposal = propose(solved([NARROW], [WIDE]), 1)
    found = by_name(proposal)
    assert list(found) == [f"{surface.label}_{i}" for i, surface in enumerate(SEEN)]
    for surface, proposed in zip(SEEN, found.values(), strict=True):
        assert off(proposed.element.amodal, rooms.draw(surface.corners, WIDE)) < 0.05
        # Only where it was drawn: in the middle, from 2/3 of the distance.
        drawn_before = rooms.draw(surface.corners, WIDE).intersection(shapely.box(320 / 3, 80, 1600 / 3, 400))
        assert off(proposed.element.visible, polygons(drawn_before)) < 0.05
    assert proposal.uncovered.is_empty
    assert proposal.occlusion_edges == ()
    assert proposal.key_frame() == KeyFrame(1, tuple(proposed.element for proposed in proposal.elements))


def test_only_what_was_drawn_ends_what_is_proposed() -> None:
    """Nothing but the floor was drawn: it ends at the walls that it was drawn to, and goes on elsewhere."""
    solution = solved([NARROW], [WIDE], SEEN[:1])
    (floor,) = propose(solution, 1).elements
    assert off(floor.element.amodal, rooms.draw(rooms.FLOOR.corners, WIDE)) < 0.05
    # The upper half of the image and more shows nothing that is known.
    assert propose(solution, 1).uncovered.area > 640 * 240


def test_a_key_frame_is_proposed_as_if_it_were_not_drawn() -> None:
    nearer = rooms.level_camera((2.0, 2.0, 1.25), focal=200.0, width=640, height=480)
    scene = rooms.seen_from([NARROW, nearer], SEEN)
    # Its own drawing lets the floor go up into the far wall.
    far_wall, floor = (rooms.draw(surface.corners, nearer) for surface in (rooms.FAR, rooms.FLOOR))
    strip = far_wall.intersection(rooms.pixels(0, 290, 640, 480))
    wrong = rooms.redraw(scene, 1, 4, polygons(far_wall.difference(strip)))
    wrong = rooms.redraw(wrong, 1, 0, polygons(floor.union(strip)))
    spoiled = solved([], [], SEEN, scene=wrong)
    (far,) = (proposed for proposed in propose(spoiled, 1).elements if proposed.element.id == "wall_4")
    assert off(far.element.amodal, rooms.draw(rooms.FAR.corners, nearer)) < 0.05


def test_what_another_drawing_contradicts_is_not_filled() -> None:
    """The first image cuts a screen off; the second shows the wall behind, to the right of where the screen ends."""
    screen = rooms.Surface("wall", rooms.rectangle([1.4, 4.0, 0.5], [1.0, 0, 0], [0, 0, 1.2]))
    left = rooms.level_camera((0.9, 0.6, 1.25), focal=300.0, width=640, height=480)
    drawings: list[list[rooms.Drawing]] = []
    for camera in (left, NARROW):
        outline = rooms.draw(screen.corners, camera)
        around = polygons(rooms.draw(rooms.FAR.corners, camera).difference(outline))
        both: list[rooms.Drawing] = [("wall", around), ("wall", outline)]
        drawings.append(both if camera is left else both[:1])
    cut = 420
    drawings[0] = [
        (label, polygons(region.intersection(rooms.pixels(0, 0, cut, 480)))) for label, region in drawings[0]
    ]
    scene = rooms.make_scene([replace(left, width=cut), NARROW], drawings)
    far, cut_off = rooms.instances_of((rooms.FAR, screen), 2)
    instances = (far, replace(cut_off, members=((0, 1),)))
    solution = solved([], [WIDE], (rooms.FAR, screen), scene=scene, instances=instances)
    seen = seen_instances(solution, FillConfig())
    grown = filled(solution, seen, solution.layout.extents, [0, 1], FillConfig())[1]
    ends = [point[0] for rings in grown.frame.rings_to_world(grown.region) for ring in rings for point in ring]
    assert max(ends) == pytest.approx(2.4)
    assert grown.region.area == pytest.approx(1.2, rel=0.01)
    alone = filled(solution, seen, solution.layout.extents, [0], FillConfig())[1]
    assert alone.region.area > 10 * grown.region.area


def test_the_nearest_drawing_says_where_a_line_lies() -> None:
    """Two drawings differ by 10 cm in where a free-standing screen ends: each is right beside its own image."""
    ahead = rooms.level_camera((2.0, 1.4, 1.25), focal=300.0, width=640, height=480)
    near_first = rooms.level_camera((2.0, 0.65, 1.25), focal=300.0, width=640, height=480)
    screens = [rooms.Surface("wall", rooms.rectangle([1.2, 4, 0.5], [x, 0, 0], [0, 0, 1.2])) for x in (1.5, 1.6)]
    drawings: list[list[rooms.Drawing]] = []
    for screen, camera in zip(screens, (NARROW, ahead), strict=True):
        outline = rooms.draw(screen.corners, camera)
        drawings.append(
            [("wall", outline), ("wall", polygons(rooms.draw(rooms.FAR.corners, camera).difference(outline)))]
        )
    scene = rooms.make_scene([NARROW, ahead], drawings)
    solution = solved([], [near_first], (screens[0], rooms.FAR), scene=scene)
    found = by_name(propose(solution, 2))
    assert off(found["wall_0"].element.amodal, rooms.draw(screens[0].corners, near_first)) < 0.1


@pytest.mark.parametrize("height", [0.9, 1.7], ids=["a hole", "up to the ceiling's line"])
def test_what_something_nearer_hid_goes_on_behind_it(height: float) -> None:
    """The far wall was drawn around a screen before it; seen from the side, what that hid comes out."""
    screen = rooms.Surface("wall", rooms.rectangle([1.4, 3.0, 0.8], [0.8, 0, 0], [0, 0, height]))
    outline = rooms.draw(screen.corners, NARROW)
    around = [(s.label, polygons(rooms.draw(s.corners, NARROW).difference(outline))) for s in SEEN]
    scene = rooms.make_scene([NARROW], [[*around, ("wall", outline)]])
    aside = rooms.level_camera((2.9, 0.6, 1.25), focal=300.0, width=640, height=480)
    found = by_name(propose(solved([], [aside], (*SEEN, screen), scene=scene), 1))
    hidden = rooms.draw(screen.corners, aside)
    assert off(found["wall_5"].element.amodal, hidden) < 0.05
    far = polygons(rooms.draw(rooms.FAR.corners, aside).difference(hidden))
    assert off(found["wall_4"].element.amodal, far) < 0.05


def test_an_opening_lies_above_its_host_and_does_not_grow_sideways() -> None:
    door = rooms.Surface("door", rooms.rectangle([1.5, 5, 0], [0.9, 0, 0], [0, 0, 2.0]), host=4)
    low = rooms.level_camera((2.0, 0.6, 1.25), focal=900.0, width=640, height=480)
    # The door's top is above the first image; its sides go straight on, and the drawing of the second ends them.
    solution = solved([low, NARROW], [WIDE], (*SEEN, door))
    found = by_name(propose(solution, 2))
    assert off(found["door_5"].element.amodal, rooms.draw(door.corners, WIDE)) < 0.1
    assert off(found["wall_4"].element.amodal, rooms.draw(rooms.FAR.corners, WIDE)) < 0.05
    hidden = found["wall_4"].element.visible.intersection(found["door_5"].element.amodal)
    assert hidden.area == pytest.approx(0, abs=1e-6)


def test_an_opening_ends_where_its_host_does() -> None:
    """A screen and the window in it are cut off in the first image, and go on as far as that shows nothing else.

    The second image, from behind them, shows the wall that both would hide from where the third is.
    """
    screen = rooms.Surface("wall", rooms.rectangle([1.4, 4.0, 0.5], [1.0, 0, 0], [0, 0, 1.2]))
    window = rooms.Surface("window", rooms.rectangle([1.7, 4.0, 0.8], [0.7, 0, 0], [0, 0, 0.6]), host=1)
    left = replace(rooms.level_camera((0.9, 0.6, 1.25), focal=300.0, width=640, height=480), width=420)
    behind = rooms.level_camera((2.9, 4.3, 1.25), focal=300.0, width=640, height=480)
    image = rooms.pixels(0, 0, 420, 480)
    far, outline, inner = (
        polygons(rooms.draw(surface.corners, left).intersection(image)) for surface in (rooms.FAR, screen, window)
    )
    first: list[rooms.Drawing] = [("wall", polygons(far.difference(outline))), ("wall", outline), ("window", inner)]
    scene = rooms.make_scene([left, behind], [first, [("wall", rooms.draw(rooms.FAR.corners, behind))]])
    surfaces = (rooms.FAR, screen, window)
    both, cut, hole = rooms.instances_of(surfaces, 2)
    instances = (both, replace(cut, members=((0, 1),)), replace(hole, members=((0, 2),)))
    found = by_name(propose(solved([], [WIDE], surfaces, scene=scene, instances=instances), 2))
    host, opening = found["wall_1"].element.amodal, found["window_2"].element.amodal
    assert opening.area > 500
    assert opening.difference(host.buffer(0.05)).area == pytest.approx(0, abs=1e-6)


def test_visible_parts_are_those_of_the_nearest_drawing_that_shows_the_place() -> None:
    """Two drawings have different parts of the far wall behind a cupboard; the nearer one does not show its right."""
    first = rooms.level_camera((2.0, 1.6, 1.25), focal=200.0, width=640, height=480)
    second, asked = (rooms.level_camera((2.0, y, 1.25), focal=200.0, width=640, height=480) for y in (0.62, 0.63))
    second = replace(second, width=360)
    scene = rooms.seen_from([first, second], SEEN)
    image = rooms.pixels(0, 0, 360, 480)
    cupboards = [rooms.rectangle([x, 5, 0], [0.5, 0, 0], [0, 0, 2.0]) for x in (2.0, 1.3)]
    for k, (camera, hidden) in enumerate(zip((first, second), cupboards, strict=True)):
        wall = rooms.draw(rooms.FAR.corners, camera).difference(rooms.draw(hidden, camera))
        scene = seen_only(scene, k, 4, polygons(wall))
    for e, element in enumerate(scene.key_frames[1].elements):
        cropped = (polygons(region.intersection(image)) for region in (element.amodal, element.visible))
        scene = with_element(scene, 1, e, *cropped)

    def visible(frame: int) -> MultiPolygon:
        found = propose(solved([], [asked], scene=scene), frame).elements
        return next(one.element.visible for one in found if one.instance == 4)

    expected = rooms.draw(rooms.FAR.corners, asked).difference(rooms.draw(cupboards[1], asked))
    assert off(visible(2), polygons(expected)) < 0.2
    # The key frame itself has no say in its own proposal.
    expected = rooms.draw(rooms.FAR.corners, second).difference(rooms.draw(cupboards[0], second)).intersection(image)
    assert off(visible(1), polygons(expected)) < 0.2
    # … and what no other shows is not known: the second image ends 4.38 m · 40 px / 200 px to the right of the middle.
    assert visible(0).bounds[2] == pytest.approx(320 + 4.38 * 40 / 3.4, abs=0.5)


def seen_only(scene: Scene, key_frame: int, element: int, visible: MultiPolygon) -> Scene:
    """The scene with the visible part of one element drawn differently."""
    whole = scene.key_frames[key_frame].elements[element].amodal
    return with_element(scene, key_frame, element, whole, visible)


def with_element(scene: Scene, key_frame: int, element: int, amodal: MultiPolygon, visible: MultiPolygon) -> Scene:
    key_frames = list(scene.key_frames)
    elements = list(key_frames[key_frame].elements)
    elements[element] = replace(elements[element], amodal=amodal, visible=visible)
    key_frames[key_frame] = replace(key_frames[key_frame], elements=tuple(elements))
    return replace(scene, key_frames=tuple(key_frames))


def test_a_drawing_without_visible_parts_says_nothing_of_them() -> None:
    scene = rooms.seen_from([NARROW], SEEN)
    for element in range(len(SEEN)):
        scene = seen_only(scene, 0, element, MultiPolygon())
    found = by_name(propose(solved([], [NARROW], scene=scene), 1))
    assert all(proposed.element.visible.is_empty for proposed in found.values())
    # One that has some says that nothing is seen of the others.
    scene = seen_only(scene, 0, 4, rooms.draw(rooms.FAR.corners, NARROW))
    found = by_name(propose(solved([], [NARROW], scene=scene), 1))
    assert [name for name, proposed in found.items() if not proposed.element.visible.is_empty] == ["wall_4"]


def test_corners_lie_where_tools_write_them() -> None:
    """To .01 px: so no outline crosses itself in a file or on a page, and neighbours still meet."""
    door = rooms.Surface("door", rooms.rectangle([1.5, 5, 0], [0.9, 0, 0], [0, 0, 2.0]), host=4)
    aside = rooms.level_camera((2.213, 0.711, 1.17), focal=217.3, width=640, height=480)
    x = float(rooms.draw(rooms.FAR.corners, aside).bounds[0])
    image = pictured((x + 3.337, 100, x + 3.337, 400))
    proposal = propose(solved([NARROW], [aside], (*SEEN, door)), 1, image=image)
    regions = [region for one in proposal.elements for region in (one.element.amodal, one.element.visible)]
    assert any(edge.unsnapped_px is not None for one in proposal.elements for edge in one.edges)
    for region in regions:
        corners = shapely.get_coordinates(region)
        assert len(corners) and np.array_equal(corners, corners.round(2))
        assert region.is_valid
    # A needle of .004 px between two regions, which would cross itself when it is rounded.
    left = Polygon([(0, 0), (50, 0), (50.004, 60), (50, 100), (0, 100)])
    image_area = shapely.box(0, 0, 100, 100)
    halves = {0: MultiPolygon([left]), 1: polygons(image_area.difference(left))}
    flat = {0: np.array([0.0, 0.0, 1.0]), 1: np.array([0.0, 0.0, 1.0])}
    for region in cover(halves, image_area, flat, 1e-3, 1e-3).values():
        corners = shapely.get_coordinates(region)
        assert np.array_equal(corners, corners.round(2)) and region.is_valid


def test_edges_say_what_they_are_and_how_well_they_are_known() -> None:
    stub = rooms.Surface("wall", rooms.rectangle([1.2, 3.0, 0.8], [0.8, 0, 0], [0, 0, 0.9]))
    solution = solved([NARROW], [WIDE], (*SEEN, stub), sigma=0.02)
    found = by_name(propose(solution, 1))
    assert {edge.kind for edge in found["wall_5"].edges} == {"occlusion"}
    assert {edge.kind for edge in found["floor_0"].edges} == {"contact", "border"}
    for edge in found["floor_0"].edges:
        assert 0 < edge.confidence < 1
        assert (edge.sigma_px == 0) == (edge.kind == "border")
    assert len(propose(solution, 1).occlusion_edges) > 0
    # From elsewhere, lines that were drawn are off by the parallax of planes that are not known exactly.
    elsewhere = rooms.level_camera((2.6, 0.9, 1.4), focal=200.0, width=640, height=480)
    sharp, blurred = (by_name(propose(solved([NARROW], [elsewhere], SEEN, sigma), 1)) for sigma in (0.0, 0.2))
    assert blurred["floor_0"].score < sharp["floor_0"].score - 0.01
    known = [edge.sigma_px for edge in sharp["floor_0"].edges if edge.kind == "contact"]
    np.testing.assert_allclose(known, ProposalConfig().drawing_sigma_px)


def test_nothing_is_proposed_of_what_no_plane_places() -> None:
    solution = solved([NARROW], [WIDE])
    lost = replace(solution.layout.planes[4], observable=False)
    layout = replace(solution.layout, planes=(*solution.layout.planes[:4], lost))
    found = by_name(propose(replace(solution, layout=layout), 1))
    assert set(found) == {"floor_0", "ceiling_1", "wall_2", "wall_3"}


# --- fill ---

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("ring", "closed", "expected"),
    [
        (SQUARE, [True, True, False, True], Polygon([(0, 1), (1, 1), (1, 6), (0, 6)])),
        (
            np.array([[0, 0], [3, 0], [2, 1], [1, 1.0]]),
            [True, True, False, True],
            Polygon([(1, 1), (2, 1), (1.5, 1.5)]),
        ),
        (SQUARE, [False] * 4, shapely.box(-5, -5, 6, 6)),
        (
            np.array([[0, 0], [3, 0], [2.8, 4], [0.2, 4.0]]),
            [True, True, False, True],
            Polygon(
                [
                    (0.2, 4),
                    (2.8, 4),
                    (2.8 - 5 / np.hypot(1, 20), 4 + 100 / np.hypot(1, 20)),
                    (0.2 + 5 / np.hypot(1, 20), 4 + 100 / np.hypot(1, 20)),
                ]
            ),
        ),
    ],
    ids=["straight on", "to where they meet", "all round", "they would meet too far away"],
)
def test_open_edges_go_on_between_closed_ones(
    ring: np.ndarray[Any, Any], closed: list[bool], expected: Polygon
) -> None:
    found = shapely.union_all(list(wedges_over_open(ring, np.array(closed), 5.0, None)))
    # A fan ends in an arc, not in a chord.
    assert found.symmetric_difference(expected).area == pytest.approx(0, abs=0.01)


def test_one_closed_edge_bounds_a_half_plane() -> None:
    found = shapely.union_all(list(wedges_over_open(SQUARE, np.array([True, False, False, False]), 5.0, None)))
    assert found.bounds[1] == pytest.approx(0)
    assert found.contains(shapely.box(-3, 0.1, 0, 2))
    assert list(wedges_over_open(SQUARE, np.array([True, False, False, False]), 5.0, 0.9)) == []


def test_gaps_go_to_what_lies_behind_and_borders_stay_one_line() -> None:
    image = shapely.box(0, 0, 100, 100)
    wobbly = [(40, 0), (41, 30), (39.5, 60), (40, 100)]
    left, right = Polygon([(0, 0), *wobbly, (0, 100)]), Polygon([(45, 0), (100, 0), (100, 100), (45, 100)])
    depths = {0: np.array([0, 0, 0.5]), 1: np.array([0, 0, 0.25])}
    found = cover({0: MultiPolygon([left]), 1: MultiPolygon([right])}, image, depths, 8.0, 3.0)
    assert found[0].symmetric_difference(shapely.box(0, 0, 40, 100)).area == pytest.approx(0, abs=0.2)
    assert found[1].symmetric_difference(shapely.box(40, 0, 100, 100)).area == pytest.approx(0, abs=0.2)
    # A wide gap is nobody's.
    found = cover({0: MultiPolygon([left]), 1: MultiPolygon([right])}, image, depths, 2.0, 3.0)
    assert shapely.union_all(list(found.values())).area == pytest.approx(9500, abs=60)


# --- σ ---


def test_sigma_of_a_contact_is_how_far_the_line_moves() -> None:
    planes = rooms.FLOOR.plane, rooms.FAR.plane
    moved = [replace(plane, d=plane.d + step) for plane, step in zip(planes, (0.01, -0.01), strict=True)]
    row = float(rooms.draw(rooms.FLOOR.corners, WIDE).bounds[1])
    across = np.array([[300.0, row], [340.0, row]])
    rows = [_meeting_row(pair) for pair in ((moved[0], planes[1]), (planes[0], moved[1]))]
    expected = np.hypot(*(np.array(rows) - row))
    covariance = np.diag([0, 0, 0, 1e-4] * 2)
    assert contact_sigma(planes, covariance, WIDE, across) == pytest.approx(expected, rel=0.01)
    # Both moved alike: their joint covariance, not two alone.
    covariance[3, 7] = covariance[7, 3] = -1e-4
    assert contact_sigma(planes, covariance, WIDE, across) == pytest.approx(abs(sum(rows) - 2 * row), rel=0.01)
    assert contact_sigma((planes[0], planes[0]), covariance, WIDE, across) == np.inf


def _meeting_row(pair: tuple[Plane, Plane]) -> float:
    a, b, c = inverse_depth(pair[0], WIDE) - inverse_depth(pair[1], WIDE)
    return float(-(a * 320 + c) / b)


def test_a_line_drawn_in_another_image_is_off_by_its_parallax() -> None:
    plane = replace(rooms.FAR.plane, covariance=np.diag([0, 0, 0, 0.01]))
    beside = rooms.level_camera((2.5, 0.6, 1.25), focal=200.0, width=640, height=480)
    upright = np.array([[320.0, 200.0], [320.0, 280.0]])
    # 4.4 m away, seen from .5 m beside: f b / z² σ.
    assert drawn_sigma(plane, beside, WIDE, upright) == pytest.approx(200 * 0.5 / 4.4**2 * 0.1, rel=0.03)
    assert drawn_sigma(plane, WIDE, WIDE, upright) == pytest.approx(0, abs=1e-6)
    assert drawn_sigma(plane, beside, WIDE, upright[:, ::-1] + [120, -120]) == pytest.approx(0, abs=1e-6)


def test_probability_within_is_that_of_a_normal() -> None:
    assert probability_within(5.0, 5.0) == pytest.approx(0.6827, abs=1e-4)
    assert probability_within(5.0, np.inf) == 0
    assert probability_within(5.0, 0.0) == 1


# --- snapping ---


def pictured(*lines: tuple[float, float, float, float]) -> ImageArray:
    """Grey, with dark half-planes' borders drawn as bars 40 px wide whose left or upper side is the line."""
    image = np.full((240, 320, 3), 200, np.uint8)
    for x0, y0, x1, y1 in lines:
        along = np.array([x1 - x0, y1 - y0])
        right = np.array([-along[1], along[0]]) / np.hypot(*along) * -40
        bar = np.array([[x0, y0], [x1, y1], [x1 + right[0], y1 + right[1]], [x0 + right[0], y0 + right[1]]])
        cv2.fillPoly(image, [np.round(bar * 16 - 8).astype(np.int32)], (40, 40, 40), cv2.LINE_AA, 4)
    return image


CAMERA = rooms.level_camera((0, 0, 0), width=320, height=240)


def test_edges_move_to_the_lines_beside_them_and_corners_follow() -> None:
    lines = image_lines(pictured((164, 0, 164, 240)))
    left, right = rooms.pixels(0, 0, 160, 240), rooms.pixels(160, 0, 320, 240)
    found = snap({0: left, 1: right}, CAMERA, lines, SnapConfig())
    # Both sides of the border moved, and its ends stayed on the border of the image.
    assert off(found[0], rooms.pixels(0, 0, 164, 240)) < 0.3
    assert found[0].union(found[1]).area == pytest.approx(320 * 240)
    assert len(list(segments(found[0]))) == len(list(segments(left)))
    far = snap({0: rooms.pixels(0, 0, 150, 240), 1: rooms.pixels(150, 0, 320, 240)}, CAMERA, lines, SnapConfig())
    assert far[0].equals(rooms.pixels(0, 0, 150, 240))


def test_a_line_must_have_the_direction_and_cover_the_edge() -> None:
    edge = np.array([[100.0, 20.0], [100.0, 220.0]])

    def line(x0: float, y0: float, x1: float, y1: float) -> np.ndarray[Any, Any]:
        return np.array([[[x0, y0], [x1, y1]]])

    config = SnapConfig()
    found = line_beside(edge, line(104, 20, 104, 220), config)
    assert found is not None
    assert found @ [104, 50, 1] == pytest.approx(0)
    assert line_beside(edge, line(109, 20, 109, 220), config) is None
    assert line_beside(edge, line(97, 70, 106, 170), config) is None
    assert line_beside(edge, line(104, 20, 104, 110), config) is None
    # Two pieces of one line count together, the nearer of two lines wins.
    both = np.concatenate([line(104, 20, 104, 90), line(105, 130, 105, 200)])
    assert line_beside(edge, both, config) is not None
    nearer = line_beside(edge, np.concatenate([line(107, 20, 107, 220), line(98, 20, 98, 200)]), config)
    assert nearer is not None
    assert nearer @ [98, 50, 1] == pytest.approx(0)


def test_an_outline_that_would_cross_itself_stays() -> None:
    thin = MultiPolygon([Polygon([(100, 50), (104, 50), (104, 200), (100, 200)])])
    lines = np.array([[[107.0, 50.0], [107.0, 200.0]]])
    found = snap({0: thin}, CAMERA, np.concatenate([lines, lines - [[10, 0], [10, 0]]]), SnapConfig(near_px=100))
    assert found[0].is_valid
    assert len(list(segments(found[0]))) == 4


def test_what_was_moved_says_where_it_was() -> None:
    solution = solved([NARROW], [WIDE])
    plain = propose(solution, 1)
    image = np.full((480, 640, 3), 200, np.uint8)
    # The far wall 3 px lower than predicted where it meets the floor.
    row = round(float(rooms.draw(rooms.FLOOR.corners, WIDE).bounds[1])) + 3
    image[row:] = 60
    moved = propose(solution, 1, ProposalConfig(), image=image)
    before = {edge for proposed in plain.elements for edge in _ends(proposed)}
    changed = [edge for proposed in moved.elements for edge in proposed.edges if edge.unsnapped_px is not None]
    assert changed
    for edge in changed:
        assert edge.unsnapped_px is not None
        assert tuple(np.ravel(edge.unsnapped_px)) in before
        assert edge.confidence == LEFT_SNAPPED[edge.kind]
    floor = by_name(moved)["floor_0"].element.amodal
    assert floor.bounds[1] == pytest.approx(row, abs=0.7)
    assert len(plain.elements) == len(moved.elements)


def _ends(proposed: ProposedElement) -> list[tuple[float, ...]]:
    return [tuple(np.concatenate([edge.start_px, edge.end_px])) for edge in proposed.edges]


# --- which frames ---


def turning(count: int, step_deg: float) -> Scene:
    """Cameras on the spot that turn."""
    frames = []
    for k in range(count):
        angle = np.deg2rad(k * step_deg)
        rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        camera = rooms.level_camera((0, 0, 0))
        frames.append(Frame(f"{k}.png", Path("x"), camera.placed(rotation @ camera.R_cam_from_world, np.zeros(3))))
    return Scene(Path("x"), tuple(frames), (), metric=True)


def drawn(scene: Scene, *frames: int) -> Scene:
    return replace(scene, key_frames=tuple(KeyFrame(frame, ()) for frame in frames))


def test_the_second_frame_overlaps_the_first_and_then_they_are_spread() -> None:
    slowly, quickly = turning(40, 0.5), turning(40, 6.0)
    assert next_frames(slowly, 4) == (10, 30, 0, 20)
    first, second = next_frames(quickly, 2)
    # 90° wide: at least 30 % in common, and no more than needed.
    assert first == 10
    assert 30 < (second - first) * 6.0 < 75
    assert next_frames(drawn(slowly, 0, 39), 1) == (19,)
    assert next_frames(drawn(slowly, 0), 1) == (30,)


def test_in_video_order_the_next_is_one_step_on() -> None:
    scene = turning(40, 0.5)
    assert next_frames(drawn(scene, 0, 6, 12), 3, "video") == (18, 24, 30)
    assert next_frames(drawn(scene, 0, 6, 36), 2, "video", step=4) == (39, 21)
    assert next_frames(scene, 3, "video") == (0, 4, 8)


def test_no_more_frames_than_there_are() -> None:
    scene = turning(5, 0.5)
    assert sorted(next_frames(scene, 99)) == [0, 1, 2, 3, 4]
    assert next_frames(drawn(scene, *range(5)), 1) == ()
    with pytest.raises(GtlayoutError, match="no order 'best'; there are: spread, video"):
        next_frames(scene, 1, cast(Any, "best"))
