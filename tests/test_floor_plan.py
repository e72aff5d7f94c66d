"""Floor plans: by hand, as SVG, and loaded back from DXF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import rooms
import shapely
from box_room import SHIFT, SIGMA, TURN, made
from ezdxf.document import Drawing as Document
from ezdxf.entities import Dimension as DxfDimension
from ezdxf.entities import LWPolyline

from gtlayout.errors import GtlayoutError
from gtlayout.export import export_layout
from gtlayout.export.floor_plan import BAND_SIGMAS, FloorPlan, Footprint, floor_plan
from gtlayout.export.plan_drawing import draw, length_text
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
    (floor,) = plan.outlines
    assert floor.region.area == pytest.approx(20.0)


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
    for to in ("svg", "dxf"):
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
    assert drawn == pytest.approx({"floor_0": 20.0, "slanted_6": 10.0, "window_7": 1.0})
    assert not plan.openings
    export_layout(tmp_path / "a.dxf", scene, layout, "dxf")
    doc = ezdxf.readfile(tmp_path / "a.dxf")
    assert len(doc.modelspace().query('LWPOLYLINE[layer=="SLANTED"]')) == 2
    assert doc.layers.get("SLANTED").dxf.linetype == "GTLAYOUT_DASHED"


@pytest.mark.parametrize("scale", [1.0, 0.01, 300.0])
def test_no_text_lies_on_a_wall_or_another_text(room: tuple[Scene, Layout], scale: float) -> None:
    plan = _scaled(floor_plan(*room), scale)
    drawing = draw(plan)
    walls = shapely.union_all([shapely.LineString(wall.ends) for wall in plan.walls])
    boxes = [text.box for text in drawing.texts]
    for measure in drawing.measures:
        boxes.append(shapely.LineString(measure.ends).buffer(measure.height * 1.4))
    assert len(boxes) == 6 + 2 + 5
    for i, one in enumerate(boxes):
        assert not one.intersects(walls)
        assert all(one.distance(other) > 0 for other in boxes[:i])
        assert shapely.box(*drawing.bounds.ravel()).buffer(1e-9).covers(one)


def _scaled(plan: FloorPlan, scale: float) -> FloorPlan:
    """The plan in another, unknown unit."""

    def line(one: Footprint) -> Footprint:
        return replace(one, ends=scale * one.ends, drawn=scale * one.drawn, band=scale * one.band)

    return replace(
        plan,
        walls=tuple(map(line, plan.walls)),
        openings=tuple(map(line, plan.openings)),
        outlines=tuple(
            replace(one, region=shapely.transform(one.region, lambda uv: scale * uv)) for one in plan.outlines
        ),
        dimensions=tuple(replace(one, ends=scale * one.ends, length=scale * one.length) for one in plan.dimensions),
        metric=scale == 1.0,
    )


def test_lengths_are_written_with_their_uncertainty() -> None:
    assert length_text(3.93525, 0.0159, True) == "3.935 ± 0.016 m"
    assert length_text(2.68247, 0.1588, True) == "2.68 ± 0.16 m"
    assert length_text(2.4596, 0.0004, True) == "2.460 ± 0.000 m"
    assert length_text(0.0123456, 0.00012, False) == "0.01235 ± 0.00012 units"
    assert length_text(2.5, np.nan, True) == "2.500 m ± unknown"
    assert length_text(2.5, 2048.5, True) == "2.500 m ± unknown"


# The files of floor plans


def test_dxf_holds_the_same_planes(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    """Each wall's segments, put back into the world, lie on its plane and on the floor's, and are as long as it."""
    scene, layout = room
    export_layout(tmp_path / "a.dxf", scene, layout, "dxf")
    doc = ezdxf.readfile(tmp_path / "a.dxf")
    audit = doc.audit()
    assert not audit.errors
    assert not audit.fixes
    origin, *axes = (_vector(doc, name) for name in ("plan_origin", "plan_x", "plan_y"))
    segments = [
        origin + np.array(line.get_points("xy")) @ np.array(axes)
        for line in doc.query('LWPOLYLINE[layer=="WALLS"]')
        if isinstance(line, LWPolyline)
    ]
    floor = layout.planes[0]
    lengths = {2: 3.5, 3: 5.0, 4: 3.0, 5: 4.0}
    found = dict.fromkeys(lengths, 0.0)
    for segment in segments:
        np.testing.assert_allclose(segment @ floor.normal + floor.d, 0, atol=1e-9)
        distances = {i: np.abs(segment @ layout.planes[i].normal + layout.planes[i].d).max() for i in lengths}
        wall = min(distances, key=lambda i: distances[i])
        assert distances[wall] < 1e-9
        found[wall] += float(np.linalg.norm(segment[1] - segment[0]))
    assert found == pytest.approx(lengths)
    (arc,) = doc.query("ARC")
    assert arc.dxf.radius == pytest.approx(1.0)
    assert (arc.dxf.end_angle - arc.dxf.start_angle) % 360 == pytest.approx(90.0)
    measured = {one.dxf.text: one.get_measurement() for one in doc.query("DIMENSION") if isinstance(one, DxfDimension)}
    assert measured == pytest.approx({"4.000 ± 0.012 m": 4.0, "5.00 ± 0.20 m": 5.0})
    assert doc.header["$INSUNITS"] == 6


def test_dxf_is_the_same_bytes_again(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    for name in ("a.dxf", "b.dxf"):
        export_layout(tmp_path / name, *room, "dxf")
    assert (tmp_path / "a.dxf").read_bytes() == (tmp_path / "b.dxf").read_bytes()
    assert not ezdxf.options.write_fixed_meta_data_for_testing


def test_dxf_without_metres_has_no_unit(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    export_layout(tmp_path / "a.dxf", room[0], replace(room[1], metric=False), "dxf")
    doc = ezdxf.readfile(tmp_path / "a.dxf")
    assert doc.header["$INSUNITS"] == 0
    assert any("not metric" in text.dxf.text for text in doc.query("TEXT"))
    assert all("units" in dimension.dxf.text for dimension in doc.query("DIMENSION"))


def test_svg_prints_to_scale(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    scene, layout = room
    hostile = replace(layout.instances[2], name="<script>alert(1)</script>")
    layout = replace(layout, instances=(*layout.instances[:2], hostile, *layout.instances[3:]))
    export_layout(tmp_path / "a.svg", scene, layout, "svg")
    root = ET.parse(tmp_path / "a.svg").getroot()
    space = {"s": "http://www.w3.org/2000/svg"}
    assert not root.findall(".//s:script", space)
    walls = [
        np.array([[float(x) for x in point.split(",")] for point in line.attrib["points"].split()])
        for line in root.findall(".//s:polyline[@class='walls']", space)
    ]
    texts = [text.text or "" for text in root.findall(".//s:text", space)]
    assert "Unit: metre, scale 1:50" in texts
    assert sum(np.linalg.norm(line[1] - line[0]) for line in walls) == pytest.approx(1000 / 50 * 15.5, abs=0.05)
    assert {"4.000 ± 0.012 m", "5.00 ± 0.20 m", "height floor_0 – ceiling_1: 2.500 m ± unknown"} <= set(texts)
    width, height = (float(root.attrib[name].removesuffix("mm")) for name in ("width", "height"))
    assert root.attrib["viewBox"] == f"0 0 {width:.2f} {height:.2f}"
    every = np.concatenate(walls)
    assert every.min() > 0
    assert (every.max(axis=0) < [width, height]).all()


def _vector(doc: Document, name: str) -> FloatArray:
    return np.array([float(number) for number in str(doc.header.custom_vars.get(name)).split()])
