"""IFC as a building: corners are closed outside, no measured face moves, openings are cut, and all sizes come back.

Whatever is compared with a layout is computed from the IFC file alone: placements and shapes as ifcopenshell reads
them.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import ifcopenshell.util.element
import ifcopenshell.util.placement
import numpy as np
import pytest
import rooms
import shapely
import trimesh
from room_dimensions import room_dimensions
from scipy.spatial import ConvexHull, HalfspaceIntersection
from shapely import MultiPolygon, Polygon
from test_export_building import (
    DOOR,
    LOOSE,
    UP,
    WINDOW,
    complaints,
    scene_and_layout,
    shape,
    without_place,
    written_ifc,
)

from gtlayout.accuracy import accuracy_of
from gtlayout.export import export_layout
from gtlayout.export.ifc import INFERRED, MEASURED, NO_FLOOR, PROPERTIES, SHELL_THICKNESS_M
from gtlayout.export.ifc_facts import ACCURACY
from gtlayout.export.shell import Surface, bodies
from gtlayout.instances import Extent, Plane, PlaneFrame
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

TENTH_OF_A_MM = 1e-4
T, HEIGHT = SHELL_THICKNESS_M, 2.5
BOX = [(0, 0), (4, 0), (4, 5), (0, 5)]
L_SHAPE = [(0, 0), (5, 0), (5, 2), (3, 2), (3, 4), (0, 4)]
ODD = [(0, 0), (4, 0.5), (5, 3), (1.5, 4.5), (-1, 2)]
"""Angles of 94 to 125 degrees."""


def prism(outline: Sequence[tuple[float, float]], height: float = HEIGHT) -> tuple[rooms.Surface, ...]:
    """A room of upright walls over an outline that runs counter-clockwise, seen from above."""
    foot = np.array([[x, y, 0.0] for x, y in outline])
    up = np.array([0, 0, height])
    # The surface's first corner must be convex.
    turns = np.cross(foot - np.roll(foot, 1, axis=0), np.roll(foot, -1, axis=0) - foot)[:, 2]
    foot = np.roll(foot, -int(np.argmax(turns)), axis=0)
    ends = zip(foot, np.roll(foot, -1, axis=0), strict=True)
    walls = [rooms.Surface("wall", np.stack([b, a, a + up, b + up])) for a, b in ends]
    ceiling = np.roll(foot[::-1] + up, 1, axis=0)
    return rooms.Surface("floor", foot), rooms.Surface("ceiling", ceiling), *walls


def layout_of(surfaces: Sequence[rooms.Surface], metric: bool = True) -> tuple[Scene, Layout]:
    """With all heights and widths."""
    scene, layout = scene_and_layout(surfaces, metric)
    zero = np.zeros((4 * len(surfaces), 4 * len(surfaces)))
    dimensions = room_dimensions(layout.instances, layout.planes, layout.extents, zero)
    return scene, replace(layout, dimensions=dimensions)


def product_of(model: Any, name: str) -> Any:
    (found,) = [one for one in model.by_type("IfcBuildingElement") if one.Name == name]
    return found


def front(product: Any) -> tuple[PlaneFrame, MultiPolygon]:
    """The measured face: the plane that the product's placement and its body's first faces are in."""
    matrix = ifcopenshell.util.placement.get_local_placement(product.ObjectPlacement)
    frame = PlaneFrame(matrix[:3, 3], matrix[:3, :2].T)
    region = []
    for item in product.Representation.Representations[0].Items:
        if item.is_a("IfcPolygonalFaceSet"):
            points, face = np.array(item.Coordinates.CoordList), item.Faces[0]
            rings = [np.array(ring) - 1 for ring in (face.CoordIndex, *getattr(face, "InnerCoordIndices", ()))]
            assert np.array_equal(points[np.concatenate(rings), 2], np.zeros(sum(map(len, rings))))
            region.append(Polygon(points[rings[0], :2], [points[ring, :2] for ring in rings[1:]]))
        else:
            profile = item.SweptArea
            region.append(Polygon([point.Coordinates for point in profile.OuterCurve.Points]))
    return frame, MultiPolygon(region)


def closed(product: Any) -> trimesh.Trimesh:
    """The body as triangles, its points joined; closed, and its faces turned outwards."""
    body = shape(product)
    body.merge_vertices(digits_vertex=7)
    assert body.is_watertight
    assert body.is_winding_consistent
    assert body.volume > 0
    return body


def dimensions_of(model: Any, layout: Layout) -> list[float]:
    """Heights and widths between the faces in the file."""
    planes, extents = [], []
    for instance, plane, extent in zip(layout.instances, layout.planes, layout.extents, strict=True):
        if extent.region.is_empty:
            planes.append(replace(plane, observable=False))
            extents.append(extent)
            continue
        product = product_of(model, instance.name)
        frame, region = front(product)
        # Widths are measured in the middle of what two walls cover alike, their openings included.
        holes = [hole_of(one.RelatedOpeningElement)[1] for one in product.HasOpenings]
        region = shapely.multipolygons(shapely.get_parts(shapely.union_all([region, *holes])))
        normal = np.cross(*frame.axes)
        planes.append(Plane(normal, -float(normal @ frame.origin), np.zeros((4, 4)), observable=True))
        extents.append(Extent(frame, region, region))
    zero = np.zeros((4 * len(planes), 4 * len(planes)))
    return [one.length for one in room_dimensions(layout.instances, planes, extents, zero)]


def quantities(product: Any, name: str) -> dict[str, Any]:
    return dict(ifcopenshell.util.element.get_psets(product)[name])


@pytest.mark.parametrize("outline", [BOX, L_SHAPE, ODD], ids=["box", "L", "odd angles"])
def test_bodies_close_the_corners_and_do_not_overlap(tmp_path: Path, outline: list[tuple[float, float]]) -> None:
    """Together they are exactly what lies within one thickness of the room, with its corners mitred."""
    scene, layout = layout_of(prism(outline))
    model = written_ifc(tmp_path, scene, layout)
    bodies = [closed(product) for product in model.by_type("IfcBuildingElement")]
    outside = Polygon(outline).buffer(T, join_style="mitre", mitre_limit=10)
    shell = outside.area * (HEIGHT + 2 * T) - Polygon(outline).area * HEIGHT
    assert np.isclose(sum(body.volume for body in bodies), shell, atol=1e-6)
    # Four sides of a wall, its front and its back: a side in one plane is one face.
    assert len(model.by_type("IfcWall")[0].Representation.Representations[0].Items[0].Faces) == 6
    everything = np.concatenate([body.vertices for body in bodies])
    assert np.allclose(np.ptp(everything, axis=0)[2], HEIGHT + 2 * T, atol=1e-6)
    hull = trimesh.convex.convex_hull(everything).volume
    assert np.isclose(hull, outside.convex_hull.area * (HEIGHT + 2 * T), atol=1e-6)


@pytest.mark.parametrize("outline", [L_SHAPE, ODD], ids=["L", "odd angles"])
def test_no_measured_face_moves_and_sizes_come_back(tmp_path: Path, outline: list[tuple[float, float]]) -> None:
    scene, layout = layout_of(prism(outline))
    model = written_ifc(tmp_path, scene, layout)
    for instance, extent in zip(layout.instances, layout.extents, strict=True):
        _, region = front(product_of(model, instance.name))
        assert region.symmetric_difference(extent.region).area < 1e-9
    lengths = dimensions_of(model, layout)
    assert len(lengths) == len(layout.dimensions)
    assert np.allclose(lengths, [one.length for one in layout.dimensions], atol=TENTH_OF_A_MM)
    (space,) = model.by_type("IfcSpace")
    body = closed(space)
    assert np.isclose(np.ptp(body.vertices[:, 2]), HEIGHT)
    assert np.isclose(body.volume, Polygon(outline).area * HEIGHT)
    measured = quantities(space, "Qto_SpaceBaseQuantities")
    assert np.isclose(measured["Height"], HEIGHT)
    assert np.isclose(measured["NetFloorArea"], Polygon(outline).area)


def test_a_corner_below_the_mitre_limit_stays_open_and_bodies_stay_near(tmp_path: Path) -> None:
    """At 20° the mitre would reach 57 cm out."""
    far = 4 * np.tan(np.deg2rad(20))
    scene, layout = layout_of(prism([(0, 0), (4, 0), (4, far)]))
    model = written_ifc(tmp_path, scene, layout)
    frame, room = front(product_of(model, "floor_0"))
    corners = np.concatenate([closed(product).vertices for product in model.by_type("IfcBuildingElement")])
    reach = shapely.distance(room, shapely.points(frame.to_plane(corners))).max()
    assert 3 * T < reach < 3.5 * T


def test_a_wall_that_stands_on_another_ends_at_its_face(tmp_path: Path) -> None:
    """A partition that meets a long wall in its middle is no corner; nor does the floor below it move."""
    partition = rooms.Surface("wall", rooms.rectangle([2, 5, 0], [0, -2, 0], [0, 0, HEIGHT]))
    scene, layout = layout_of((*rooms.BOX, partition))
    model = written_ifc(tmp_path, scene, layout)
    frame, _ = front(product_of(model, "wall_4"))
    heights = (closed(product_of(model, "wall_6")).vertices - frame.origin) @ np.cross(*frame.axes)
    assert np.isclose(heights.min(), 0, atol=1e-6)
    assert np.isclose(closed(product_of(model, "wall_6")).volume, 2 * HEIGHT * T, rtol=0.05)


@pytest.mark.parametrize(("gap", "is_closed"), [(0.03, True), (0.07, False)])
def test_a_corner_with_a_gap_of_some_centimetres_is_closed_outside(tmp_path: Path, gap: float, is_closed: bool) -> None:
    """The left wall ends short of the far one; its face does not move."""
    short = rooms.Surface("wall", rooms.rectangle([0, 0, 0], [0, 5 - gap, 0], [0, 0, HEIGHT]))
    scene, layout = layout_of((*rooms.BOX[:2], short, *rooms.BOX[3:]))
    model = written_ifc(tmp_path, scene, layout)
    assert np.isclose(front(product_of(model, "wall_2"))[1].area, (5 - gap) * HEIGHT)
    frame, _ = front(product_of(model, "wall_4"))
    heights = (closed(product_of(model, "wall_2")).vertices - frame.origin) @ np.cross(*frame.axes)
    assert np.isclose(heights.min(), -T if is_closed else gap, atol=1e-6)


def test_the_far_edge_of_a_strip_beside_a_corner_is_no_corner(tmp_path: Path) -> None:
    """It is as near to the other wall as edges that touch are, but the strip ends there."""
    strip = rooms.Surface("wall", rooms.rectangle([0, 0, 0], [0, 0, HEIGHT], [0.04, 0, 0]))
    scene, layout = layout_of((*rooms.BOX[:5], strip))
    model = written_ifc(tmp_path, scene, layout)
    frame, _ = front(product_of(model, "wall_2"))
    heights = (closed(product_of(model, "wall_5")).vertices - frame.origin) @ np.cross(*frame.axes)
    assert np.allclose([heights.min(), heights.max()], [-T, 0.04], atol=1e-6)


def test_a_chamfer_that_the_mitre_uses_up_does_not_prevent_it() -> None:
    """An outline cut by a few millimetres at the inner corner of an L."""
    along = rooms.Surface("wall", rooms.rectangle([0, 0, 0], [2, 0, 0], [0, 0, HEIGHT]))
    away = rooms.Surface("wall", rooms.rectangle([0, 0, 0], [0, 0, HEIGHT], [0, 2, 0]))
    assert np.allclose([along.plane.normal, away.plane.normal], [[0, -1, 0], [-1, 0, 0]])
    extents = [along.extent, away.extent]
    whole = extents[0].region
    (u0, v0) = extents[0].frame.to_plane(np.zeros((1, 3)))[0]
    cut = Polygon([(u0, v0), (u0 + 0.02, v0), (u0 + 0.015, v0 + 0.01), (u0, v0 + 0.01)])
    chamfered = MultiPolygon([whole.difference(cut)])
    surfaces = [
        Surface(extents[0].frame, chamfered, chamfered, T),
        Surface(extents[1].frame, extents[1].region, extents[1].region, T),
    ]
    (solid,), _ = bodies(surfaces)
    back = solid.points[solid.points[:, 2] < -T / 2]
    assert np.isclose(back[:, 0].min() - u0, T, atol=1e-6)


def test_jagged_outlines_get_bodies_that_do_not_cross_themselves() -> None:
    """Of what people draw edges jump to and fro by centimetres beside every corner."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        surfaces = []
        for side in rooms.BOX:
            extent = side.extent
            ring = shapely.get_coordinates(shapely.segmentize(extent.region.geoms[0].exterior, 0.3))[:-1]
            jagged = Polygon(ring + rng.uniform(-0.15, 0.15, ring.shape))
            assert jagged.is_valid
            region = MultiPolygon([jagged])
            surfaces.append(Surface(extent.frame, region, region, T))
        for surface, (solid,) in zip(surfaces, bodies(surfaces), strict=True):
            assert np.isclose(Polygon(solid.points[list(solid.faces[0][0]), :2]).area, surface.region.area)
            back = Polygon(solid.points[list(solid.faces[1][0][::-1]), :2])
            assert back.is_valid
            assert back.exterior.is_ccw


