"""Exports load back: the same planes, areas and openings, in every format."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rooms
import trimesh
from box_room import SURFACES, made

from gtlayout.errors import GtlayoutError
from gtlayout.export import EXPORTERS, Exporter, Format, export_layout
from gtlayout.export.glb import y_up
from gtlayout.geometry.render import render
from gtlayout.instances import Extent
from gtlayout.io.cad_estate.room_structure import DOOR_FLAG, WINDOW_FLAG, read_room_structure
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.scene import Scene

VALIDATOR = Path(__file__).parent / "tools/node"
MESH_FORMATS: tuple[Format, ...] = ("glb", "obj")


@pytest.fixture
def room(tmp_path: Path) -> tuple[Scene, Layout]:
    """The box room with a door in the far wall and a window in the left one, somewhere in the world."""
    return made(tmp_path)


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
