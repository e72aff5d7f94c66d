"""Frames found by the names that tools have for them, and proposals as tools draw them."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from serving import SIZE
from shapely import MultiPolygon, Polygon, box

from gtlayout.io.annotations.outlines import View
from gtlayout.io.annotations.tool_shapes import tool_shapes
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.pixels.turn import TURNS
from gtlayout.proposals.proposal import Proposal, ProposedElement
from gtlayout.scene import Camera, Element, Frame, Label, VideoOrigin
from gtlayout.serve.solved_room import Found, SolvedRoom, version_of

LENS = Undistortion("SIMPLE_RADIAL", 120, 100, (110.0, 58.0, 51.5, -0.1))
NOTHING = MultiPolygon()


def _frame(width: int = 160, height: int = 120) -> Frame:
    return Frame("a.png", Path("a.png"), Camera(np.eye(3), np.eye(3), np.zeros(3), width, height))


def _of_lens(lens: Undistortion | Upright, turned: bool = False) -> Frame:
    target = lens.target if isinstance(lens, Undistortion) else LENS.target
    size = (target.height, target.width) if turned else (target.width, target.height)
    return replace(_frame(*map(int, size)), undistort=lens)


def _proposed(name: str, label: Label, amodal: MultiPolygon, visible: MultiPolygon, score: float) -> ProposedElement:
    return ProposedElement(Element(name, label, amodal, visible), 0, (), score)


@pytest.mark.parametrize("size", [None, (240, 200)], ids=["as stored", "twice as large"])
@pytest.mark.parametrize("turn", range(8))
def test_what_is_shown_is_where_it_would_be_drawn(turn: int, size: tuple[int, int] | None) -> None:
    """For every orientation tag, with a lens, in the image's size and another: readers take it back to where it was."""
    way = Upright(TURNS[turn], 120, 100, (LENS,), TURNS[0], TURNS[0] if TURNS[turn].is_mirrored else TURNS[turn])
    frame = _of_lens(way, TURNS[turn].swaps_axes and not TURNS[turn].is_mirrored)
    shown = None if size is None else TURNS[turn].size(size)
    view = View.of("a.png", frame, shown)
    points = np.array([[0.0, 0.0], [3.0, 70.0], [50.0, 20.0], [85.0, 75.0]])
    drawn = view.to_drawn(points)
    assert np.abs(drawn - points).max() > 0.3
    assert view.to_pinhole(view.to_file(drawn)) == pytest.approx(points, abs=1e-6)


def test_a_lens_without_a_turn_and_a_video_of_another_size() -> None:
    points = np.array([[10.0, 5.0], [50.0, 20.0]])
    view = View.of("a.png", _of_lens(LENS), None)
    assert np.abs(view.to_drawn(points) - points).max() > 0.3
    assert view.to_pinhole(view.to_drawn(points)) == pytest.approx(points, abs=1e-6)
    way = Upright(TURNS[0], 120, 100, (LENS,), TURNS[0], TURNS[0])
    origin = VideoOrigin("a.mp4", 0, 0.0, 9, resampled=way)
    frame = replace(_frame(int(LENS.target.width), int(LENS.target.height)), origin=origin)
    on_video = View.of("frame_000000", frame, None, on_video=True)
    assert on_video.to_drawn(points) == pytest.approx(LENS.distorted(points))


@pytest.mark.parametrize(
    ("image", "frame"),
    [
        ("000003.jpg", 3),
        ("images/000003.JPG", 3),
        ("/data/upload/7/1a2b3c4d-000003.jpg", 3),
        ("/data/local-files/?d=room%2Fimages/000003.jpg", 3),
        ("000003_jpg.rf.abcdef0123.jpg", 3),
    ],
)
def test_names_are_matched_as_those_of_drawings(
    served_room: SolvedRoom, caplog: pytest.LogCaptureFixture, image: str, frame: int
) -> None:
    found = served_room.find(image)
    assert isinstance(found, Found)
    assert (found.frame, found.is_drawn, found.view.annotated_size) == (frame, False, SIZE)
    assert not caplog.records


def test_what_is_not_found_says_why(served_room: SolvedRoom, caplog: pytest.LogCaptureFixture) -> None:
    assert served_room.find("kitchen.jpg") == "has no camera"
    assert served_room.find("000099.jpg") == "has no camera"
    assert served_room.find("000003.jpg", (120, 160)) == "is shown with 120x160 px, and its camera is of 160x120"
    assert not caplog.records
    by_number = served_room.find("frame_3")
    assert isinstance(by_number, Found)
    assert by_number.frame == 3
    assert [each.message for each in caplog.records] == ["frame_3 is taken to be 000003.jpg, by its number alone"]