def test_a_pillar_thinner_than_two_walls_is_still_closed(tmp_path: Path) -> None:
    """Its bodies lie inside it and would cross one another."""
    pillar = prism([(1, 1), (1, 1.15), (1.15, 1.15), (1.15, 1)][::-1])[2:]
    inward = [replace(side, corners=side.corners[::-1].copy()) for side in pillar]
    scene, layout = layout_of((*rooms.BOX, *inward))
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model) == []
    for product in model.by_type("IfcWall"):
        closed(product)
    _, region = front(product_of(model, "wall_6"))
    assert np.isclose(region.area, 0.15 * HEIGHT)


def test_walls_over_one_another_are_both_there(tmp_path: Path) -> None:
    """As measured: two drawings of one wall, 4 cm apart, do not melt into one."""
    behind = rooms.Surface("wall", rooms.rectangle([0, 1, 0], [0, 3, 0], [0, 0, HEIGHT]) - [0.04, 0, 0])
    scene, layout = layout_of((*rooms.BOX, behind))
    model = written_ifc(tmp_path, scene, layout)
    assert len(model.by_type("IfcWall")) == 5
    assert complaints(model) == []
    lengths = dimensions_of(model, layout)
    assert np.allclose(lengths, [one.length for one in layout.dimensions], atol=TENTH_OF_A_MM)
    assert np.isclose(lengths, 4.04, atol=TENTH_OF_A_MM).any()


