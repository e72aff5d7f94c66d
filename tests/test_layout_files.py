"""Result files: written, read back, the same bytes twice, and one clear line for a damaged layout."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rooms
import shapely
import trimesh
from shapely import MultiPolygon, Polygon, box

from gtlayout.colors import LABEL_COLORS
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.instances import Dimension, Extent, Plane, Support
from gtlayout.io.files import write_all_atomic
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh, vertex_sigma
from gtlayout.quality.assess import Quality, assess
from gtlayout.results.layout_files import write_results
from gtlayout.results.layout_reader import read_layout
from gtlayout.results.tables import dimensions, headline_text, instance_table, markdown, measures, reasons
from gtlayout.scene import Scene

DOOR = rooms.Surface("door", rooms.rectangle([1.5, 5.0, 0], [1.0, 0, 0], [0, 0, 2.0]), host=4)
SURFACES = (*rooms.BOX[:5], DOOR)
SUPPORT = Support(17, 0.25, 1.25, 0.5, 3, 2.5, "contact edges")
FILES = ["config.json", "layout.glb", "layout.json", "layout.ply", "quality.json"]
Edit = Callable[[Path, Callable[[Any], object]], None]


@pytest.fixture
def solved() -> tuple[Scene, Layout, Quality]:
    """Five sides of the box room with a door; the ceiling is unobservable, the left wall has a hole and two pieces."""
    scene = rooms.seen_from([rooms.level_camera([2.0, y, 1.25]) for y in (1.0, 0.5)], SURFACES)
    instances = rooms.instances_of(SURFACES, 2)
    planes, extents = [surface.plane for surface in SURFACES], [surface.extent for surface in SURFACES]
    planes[0] = replace(planes[0], covariance=np.diag([1e-4, 2e-4, 3e-5, 4e-6]) + 1e-6, support=SUPPORT, note="thin")
    planes[1] = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False, note="no track places it")
    extents[1] = Extent(extents[1].frame, rooms.NOTHING, rooms.NOTHING)
    pieces = MultiPolygon([Polygon(box(0, 0, 3, 2.5).exterior, [box(1, 1, 2, 2).exterior.coords]), box(4, 0, 5, 2.5)])
    extents[2] = Extent(extents[2].frame, pieces, extents[2].unrefined, unknown_area=1.5)
    mesh = build_mesh(instances, extents)
    quality = assess(scene, instances, planes, extents, Config().quality)
    depth = Dimension(4, 0, "width", 5.0, 0.0125, np.array([[2.0, 5.0, 1.25], [2.0, 0.0, 1.25]]))
    unknown = Dimension(0, 1, "height", 2.5, np.nan, np.array([[2.0, 2.5, 0.0], [2.0, 2.5, 2.5]]))
    return scene, Layout(instances, tuple(planes), tuple(extents), mesh, True, (depth, unknown)), quality


def test_layout_reads_back_equal(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, quality = solved
    write_results(tmp_path, scene, layout, quality, Config())
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES
    back = read_layout(tmp_path, scene)
    assert back.instances == layout.instances
    assert back.metric
    for found, plane in zip(back.planes, layout.planes, strict=True):
        np.testing.assert_array_equal(found.normal, plane.normal)
        np.testing.assert_array_equal(found.d, plane.d)
        np.testing.assert_array_equal(found.covariance, plane.covariance)
        assert (found.observable, found.note) == (plane.observable, plane.note)
        # NaN is not equal to itself, but its text is.
        assert repr(found.support) == repr(plane.support)
    for read, dimension in zip(back.dimensions, layout.dimensions, strict=True):
        assert (read.first, read.second, read.kind) == (dimension.first, dimension.second, dimension.kind)
        np.testing.assert_array_equal([read.length, read.sigma], [dimension.length, dimension.sigma])
        np.testing.assert_array_equal(read.ends_world, dimension.ends_world)
    np.testing.assert_array_equal(back.triangles.vertices, layout.triangles.vertices)
    np.testing.assert_array_equal(back.triangles.faces, layout.triangles.faces)
    np.testing.assert_array_equal(back.triangles.face_instance, layout.triangles.face_instance)
    for got, extent in zip(back.extents, layout.extents, strict=True):
        np.testing.assert_array_equal(got.frame.axes, extent.frame.axes)
        for region, expected in ((got.region, extent.region), (got.unrefined, extent.unrefined)):
            assert shapely.equals_exact(region, expected, tolerance=1e-12)
        assert got.unknown_area == extent.unknown_area
    assert assess(scene, back.instances, back.planes, back.extents, Config().quality).elements == quality.elements


def test_same_layout_same_bytes(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    for folder in ("a", "b"):
        write_results(tmp_path / folder, *solved, Config())
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_refined_cameras_do_not_outlive_their_layout(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    write_results(tmp_path, *solved, Config(), new_cameras=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["cameras.json", *FILES])
    write_results(tmp_path, *solved, Config())
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES


def test_layout_json_says_what_a_reader_needs(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, quality = solved
    write_results(tmp_path, scene, layout, quality, Config(seed=7))
    data = json.loads((tmp_path / "layout.json").read_text(), parse_constant=pytest.fail)
    assert data["metric"] is True
    assert data["seed"] == 7
    door, ceiling = data["instances"][5], data["instances"][1]
    assert door["host"] == "wall_4"
    assert door["members"][1] == {"image": "1.png", "element": "e5"}
    assert door["extent"]["area"] == pytest.approx(2.0)
    corners = np.array(door["extent"]["polygons"][0][0])
    np.testing.assert_allclose(corners[:, 1], 5.0)
    assert len(corners) == 4
    assert ceiling["plane"]["normal"] == [None] * 3
    assert ceiling["verdict"] == "unobservable"
    assert len(data["instances"][2]["extent"]["polygons"][0]) == 2
    assert data["headline"] == {"word": "redo", "reasons": list(quality.headline.reasons)}
    assert data["predicted"] == quality.predicted == "doubtful", "the ceiling is unknown"
    assert ceiling["causes"] == ["no point on it could be tracked", "no contact edge"]
    assert data["instances"][0]["plane"]["support"]["parallax_deg"] == 1.25
    assert data["dimensions"][0]["between"] == ["wall_4", "floor_0"]
    assert data["dimensions"][0]["sigma"] == 0.0125
    mesh = data["mesh"]
    assert len(mesh["vertex_sigma"]) == len(mesh["vertices"]) == len(layout.triangles.vertices)
    corner = mesh["vertices"].index([4.0, 0.0, 0.0])
    covariance = layout.planes[0].covariance
    point = np.array([4.0, 0, 0, 1])
    assert mesh["vertex_sigma"][corner] == pytest.approx(np.sqrt(point @ covariance @ point))
    assert mesh["face_instance"].count("door_5") == 2
    config = json.loads((tmp_path / "config.json").read_text())
    assert config["config"]["seed"] == 7
    assert {"gtlayout", "python", "gtsam", "shapely"} <= set(config["versions"])


def test_scene_without_unit_says_so(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, quality = solved
    write_results(tmp_path, scene, replace(layout, metric=False), quality, Config())
    assert json.loads((tmp_path / "layout.json").read_text())["metric"] is False
    assert not read_layout(tmp_path, scene).metric


def test_quality_json_has_the_verdict_on_top(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, quality = solved
    write_results(tmp_path, scene, layout, quality, Config())
    data = json.loads((tmp_path / "quality.json").read_text(), parse_constant=pytest.fail)
    assert next(iter(data)) == "headline"
    assert data["headline"] == {"word": "redo", "reasons": list(quality.headline.reasons)}
    assert data["iou"] == quality.iou
    assert data["known_share"] == quality.known_share
    assert data["accepted"] is quality.accepted
    assert data["predicted"] == quality.predicted
    assert data["sigma_depth_share"] == quality.sigma_depth_share
    assert data["worst_element"]["instance"] == "ceiling_1"
    assert [len(frame["elements"]) for frame in data["frames"]] == [6, 6]
    assert [row["name"] for row in data["instances"]] == [instance.name for instance in layout.instances]
    assert data["instances"][1]["sigma_depth"] is None


def _by_node(glb: bytes) -> dict[str, trimesh.Trimesh]:
    """Each node's surface where the scene graph puts it."""
    scene = trimesh.load_scene(io.BytesIO(glb), file_type="glb")
    found = {}
    for node in scene.graph.nodes_geometry:
        transform, geometry = scene.graph[node]
        found[node] = scene.geometry[geometry].copy().apply_transform(transform)
    return found