def test_drawn_frames_are_known_as_such(served_room: SolvedRoom) -> None:
    drawn = [i for i, frame in enumerate(served_room.scene.frames) if _found(served_room, frame.name).is_drawn]
    assert drawn == [key_frame.frame for key_frame in served_room.scene.key_frames]
    assert 0 < len(drawn) < len(served_room.scene.frames)


def test_a_frame_without_pixels_is_proposed_all_the_same(
    served_room: SolvedRoom, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = list(served_room.scene.frames)
    frames[5] = replace(frames[5], image_path=Path("gone.jpg"))
    monkeypatch.setattr(served_room, "scene", replace(served_room.scene, frames=tuple(frames)))
    monkeypatch.setattr(served_room, "_proposals", {})
    with caplog.at_level(logging.WARNING):
        proposal = served_room.propose(_found(served_room, "000005.jpg"))
    assert proposal.frame == 5
    assert proposal.elements
    (said,) = caplog.records
    assert said.message.startswith("000005.jpg: proposed without its pixels: cannot read image gone.jpg")


def test_the_version_is_that_of_the_drawings(served_room: SolvedRoom) -> None:
    scene = served_room.scene
    version = version_of(scene)
    assert version == served_room.version
    assert f"{len(scene.key_frames)} frames drawn" in version
    first = scene.key_frames[0]
    wall = first.elements[0]
    moved = replace(wall, amodal=MultiPolygon([box(0, 0, 30, 40)]))
    for other in (
        replace(first, elements=(moved, *first.elements[1:])),
        replace(first, elements=(replace(wall, label="slanted"), *first.elements[1:])),
        replace(first, occlusion_edges=(*first.occlusion_edges, np.zeros((2, 2)))),
    ):
        assert version_of(replace(scene, key_frames=(other, *scene.key_frames[1:]))) != version
    assert version_of(replace(scene, frames=scene.frames[:])) == version


def test_openings_lie_above_their_walls_and_nothing_covers_visible_parts_and_edges() -> None:
    wall = box(0, 0, 160, 120).difference(box(20, 20, 40, 40))
    door = MultiPolygon([box(100, 40, 120, 120)])
    proposal = Proposal(
        0,
        (
            _proposed("door_0", "door", door, NOTHING, 0.5),
            _proposed("wall_0", "wall", MultiPolygon([wall]), MultiPolygon([box(50, 0, 90, 30)]), 0.9),
        ),
        (np.array([[0.0, 0.0], [50.0, 60.0]]),),
        NOTHING,
    )
    shapes = tool_shapes(proposal.draft(), View.of("a.png", _frame(), (320, 240)))
    about = [(shape.name, shape.kind, shape.label, shape.text, shape.score) for shape in shapes]
    assert about == [
        ("wall_0-0", "polygon", "wall", ("id", "wall_0"), 0.9),
        ("wall_0-1", "polygon", "wall", ("id", "wall_0"), 0.9),
        ("door_0-0", "polygon", "door", ("id", "door_0"), 0.5),
        ("wall_0-visible-0", "polygon", "visible", ("element", "wall_0"), 0.9),
        ("occlusion_edge-0", "polyline", "occlusion_edge", None, pytest.approx(0.7)),
    ]
    halves = [Polygon(shape.points_px / 2) for shape in shapes[:2]]
    assert halves[0].union(halves[1]).symmetric_difference(wall).area < 1e-6
    assert shapes[-1].points_px.tolist() == [[0, 0], [100, 120]]


def test_points_stay_within_the_image() -> None:
    beyond = MultiPolygon([box(-1e-9, -1e-9, 160 + 1e-9, 120 + 1e-9)])
    proposal = Proposal(0, (_proposed("wall_0", "wall", beyond, NOTHING, 1.0),), (), NOTHING)
    (shape,) = tool_shapes(proposal.draft(), View.of("a.png", _frame(), None))
    assert shape.points_px.min() == 0
    assert shape.points_px.max(axis=0).tolist() == [160, 120]


def test_nothing_has_no_score() -> None:
    assert Proposal(0, (), (), NOTHING).draft().score == 0


def _found(served_room: SolvedRoom, image: str) -> Found:
    found = served_room.find(image)
    assert isinstance(found, Found)
    return found
