"""Exports load back: the same planes, areas and openings, in every format; floor plans by hand."""

from __future__ import annotations

import json
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import ezdxf
import numpy as np
import pytest
import rooms
import shapely
import trimesh
from ezdxf.document import Drawing as Document
from ezdxf.entities import Dimension as DxfDimension
from ezdxf.entities import LWPolyline
from scipy.spatial.transform import Rotation

from gtlayout.errors import GtlayoutError
from gtlayout.export import EXPORTERS, Exporter, Format, export_layout
from gtlayout.export.floor_plan import BAND_SIGMAS, FloorPlan, Footprint, floor_plan
from gtlayout.export.glb import y_up
from gtlayout.export.plan_drawing import draw, length_text
from gtlayout.io.room_structure import DOOR_FLAG, WINDOW_FLAG, read_room_structure
from gtlayout.layout import Dimension, Extent, Layout
from gtlayout.mesh import build_mesh
from gtlayout.render import render
from gtlayout.scene import Camera, FloatArray, Frame, Scene

TURN = Rotation.from_euler("xyz", [20, -110, 65], degrees=True).as_matrix()
"""World from room: exports must not count on z up."""
SHIFT = np.array([0.5, -3.0, 7.0])
DOOR = rooms.Surface("door", rooms.rectangle([1.5, 5.0, 0], [1.0, 0, 0], [0, 0, 2.0]), host=4)
WINDOW = rooms.Surface("window", rooms.rectangle([0, 1.0, 1.0], [0, 1.5, 0], [0, 0, 1.0]), host=2)
SURFACES = (*rooms.BOX, DOOR, WINDOW)
SIGMA = 0.02
VALIDATOR = Path(__file__).parent / "tools/node"
MESH_FORMATS: tuple[Format, ...] = ("glb", "obj")


@pytest.fixture
def room(tmp_path: Path) -> tuple[Scene, Layout]:
    """The box room with a door in the far wall and a window in the left one, somewhere in the world."""
    return made(tmp_path)


def made(folder: Path, surfaces: Sequence[rooms.Surface] = SURFACES) -> tuple[Scene, Layout]:
    cameras = [rooms.level_camera([2.0, y, 1.25]) for y in (1.5, 1.0)]
    seen = rooms.seen_from(cameras, surfaces)
    frames = []
    for frame in seen.frames:
        (folder / "images").mkdir(exist_ok=True)
        image = folder / "images" / frame.name
        cv2.imwrite(str(image), np.full((100, 160, 3), 90, dtype=np.uint8))
        frames.append(Frame(frame.name, image, _moved_camera(frame.camera)))
    scene = replace(seen, root=folder, frames=tuple(frames))
    moved = [replace(surface, corners=surface.corners @ TURN.T + SHIFT) for surface in surfaces]
    instances, extents = rooms.instances_of(surfaces, 2), tuple(surface.extent for surface in moved)
    planes = tuple(replace(surface.plane, covariance=np.diag([0, 0, 0, SIGMA**2])) for surface in moved)
    ends = np.array(
        [[[0, 1.0, 1.25], [4.0, 1.0, 1.25]], [[2.0, 0, 1.25], [2.0, 5.0, 1.25]], [[2.0, 1, 0], [2.0, 1, 2.5]]]
    )
    width, depth, height = ends @ TURN.T + SHIFT
    dimensions = (
        Dimension(2, 3, "width", 4.0, 0.0123, width),
        Dimension(5, 4, "width", 5.0, 0.2, depth),
        Dimension(0, 1, "height", 2.5, np.nan, height),
    )
    return scene, Layout(
        instances, planes, extents, build_mesh(instances, extents), True, dimensions if surfaces is SURFACES else ()
    )


def _moved_camera(camera: Camera) -> Camera:
    rotation = camera.R_cam_from_world @ TURN.T
    return replace(camera, R_cam_from_world=rotation, t_cam_from_world=camera.t_cam_from_world - rotation @ SHIFT)