def test_two_rooms_are_two_spaces(tmp_path: Path) -> None:
    beside = prism([(4.2, 0), (7.2, 0), (7.2, 5), (4.2, 5)], 2.3)
    scene, layout = layout_of((*rooms.BOX, *beside))
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model) == []
    found = [quantities(space, "Qto_SpaceBaseQuantities") for space in model.by_type("IfcSpace")]
    assert np.allclose([[one["NetFloorArea"], one["Height"]] for one in found], [[20, 2.5], [15, 2.3]])
    assert [quantities(space, PROPERTIES)["floor"] for space in model.by_type("IfcSpace")] == ["floor_0", "floor_6"]
    assert np.allclose([closed(space).volume for space in model.by_type("IfcSpace")], [50, 34.5])


def test_slanted_surfaces_bound_the_space(tmp_path: Path) -> None:
    """An attic: from 1 m at one side to the ceiling, 1 m further in."""
    slanted = rooms.Surface("slanted", rooms.rectangle([0, 0, 1], [0, 5, 0], [1.5, 0, 1.5]))
    low = rooms.Surface("wall", rooms.rectangle([0, 0, 0], [0, 5, 0], [0, 0, 1]))
    ceiling = rooms.Surface("ceiling", rooms.rectangle([1.5, 0, 2.5], [0, 5, 0], [2.5, 0, 0]))
    gable = np.array([[0, 0, 0], [0, 0, 1], [1.5, 0, 2.5], [4, 0, 2.5], [4, 0, 0]])
    near, far = (rooms.Surface("wall", corners) for corners in (gable, (gable + np.array([0, 5, 0]))[::-1].copy()))
    attic = (rooms.FLOOR, ceiling, low, rooms.RIGHT, near, far, slanted)
    scene, layout = layout_of(attic)
    model = written_ifc(tmp_path, scene, layout)
    (space,) = model.by_type("IfcSpace")
    assert np.isclose(shape(space).volume, 4 * 5 * 2.5 - 5 * 1.5 * 1.5 / 2)
    assert "not_bounding_the_body" not in quantities(space, PROPERTIES)
    # An attic is convex: its shell is what lies before all planes moved outwards, less what lies before all of them.
    planes = np.array([np.append(-surface.plane.normal, -surface.plane.d) for surface in attic])
    outer, inner = (
        ConvexHull(HalfspaceIntersection(planes - [0, 0, 0, moved], np.array([2.0, 2.0, 1.0])).intersections).volume
        for moved in (T, 0)
    )
    bodies = sum(closed(product).volume for product in model.by_type("IfcBuildingElement"))
    assert np.isclose(bodies, outer - inner, atol=1e-6)


