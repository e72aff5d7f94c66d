"""IFC and USD: valid by their own tools' checkers, and surfaces where the layout has them; SceneScript read back."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.util.element
import ifcopenshell.validate
import numpy as np
import pytest
import rooms
import trimesh
from pxr import Usd, UsdGeom, UsdValidation

from gtlayout.errors import GtlayoutError
from gtlayout.export import EXPORTERS, Format, export_layout
from gtlayout.export.facts import NOT_METRIC
from gtlayout.export.ifc import PROPERTIES, SHELL_THICKNESS_M, THICKNESS_M
from gtlayout.export.upright import z_up_from_world
from gtlayout.instances import Dimension, Extent, Plane
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.scene import FloatArray, Scene

UP = np.array([[0.6, 0.8, 0.0], [0.0, 0.0, 1.0], [0.8, -0.6, 0.0]])
"""A world that is not level: rows are its axes in the room's."""
DOOR = rooms.Surface("door", rooms.rectangle([1.5, 5.05, 0], [0, 0, 2.0], [1.0, 0, 0]), host=4)
WINDOW = rooms.Surface("window", rooms.rectangle([0, 1, 1], [0, 2, 0], [0, 0, 1.0]), host=2)
LOOSE = rooms.Surface("door", rooms.rectangle([4, 1, 0], [0, 0, 2.0], [0, 1.0, 0]))
SLANTED = rooms.Surface("slanted", rooms.rectangle([0, 0, 1.5], [4.0, 0, 0], [0, 1.0, 1.0])[::-1].copy())
SURFACES = (*rooms.BOX, DOOR, WINDOW, LOOSE, SLANTED)
CLASSES = {"IfcWall": 4, "IfcSlab": 2, "IfcCovering": 1, "IfcDoor": 2, "IfcWindow": 1, "IfcOpeningElement": 2}
AREAS = [20.0, 20.0, 12.5 - 2.0, 12.5, 10.0 - 2.0, 10.0, 2.0, 2.0, 2.0, 4 * np.sqrt(2)]
"""Of SURFACES, less the openings in them."""


def scene_and_layout(surfaces: Sequence[rooms.Surface] = SURFACES, metric: bool = True) -> tuple[Scene, Layout]:
    """The surfaces in the tilted world, each plane with a σ of 1° and 2 cm."""
    surfaces = [replace(surface, corners=surface.corners @ UP.T) for surface in surfaces]
    drawn = [(surface.label, rooms.pixels(70, 40, 95, 67)) for surface in surfaces]
    scene = replace(rooms.make_scene([rooms.level_camera([2.0, 1.0, 1.25])], [drawn]), metric=metric)
    instances = rooms.instances_of(surfaces, 1)
    covariance = np.diag([*np.deg2rad([1.0, 1.0, 1.0]) ** 2, 0.02**2])
    planes = tuple(replace(surface.plane, covariance=covariance, note='a "note" — ü') for surface in surfaces)
    extents = tuple(surface.extent for surface in surfaces)
    height = Dimension(0, 1, "height", 2.5, 0.03, np.array([[0, 0, 0], [0, 0, 2.5]]) @ UP.T)
    return scene, Layout(instances, planes, extents, build_mesh(instances, extents), metric, (height,))


def without_place(layout: Layout, *gone: int) -> Layout:
    """The layout with unobservable planes."""
    planes, extents = list(layout.planes), list(layout.extents)
    for i in gone:
        planes[i] = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False, note="nothing")
        extents[i] = Extent(extents[i].frame, rooms.NOTHING, rooms.NOTHING)
    mesh = build_mesh(layout.instances, extents)
    return replace(layout, planes=tuple(planes), extents=tuple(extents), triangles=mesh, dimensions=())


def written_ifc(folder: Path, scene: Scene, layout: Layout) -> Any:
    export_layout(folder / "layout.ifc", scene, layout, "ifc")
    return ifcopenshell.open(str(folder / "layout.ifc"))


def complaints(model: Any, rules: bool = False) -> list[Any]:
    """What ifcopenshell's validation says, the schema's WHERE rules included where they are asked for (seconds)."""
    log = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(model, log, express_rules=rules)
    return list(log.statements)


def shape(product: Any) -> trimesh.Trimesh:
    """A product as triangles, its openings cut out."""
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    made: Any = ifcopenshell.geom.create_shape(settings, product)
    triangles = made.geometry
    return trimesh.Trimesh(np.reshape(triangles.verts, (-1, 3)), np.reshape(triangles.faces, (-1, 3)), process=False)


def heights(points: FloatArray, plane: Plane, scene: Scene, layout: Layout) -> FloatArray:
    """Distances of (..., 3) points of a file from a plane of the layout."""
    return points @ (z_up_from_world(scene, layout) @ plane.normal) + plane.d


