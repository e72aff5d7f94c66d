"""Exact annotations of synthetic rooms: what is drawn is what the empty building looks like, and where it is."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import shapely
from shapely import MultiLineString, MultiPoint, Polygon
from synth_views import HEIGHT, WIDTH, camera_at, drawn, every_kind, the_room, views

from gtlayout.geometry.raster import fill, rings_of
from gtlayout.scene import OPENINGS, Camera, FloatArray, IntArray
from gtlayout.synth.annotate import annotate, draw, occlusion_edges
from gtlayout.synth.extents import seen_extents
from gtlayout.synth.render import cast
from gtlayout.synth.room import Room, RoomKind
from gtlayout.synth.surfaces import Surface, make_surface
from gtlayout.synth.textures import plain


@every_kind
def test_what_is_drawn_is_what_the_empty_room_looks_like(kind: RoomKind) -> None:
    room = the_room(kind)
    index = {surface.name: number for number, surface in enumerate(room.surfaces[: room.built])}
    for camera, (key_frame, names) in zip(views(kind), drawn(kind), strict=True):
        seen = cast(room.building, camera).surface
        labels = np.full(seen.shape, -1)
        for element in sorted(key_frame.elements, key=lambda e: e.label in OPENINGS):
            assert element.amodal.is_valid
            labels[fill(rings_of(element.amodal), HEIGHT, WIDTH)] = index[names[element.id]]
        # Away from the boundaries, where a pixel's centre decides.
        reach = np.ones((3, 3), np.uint8)
        inner = cv2.erode(seen.astype(np.int16), reach) == cv2.dilate(seen.astype(np.int16), reach)
        labelled = np.array([surface.label is not None for surface in room.building])[seen]
        assert (labels == seen)[inner & (labels >= 0)].all()
        assert (inner & (labels < 0) & labelled).mean() < 0.01  # pieces too small to draw
        assert len(key_frame.elements) >= 3


@every_kind
def test_visible_parts_are_within_their_element_and_really_seen(kind: RoomKind) -> None:
    room, share = the_room(kind), 0.0
    for camera, (key_frame, names) in zip(views(kind), drawn(kind), strict=True):
        hits = cast(room.surfaces, camera)
        for element in key_frame.elements:
            assert (element.visible - element.amodal).area < 1e-6
            mask = fill(rings_of(element.visible), HEIGHT, WIDTH)
            assert {room.surfaces[n].name for n in np.unique(hits.surface[mask])} <= {names[element.id]}
            share += float(mask.mean()) / len(views(kind))
    assert share > 0.3


@pytest.mark.parametrize(("strip_px", "is_drawn"), [(2.5, False), (9.0, True)])
def test_a_sliver_of_a_window_at_the_image_border_is_left_to_its_wall(strip_px: float, is_drawn: bool) -> None:
    room = the_room("box")
    window = next(surface for surface in room.structure if surface.label == "window")
    camera = camera_at(np.append(room.focus - (0.3, 1.0), 1.5), np.array([0.1, 1.0, 0.0]))
    left_px = camera.project(window.corners_world)[0][:, 0].min()
    shift = np.array([[0, 0, WIDTH - strip_px - left_px], [0, 0, 0], [0, 0, 0]])
    shifted = replace(camera, K=camera.K + shift)
    key_frame, _ = annotate(room, shifted, cast(room.surfaces, shifted), 0, np.random.default_rng(0))
    labels = [element.label for element in key_frame.elements]
    assert ("window" in labels) == is_drawn
    assert sum(element.amodal.area for element in key_frame.elements if element.label not in OPENINGS) == pytest.approx(
        WIDTH * HEIGHT
    )


@every_kind
def test_neighbours_share_every_corner_on_their_common_boundary(kind: RoomKind) -> None:
    shared = 0
    for key_frame, _ in drawn(kind):
        for one in key_frame.elements:
            corners = shapely.points(np.concatenate(rings_of(one.amodal)))
            for other in key_frame.elements:
                if other is not one:
                    on_it = corners[shapely.distance(other.amodal.boundary, corners) < 0.02]
                    theirs = MultiPoint(np.concatenate(rings_of(other.amodal)))
                    assert (shapely.distance(theirs, on_it) == 0).all()
                    shared += len(on_it)
        for line in key_frame.occlusion_edges:
            corners = np.concatenate([ring for e in key_frame.elements for ring in rings_of(e.amodal)])
            apart = np.linalg.norm(line[:, None] - corners, axis=2).min(axis=1)
            assert apart[np.r_[0, -1]].max() == 0 or kind == "two-rooms"  # there it may end on an unlabelled reveal
    assert shared > 50


@every_kind
def test_occlusion_edges_run_exactly_where_the_buildings_depth_jumps(kind: RoomKind) -> None:
    room, jumps = the_room(kind), 0
    for camera, (key_frame, _) in zip(views(kind), drawn(kind), strict=True):
        lines = MultiLineString(list(key_frame.occlusion_edges))
        seen = cast(room.building, camera).surface
        between, least_m, most_m = _gaps(room, camera, seen)
        assert (shapely.distance(lines, shapely.points(between)) < 1.5)[least_m > 0.1].all()
        jumps += int((least_m > 0.1).sum())
        along = shapely.line_interpolate_point(lines, np.arange(0.5, lines.length, 1.0)) if not lines.is_empty else []
        for point in shapely.get_coordinates(along):
            if 3 < point[0] < WIDTH - 3 and 3 < point[1] < HEIGHT - 3:
                assert most_m[np.linalg.norm(between - point, axis=1) < 2].max() > 0.01
    assert (jumps > 100) == (kind in ("l-shaped", "two-rooms")) or kind == "polygon"


def _gaps(room: Room, camera: Camera, seen: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N, 2) px between pixels that show two surfaces, and how far these are apart there, m.

    The least and the most within three quarters of a pixel: at a grazing angle that may be decimetres.
    """
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    points, pairs = [], []
    for axis, step in ((0, (0.5, 1.0)), (1, (1.0, 0.5))):
        a, b = (np.delete(seen, cut, axis) for cut in (-1, 0))
        at = a != b
        points.append(np.stack([np.delete(grid, -1, axis)[at] for grid in (x, y)], axis=1) + step)
        pairs.append(np.stack([a[at], b[at]], axis=1))
    between, pair = np.concatenate(points), np.concatenate(pairs)
    gap = np.zeros((9, len(between)))
    for one, other in np.unique(pair, axis=0):
        at = (pair == (one, other)).all(axis=1)
        for number, shift in enumerate(np.mgrid[-1:2, -1:2].reshape(2, 9).T * 0.75):
            depths = [_depth(room.building[k], camera, between[at] + shift) for k in (one, other)]
            gap[number, at] = depths[0] - depths[1]
    crossing = (gap.min(axis=0) < 0) & (gap.max(axis=0) > 0)
    return between, np.where(crossing, 0, np.abs(gap).min(axis=0)), np.abs(gap).max(axis=0)