def areas(layout: Layout) -> dict[str, float]:
    """Of each element, without the openings that lie in it."""
    own = [extent.region.area for extent in layout.extents]
    inside = [sum(own[j] for j, one in enumerate(layout.instances) if one.host == i) for i in range(len(own))]
    return {instance.name: own[i] - inside[i] for i, instance in enumerate(layout.instances)}


def loaded(path: Path) -> dict[str, trimesh.Trimesh]:
    """Each node's surface where the file puts it."""
    scene = trimesh.load_scene(path, split_objects=True, group_material=False)
    found = {}
    for node in scene.graph.nodes_geometry:
        transform, geometry = scene.graph[node]
        found[node] = scene.geometry[geometry].copy().apply_transform(transform)
    return found


@pytest.mark.parametrize("to", MESH_FORMATS)
def test_meshes_hold_the_same_planes_and_areas(tmp_path: Path, room: tuple[Scene, Layout], to: Format) -> None:
    scene, layout = room
    path = tmp_path / "out" / EXPORTERS[to].file_name
    export_layout(path, scene, layout, to)
    surfaces = loaded(path)
    assert set(surfaces) == {instance.name for instance in layout.instances}
    world = y_up(layout).T if to == "glb" else np.eye(3)
    for instance, plane in zip(layout.instances, layout.planes, strict=True):
        surface = surfaces[instance.name]
        assert surface.area == pytest.approx(areas(layout)[instance.name], abs=1e-4)
        proper = surface.area_faces > 1e-6  # along a straight seam the mesh may have slivers
        np.testing.assert_allclose(surface.face_normals[proper] @ world.T @ plane.normal, 1.0, atol=1e-6)
        np.testing.assert_allclose(surface.vertices @ world.T @ plane.normal + plane.d, 0, atol=1e-5)
        assert isinstance(surface.visual, trimesh.visual.TextureVisuals)
        assert surface.visual.material.name == instance.name


