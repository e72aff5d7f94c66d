"""Floor plans by hand: walls, openings, rooms, what is weak or inferred, and where labels stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import rooms
import shapely
from box_room import SHIFT, SIGMA, TURN, made
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.accuracy import accuracy_of
from gtlayout.errors import GtlayoutError
from gtlayout.export import Format, export_layout
from gtlayout.export.floor_plan import FloorPlan, PlanDimension, floor_plan
from gtlayout.export.plan_drawing import MARGIN_MM, draw
from gtlayout.export.plan_labels import Free, area_texts, labels
from gtlayout.export.plan_measures import length_text, sides
from gtlayout.export.plan_rooms import Room
from gtlayout.export.plan_shapes import STYLES, Drawing
from gtlayout.export.plan_walls import BAND_SIGMAS, Footprint, join_corners
from gtlayout.geometry.polygons import half_plane, polygons
from gtlayout.instances import Extent
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene


@pytest.fixture
def room(tmp_path: Path) -> tuple[Scene, Layout]:
    """The box room with a door in the far wall and a window in the left one, somewhere in the world."""
    return made(tmp_path)


def in_world(plan: FloorPlan, points: FloatArray) -> FloatArray:
    """(N, 2) plan → (N, 3) room coordinates."""
    return (plan.frame.to_world(points) - SHIFT) @ TURN


def named(lines: Sequence[Footprint]) -> dict[str, Footprint]:
    return {line.name: line for line in lines}


def test_plan_of_the_box_room_by_hand(room: tuple[Scene, Layout]) -> None:
    plan = floor_plan(*room)
    assert plan.level == "floor"
    np.testing.assert_allclose(np.cross(*plan.frame.axes) @ TURN, [0, 0, 1], atol=1e-12)
    walls, openings = named(plan.walls), named(plan.openings)
    assert list(walls) == ["wall_2", "wall_3", "wall_4", "wall_5"]
    far = walls["wall_4"]
    ends = in_world(plan, far.ends)
    np.testing.assert_allclose(ends[ends[:, 0].argsort()], [[0, 5, 0], [4, 5, 0]], atol=1e-9)
    np.testing.assert_allclose(np.sort(in_world(plan, far.at(far.drawn.ravel()))[:, 0]), [0, 1.5, 2.5, 4], atol=1e-9)
    np.testing.assert_allclose(np.sort(in_world(plan, openings["door_6"].ends)[:, 0]), [1.5, 2.5], atol=1e-9)
    np.testing.assert_allclose(np.sort(in_world(plan, openings["window_7"].ends)[:, 1]), [1.0, 2.5], atol=1e-9)
    assert [len(walls[f"wall_{i}"].drawn) for i in (2, 3, 4, 5)] == [2, 1, 2, 1]
    np.testing.assert_allclose((in_world(plan, far.ends + far.inside) - ends)[:, 1], -1, atol=1e-9)
    band = in_world(plan, far.band)
    np.testing.assert_allclose([band[:, 1].min(), band[:, 1].max()], 5 + BAND_SIGMAS * SIGMA * np.array([-1, 1]))
    # The longest wall lies level, the room below it.
    sides = [wall.inside for wall in plan.walls if wall.length == pytest.approx(5.0)]
    assert any(np.allclose(inside, [0, -1], atol=1e-12) for inside in sides)
    (floor,) = plan.rooms
    assert floor.area == pytest.approx(20.0)
    assert (floor.open, floor.weak) == ((), False)


def test_walls_that_nearly_meet_do(tmp_path: Path) -> None:
    def far_wall(start: float) -> rooms.Surface:
        return rooms.Surface("wall", rooms.rectangle([start, 5.0, 0], [4.0 - start, 0, 0], [0, 0, 2.5]))

    for gap, reaches in ((0.05, True), (0.3, False)):
        plan = floor_plan(*made(tmp_path, (rooms.FLOOR, rooms.LEFT, rooms.RIGHT, far_wall(gap))))
        length = named(plan.walls)["wall_3"].length
        assert length == pytest.approx(4.0 if reaches else 4.0 - gap)


@pytest.mark.parametrize(
    ("surfaces", "level"),
    [
        ((rooms.CEILING, rooms.LEFT, rooms.FAR), "ceiling"),
        ((rooms.LEFT, rooms.FAR), "walls and cameras"),
        ((rooms.LEFT, rooms.RIGHT), "walls and cameras"),
        ((rooms.FAR,), "walls and cameras"),
    ],
)
def test_rooms_without_a_floor(tmp_path: Path, surfaces: tuple[rooms.Surface, ...], level: str) -> None:
    """The lowest point is the walls' lower edge."""
    plan = floor_plan(*made(tmp_path, surfaces))
    assert plan.level == level
    np.testing.assert_allclose(np.cross(*plan.frame.axes) @ TURN, [0, 0, 1], atol=1e-9)
    for wall in plan.walls:
        np.testing.assert_allclose(in_world(plan, wall.ends)[:, 2], 0, atol=1e-9)
    assert any("No floor" in text.text for text in draw(plan).texts)