def properties(product: Any) -> dict[str, Any]:
    return dict(ifcopenshell.util.element.get_psets(product)[PROPERTIES])


def test_ifc_is_valid_and_has_every_element(tmp_path: Path) -> None:
    scene, layout = scene_and_layout()
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model, rules=True) == []
    assert {kind: len(model.by_type(kind)) for kind in CLASSES} == CLASSES
    assert [len(model.by_type(f"IfcRel{kind}Element")) for kind in ("Voids", "Fills")] == [2, 2]
    for surface, instance in zip(SURFACES, layout.instances, strict=True):
        (product,) = (e for e in model.by_type("IfcBuildingElement") if e.Name == instance.name)
        filled = [rel.RelatingOpeningElement.VoidsElements[0] for rel in getattr(product, "FillsVoids", ())]
        hosts = [rel.RelatingBuildingElement.Name for rel in filled]
        assert hosts == ([] if surface.host is None else [layout.instances[surface.host].name])
        storey: Any = ifcopenshell.util.element.get_container(product)
        assert storey.is_a("IfcBuildingStorey")


def test_ifc_surfaces_lie_where_the_layout_has_them(tmp_path: Path) -> None:
    """The room's side of each body is on the plane and as large as the extent; the other one thickness behind it."""
    scene, layout = scene_and_layout()
    model = written_ifc(tmp_path, scene, layout)  # its products point into it
    products = {e.Name: e for e in model.by_type("IfcBuildingElement")}
    assert np.allclose(z_up_from_world(scene, layout) @ layout.planes[0].normal, [0, 0, 1])
    for instance, plane, area in zip(layout.instances, layout.planes, AREAS, strict=True):
        body = shape(products[instance.name])
        distances = heights(body.vertices, plane, scene, layout)
        thickness = THICKNESS_M.get(instance.label, SHELL_THICKNESS_M)
        assert np.allclose(distances[distances > -0.5 * thickness], 0, atol=1e-6)
        assert np.allclose(distances[distances < -0.5 * thickness], -thickness, atol=1e-6)
        front = np.abs(heights(body.triangles, plane, scene, layout)).max(axis=1) < 1e-6
        assert np.isclose(body.area_faces[front].sum(), area)
    assert np.isclose(products["door_6"].OverallHeight, 2.0)
    assert np.isclose(products["door_6"].OverallWidth, 1.0)
    assert np.isclose(products["window_7"].OverallWidth, 2.0)


def test_walls_alone_tell_where_up_is(tmp_path: Path) -> None:
    """Without floor and ceiling, and by cameras that look 20° down."""
    scene, layout = scene_and_layout()
    nod = rooms.level_camera([2.0, 1.0, 1.25]).R_cam_from_world.T
    down = trimesh.transformations.rotation_matrix(np.deg2rad(-20), [1, 0, 0])[:3, :3] @ nod
    camera = replace(scene.frames[0].camera, R_cam_from_world=(UP @ down).T)
    scene = replace(scene, frames=(replace(scene.frames[0], camera=camera),))
    layout = without_place(layout, 0, 1, 9)
    assert np.allclose(z_up_from_world(scene, layout) @ UP[:, 2], [0, 0, 1])
    export_layout(tmp_path / "room.txt", scene, layout, "scenescript")
    assert len(read_commands((tmp_path / "room.txt").read_text())) == 6


def test_ifc_properties(tmp_path: Path) -> None:
    scene, layout = scene_and_layout()
    model = written_ifc(tmp_path, scene, layout)
    wall = properties(next(e for e in model.by_type("IfcWall") if e.Name == "wall_2"))
    assert np.isclose(wall["sigma_normal_deg"], 1.0)
    assert wall["note"] == 'a "note" — ü'
    rows = [[float(number) for number in row.split()] for row in wall["covariance_world"].split(";")]
    assert np.array_equal(rows, layout.planes[2].covariance)
    assert properties(model.by_type("IfcBuildingStorey")[0])["height floor_0 ceiling_1"] == "2.5 ± 0.03 m"


def test_ifc_without_metres_says_so(tmp_path: Path) -> None:
    """And its thickness goes with the size of the room."""
    thickness = []
    for size in (1.0, 100.0):
        surfaces = [replace(surface, corners=size * surface.corners) for surface in SURFACES]
        model = written_ifc(tmp_path, *scene_and_layout(surfaces, metric=False))
        assert model.by_type("IfcProject")[0].Description == NOT_METRIC
        wall = properties(model.by_type("IfcWall")[0])
        assert wall["metric"] is False
        thickness.append(wall["nominal_thickness"])
    assert 0.1 < thickness[0] < 0.2
    assert np.isclose(thickness[1], 100 * thickness[0])
    assert "scene unit" in properties(model.by_type("IfcBuildingStorey")[0])["height floor_0 ceiling_1"]