def test_ply_holds_the_same_planes_and_areas(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    scene, layout = room
    export_layout(tmp_path / "a.ply", scene, layout, "ply")
    surface = trimesh.load_mesh(tmp_path / "a.ply", process=False)
    for i, instance in enumerate(layout.instances):
        own = layout.triangles.face_instance == i
        assert surface.area_faces[own].sum() == pytest.approx(areas(layout)[instance.name], abs=1e-4)
        np.testing.assert_allclose(surface.triangles[own] @ layout.planes[i].normal + layout.planes[i].d, 0, atol=1e-5)


def test_every_file_with_units_says_whether_it_is_metric(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    scene, metric = room
    for layout, said in ((metric, b"m"), (replace(metric, metric=False), b"not metric")):
        for to in ("glb", "ply", "obj", "svg", "dxf"):
            path = tmp_path / str(layout.metric) / EXPORTERS[to].file_name
            export_layout(path, scene, layout, to)
            content = path.read_bytes()
            assert said in content
            assert (b"not metric" in content) is not layout.metric
        export_layout(tmp_path / str(layout.metric) / "clip_0", scene, layout, "cad-estate")
        said_in_folder = json.loads((tmp_path / str(layout.metric) / "clip_0/scene.json").read_text())
        assert said_in_folder["metric"] is scene.metric
    assert b"comment unit: m\n" in (tmp_path / "True/layout.ply").read_bytes()


def test_the_khronos_validator_finds_no_fault(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    node = shutil.which("node")
    if node is None or not (VALIDATOR / "node_modules/gltf-validator").is_dir():
        pytest.skip(f"no Khronos glTF validator: node, and npm install in {VALIDATOR}")
    scene, layout = room
    nothing = tuple(Extent(extent.frame, rooms.NOTHING, rooms.NOTHING) for extent in layout.extents)
    empty = replace(layout, extents=nothing, triangles=build_mesh(layout.instances, nothing))
    for what in (layout, empty):
        export_layout(tmp_path / "a.glb", scene, what, "glb")
        command = [node, str(VALIDATOR / "validate_gltf.cjs"), str(tmp_path / "a.glb")]
        report = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        assert report["issues"]["numErrors"] == report["issues"]["numWarnings"] == 0, report["issues"]["messages"]
        assert report["mimeType"] == "model/gltf-binary"
        assert report.get("info", {}).get("materialCount", 0) == (len(layout.instances) if what is layout else 0)


def test_cad_estate_renders_the_same(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    scene, layout = room
    out = tmp_path / "film_0"
    export_layout(out, scene, layout, "cad-estate")
    with np.load(out / "room_structure.npz") as data:
        count = len(layout.triangles.faces)
        types = {name: (data[name].dtype.str, data[name].shape) for name in data.files if name != "clip_name"}
        assert types == {
            "layout_triangles": ("<f4", (count, 3, 3)),
            "layout_triangle_flags": ("<i8", (count,)),
            "layout_num_tri": ("<i8", (7,)),
            "layout_labels": ("<i8", (7,)),
            "annotated_timestamps": ("<i8", (2,)),
        }
        assert data["layout_labels"].tolist() == [0, 2, 3, 1, 1, 1, 1]
        assert data["layout_num_tri"][0] == 0
    structure = read_room_structure(out / "room_structure.npz")
    area = (
        np.linalg.norm(np.cross(*(structure.triangles[:, 1:] - structure.triangles[:, :1]).swapaxes(0, 1)), axis=1) / 2
    )
    for i, surface in enumerate(SURFACES):
        host = i if surface.host is None else surface.host
        flag = {"window": WINDOW_FLAG, "door": DOOR_FLAG}.get(surface.label, 0)
        own = (structure.triangle_element == host + 1) & (structure.triangle_flags == flag)
        assert area[own].sum() == pytest.approx(areas(layout)[layout.instances[i].name], abs=1e-4)
        np.testing.assert_allclose(
            structure.triangles[own] @ layout.planes[i].normal + layout.planes[i].d, 0, atol=1e-5
        )
    # By the release's numbers a door or window is its wall.
    number = np.array([*(1 + (i if s.host is None else s.host) for i, s in enumerate(SURFACES)), 0])
    for frame in scene.frames:
        seen, _ = render(layout.planes, layout.extents, layout.instances, frame.camera)
        again = structure.render(frame.camera)
        for element in np.unique(number[seen]):
            ours, theirs = number[seen] == element, again == element
            assert (ours & theirs).sum() / (ours | theirs).sum() == pytest.approx(1.0, abs=2e-3)


def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full/mine").touch()
    with pytest.raises(GtlayoutError, match="not an empty folder"):
        export_layout(tmp_path / "full", *room, "cad-estate")
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["mine"]


def test_obj_finds_its_materials(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    for name in ("my room.obj", "room.mtl"):
        with pytest.raises(GtlayoutError, match="must not hold blanks"):
            export_layout(tmp_path / name, *room, "obj")
    assert [path.name for path in tmp_path.iterdir()] == ["images"]


def test_what_is_not_installed_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(GtlayoutError, match=r"no_such_module is not installed: pip install 'gtlayout\[extra\]'"):
        Exporter("a.b", "no_such_module", needs="extra").load()
    with pytest.raises(ModuleNotFoundError):
        Exporter("a.b", "no_such_module").load()


# Floor plans


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
    assert length_text(2.5, np.nan, True) == "2.500 ± ? m"


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
    assert {"4.000 ± 0.012 m", "5.00 ± 0.20 m", "height floor_0 – ceiling_1: 2.500 ± ? m"} <= set(texts)
    width, height = (float(root.attrib[name].removesuffix("mm")) for name in ("width", "height"))
    assert root.attrib["viewBox"] == f"0 0 {width:.2f} {height:.2f}"
    every = np.concatenate(walls)
    assert every.min() > 0
    assert (every.max(axis=0) < [width, height]).all()


def _vector(doc: Document, name: str) -> FloatArray:
    return np.array([float(number) for number in str(doc.header.custom_vars.get(name)).split()])