def test_glb_has_a_named_node_and_material_per_element_and_is_y_up(
    tmp_path: Path, solved: tuple[Scene, Layout, Quality]
) -> None:
    scene, layout, quality = solved
    write_results(tmp_path, scene, layout, quality, Config())
    nodes = _by_node((tmp_path / "layout.glb").read_bytes())
    drawn = [instance for i, instance in enumerate(layout.instances) if i != 1]
    assert sorted(nodes) == sorted(instance.name for instance in drawn)
    for instance in drawn:
        visual = nodes[instance.name].visual
        assert isinstance(visual, trimesh.visual.TextureVisuals)
        assert visual.material.name == instance.name
    np.testing.assert_allclose(nodes["floor_0"].vertices[:, 1], 0, atol=1e-6)
    np.testing.assert_allclose(np.unique(nodes["wall_3"].vertices[:, 1].round(5)), [0, rooms.HEIGHT_M])
    np.testing.assert_allclose(nodes["floor_0"].face_normals[:, 1], 1.0, atol=1e-6)
    assert nodes["door_5"].area == pytest.approx(2.0)
    assert nodes["wall_4"].area == pytest.approx(rooms.WIDTH_M * rooms.HEIGHT_M - 2.0)
    # A rotation, not a mirror image: the left wall still has the floor's far end on its left.
    volume = np.linalg.det(np.stack([nodes[n].face_normals[0] for n in ("wall_2", "wall_4", "floor_0")]))
    assert volume == pytest.approx(
        np.linalg.det(np.stack([surface.plane.normal for surface in (rooms.LEFT, rooms.FAR, rooms.FLOOR)]))
    )