def volume_of_room(folder: Path, surfaces: Sequence[rooms.Surface]) -> float | None:
    """None for a room without a body."""
    model = written_ifc(folder, *layout_of(surfaces))
    (space,) = model.by_type("IfcSpace")
    bodies = [one for one in space.Representation.Representations if one.RepresentationIdentifier == "Body"]
    return float(shape(space).volume) if bodies else None


def test_what_bounds_a_room_upwards(tmp_path: Path) -> None:
    """One ceiling in two pieces, a ramp below it; slanted surfaces alone: over all of the floor, and over little."""
    halves = [rooms.Surface("ceiling", rooms.rectangle([x, 0, HEIGHT], [0, 5, 0], [2, 0, 0])) for x in (0, 2)]
    ramp = rooms.Surface("slanted", rooms.rectangle([0, 0, 0.2], [2, 0, 1], [0, 2, 0]))
    assert volume_of_room(tmp_path, (rooms.FLOOR, *halves, ramp, *rooms.BOX[2:])) == pytest.approx(50)
    # From 1.5 m below the floor's edge at x = 0, over the floor from x = 2 on, to 1.5 m.
    roof = rooms.Surface("slanted", rooms.rectangle([1, 0, -0.75], [0, 5, 0], [3, 0, 2.25]))
    assert volume_of_room(tmp_path, (rooms.FLOOR, roof)) == pytest.approx(5 * 2 * 1.5 / 2, abs=1e-3)
    small = rooms.Surface("slanted", rooms.rectangle([3, 0, 0.75], [0, 5, 0], [1, 0, 0.75]))
    assert volume_of_room(tmp_path, (rooms.FLOOR, small)) is None