def test_ifc_of_what_has_no_place(tmp_path: Path) -> None:
    """A door whose wall is unobservable stands in the storey; what has no place itself is only named."""
    scene, layout = scene_and_layout()
    model = written_ifc(tmp_path, scene, without_place(layout, 4, 7))
    assert complaints(model) == []
    assert (len(model.by_type("IfcWall")), len(model.by_type("IfcOpeningElement"))) == (3, 0)
    door = next(door for door in model.by_type("IfcDoor") if door.Name == "door_6")
    assert np.abs(heights(shape(door).vertices, layout.planes[6], scene, layout)).max() < THICKNESS_M["door"] + 1e-6
    assert properties(model.by_type("IfcBuildingStorey")[0])["not_placed"] == "wall_4, window_7"
    empty = written_ifc(tmp_path, scene, without_place(layout, *range(len(SURFACES))))
    assert complaints(empty) == []
    assert len(empty.by_type("IfcBuildingElement")) == 0


@pytest.mark.parametrize("to", ["ifc", "usd"])
def test_the_same_bytes_twice(tmp_path: Path, to: Format) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for path in (first, second):
        export_layout(path, *scene_and_layout(), to)
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("to", ["ifc", "usd"])
def test_names_as_hostile_as_they_come(tmp_path: Path, to: Format) -> None:
    scene, layout = scene_and_layout()
    names = ["<script>", "</Room>", "a'b\"c\\", "x" * 300, "", "\n\t\x00", "日本", "a b", "a_b", "\ud800"]
    layout = replace(layout, instances=tuple(replace(i, name=n) for i, n in zip(layout.instances, names, strict=True)))
    if to == "ifc":
        model = written_ifc(tmp_path, scene, layout)
        assert complaints(model) == []
        assert "a'b\"c\\" in {wall.Name for wall in model.by_type("IfcWall")}
    else:
        stage, prims = written_usd(tmp_path, scene, layout)
        assert usd_complaints(stage) == []
        assert prims["日本"].GetPrim().IsValid()
        assert len(list(stage.GetPrimAtPath("/Room").GetChildren())) == len(names)


@pytest.mark.parametrize(("to", "package"), [("ifc", "ifcopenshell"), ("usd", "pxr")])
def test_the_extra_is_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, to: Format, package: str) -> None:
    for module in [name for name in sys.modules if name.startswith(EXPORTERS[to].module)]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(GtlayoutError, match=rf"pip install 'gtlayout\[{to}\]'"):
        export_layout(tmp_path / "out", *scene_and_layout(), to)
    assert not list(tmp_path.iterdir())


def written_usd(folder: Path, scene: Scene, layout: Layout) -> tuple[Any, dict[str, Any]]:
    """The stage, and its meshes by the names of their elements."""
    export_layout(folder / "layout.usda", scene, layout, "usd")
    stage = Usd.Stage.Open(str(folder / "layout.usda"))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.GetPrimAtPath("/Room").GetChildren()]
    return stage, {mesh.GetPrim().GetAttribute("gtlayout:name").Get(): mesh for mesh in meshes}


def usd_complaints(stage: Any) -> list[str]:
    """What all of USD's validators say."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    return [error.GetMessage() for error in UsdValidation.ValidationContext(validators).Validate(stage)]


def test_usd_is_valid_and_its_surfaces_lie_where_the_layout_has_them(tmp_path: Path) -> None:
    scene, layout = scene_and_layout()
    stage, meshes = written_usd(tmp_path, scene, layout)
    assert usd_complaints(stage) == []
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Z", 1.0)
    assert stage.GetDefaultPrim().GetPath() == "/Room"
    for instance, plane, area in zip(layout.instances, layout.planes, AREAS, strict=True):
        mesh = meshes[instance.name]
        faces = np.reshape(mesh.GetFaceVertexIndicesAttr().Get(), (-1, 3))
        surface = trimesh.Trimesh(np.array(mesh.GetPointsAttr().Get()), faces, process=False)
        assert np.isclose(surface.area, area, rtol=1e-5)
        assert np.allclose(heights(surface.vertices, plane, scene, layout), 0, atol=1e-5)
        assert np.allclose(surface.face_normals, z_up_from_world(scene, layout) @ plane.normal, atol=1e-5)
        assert np.isclose(mesh.GetPrim().GetAttribute("gtlayout:sigma_normal_deg").Get(), 1.0)
        sigma = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("sigma")
        assert sigma.GetInterpolation() == "vertex"
        assert min(sigma.Get()) >= 0.02 - 1e-6


def test_usd_without_metres_says_so(tmp_path: Path) -> None:
    stage, meshes = written_usd(tmp_path, *scene_and_layout(metric=False))
    assert stage.GetMetadata("comment") == NOT_METRIC
    assert not any(mesh.GetPrim().GetAttribute("gtlayout:metric").Get() for mesh in meshes.values())


def test_usd_of_nothing(tmp_path: Path) -> None:
    scene, layout = scene_and_layout()
    stage, meshes = written_usd(tmp_path, scene, without_place(layout, *range(len(SURFACES))))
    assert usd_complaints(stage) == []
    assert meshes == {}


def read_commands(text: str) -> dict[tuple[str, int], dict[str, float]]:
    """As the authors' LanguageSequence.load_from_file takes a file apart."""
    commands = {}
    for line in text.splitlines():
        name, *parameters = line.rstrip().split(", ")
        values = {key: float(value) for key, value in (parameter.split("=") for parameter in parameters)}
        commands[name, int(values["id"])] = values
    return commands