@pytest.mark.parametrize("up", [(0, 0, 1), (0, -1, 0), (0, 1, 0), (1, 0, 0), (0.6, 0.0, 0.8)])
@pytest.mark.parametrize("floor_seen", [True, False])
def test_glb_is_y_up_whichever_way_the_world_lies(
    tmp_path: Path, solved: tuple[Scene, Layout, Quality], up: tuple[float, float, float], floor_seen: bool
) -> None:
    """COLMAP's worlds have y down, others z up. Without a floor the ceiling tells."""
    scene, _, _ = solved
    e_up = np.array(up)
    e_side = np.cross(e_up, np.eye(3)[np.argmin(np.abs(e_up))])
    e_side /= np.linalg.norm(e_side)
    turn = np.column_stack([e_side, np.cross(e_up, e_side), e_up])
    surfaces = [rooms.Surface(s.label, s.corners @ turn.T) for s in (rooms.FLOOR, rooms.CEILING, rooms.FAR)]
    planes, extents = [s.plane for s in surfaces], [s.extent for s in surfaces]
    planes[0] = replace(planes[0], observable=floor_seen)
    instances = rooms.instances_of(surfaces, 1)
    layout = Layout(instances, tuple(planes), tuple(extents), build_mesh(instances, extents), metric=True)
    write_results(tmp_path, scene, layout, assess(scene, instances, planes, extents, Config().quality), Config())
    nodes = _by_node((tmp_path / "layout.glb").read_bytes())
    height = nodes["ceiling_1"].vertices[:, 1].mean() - nodes["floor_0"].vertices[:, 1].mean()
    assert height == pytest.approx(rooms.HEIGHT_M)