def test_a_lower_ceiling_over_a_part_does_not_bound_the_space_and_says_so(tmp_path: Path) -> None:
    lower = rooms.Surface("ceiling", rooms.rectangle([0, 0, 2.2], [0, 1, 0], [4, 0, 0]))
    scene, layout = layout_of((lower, *rooms.BOX))
    model = written_ifc(tmp_path, scene, layout)
    (space,) = model.by_type("IfcSpace")
    assert np.isclose(closed(space).volume, 50)
    assert quantities(space, PROPERTIES)["not_bounding_the_body"] == "ceiling_0"
    assert np.isclose(quantities(space, "Qto_SpaceBaseQuantities")["Height"], 2.5)


def test_no_floor_no_room_and_no_ceiling_no_body(tmp_path: Path) -> None:
    scene, layout = layout_of(rooms.BOX)
    model = written_ifc(tmp_path, scene, without_place(layout, 0))
    assert complaints(model) == []
    assert len(model.by_type("IfcSpace")) == 0
    assert quantities(model.by_type("IfcBuildingStorey")[0], PROPERTIES)["rooms"] == NO_FLOOR
    model = written_ifc(tmp_path, scene, without_place(layout, 1))
    (space,) = model.by_type("IfcSpace")
    assert [one.RepresentationIdentifier for one in space.Representation.Representations] == ["FootPrint"]
    assert quantities(space, "Qto_SpaceBaseQuantities").keys() == {"id", "NetFloorArea"}