def _flat(name: str, left: float, right: float, depth: float, low: float = -2.0, high: float = 2.0) -> Surface:
    """A wall across the view of a camera at the origin that looks along z."""
    corners = np.array([[left, high, depth], [right, high, depth], [right, low, depth], [left, low, depth]])
    return make_surface(
        name,
        "wall",
        corners,
        lambda rng, shape: plain(rng, shape, (90, 90, 90), 5),
        lambda points, _: np.ones(len(points)),
        np.random.default_rng(0),
    )


def test_a_pillar_cuts_the_wall_behind_it_in_two() -> None:
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), np.eye(3), np.zeros(3), 100, 80)
    wall, pillar = _flat("wall", -3, 3, 4.0, -3, 3), _flat("pillar", -0.2, 0.2, 2.0)
    drawing = draw((wall, pillar), camera)
    left, right = sorted(drawing.regions[0].geoms, key=lambda part: part.bounds)
    assert left.bounds == pytest.approx((0, 0, 40, 80), abs=1e-4)
    assert right.bounds == pytest.approx((60, 0, 100, 80), abs=1e-4)
    assert drawing.regions[1].bounds == pytest.approx((40, 0, 60, 80), abs=1e-4)
    lines = sorted(occlusion_edges(drawing, camera), key=lambda line: line[:, 0].min())
    for line, x in zip(lines, (40, 60), strict=True):
        np.testing.assert_allclose(line[:, 0], x, atol=1e-4)
        assert sorted(line[:, 1]) == pytest.approx([0, 80])