def test_ply_is_in_the_world_of_the_cameras_and_coloured_by_label(
    tmp_path: Path, solved: tuple[Scene, Layout, Quality]
) -> None:
    scene, layout, quality = solved
    write_results(tmp_path, scene, layout, quality, Config())
    surface = trimesh.load_mesh(tmp_path / "layout.ply", process=False)
    assert isinstance(surface.visual, trimesh.visual.ColorVisuals)
    np.testing.assert_allclose(surface.vertices, layout.triangles.vertices, atol=1e-6)
    np.testing.assert_array_equal(surface.faces, layout.triangles.faces)
    expected = np.array([LABEL_COLORS[layout.instances[i].label] for i in layout.triangles.face_instance])
    np.testing.assert_array_equal(surface.visual.face_colors[:, :3], expected)
    sigma = surface.metadata["_ply_raw"]["vertex"]["data"]["sigma"].ravel()
    np.testing.assert_array_equal(
        sigma, vertex_sigma(layout.triangles, layout.planes, layout.extents).astype(np.float32)
    )
    assert sigma.max() > 0


def test_layout_without_any_surface_is_written_too(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, _ = solved
    extents = tuple(Extent(extent.frame, rooms.NOTHING, rooms.NOTHING) for extent in layout.extents)
    empty = replace(layout, extents=extents, triangles=build_mesh(layout.instances, extents))
    quality = assess(scene, empty.instances, empty.planes, extents, Config().quality)
    assert quality.iou == 0.0
    write_results(tmp_path, scene, empty, quality, Config())
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES
    assert all(extent.region.is_empty for extent in read_layout(tmp_path, scene).extents)


DAMAGE: dict[str, Callable[[Any], object]] = {
    "other format": lambda data: data.update(format="gtlayout-layout/99"),
    "no format": lambda data: data.pop("format"),
    "no instances": lambda data: data.pop("instances"),
    "instances null": lambda data: data.update(instances=None),
    "instances a number": lambda data: data.update(instances=3),
    "instance a text": lambda data: data["instances"].append("wall"),
    "no plane": lambda data: data["instances"][0].pop("plane"),
    "plane a list": lambda data: data["instances"][0].update(plane=[]),
    "normal of two": lambda data: data["instances"][0]["plane"].update(normal=[0.0, 1.0]),
    "normal a text": lambda data: data["instances"][0]["plane"].update(normal="up"),
    "covariance 3x3": lambda data: data["instances"][0]["plane"].update(covariance=np.eye(3).tolist()),
    "d a list": lambda data: data["instances"][0]["plane"].update(d=[1.0, 2.0]),
    "axes of one": lambda data: data["instances"][0]["extent"].update(axes=[[1.0, 0.0, 0.0]]),
    "polygon of two points": lambda data: data["instances"][0]["extent"].update(polygons=[[[[0, 0, 0], [1, 0, 0]]]]),
    "polygon in 2D": lambda data: data["instances"][0]["extent"].update(polygons=[[[[0, 0], [1, 0], [1, 1]]]]),
    "polygon empty": lambda data: data["instances"][0]["extent"].update(polygons=[[]]),
    "unknown host": lambda data: data["instances"][5].update(host="wall_9"),
    "unknown label": lambda data: data["instances"][0].update(label="roof"),
    "member a number": lambda data: data["instances"][0].update(members=[1]),
    "no support": lambda data: data["instances"][0]["plane"].pop("support"),
    "unknown support": lambda data: data["instances"][0]["plane"]["support"].update(dominant_evidence="faith"),
    "no dimensions": lambda data: data.pop("dimensions"),
    "dimension of another kind": lambda data: data["dimensions"][0].update(kind="time"),
    "dimension to nowhere": lambda data: data["dimensions"][0].update(between=["wall_4", "wall_9"]),
    "one end": lambda data: data["dimensions"][0].update(ends=[[0, 0, 0]]),
    "no mesh": lambda data: data.pop("mesh"),
    "face without vertex": lambda data: data["mesh"]["faces"][0].__setitem__(0, 999),
    "face without instance": lambda data: data["mesh"]["face_instance"].pop(),
    "no metric": lambda data: data.pop("metric"),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_damaged_layout_is_one_clear_line(
    tmp_path: Path, solved: tuple[Scene, Layout, Quality], edit_json: Edit, what: str
) -> None:
    write_results(tmp_path, *solved, Config())
    edit_json(tmp_path / "layout.json", DAMAGE[what])
    with pytest.raises(GtlayoutError, match=r"layout\.json is (damaged|not a layout)") as caught:
        read_layout(tmp_path, solved[0])
    assert "\n" not in str(caught.value)


def test_absent_layout_is_one_clear_line(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    with pytest.raises(GtlayoutError, match=r"cannot read .*layout\.json"):
        read_layout(tmp_path, solved[0])


def test_drawings_are_found_by_name(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    """Elements in another order are the same annotation; an element of another name is another annotation."""
    scene, layout, quality = solved
    write_results(tmp_path, *solved, Config())
    turned = tuple(replace(key_frame, elements=key_frame.elements[::-1]) for key_frame in scene.key_frames)
    other = replace(scene, key_frames=turned)
    back = read_layout(tmp_path, other)
    last = len(SURFACES) - 1
    assert [i.members for i in back.instances] == [tuple((k, last - e) for k, e in i.members) for i in layout.instances]
    assert assess(other, back.instances, back.planes, back.extents, Config().quality).iou == quality.iou
    renamed = replace(turned[0], elements=(replace(turned[0].elements[0], id="x"), *turned[0].elements[1:]))
    with pytest.raises(GtlayoutError, match=r"made from other annotations: 0\.png has no element e5"):
        read_layout(tmp_path, replace(scene, key_frames=(renamed, turned[1])))


def test_folder_that_takes_no_files_is_one_clear_line(tmp_path: Path, solved: tuple[Scene, Layout, Quality]) -> None:
    (tmp_path / "out").touch()
    with pytest.raises(GtlayoutError, match=r"cannot write .*out"):
        write_results(tmp_path / "out", *solved, Config())
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_tables_name_what_to_redraw(solved: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, quality = solved
    table = instance_table(layout, quality)
    assert table.row_count == len(SURFACES)
    headline = quality.headline
    assert headline.word == "redo", "without the ceiling the IoU is too low"
    assert headline_text(headline).plain.splitlines()[0] == f"REDO: {headline.reasons[0]}"
    assert headline_text(headline).plain.splitlines()[1:] == [f"  and {reason}" for reason in headline.reasons[1:]]
    line = measures(scene, layout, quality)
    assert line.startswith(
        f"IoU {quality.iou:.3f} (not accepted, of doors and windows alone {quality.openings_iou:.3f}); "
    )
    assert "worst element ceiling_1 = e1 in 0.png" in line
    assert f"; σ of depth {100 * quality.sigma_depth_share:.1f} % (predicted doubtful). " in line
    assert reasons(layout, quality)[:2] == [
        "floor_0 is weak: depth uncertain by more than 3 % "
        "(mostly contact edges hold it, seen under 1.2° of parallax, held by 17 tracks)",
        "ceiling_1 is unobservable: no track places it (no point on it could be tracked, no contact edge)",
    ]
    assert dimensions(layout) == [
        "height floor_0 – ceiling_1: 2.500 m ± unknown",
        "width wall_4 – floor_0: 5.000 ± 0.013 m",
    ]
    assert dimensions(replace(layout, metric=False))[1].endswith("± 0.013 units")
    text = markdown(layout, quality)
    assert text.startswith(f"**redo**: {headline.reasons[0]}\n- {headline.reasons[1]}\n")
    assert "% (predicted doubtful)" in text
    assert "- width wall_4 – floor_0: 5.000 ± 0.013 m" in text
    assert "|floor_0|20.00 m²|2|17|" in text
    assert "|ceiling_1|0.00 m²|2|0|–|–|–|0.000|unobservable|" in text


def test_several_files_are_written_all_or_none(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    with pytest.raises(GtlayoutError, match="folder is in its place"):
        write_all_atomic({tmp_path / "a": "1", tmp_path / "b": "2"})
    assert [path.name for path in tmp_path.iterdir()] == ["b"]
