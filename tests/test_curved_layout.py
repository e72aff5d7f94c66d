"""Round walls all the way: extents on the cylinder, what cameras see, the mesh, dimensions, files, plan and IFC."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from curved_rooms import TOLERANCE_M, laid_out, round_wall
from scipy.spatial import cKDTree
from shapely import LineString, MultiPolygon
from synth_views import the_room, views
from test_curved import true_wall
from test_export_building import complaints, shape, written_ifc

from gtlayout.config import Config
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.errors import GtlayoutError
from gtlayout.export import export_layout
from gtlayout.export.floor_plan import floor_plan
from gtlayout.export.plan_drawing import draw
from gtlayout.export.round_wall import slabs
from gtlayout.export.upright import z_up_from_world
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Extent, Instance, Plane, PlaneFrame
from gtlayout.layout import Layout
from gtlayout.measured.measurables import NotMeasurableError, measurable_of
from gtlayout.measurement import MeasuredKind, Measurement
from gtlayout.mesh import build_mesh
from gtlayout.quality.assess import assess
from gtlayout.results.layout_files import write_results
from gtlayout.results.layout_reader import read_layout
from gtlayout.results.tables import dimensions
from gtlayout.scene import Scene
from gtlayout.synth.render import cast
from gtlayout.synth.room import CURVED_ROOM_KINDS, RoomKind

every_round = pytest.mark.parametrize("kind", CURVED_ROOM_KINDS)
Edit = Callable[[Path, Callable[[Any], object]], None]


@every_round
def test_cameras_see_the_round_wall_where_it_is(kind: RoomKind) -> None:
    _, layout = laid_out(kind)
    room, index = the_room(kind), round_wall(layout)
    facets = [number for number, surface in enumerate(room.building) if surface.arc is not None]
    shown = 0
    for camera in views(kind)[:4]:
        truth = cast(room.building, camera)
        labels, depth = layout.render(camera)
        true, found = np.isin(truth.surface, facets), labels == index
        if true.sum() < 100:
            continue
        shown += 1
        assert (true & found).sum() > 0.98 * (true | found).sum()
        assert np.quantile(np.abs(depth - truth.depth)[true & found], 0.95) < 0.02
    assert shown >= 3


@every_round
def test_extents_are_right_and_better_than_of_planes(kind: RoomKind) -> None:
    scene, layout = laid_out(kind)
    _, flat = laid_out(kind, curved=False)
    _, arc = true_wall(kind)
    index = round_wall(layout)
    assert layout.extents[index].region.area == pytest.approx(arc.length_m * the_room(kind).height_m, rel=0.06)
    ious = [
        [judged.iou for judged in assess(scene, one.instances, one.planes, one.extents, Config().quality).instances]
        for one in (layout, flat)
    ]
    # Windows have no host here, so that one is missing from its wall.
    pierced = {"wall_3"} if kind == "round-corner" else set()
    structure = [
        i
        for i, instance in enumerate(layout.instances)
        if instance.label in ("wall", "floor", "ceiling") and instance.name not in pierced
    ]
    assert min(ious[0][i] for i in structure) > 0.97
    assert ious[0][index] > ious[1][index] + 0.1


@every_round
def test_floor_and_ceiling_end_at_the_arc(kind: RoomKind) -> None:
    """Nothing of them is outside of the room, and the arc is their border."""
    _, layout = laid_out(kind)
    _, arc = true_wall(kind)
    for i, instance in enumerate(layout.instances):
        if instance.label in ("floor", "ceiling"):
            extent = layout.extents[i]
            corners = extent.frame.to_world(shapely.get_coordinates(extent.region))[:, :2] - arc.center_xy
            distance, angles = np.linalg.norm(corners, axis=1), np.arctan2(corners[:, 1], corners[:, 0])
            after = (angles - arc.from_rad) % (2 * np.pi) / (arc.to_rad - arc.from_rad)
            # Near its ends others may go on.
            within = (after > 0.05) & (after < 0.95) & (distance > 0.5 * arc.radius_m)
            np.testing.assert_allclose(distance[within], arc.radius_m, rtol=0.03)
            assert within.sum() >= 8


@every_round
def test_the_mesh_is_the_cylinder_within_its_tolerance(kind: RoomKind) -> None:
    _, layout = laid_out(kind)
    index, cylinder = round_wall(layout), layout.curved[round_wall(layout)]
    mesh = layout.triangles
    own = mesh.vertices[mesh.faces[mesh.face_instance == index]]
    middles = np.concatenate([own.mean(axis=1), *((own[:, a] + own[:, (a + 1) % 3]) / 2 for a in range(3))])
    for points in (own.reshape(-1, 3), middles):
        off = np.abs(cylinder.unrolled(points)[2])
        # Where it is welded to others it moves with them.
        assert np.quantile(off, 0.95) < 1.1 * TOLERANCE_M
        assert off.max() < 0.01
    normals = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
    assert (np.sum(normals * (cylinder.axis_point_world - own.mean(axis=1)), axis=1) > 0).all()
    area = 0.5 * np.linalg.norm(normals, axis=1).sum()
    assert area == pytest.approx(layout.extents[index].region.area, rel=0.005)


@every_round
def test_wall_and_floor_share_their_corners_along_the_arc(kind: RoomKind) -> None:
    _, layout = laid_out(kind)
    mesh, index = layout.triangles, round_wall(layout)
    floor = next(i for i, one in enumerate(layout.instances) if one.label == "floor")
    wall, below = (set(mesh.faces[mesh.face_instance == i].ravel().tolist()) for i in (index, floor))
    strip = strip_of(layout.extents[index])
    assert strip is not None
    low, _, high, _ = layout.extents[index].region.bounds
    assert len(wall & below) >= 0.8 * len(strip.borders(low, high))


def test_openings_are_cut_out_of_a_round_wall() -> None:
    _, layout = _with_a_window()
    index = round_wall(layout)
    window = len(layout.instances) - 1
    of_wall = layout.triangles.faces[layout.triangles.face_instance == index]
    own = layout.triangles.vertices[of_wall]
    area = 0.5 * np.linalg.norm(np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0]), axis=1).sum()
    assert area == pytest.approx(layout.extents[index].region.area - layout.extents[window].region.area, rel=0.01)


def _with_a_window() -> tuple[Scene, Layout]:
    """The bay with a flat window of 60 × 80 cm that touches the middle of its round wall."""
    scene, layout = laid_out("bay")
    index = round_wall(layout)
    strip = strip_of(layout.extents[index])
    assert strip is not None
    region = MultiPolygon([shapely.box(-0.3, -0.4, 0.3, 0.4)])
    frame = PlaneFrame(strip.origin, strip.axes)
    normal = np.cross(*strip.axes)
    instances = (*layout.instances, Instance("window_9", "window", layout.instances[index].members[:1], index))
    planes = (*layout.planes, Plane(normal, -float(normal @ strip.origin), np.zeros((4, 4)), observable=True))
    extents = (*layout.extents, Extent(frame, region, region))
    mesh = build_mesh(instances, extents)
    accuracies = (*layout.accuracies, layout.accuracies[0])
    return scene, replace(
        layout, instances=instances, planes=planes, extents=extents, triangles=mesh, accuracies=accuracies
    )


def test_no_width_is_taken_from_a_round_wall_but_its_radius() -> None:
    scene, layout = laid_out("bay")
    index = round_wall(layout)
    assert layout.dimensions
    assert not any(index in (one.first, one.second) for one in layout.dimensions)
    name, cylinder = layout.instances[index].name, layout.curved[index]
    lines = dimensions(layout)
    assert f"radius of the curved wall {name}: {cylinder.radius:.3f} ± {cylinder.sigma_radius:.3f} m" in lines
    assert "1 of them curved" in repr(layout)
    own = next(q for q in layout.quantities if q.kind == "net wall area" and q.instances == (index,))
    assert own.amount == pytest.approx(layout.extents[index].region.area)
    assert own.sigma == pytest.approx(own.amount * cylinder.sigma_radius / cylinder.radius)
    assert not own.closed
    room = SolvedRoom(scene, layout.instances, layout.planes, layout.extents)
    other = next(i for i, one in enumerate(layout.instances) if one.label == "wall" and i != index)
    kinds: tuple[MeasuredKind, ...] = ("between", "angle")
    for kind in kinds:
        asked = Measurement(kind, (name, layout.instances[other].name), 4.0, 0.01)
        with pytest.raises(NotMeasurableError, match=f"{name} is curved"):
            measurable_of(room, asked)


@every_round
def test_layout_json_reads_back(kind: RoomKind, tmp_path: Path) -> None:
    scene, layout = laid_out(kind)
    quality = assess(scene, layout.instances, layout.planes, layout.extents, Config().quality)
    write_results(tmp_path, scene, layout, quality, Config())
    index = round_wall(layout)
    row = json.loads((tmp_path / "layout.json").read_text())["instances"][index]["cylinder"]
    cylinder = layout.curved[index]
    assert (row["radius"], row["sigma_radius"], row["concave"]) == (cylinder.radius, cylinder.sigma_radius, True)
    np.testing.assert_allclose(row["axis_point"], cylinder.axis_point_world)
    np.testing.assert_allclose(row["axis"], cylinder.axis_world)
    assert np.ptp(row["angles"]) * cylinder.radius == pytest.approx(np.ptp(layout.extents[index].region.bounds[::2]))
    back = read_layout(tmp_path, scene)
    assert list(back.curved) == [index]
    np.testing.assert_array_equal(back.curved[index].values, cylinder.values)
    np.testing.assert_array_equal(back.curved[index].covariance, cylinder.covariance)
    for found, extent in zip(back.extents, layout.extents, strict=True):
        assert shapely.equals_exact(found.region, extent.region, tolerance=1e-9)
    again = assess(scene, back.instances, back.planes, back.extents, Config().quality)
    assert again.elements == quality.elements


def test_layouts_from_before_there_were_round_walls_are_read(tmp_path: Path, edit_json: Edit) -> None:
    scene, layout = laid_out("bay", curved=False)
    quality = assess(scene, layout.instances, layout.planes, layout.extents, Config().quality)
    write_results(tmp_path, scene, layout, quality, Config())

    def older(data: Any) -> None:
        data["format"] = "gtlayout-layout/5"
        for row in data["instances"]:
            assert row.pop("cylinder") is None

    edit_json(tmp_path / "layout.json", older)
    back = read_layout(tmp_path, scene)
    assert back.curved == {}
    assert [one.region.area for one in back.extents] == pytest.approx([one.region.area for one in layout.extents])


@pytest.mark.parametrize(
    "change", [{"facet": 0}, {"values": [0, 0, -1, 0, 0]}, {"covariance": [[1.0]]}, {"middle": None}]
)
def test_a_damaged_cylinder_is_refused(change: dict[str, Any], tmp_path: Path, edit_json: Edit) -> None:
    scene, layout = laid_out("bay")
    quality = assess(scene, layout.instances, layout.planes, layout.extents, Config().quality)
    write_results(tmp_path, scene, layout, quality, Config())
    edit_json(tmp_path / "layout.json", lambda data: data["instances"][round_wall(layout)]["cylinder"].update(change))
    with pytest.raises(GtlayoutError, match="damaged"):
        read_layout(tmp_path, scene)


@every_round
def test_the_plan_draws_the_arc(kind: RoomKind) -> None:
    scene, layout = laid_out(kind)
    _, arc = true_wall(kind)
    plan = floor_plan(scene, layout)
    (found,) = plan.curves
    assert found.name == layout.instances[round_wall(layout)].name
    assert found.name not in [one.name for one in plan.walls]
    assert LineString(found.points).length == pytest.approx(arc.length_m, rel=0.06)
    assert found.radius == pytest.approx(arc.radius_m, rel=0.03)
    (room,) = plan.rooms
    along = shapely.union_all([LineString(line) for line in room.open] or [LineString()])
    assert along.intersection(LineString(found.points).buffer(0.03)).length < 0.1 * arc.length_m, "it closes its room"
    drawing = draw(plan)
    assert any(f"r {found.radius:.2f} m" in text.text for text in drawing.texts)
    own = [line for line in drawing.lines if line.name == found.name and line.layer == "walls"]
    assert sum(LineString(line.points).length for line in own) == pytest.approx(LineString(found.points).length)


def test_an_opening_is_a_gap_in_the_arc() -> None:
    scene, layout = _with_a_window()
    plan = floor_plan(scene, layout)
    (found,) = plan.curves
    gap = LineString(found.points).length - sum(LineString(part).length for part in found.drawn)
    radius = layout.curved[round_wall(layout)].radius
    assert gap == pytest.approx(2 * radius * np.arctan(0.3 / radius), rel=0.02)
    assert "window_9" in [one.name for one in plan.openings]


@every_round
def test_ifc_has_the_arc(kind: RoomKind, tmp_path: Path) -> None:
    scene, layout = laid_out(kind)
    index = round_wall(layout)
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model, rules=kind == "bay") == []
    (wall,) = [one for one in model.by_type("IfcWall") if one.Name == layout.instances[index].name]
    axis, body = wall.Representation.Representations
    assert (axis.RepresentationIdentifier, body.RepresentationType) == ("Axis", "SweptSolid")
    cylinder = layout.curved[index]
    assert axis.Items[0].BasisCurve.Radius == cylinder.radius
    assert [segment.is_a() for segment in body.Items[0].SweptArea.OuterCurve.Segments].count("IfcArcIndex") == 2
    made = shape(wall)
    made.merge_vertices(digits_vertex=7)
    assert made.is_watertight
    bounds = layout.extents[index].region.bounds
    ring = (bounds[2] - bounds[0]) * (1 + 0.05 / cylinder.radius) * 0.1 * (bounds[3] - bounds[1])
    assert made.volume == pytest.approx(ring, rel=0.01)
    # The measured side is where the mesh is, the other a thickness further from the room.
    turn = z_up_from_world(scene, layout)
    off = cylinder.unrolled(np.asarray(made.vertices) @ turn)[2]
    assert np.abs(np.minimum(np.abs(off), np.abs(off - 0.1))).max() < 0.005
    assert (off > 0.05).sum() > 0.4 * len(off)
    properties = {one.Name: one.NominalValue.wrappedValue for one in _properties(wall)}
    assert properties["radius"] == cylinder.radius
    assert properties["sigma_radius"] == pytest.approx(cylinder.sigma_radius)
    assert "normal_world" not in properties


def _properties(product: Any) -> list[Any]:
    sets = [one.RelatingPropertyDefinition for one in product.IsDefinedBy]
    return [single for one in sets if one.is_a("IfcPropertySet") for single in one.HasProperties]


def test_ifc_cuts_openings_out_of_a_round_wall(tmp_path: Path) -> None:
    scene, layout = _with_a_window()
    index = round_wall(layout)
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model) == []
    (wall,) = [one for one in model.by_type("IfcWall") if one.Name == layout.instances[index].name]
    (body,) = wall.Representation.Representations
    assert body.RepresentationType == "Tessellation"
    radius = layout.curved[index].radius
    whole = layout.extents[index].region.area - 0.8 * 2 * radius * np.arctan(0.3 / radius)
    made = shape(wall)
    assert made.volume == pytest.approx(whole * 0.1 * (1 + 0.05 / radius), rel=0.01)
    assert not model.by_type("IfcOpeningElement") or all(
        one.VoidsElements[0].RelatingBuildingElement != wall for one in model.by_type("IfcOpeningElement")
    )
    (window,) = [one for one in model.by_type("IfcWindow") if one.Name == "window_9"]
    assert window.Representation.Representations[0].RepresentationType == "SweptSolid"


def test_slabs_are_closed_and_turned_outwards() -> None:
    _, layout = laid_out("bay")
    index = round_wall(layout)
    strip = strip_of(layout.extents[index])
    assert strip is not None
    holed = MultiPolygon([shapely.box(-1, -1, 1, 1) - shapely.box(-0.4, -0.3, 0.33, 0.5)])
    volume = 0.0
    for solid in slabs(holed, strip, 0.1):
        edges: dict[tuple[int, int], int] = {}
        for (face,) in solid.faces:
            a, b, c = solid.points[list(face)]
            volume += float(a @ np.cross(b, c)) / 6
            for k in range(3):
                edges[face[k], face[(k + 1) % 3]] = edges.get((face[k], face[(k + 1) % 3]), 0) + 1
        assert all(count == 1 and edges.get((b, a)) == 1 for (a, b), count in edges.items())
    assert volume == pytest.approx(holed.area * 0.1 * (1 + 0.05 / strip.cylinder.radius), rel=0.005)


@pytest.mark.parametrize("to", ["glb", "ply", "obj", "usd", "dxf", "scenescript", "csv"])
def test_every_format_is_written(to: Any, tmp_path: Path) -> None:
    scene, layout = laid_out("bay")
    export_layout(tmp_path / f"out.{to}", scene, layout, to)
    if to == "csv":
        assert "radius," in (tmp_path / "out.csv").read_text()
    if to == "obj":
        rows = (tmp_path / "out.obj").read_text().splitlines()
        vertices = np.array([line.split()[1:4] for line in rows if line.startswith("v ")], dtype=float)
        assert len(vertices) == len(layout.triangles.vertices)
    if to == "scenescript":
        walls = [line for line in (tmp_path / "out.scenescript").read_text().splitlines() if "make_wall" in line]
        assert len(walls) > 20
        assert len({line.split(",")[1] for line in walls}) == len(walls)


def test_flat_walls_beside_it_end_where_the_wall_begins() -> None:
    _, layout = laid_out("bay")
    _, arc = true_wall("bay")
    ends = arc.points_xy()[[0, -1]]
    corners = [
        extent.frame.to_world(shapely.get_coordinates(extent.region))[:, :2]
        for i, extent in enumerate(layout.extents)
        if layout.instances[i].label == "wall" and i != round_wall(layout)
    ]
    distance, _ = cKDTree(np.concatenate(corners)).query(ends)
    assert np.max(distance) < 0.05