def test_scenescript_walls_and_what_lies_in_them(tmp_path: Path) -> None:
    """Where walls and openings of the box are, in the file's frame; the slanted surface and the loose door are not."""
    scene, layout = scene_and_layout()
    export_layout(tmp_path / "room.txt", scene, layout, "scenescript")
    commands = read_commands((tmp_path / "room.txt").read_text())
    assert list(commands) == [*(("make_wall", i) for i in range(4)), ("make_door", 1000), ("make_window", 2000)]
    file_from_room = z_up_from_world(scene, layout) @ UP
    for number, surface in enumerate(rooms.BOX[2:]):
        wall = commands["make_wall", number]
        ends = np.array([[wall[f"{end}_{axis}"] for axis in "xyz"] for end in "ab"]) @ file_from_room
        corners = surface.corners[surface.corners[:, 2] == 0]
        distances = np.linalg.norm(ends[:, None] - corners, axis=2)
        assert np.allclose(np.sort(distances, axis=1)[:, 0], 0, atol=2e-6)
        assert np.isclose(np.linalg.norm(ends[1] - ends[0]), np.linalg.norm(corners[1] - corners[0]), atol=2e-6)
        assert (wall["height"], wall["thickness"]) == (2.5, 0.0)
    # The door's leaf is 5 cm behind its wall, the door in it.
    for opening, host, center, size in (
        (commands["make_door", 1000], 2, [2.0, 5.0, 1.0], (1.0, 2.0)),
        (commands["make_window", 2000], 0, [0.0, 2.0, 1.5], (2.0, 1.0)),
    ):
        assert (opening["wall0_id"], opening["wall1_id"]) == (host, host)
        position = np.array([opening[f"position_{axis}"] for axis in "xyz"]) @ file_from_room
        assert np.allclose(position, center, atol=2e-6)
        assert np.allclose((opening["width"], opening["height"]), size, atol=2e-6)


def test_scenescript_leans_a_wall_upright_at_half_its_height(tmp_path: Path) -> None:
    """5° from upright it is still a wall, 15° no more."""
    for degrees, walls in ((5, 4), (15, 3)):
        lean = 2.5 * np.tan(np.deg2rad(degrees))
        leaning = rooms.Surface("wall", rooms.rectangle([0, 0, 0], [0, 5, 0], [-lean, 0, 2.5]))
        scene, layout = scene_and_layout((*rooms.BOX[:2], leaning, *rooms.BOX[3:]))
        export_layout(tmp_path / "room.txt", scene, layout, "scenescript")
        commands = read_commands((tmp_path / "room.txt").read_text())
        assert len(commands) == walls
        if walls == 4:
            ends = np.array([[commands["make_wall", 0][f"{end}_{axis}"] for axis in "xyz"] for end in "ab"])
            assert np.allclose((ends @ z_up_from_world(scene, layout) @ UP)[:, 0], -lean / 2, atol=2e-6)


def test_scenescript_cannot_say_that_it_is_not_metric(tmp_path: Path) -> None:
    with pytest.raises(GtlayoutError, match="--known-distance"):
        export_layout(tmp_path / "room.txt", *scene_and_layout(metric=False), "scenescript")
    assert not list(tmp_path.iterdir())


def test_scenescript_of_nothing(tmp_path: Path) -> None:
    scene, layout = scene_and_layout()
    export_layout(tmp_path / "room.txt", scene, without_place(layout, *range(len(SURFACES))), "scenescript")
    assert (tmp_path / "room.txt").read_text() == ""