def test_nothing_to_draw_is_one_clear_line(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    scene, layout = room
    lost = replace(layout, planes=tuple(replace(plane, observable=False) for plane in layout.planes))
    formats: tuple[Format, ...] = ("svg", "pdf", "dxf")
    for to in formats:
        with pytest.raises(GtlayoutError, match="tells which way is up: it has no floor, ceiling or wall"):
            export_layout(tmp_path / "plan", scene, lost, to)
    assert not (tmp_path / "plan").exists()
    with pytest.raises(GtlayoutError, match="no floor plan: the layout has no wall, floor or slanted"):
        floor_plan(*made(tmp_path, (rooms.CEILING,)))
    scene, layout = made(tmp_path, (rooms.FLOOR,))
    taken_for_a_wall = replace(layout, instances=(replace(layout.instances[0], label="wall"),))
    with pytest.raises(GtlayoutError, match="its walls are parallel"):
        floor_plan(scene, taken_for_a_wall)


def test_slanted_surfaces_are_outlines(tmp_path: Path) -> None:
    roof = rooms.Surface("slanted", rooms.rectangle([0, 0, 2], [0, 5, 0], [2, 0, 1]))
    skylight = rooms.Surface("window", rooms.rectangle([0.5, 2, 2.25], [0, 1, 0], [1, 0, 0.5]), host=6)
    scene, layout = made(tmp_path, (*rooms.BOX, roof, skylight))
    plan = floor_plan(scene, layout)
    drawn = {one.name: one.region.area for one in plan.outlines}
    assert drawn == pytest.approx({"slanted_6": 10.0, "window_7": 1.0})
    assert not plan.openings
    export_layout(tmp_path / "a.dxf", scene, layout, "dxf")
    doc = ezdxf.readfile(tmp_path / "a.dxf")
    assert len(doc.modelspace().query('LWPOLYLINE[layer=="SLANTED"]')) == 2
    assert doc.layers.get("SLANTED").dxf.linetype == "GTLAYOUT_SLANTED"


@pytest.mark.parametrize("scale", [1.0, 0.01, 300.0])
def test_no_text_lies_on_a_line_or_another_text(room: tuple[Scene, Layout], scale: float) -> None:
    drawing = draw(_scaled(floor_plan(*room), scale))
    assert {"wall_2", "wall_3", "wall_4", "wall_5", "door_6", "window_7"} <= {
        text.text.split()[0] for text in drawing.texts if text.layer == "labels"
    }
    assert_legible(drawing)


def assert_legible(drawing: Drawing) -> None:
    """Texts keep off walls, openings, the ends of what was seen, dimension lines and one another; A4 holds it all."""
    lines = [shapely.LineString(line.points) for line in drawing.lines if line.layer != "notes"]
    lines += [shapely.LineString(points) for measure in drawing.measures for points in measure.lines]
    boxes = [text.box for text in (*drawing.texts, *(measure.text for measure in drawing.measures))]
    for i, one in enumerate(boxes):
        assert not shapely.intersects(one, lines).any()
        assert all(one.distance(other) > 0 for other in boxes[:i])
        assert shapely.box(*drawing.bounds.ravel()).buffer(1e-9 * drawing.bounds.max()).covers(one)
    width_mm, height_mm = np.ptp(drawing.bounds, axis=0) * drawing.mm_per_unit
    assert width_mm <= 297 - 2 * MARGIN_MM
    assert height_mm <= 210 - 2 * MARGIN_MM


def test_labels_of_many_short_walls_are_led_away(tmp_path: Path) -> None:
    """A saw of 24 walls of 20 cm: each has its name, and its length, at the end of a line that begins on it."""
    steps = [np.array([0.2 * (k // 2), 0.2 * (k - k // 2)]) for k in range(25)]
    saw = [
        rooms.Surface("wall", rooms.rectangle([*start, 0], [*(end - start), 0], [0, 0, 2.5]))
        for start, end in pairwise(steps)
    ]
    drawing = draw(floor_plan(*made(tmp_path, (rooms.FLOOR, *saw))))
    assert len([text for text in drawing.texts if "0.20 m" in text.text]) == 24
    assert not [text for text in drawing.texts if "No room" in text.text]
    leads = [line for line in drawing.lines if line.layer == "labels"]
    walls = shapely.union_all([shapely.LineString(line.points) for line in drawing.lines if line.layer == "walls"])
    assert len(leads) == 24
    for lead in leads:
        assert shapely.Point(lead.points[0]).distance(walls) * drawing.mm_per_unit < 1.01
    boxes = [text.box for text in drawing.texts]
    assert all(one.distance(other) > 0 for i, one in enumerate(boxes) for other in boxes[:i])
    assert not shapely.intersects(boxes, walls).any()


def test_a_label_without_a_place_is_named(room: tuple[Scene, Layout]) -> None:
    whole = floor_plan(*room)
    plan = replace(whole, walls=whole.walls[:1], openings=(), dimensions=())
    everywhere = Free([shapely.box(-100, -100, 100, 100)], [])
    assert labels(plan, everywhere, 0.05) == ([], [], ("20.00 m², floor_0", "wall_2 5.00 m"))


def test_a_wall_that_may_be_anywhere_is_grey_and_has_no_band(room: tuple[Scene, Layout]) -> None:
    """Off by more than 15 cm with 5 %: σ of 8 cm, not of 7 cm. Without metres by more than 2 % of the plan's size."""
    scene, layout = room
    share = 0.02 * np.hypot(4.0, 5.0)
    for metric, sigma, weak in (
        (True, 0.07, False),
        (True, 0.08, True),
        (True, np.nan, True),
        (False, 0.49 * share, False),
        (False, 0.52 * share, True),
    ):
        planes = list(layout.planes)
        planes[3] = replace(planes[3], covariance=np.diag([0, 0, 0, sigma**2]))
        plan = floor_plan(scene, replace(layout, planes=tuple(planes), metric=metric))
        wall = named(plan.walls)["wall_3"]
        assert wall.weak is weak
        assert len(wall.band) == (0 if weak else 18)
        assert [one.weak for one in plan.rooms] == [weak]
        assert ("about" in area_texts(plan.rooms[0], metric)[0]) is weak
    drawing = draw(plan)
    assert {line.name for line in drawing.lines if line.layer == "weak_walls"} == {"wall_3"}
    assert {line.name for line in drawing.lines if line.layer == "walls"} == {"wall_2", "wall_4", "wall_5"}
    assert [text for text in drawing.texts if text.text.startswith("wall whose place")]


def test_levels_of_accuracy_decide_and_are_written(room: tuple[Scene, Layout]) -> None:
    scene, layout = room
    sigmas = [0.01, 0.01, 0.004, 0.02, 0.2, np.nan, 0.01, 0.01]
    plan = floor_plan(scene, replace(layout, accuracies=tuple(accuracy_of(sigma, 20) for sigma in sigmas)))
    assert {wall.name: wall.weak for wall in plan.walls} == {
        "wall_2": False,
        "wall_3": False,
        "wall_4": True,
        "wall_5": True,
    }
    texts = {text.text for text in draw(plan).texts}
    assert {"wall_2 5.00 m LOA30", "wall_3 5.00 m LOA20", "wall_4 4.00 m", "wall_5 4.00 m"} <= texts


def test_a_room_is_closed_by_walls_or_said_to_be_open(tmp_path: Path) -> None:
    """Without its fourth wall the room's outline has one open side, which closes it with a dashed line."""
    plan = floor_plan(*made(tmp_path, (rooms.FLOOR, rooms.LEFT, rooms.RIGHT, rooms.FAR)))
    (room,) = plan.rooms
    (side,) = room.open
    ends = in_world(plan, side)
    np.testing.assert_allclose(ends[ends[:, 0].argsort()], [[0, 0, 0], [4, 0, 0]], atol=1e-3)
    assert area_texts(room, True) == ("at least 20.00 m²",)
    drawing = draw(plan)
    assert [len(line.points) for line in drawing.lines if line.layer == "open"] == [2]
    assert "floor_0: at least 20.00 m²" in {text.text for text in drawing.texts}
    assert_legible(drawing)


@pytest.mark.parametrize(("low", "high"), [(0.05, 3.95), (-0.05, 4.05), (-0.05, 3.95)])
def test_floors_end_at_the_walls_that_they_nearly_reach(tmp_path: Path, low: float, high: float) -> None:
    """Drawn 5 cm short of the walls, or beyond them; the tolerance is 13 cm."""
    floor = rooms.Surface("floor", rooms.rectangle([low, low, 0], [high - low, 0, 0], [0, high - low + 1.0, 0]))
    (room,) = floor_plan(*made(tmp_path, (floor, *rooms.BOX[2:]))).rooms
    assert room.area == pytest.approx(20.0, abs=1e-6)
    assert room.open == ()


def test_a_short_wall_moves_no_floor_further_than_itself(tmp_path: Path) -> None:
    """A stub of 10 cm, 10 cm behind the end of the floor."""
    floor = rooms.Surface("floor", rooms.rectangle([0, 0, 0], [4.0, 0, 0], [0, 4.9, 0]))
    stub = rooms.Surface("wall", rooms.rectangle([1.0, 5.0, 0], [0.1, 0, 0], [0, 0, 2.5]))
    (room,) = floor_plan(*made(tmp_path, (floor, rooms.LEFT, rooms.RIGHT, rooms.NEAR, stub))).rooms
    assert room.area == pytest.approx(4.0 * 4.9, abs=1e-4)


def test_a_floor_behind_a_wall_begins_at_it(tmp_path: Path) -> None:
    """Another room, seen through a gap in the far wall, and drawn from 5 cm before it."""
    floor = rooms.Surface("floor", rooms.rectangle([1.0, 4.95, 0], [2.0, 0, 0], [0, 2.05, 0]))
    (_, behind) = floor_plan(*made(tmp_path, (rooms.FLOOR, floor, *rooms.BOX[2:]))).rooms
    assert behind.area == pytest.approx(4.0, abs=1e-6)


def test_what_is_inferred_stays_where_it_is_when_its_wall_gets_longer() -> None:
    level = Footprint("a", "wall", np.array([[0.05, 0], [3.0, 0]]), np.array([0, -1.0]), np.array([[0, 2.95]]))
    level = replace(level, inferred=np.array([[2.95, 4.0]]))
    upright = Footprint("b", "wall", np.array([[0, -2.0], [0, 0]]), np.array([1.0, 0]), np.array([[0, 2.0]]))
    longer, _ = join_corners([level, upright], 0.1)
    np.testing.assert_allclose(longer.ends, [[0, 0], [3, 0]], atol=1e-12)
    np.testing.assert_allclose(longer.at(longer.inferred.ravel()), level.at(level.inferred.ravel()), atol=1e-12)


def test_a_floor_that_goes_on_behind_a_wall_is_not_cut(tmp_path: Path) -> None:
    """Seen through a gap: 1 m beyond the far wall."""
    floor = rooms.Surface("floor", rooms.rectangle([0, 0, 0], [4.0, 0, 0], [0, 6.0, 0]))
    (room,) = floor_plan(*made(tmp_path, (floor, *rooms.BOX[2:]))).rooms
    assert room.area == pytest.approx(24.0)
    assert sum(float(shapely.LineString(one).length) for one in room.open) == pytest.approx(6.0, abs=0.01)


def test_a_floor_alone_is_a_room_without_walls(tmp_path: Path) -> None:
    plan = floor_plan(*made(tmp_path, (rooms.FLOOR,)))
    assert [shapely.LineString(one).length for one in plan.rooms[0].open] == pytest.approx([18.0], abs=0.01)
    assert_legible(draw(plan))


def test_what_is_inferred_is_dashed_and_no_part_of_what_was_seen(room: tuple[Scene, Layout]) -> None:
    """The room's first two metres were not seen, nor the wall and the part of the window there."""
    plan = floor_plan(room[0], half_seen(room[1]))
    walls = named(plan.walls)
    assert list(walls) == ["wall_2", "wall_3", "wall_4"]
    assert [walls[f"wall_{i}"].length for i in (2, 3)] == pytest.approx([3.0, 3.0])
    window = named(plan.openings)["window_7"]
    for line, expected in ((walls["wall_2"], [0, 1]), (walls["wall_3"], [0, 2]), (window, [1, 2])):
        (inferred,) = line.inferred
        np.testing.assert_allclose(np.sort(in_world(plan, line.at(inferred))[:, 1]), expected, atol=1e-6)
    (floor,) = plan.rooms
    assert (floor.area, floor.inferred.area) == pytest.approx((12.0, 8.0))
    assert area_texts(floor, True) == ("at least 12.00 m²", "20.00 m² with what is inferred")
    drawing = draw(plan)
    dashed = [shapely.LineString(line.points) for line in drawing.lines if line.layer == "inferred"]
    assert sum(line.length for line in dashed) == pytest.approx(2.0 + 2.0 + 4.0, abs=0.02)
    assert STYLES["inferred"].dashes_mm
    assert_legible(drawing)


def without_slivers(geometry: BaseGeometry) -> MultiPolygon:
    return polygons(geometry.buffer(-1e-7, join_style="mitre").buffer(1e-7, join_style="mitre"))


def half_seen(layout: Layout) -> Layout:
    """The layout as if only what lies two metres and more from the near wall had been seen, and the rest inferred."""
    seen, inferred = [], []
    for plane, extent in zip(layout.planes, layout.extents, strict=True):
        near = extent.region
        if abs(plane.normal @ TURN[:, 1]) < 0.5:
            # The half-space, in the frame of a plane along the room: all that is below y = 2 m.
            rows = (extent.frame.to_world(np.array([[0, 0], [1, 0], [0, 1.0]])) - SHIFT) @ TURN[:, 1]
            near = half_plane(np.array([rows[0] - rows[1], rows[0] - rows[2], 2.0 - rows[0]]), extent.region)
            near = without_slivers(near.intersection(extent.region))
        elif (extent.frame.origin - SHIFT) @ TURN[:, 1] > 2.0:
            near = rooms.NOTHING
        # More than is missing: what was seen is not inferred.
        inferred.append(extent)
        far = without_slivers(extent.region.difference(near))
        seen.append(Extent(extent.frame, far, far))
    return replace(layout, extents=tuple(seen), inferred=tuple(inferred), dimensions=())


def _scaled(plan: FloorPlan, scale: float) -> FloorPlan:
    """The plan in another, unknown unit."""

    def line(one: Footprint) -> Footprint:
        return replace(one, ends=scale * one.ends, drawn=scale * one.drawn, band=scale * one.band)

    def floor(one: Room) -> Room:
        return replace(one, region=shapely.transform(one.region, lambda uv: scale * uv))

    return replace(
        plan,
        walls=tuple(map(line, plan.walls)),
        openings=tuple(map(line, plan.openings)),
        rooms=tuple(map(floor, plan.rooms)),
        dimensions=tuple(replace(one, ends=scale * one.ends, length=scale * one.length) for one in plan.dimensions),
        metric=scale == 1.0,
    )


def test_the_best_known_widths_have_lines_and_the_others_stand_in_the_notes(room: tuple[Scene, Layout]) -> None:
    """Six between the same two walls: four lines, each further out, and two notes."""
    plan = floor_plan(*room)
    width = next(one for one in plan.dimensions if one.kind == "width")
    plan = replace(plan, dimensions=tuple(replace(width, sigma=0.01 * k) for k in (6, 1, 5, 2, 3, 4)))
    found, others = sides(plan)
    assert sorted(side.dimension.sigma for side in found) == pytest.approx([0.01, 0.02, 0.03, 0.04])
    assert [one.sigma for one in others] == pytest.approx([0.05, 0.06])
    drawing = draw(plan)
    assert len(drawing.measures) == 4
    lines = [shapely.LineString(measure.ends) for measure in drawing.measures]
    assert min(a.distance(b) for a, b in pairwise(lines)) * drawing.mm_per_unit == pytest.approx(7.0)
    assert sum("width wall_2" in text.text for text in drawing.texts) == 2


def test_dimension_lines_stand_where_their_walls_end(tmp_path: Path) -> None:
    """Left and right wall were seen from y = 3 m on: the width stands behind the far wall."""
    sidewalls = [replace(one, corners=np.maximum(one.corners, [0, 3.0, 0])) for one in (rooms.LEFT, rooms.RIGHT)]
    plan = floor_plan(*made(tmp_path, (rooms.FLOOR, *sidewalls, rooms.FAR)))
    ends = np.array([[[0, 4.0, 1], [4.0, 4.0, 1]]]) @ TURN.T + SHIFT
    width = PlanDimension("width", ("wall_1", "wall_2"), 4.0, 0.01, plan.frame.to_plane(ends[0]))
    drawing = draw(replace(plan, dimensions=(width,)))
    (measure,) = drawing.measures
    assert (in_world(plan, measure.ends)[:, 1] > 5.0).all()
    assert_legible(drawing)


def test_lengths_are_written_with_their_uncertainty() -> None:
    assert length_text(3.93525, 0.0159, True) == "3.935 ± 0.016 m"
    assert length_text(2.68247, 0.1588, True) == "2.68 ± 0.16 m"
    assert length_text(2.4596, 0.0004, True) == "2.460 ± 0.000 m"
    assert length_text(0.0123456, 0.00012, False) == "0.01235 ± 0.00012 units"
    assert length_text(2.5, np.nan, True) == "2.500 m ± unknown"
    assert length_text(2.5, 2048.5, True) == "2.500 m ± unknown"
