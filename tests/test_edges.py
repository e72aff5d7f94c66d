"""Stage 3: contact edges of hand-made polygons, and of a box room, where the truth is the planes' intersection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from gtlayout.edges import ContactEdge, EdgeConfig, contact_edges
from gtlayout.instances import Instance
from gtlayout.scene import Camera, Element, FloatArray, Frame, KeyFrame, Scene
from simulated.simulated_edges import true_edges
from simulated.simulated_room import as_multi, make_room, orbit

CONFIG = EdgeConfig()
LEFT, RIGHT = shapely.box(20, 20, 100, 120), shapely.box(100, 20, 180, 120)


def find(*regions: BaseGeometry, occlusion: Sequence[FloatArray] = ()) -> tuple[ContactEdge, ...]:
    """Contact edges of one 200x200 px key frame, instance i = region i."""
    camera = Camera(np.array([[200.0, 0, 100], [0, 200, 100], [0, 0, 1]]), np.eye(3), np.zeros(3), 200, 200)
    elements = tuple(Element(f"e{i}", "wall", as_multi(r), as_multi(Polygon())) for i, r in enumerate(regions))
    frame = Frame("0.png", Path("/nowhere/0.png"), camera)
    scene = Scene(Path("/nowhere"), (frame,), (KeyFrame(0, elements, tuple(occlusion)),), metric=True)
    instances = [Instance(f"wall_{i}", "wall", ((0, i),)) for i in range(len(regions))]
    return contact_edges(scene, instances, CONFIG)


def covers(points_px: FloatArray, start: tuple[float, float], end: tuple[float, float]) -> bool:
    """Whether the points lie on a segment and leave no gap in it.

    At its ends, where one of the boundaries turns away, a sample may be off by half the gap allowed between the two.
    """
    line = shapely.LineString([start, end])
    off_px = shapely.distance(shapely.points(points_px), line)
    at = np.sort(shapely.line_locate_point(line, shapely.points(points_px)))
    widest_gap_px = np.diff(np.concatenate([[0], at, [line.length]])).max()
    on_it = np.median(off_px) < 1e-9 and off_px.max() <= CONFIG.max_gap_px / 2
    return bool(on_it and widest_gap_px <= CONFIG.max_gap_px + CONFIG.step_px)


def test_two_squares_side_by_side_share_their_line() -> None:
    (edge,) = find(LEFT, RIGHT)
    assert (edge.key_frame, edge.instances) == (0, (0, 1))
    assert covers(edge.points_px, (100, 20), (100, 120))


@pytest.mark.parametrize("first_vertex", range(4))
@pytest.mark.parametrize("reverse", [False, True])
def test_it_does_not_matter_where_a_polygon_starts(first_vertex: int, reverse: bool) -> None:
    corners = np.roll(shapely.get_coordinates(LEFT)[:-1], first_vertex, axis=0)
    (edge,) = find(Polygon(corners[::-1] if reverse else corners), RIGHT)
    assert covers(edge.points_px, (100, 20), (100, 120))


@pytest.mark.parametrize("gap_px", [-2.0, 2.0])
def test_a_gap_or_an_overlap_is_split_in_the_middle(gap_px: float) -> None:
    (edge,) = find(shapely.box(20, 20, 100 - gap_px / 2, 120), shapely.box(100 + gap_px / 2, 20, 180, 120))
    assert covers(edge.points_px, (100, 20), (100, 120))


def test_polygons_too_far_apart_do_not_touch() -> None:
    assert find(shapely.box(20, 20, 97, 120), shapely.box(103, 20, 180, 120)) == ()


def test_an_occlusion_edge_takes_its_part_away() -> None:
    assert find(LEFT, RIGHT, occlusion=[np.array([[101.0, 20], [101, 120]])]) == ()
    (edge,) = find(LEFT, RIGHT, occlusion=[np.array([[100.0, 20], [100, 70]])])
    assert covers(edge.points_px, (100, 70 + CONFIG.occlusion_px), (100, 120))


def test_the_image_border_is_no_contact() -> None:
    # Wall and door are both cut off by the lower border: there their boundaries coincide, and mean nothing.
    assert find(shapely.box(0, 0, 200, 200), shapely.box(80, 90, 120, 200)) == ()
    # The line between two walls runs into the border and ends short of it.
    (edge,) = find(shapely.box(0, 0, 100, 200), shapely.box(100, 0, 200, 200))
    assert covers(edge.points_px, (100, 3), (100, 197))


def test_a_common_corner_is_no_edge() -> None:
    assert find(LEFT, shapely.box(100, 120, 180, 190)) == ()
    assert find(LEFT, shapely.box(102, 122, 180, 190)) == ()


def test_a_short_contact_says_nothing() -> None:
    assert find(LEFT, shapely.box(100, 112, 180, 190)) == ()


def test_a_parallel_piece_off_the_line_is_dropped() -> None:
    # The floor's outline follows the wall for 110 px, then the foot of a cabinet 20 px lower.
    wall = Polygon([(20, 20), (180, 20), (180, 120), (130, 120), (130, 100), (20, 100)])
    floor = Polygon([(20, 100), (130, 100), (130, 120), (180, 120), (180, 180), (20, 180)])
    (edge,) = find(wall, floor)
    assert np.abs(edge.points_px[:, 1] - 100).max() < CONFIG.straightness_px
    assert edge.points_px[:, 0].max() <= 130 + CONFIG.max_gap_px
    assert np.ptp(edge.points_px[:, 0]) > 100


def test_every_corner_line_of_a_box_room_is_found_and_lies_where_the_planes_meet() -> None:
    room = make_room(orbit(), [2, 6, 10, 14, 18])
    found = contact_edges(room.scene, room.instances, CONFIG)
    expected = {(e.key_frame, frozenset(e.instances)): len(e.points_px) for e in true_edges(room)}
    lengths = {(e.key_frame, frozenset(e.instances)): len(e.points_px) for e in found}
    assert len(lengths) == len(found)
    assert set(lengths) == set(expected)
    for pair, count in expected.items():
        assert lengths[pair] >= count - 4, pair
    for edge in found:
        camera = room.scene.frame_of(edge.key_frame).camera
        a, b = (room.planes[i] for i in edge.instances)
        points_px = edge.points_px[2:-2]  # not those where the room's corners turn the boundaries away
        rays = camera.rays_world(points_px)
        depth = -(a[:3] @ camera.center_world + a[3]) / (rays @ a[:3])
        np.testing.assert_allclose((camera.center_world + depth[:, None] * rays) @ b[:3] + b[3], 0, atol=1e-9)


def test_points_run_along_the_edge_whatever_hides_its_middle() -> None:
    hidden = np.array([[100.0, 60], [100.0, 80]])
    for roll in range(4):
        corners = np.roll(shapely.get_coordinates(LEFT)[:-1], roll, axis=0)
        (edge,) = find(Polygon(corners), RIGHT, occlusion=[hidden])
        along = edge.points_px[:, 1]
        assert (np.diff(along) >= 0).all() or (np.diff(along) <= 0).all()
        assert np.ptp(along) > 90


def test_a_long_edge_does_not_need_all_pairs_of_its_points() -> None:
    height = 20000.0
    camera = Camera(np.eye(3), np.eye(3), np.zeros(3), 200, int(height))
    sides = [as_multi(shapely.box(20, 20, 100, height - 20)), as_multi(shapely.box(100, 20, 180, height - 20))]
    elements = tuple(Element(f"e{i}", "wall", side, as_multi(Polygon())) for i, side in enumerate(sides))
    scene = Scene(Path("/nowhere"), (Frame("0.png", Path("/nowhere"), camera),), (KeyFrame(0, elements),), metric=True)
    instances = [Instance(f"wall_{i}", "wall", ((0, i),)) for i in range(2)]
    dense = replace(CONFIG, step_px=CONFIG.step_px / camera.annotation_scale)
    (edge,) = contact_edges(scene, instances, dense)  # all pairs of 5,000 points would take hundreds of GB
    assert len(edge.points_px) > 4900
