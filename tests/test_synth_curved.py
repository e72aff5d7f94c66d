"""Round walls of synthetic rooms: facets of a true cylinder, drawn as one element, with lines a person would click."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import shapely
from synth_views import HEIGHT, WIDTH, drawn, the_room, views

from gtlayout.geometry.raster import fill, rings_of
from gtlayout.synth.arcs import Arc
from gtlayout.synth.baseboards import fit_baseboards
from gtlayout.synth.config import SynthConfig
from gtlayout.synth.data_set import varied
from gtlayout.synth.fitting import Fitter
from gtlayout.synth.render import cast
from gtlayout.synth.room import CURVED_ROOM_KINDS, RoomKind
from gtlayout.synth.surfaces import Surface
from gtlayout.synth.textures import plain

every_round = pytest.mark.parametrize("kind", CURVED_ROOM_KINDS)


def facets(kind: RoomKind) -> list[Surface]:
    return [surface for surface in the_room(kind).building if surface.arc is not None]


@every_round
def test_facets_lie_on_the_cylinder_and_cover_its_arc(kind: RoomKind) -> None:
    walls = facets(kind)
    arc = walls[0].arc
    assert arc is not None
    assert walls[0].label == "wall"
    assert {wall.part_of for wall in walls[1:]} == {walls[0].name}
    assert {wall.label for wall in walls[1:]} == {None}
    corners = np.concatenate([wall.corners_world[:, :2] for wall in walls])
    np.testing.assert_allclose(np.linalg.norm(corners - arc.center_xy, axis=1), arc.radius_m, atol=1e-9)
    middles = np.array([wall.corners_world[:, :2].mean(axis=0) for wall in walls])
    off = arc.radius_m - np.linalg.norm(middles - arc.center_xy, axis=1)
    assert off.min() > 0 and off.max() < 1e-3
    widths = [np.linalg.norm(wall.corners_world[1] - wall.corners_world[0]) for wall in walls]
    assert sum(widths) == pytest.approx(arc.length_m, rel=1e-3)
    inwards = np.array([wall.normal[:2] @ (arc.center_xy - wall.corners_world[0, :2]) for wall in walls])
    assert (inwards > 0).all()


@every_round
def test_the_paper_runs_on_from_facet_to_facet(kind: RoomKind) -> None:
    arc = facets(kind)[0].arc
    assert arc is not None
    left = sorted(arc.from_left_m(wall.corners_world[0, :2]) for wall in facets(kind))
    np.testing.assert_allclose(np.diff(left), arc.length_m / len(left), rtol=1e-3)
    assert left[0] == pytest.approx(0, abs=1e-6)


def test_an_arc_mirrored_is_the_mirrored_arc() -> None:
    arc = Arc(np.array([1.0, 2.0]), 0.5, 0.2, 1.0)
    np.testing.assert_allclose(arc.mirrored().points_xy()[::-1], arc.points_xy() * (-1, 1))


@every_round
def test_a_round_wall_is_drawn_as_one_element_with_few_corners(kind: RoomKind) -> None:
    room, name = the_room(kind), facets(kind)[0].name
    numbers = [n for n, surface in enumerate(room.surfaces) if surface.arc is not None]
    shown = 0
    for camera, (key_frame, names) in zip(views(kind), drawn(kind), strict=True):
        own = [element for element in key_frame.elements if names[element.id] == name]
        assert len(own) <= 1
        assert not any("facet" in of for of in names.values())
        for element in own:
            shown += 1
            assert 4 <= shapely.get_num_coordinates(element.amodal) <= 40
            truth = np.isin(cast(room.building, camera).surface, numbers)
            differs = fill(rings_of(element.amodal), HEIGHT, WIDTH) != truth
            assert not cv2.erode(differs.astype(np.uint8), np.ones((7, 7), np.uint8)).any(), "lines are off by pixels"
            seen = np.isin(cast(room.surfaces, camera).surface, numbers)
            assert seen[fill(rings_of(element.visible), HEIGHT, WIDTH)].all()
    assert shown >= 3


def test_nothing_hides_a_round_corner() -> None:
    """Where a facet is seen under a flat angle its depth jumps from pixel to pixel, and that is no occlusion."""
    assert not any(key_frame.occlusion_edges for key_frame, _ in drawn("round-corner"))


def test_round_walls_have_no_baseboard() -> None:
    room = the_room("bay")
    fitter = Fitter(np.array([[2.0, 2, 2]]), (), np.random.default_rng(0))
    boards = fit_baseboards(
        room.structure, (0.08, 0.01), 1.0, {}, lambda rng, shape: plain(rng, shape, (9, 9, 9), 0), fitter
    )
    assert {board.part_of for board in boards} == {w.name for w in room.structure if w.label == "wall" and not w.arc}


def test_data_sets_keep_their_kinds() -> None:
    assert {varied(number, SynthConfig(), ()).room for number in range(10)} == {
        "box",
        "l-shaped",
        "slanted",
        "two-rooms",
        "polygon",
    }