def test_openings_are_cut_and_have_their_sizes(tmp_path: Path) -> None:
    """Through the wall, whatever the reader does about openings; a door on no wall, and one beside it, cut nothing."""
    beside = rooms.Surface("door", rooms.rectangle([4.5, 5, 0], [0, 0, 2.0], [1.0, 0, 0]), host=4)
    skylight = rooms.Surface("window", rooms.rectangle([1, 1, 2.52], [0, 1, 0], [1, 0, 0]), host=1)
    scene, layout = layout_of((*rooms.BOX, DOOR, WINDOW, LOOSE, beside, skylight))
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model) == []
    sizes = {
        one.Name: quantities(one, "Qto_OpeningElementBaseQuantities") for one in model.by_type("IfcOpeningElement")
    }
    assert list(sizes) == ["door_6", "window_7", "window_10"]
    wanted = {"door_6": (1, 2), "window_7": (2, 1), "window_10": (1, 1)}
    for name, (width, height) in wanted.items():
        assert np.allclose([sizes[name]["Width"], sizes[name]["Height"], sizes[name]["Depth"]], [width, height, T])
        filling = product_of(model, name)
        assert np.allclose([filling.OverallWidth, filling.OverallHeight], [width, height])
        opening = filling.FillsVoids[0].RelatingOpeningElement
        assert opening.Representation.Representations[0].RepresentationIdentifier == "Reference"
        host = opening.VoidsElements[0].RelatingBuildingElement
        assert np.isclose(front(host)[1].area, {"wall_4": 10 - 2, "wall_2": 12.5 - 2, "ceiling_1": 20 - 1}[host.Name])
        middle, along, inwards = hole_middle(opening)
        assert np.isclose(turns_round(closed(host), middle - T / 2 * inwards), 0, atol=1e-6)
        beside_it = middle + (width / 2 + 0.01) * along - T / 2 * inwards
        assert np.isclose(turns_round(closed(host), beside_it), 1, atol=1e-6)
    net = quantities(product_of(model, "wall_4"), "Qto_WallBaseQuantities")
    assert np.allclose([net["GrossSideArea"], net["NetSideArea"]], [10, 8])


def hole_of(opening: Any) -> tuple[FloatArray, Polygon]:
    """(4, 4) placement of a hole in the model, and its outline there."""
    matrix: FloatArray = ifcopenshell.util.placement.get_local_placement(opening.ObjectPlacement)
    (solid,) = opening.Representation.Representations[0].Items
    return matrix, Polygon([point.Coordinates for point in solid.SweptArea.OuterCurve.Points])