def test_walls_that_meet_share_an_edge_and_no_occlusion() -> None:
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), np.eye(3), np.zeros(3), 100, 80)
    drawing = draw((_flat("left", -3, 0.1, 2.0), _flat("right", 0.1, 3, 2.004)), camera)
    assert occlusion_edges(drawing, camera) == ()
    drawing = draw((_flat("left", -3, 0.1, 2.0), _flat("right", 0.0, 3, 2.02)), camera)
    assert len(occlusion_edges(drawing, camera)) == 1


@every_kind
def test_the_extent_is_what_the_key_frames_show(kind: RoomKind) -> None:
    """Points of the empty room seen in a key frame lie in the extent, points of the extent are seen in one."""
    room = the_room(kind)
    extents = seen_extents(room, [(c, *each) for c, each in zip(views(kind), drawn(kind), strict=True)])
    assert set(extents) == {name for _, names in drawn(kind) for name in names.values()}
    regions = {
        name: shapely.union_all([Polygon(rings[0], rings[1:]) for rings in _in_plane(room, name, parts)])
        for name, parts in extents.items()
    }
    rng = np.random.default_rng(0)
    seen = dict.fromkeys(regions, 0)
    for number, surface in enumerate(room.building):
        if surface.name not in regions:
            continue
        own = [n for n, other in enumerate(room.building) if n == number or _in_wall(other, surface)]
        region, outline = regions[surface.name], Polygon(surface.corners_uv)
        assert outline.buffer(2e-4).covers(region)
        uv = rng.uniform(0, surface.corners_uv.max(axis=0), (400, 2))
        uv = uv[shapely.distance(outline.exterior, shapely.points(uv)) > 0.03]
        uv = uv[shapely.contains_xy(outline, uv)]
        visible = np.zeros(len(uv), bool)
        for camera in views(kind):
            if surface.normal @ camera.center_world + surface.d <= 0:
                continue
            px, depth = camera.project(surface.frame.to_world(uv))
            inside = (depth > 0) & ((px > 0) & (px < (WIDTH, HEIGHT))).all(axis=1)
            column, row = np.floor(px[inside]).astype(int).T
            visible[inside] |= np.isin(cast(room.building, camera).surface[row, column], own)
        away = shapely.distance(region.boundary, shapely.points(uv)) > 0.05
        agree = visible == shapely.contains_xy(region, uv)
        # Pieces too small to draw are seen, yet not part of it.
        assert agree[away].mean() > 0.97
        seen[surface.name] += int(visible.sum())
    assert sum(seen.values()) > 500


def _in_plane(room: Room, name: str, parts: list[list[FloatArray]]) -> list[list[FloatArray]]:
    surface = next(s for s in room.structure if s.name == name)
    for ring in (ring for rings in parts for ring in rings):
        np.testing.assert_allclose(ring @ surface.normal + surface.d, 0, atol=1e-9)
    return [[surface.frame.to_plane(ring) for ring in rings] for rings in parts]


def _in_wall(opening: Surface, wall: Surface) -> bool:
    off = np.abs(opening.corners_world @ wall.normal + wall.d).max()
    return opening.label in OPENINGS and wall.label not in OPENINGS and off < 1e-6


def _depth(surface: Surface, camera: Camera, points_px: FloatArray) -> FloatArray:
    return -(surface.normal @ camera.center_world + surface.d) / (camera.rays_world(points_px) @ surface.normal)