def hole_middle(opening: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(3,) middle of a hole's outline, a level direction in its wall, and the wall's normal."""
    matrix, outline = hole_of(opening)
    middle: FloatArray = (matrix @ [outline.centroid.x, outline.centroid.y, 0, 1])[:3]
    normal = matrix[:3, 2]
    level = np.cross([0, 0, 1], normal) if abs(normal[2]) < 0.5 else matrix[:3, 0]
    return middle, level / np.linalg.norm(level), normal


def turns_round(body: trimesh.Trimesh, point: FloatArray) -> float:
    """How many times a closed body lies around a point: its solid angles (van Oosterom and Strackee, 1983)."""
    a, b, c = np.swapaxes(body.triangles - point, 0, 1)
    la, lb, lc = (np.linalg.norm(one, axis=1) for one in (a, b, c))
    dot = [np.einsum("ij,ij->i", one, other) for one, other in ((a, b), (b, c), (c, a))]
    below = la * lb * lc + dot[0] * lc + dot[1] * la + dot[2] * lb
    return float(2 * np.arctan2(np.einsum("ij,ij->i", a, np.cross(b, c)), below).sum() / (4 * np.pi))


def test_a_window_may_leave_nothing_of_its_wall(tmp_path: Path) -> None:
    glass = rooms.Surface("window", rooms.LEFT.corners, host=2)
    scene, layout = layout_of((*rooms.BOX, glass))
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model) == []
    assert product_of(model, "wall_2").Representation is None
    assert np.isclose(quantities(product_of(model, "wall_2"), "Qto_WallBaseQuantities")["GrossSideArea"], 12.5)
    assert np.isclose(front(product_of(model, "window_6"))[1].area, 12.5)


def with_inferred() -> tuple[Scene, Layout]:
    """The box, its near wall seen to half its width, the rest inferred; a floor seen without its nearest metre."""
    seen = list(rooms.BOX)
    seen[0] = replace(seen[0], corners=seen[0].corners + np.array([[0, 1, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0]]))
    half = rooms.NEAR.corners.copy()
    half[half[:, 0] > 2, 0] = 2
    seen[5] = rooms.Surface("wall", half)
    scene, layout = layout_of(seen)
    rest = []
    for surface, extent in zip(rooms.BOX, layout.extents, strict=True):
        whole = extent.frame.region([[surface.corners @ UP.T]])
        region = whole if whole.area > extent.region.area else MultiPolygon()
        rest.append(Extent(extent.frame, region, region))
    return scene, replace(layout, inferred=tuple(rest))


def test_what_is_inferred_is_a_layer_of_its_own(tmp_path: Path) -> None:
    scene, layout = with_inferred()
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model) == []
    inferred = {one.Name: one for one in model.by_type("IfcBuildingElement") if one.Name.endswith(" inferred")}
    assert list(inferred) == ["floor_0 inferred", "wall_5 inferred"]
    for name, product in inferred.items():
        material: Any = ifcopenshell.util.element.get_material(product)
        assert material.Name == INFERRED
        assert quantities(product, PROPERTIES)["inferred"] is True
        assert quantities(product, PROPERTIES)["continues"] == name.removesuffix(" inferred")
        assert quantities(product, ACCURACY)["Status"] == "inferred"
        assert layers_of(product) == [INFERRED]
    measured = [one for one in model.by_type("IfcBuildingElement") if one.Name not in inferred]
    assert {layer for one in measured for layer in layers_of(one)} == {MEASURED}
    assert not any(ifcopenshell.util.element.get_material(one) for one in measured)
    # What was seen stays as it was seen, and together they close the room, mitred as if all had been seen.
    assert np.allclose([front(product_of(model, name))[1].area for name in ("floor_0", "wall_5")], [16, 5])
    assert np.allclose([front(one)[1].area for one in inferred.values()], [4, 5])
    volume = sum(closed(product).volume for product in model.by_type("IfcBuildingElement"))
    assert np.isclose(volume, 4.2 * 5.2 * 2.7 - 4 * 5 * 2.5, atol=1e-6)
    (space,) = model.by_type("IfcSpace")
    assert np.isclose(closed(space).volume, 50)
    areas = quantities(space, PROPERTIES)
    assert np.allclose([areas["floor_area_measured"], areas["floor_area_inferred"]], [16, 4])


def layers_of(product: Any) -> list[str]:
    shapes = product.Representation.Representations
    return [layer.Name for one in shapes for layer in one.LayerAssignments]


def test_each_element_has_its_accuracy(tmp_path: Path) -> None:
    scene, layout = layout_of(rooms.BOX)
    accuracies = (accuracy_of(0.01, 20), accuracy_of(0.04, 20), *[accuracy_of(np.nan, 20)] * 4)
    layout = replace(layout, accuracies=accuracies)
    model = written_ifc(tmp_path, scene, layout)
    assert complaints(model) == []
    floor, ceiling, wall = (quantities(product_of(model, n), ACCURACY) for n in ("floor_0", "ceiling_1", "wall_2"))
    assert np.isclose(floor["ErrorAt95Percent"], 0.0196, atol=1e-5)
    assert [one["LevelOfAccuracy"] for one in (floor, ceiling, wall)] == ["LOA20", "LOA10", "none"]
    assert [one["Status"] for one in (floor, ceiling, wall)] == ["within", "out", "insufficient evidence"]
    assert "ErrorAt95Percent" not in wall
    assert np.isclose(floor["SigmaOfNormalDegrees"], 1.0)
    corners = layout.extents[0].frame.to_world(shapely.get_coordinates(layout.extents[0].region))
    assert np.isclose(floor["SigmaAlongNormal"], layout.planes[0].sigma_offset(corners).max())
    assert floor["Verdict"] in ("ok", "weak")
    kinds = {
        one.Name: one.NominalValue.is_a() for one in model.by_type("IfcPropertySingleValue") if "Sigma" in one.Name
    }
    assert kinds == {"SigmaAlongNormal": "IfcLengthMeasure", "SigmaOfNormalDegrees": "IfcReal"}


def test_without_accuracies_the_sigmas_are_still_there(tmp_path: Path) -> None:
    scene, layout = layout_of(rooms.BOX)
    model = written_ifc(tmp_path, scene, layout)
    known = quantities(product_of(model, "wall_2"), ACCURACY)
    assert known.keys() == {"id", "SigmaAlongNormal", "SigmaOfNormalDegrees", "Verdict"}


def test_nothing_is_said_about_north(tmp_path: Path) -> None:
    scene, layout = layout_of(rooms.BOX)
    model = written_ifc(tmp_path, scene, layout)
    assert model.by_type("IfcGeometricRepresentationContext")[0].TrueNorth is None
    assert "true north are unknown" in model.by_type("IfcSite")[0].Description
    assert model.header.file_description.description == ("ViewDefinition [ReferenceView_V1.2]",)


_WRITE = """
import sys
from pathlib import Path
from test_export_ifc import with_inferred
from gtlayout.export import export_layout
export_layout(Path(sys.argv[1]), *with_inferred(), "ifc")
"""


def test_the_same_bytes_for_every_hash_seed_locale_and_time_zone(tmp_path: Path) -> None:
    """Here and in another process."""
    export_layout(tmp_path / "here.ifc", *with_inferred(), "ifc")
    other = {"PYTHONHASHSEED": "4242", "LC_ALL": "de_DE.UTF-8", "TZ": "Asia/Tokyo"}
    environment = {**os.environ, **other, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", _WRITE, str(tmp_path / "there.ifc")], check=True, env=environment)
    assert (tmp_path / "here.ifc").read_bytes() == (tmp_path / "there.ifc").read_bytes()


def test_a_solve_again_keeps_the_guids(tmp_path: Path) -> None:
    """So that a model made from a newer solve can be compared with the older one."""
    scene, layout = layout_of(rooms.BOX)
    _, wider = layout_of(prism([(0, 0), (4.1, 0), (4.1, 5), (0, 5)]))
    first, second = (written_ifc(tmp_path, scene, one) for one in (layout, wider))
    assert [one.GlobalId for one in first.by_type("IfcRoot")] == [one.GlobalId for one in second.by_type("IfcRoot")]
    assert len({one.GlobalId for one in first.by_type("IfcRoot")}) == len(first.by_type("IfcRoot"))
