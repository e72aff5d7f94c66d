"""``gtlayout propose``: what it writes, that readers take it back, and that nothing else in the files changes."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rooms
from shapely import MultiPolygon

from gtlayout.api import load
from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations import native
from gtlayout.io.annotations.drafts import Draft, on_shown_image
from gtlayout.io.annotations.label_studio.predictions import prediction_task
from gtlayout.io.annotations.outlines import View
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.files import write_json_atomic
from gtlayout.io.pixels.turn import AS_STORED, Turn
from gtlayout.method import solve
from gtlayout.observer import Observer
from gtlayout.scene import Element, Frame, KeyFrame, Scene
from gtlayout.solution import Solution

LENS = Undistortion("OPENCV", 640, 480, (500.0, 500.0, 320.0, 240.0, -0.2, 0.05, 0.001, -0.001))
RIGHT = Turn(swaps_axes=True, flips_x=True)
DRAWN = MultiPolygon([rooms.pixels(100, 50, 300, 200).geoms[0], rooms.pixels(310, 50, 340, 200).geoms[0]])
DRAFT = Draft(
    KeyFrame(0, (Element("wall_0", "wall", DRAWN, rooms.pixels(110, 60, 200, 100)),), (np.eye(2),)), {"wall_0": 0.7}
)


@pytest.fixture(scope="module")
def proposed(room: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example room after all three tools, with what people may have put into the file beside gtlayout's keys."""
    folder = tmp_path_factory.mktemp("proposed") / "room"
    shutil.copytree(room, folder)
    data = json.loads((folder / "annotations.json").read_text())
    kept = {"image": "000020.jpg", "elements": [], "note": "mine"}
    write_json_atomic(folder / "annotations.json", {"owner": "Ada", **data, "drafts": [kept, {"image": "000004.jpg"}]})
    with solved_once():
        assert main(["propose", str(folder), "--frames", "000004.jpg", "7"]) == 0
        assert main(["propose", str(folder), "--frames", "000004.jpg", "7", "--to", "cvat"]) == 0
    return folder


_SOLUTIONS: list[Solution] = []


@contextmanager
def solved_once() -> Iterator[None]:
    """The first solve is made; it takes seconds, and all others here are of the same drawings."""

    def once(scene: Scene, observer: Observer) -> Solution:
        if not _SOLUTIONS:
            _SOLUTIONS.append(solve(scene, observer=observer))
        return _SOLUTIONS[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gtlayout.cli.propose.solve", once)
        yield


def drafts_of(folder: Path) -> list[dict[str, Any]]:
    drafts: list[dict[str, Any]] = json.loads((folder / "annotations.json").read_text())["drafts"]
    return drafts


def test_drafts_stand_beside_the_drawings_and_count_for_nothing(
    room: Path, proposed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = (json.loads((folder / "annotations.json").read_text()) for folder in (room, proposed))
    assert list(after) == ["owner", *before, "drafts"]
    assert {key: after[key] for key in before} == before
    # Of one image the new draft, of others what there was.
    assert [draft["image"] for draft in after["drafts"]] == ["000020.jpg", "000004.jpg", "000007.jpg"]
    assert after["drafts"][0]["note"] == "mine"
    drawn, with_drafts = load(room), load(proposed)
    assert repr(with_drafts.key_frames) == repr(drawn.key_frames)
    assert with_drafts.warnings == drawn.warnings
    said = "annotations.json: 3 frames are drafts, not used: only what a person confirmed counts"
    assert (drawn.notes, with_drafts.notes) == ((), (said,))
    # Nothing that a check would doubt.
    assert main(["check", str(room)]) == 0
    before_check = capsys.readouterr().out
    assert main(["check", str(proposed)]) == 0
    assert capsys.readouterr().out == f"note: {said}\n{before_check}".replace(str(room), str(proposed))


def test_a_draft_is_what_is_there(room: Path, proposed: Path) -> None:
    """The room's annotator is simulated: in frame 7 it would draw what the truth projects to."""
    draft = drafts_of(proposed)[2]
    labels = sorted(element["label"] for element in draft["elements"])
    assert {"floor", "ceiling", "wall"} <= set(labels)
    assert all(0 < element["score"] <= 1 and element["visible"] for element in draft["elements"])
    # Confirmed, they are drawings like any other.
    data = json.loads((proposed / "annotations.json").read_text())
    confirmed = {**data, "frames": data["drafts"][1:], "drafts": []}
    scene = load(room, annotations=_written(proposed.parent / "confirmed.json", confirmed))
    assert [scene.frames[key_frame.frame].name for key_frame in scene.key_frames] == ["000004.jpg", "000007.jpg"]
    covered = sum(e.amodal.area for e in scene.key_frames[1].elements if e.label not in ("door", "window"))
    assert covered == pytest.approx(320 * 240, rel=0.02)


def _written(path: Path, data: Any) -> Path:
    write_json_atomic(path, data)
    return path


def test_cvat_reads_the_same(room: Path, proposed: Path) -> None:
    xml = proposed / "gtlayout" / "proposals_cvat.xml"
    with pytest.raises(GtlayoutError, match=r"nobody has confirmed what is drawn \(2, first in 000004.jpg\)"):
        load(room, annotations=xml)
    # Who confirms them removes the tag.
    text, count = re.subn(r'<tag label="proposed" source="manual" />', "", xml.read_text())
    assert count == 2
    confirmed = proposed.parent / "confirmed.xml"
    confirmed.write_text(text)
    scene = load(room, annotations=confirmed)
    for key_frame, draft in zip(scene.key_frames, drafts_of(proposed)[1:], strict=True):
        assert [element.id for element in key_frame.elements] == [element["id"] for element in draft["elements"]]
        for element, there in zip(key_frame.elements, draft["elements"], strict=True):
            area = sum(MultiPolygon([(ring, [])]).area for ring in there["polygons"])
            assert element.amodal.area == pytest.approx(area, abs=5)
    # What lies in the folder of results was not drawn by anyone, and is not taken for annotations.
    assert load(proposed).key_frames
    (proposed / "annotations.json").rename(proposed / "annotations.away")
    try:
        with pytest.raises(GtlayoutError, match="no annotations"):
            load(proposed)
    finally:
        (proposed / "annotations.away").rename(proposed / "annotations.json")


def test_label_studio_reads_the_same(room: Path, tmp_path: Path) -> None:
    frame = load(room).frames[0]
    task = prediction_task(frame, DRAFT)
    (prediction,) = task["predictions"]
    assert prediction["score"] == 0.7
    assert {result["score"] for result in prediction["result"] if result["type"] == "polygonlabels"} == {0.7}
    # As if a person had submitted it.
    task = {"id": 1, "data": task["data"], "annotations": [{"id": 1, "result": prediction["result"]}]}
    scene = load(room, annotations=_written(tmp_path / "export.json", [task]))
    (element,) = scene.key_frames[0].elements
    assert (element.id, element.label) == ("wall_0", "wall")
    clipped = DRAWN.intersection(rooms.pixels(0, 0, 320, 240))
    assert element.amodal.symmetric_difference(clipped).area == pytest.approx(0, abs=1e-6)
    assert element.visible.area == pytest.approx(90 * 40)
    np.testing.assert_allclose(scene.key_frames[0].occlusion_edges[0], np.eye(2))


def test_drawings_of_another_tool_are_left_alone(
    room: Path, proposed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "room"
    shutil.copytree(proposed, folder)
    (folder / "annotations.json").unlink()
    xml = folder / "task.xml"
    shutil.copy(proposed.parent / "confirmed.xml", xml)
    before = Path(xml).read_bytes()
    with solved_once():
        assert main(["propose", str(folder), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert Path(xml).read_bytes() == before
    assert said["file"] == str(folder / "gtlayout" / "drafts.json")
    written = json.loads((folder / "gtlayout" / "drafts.json").read_text())
    assert written["format"] == "gtlayout-drafts/1"
    (draft,), (shown,) = written["drafts"], said["frames"]
    assert draft["image"] == shown["image"]
    assert [element["score"] for element in draft["elements"]] == [element["score"] for element in shown["elements"]]
    kinds = {edge["kind"] for element in shown["elements"] for edge in element["edges"]}
    assert kinds <= {"contact", "occlusion", "side", "open", "border"}
    assert load(folder).key_frames


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--frames", "nowhere.jpg"], "no frame 'nowhere.jpg'; there are 24, the first is 000000.jpg"),
        (["--frames", "{drawn}"], "frame {drawn} is drawn already: remove it there to have it proposed"),
    ],
)
def test_a_frame_that_cannot_be_proposed(
    room: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = load(room)
    drawn = scene.frame_of(0).name
    before = (room / "annotations.json").read_bytes()
    assert main(["propose", str(room), *(option.format(drawn=drawn) for option in options)]) == 1
    assert capsys.readouterr().err == f"gtlayout: {message.format(drawn=drawn)}\n"
    assert (room / "annotations.json").read_bytes() == before


# --- coordinates ---


def frame_with(lens: Undistortion | Upright | None) -> Frame:
    camera = rooms.level_camera((0, 0, 0), width=600, height=440)
    if isinstance(lens, Undistortion):
        camera = replace(camera, width=int(lens.target.width), height=int(lens.target.height))
    if isinstance(lens, Upright):
        width, height = lens.after.size(lens.seen_size)
        camera = replace(camera, width=width, height=height)
    return Frame("a.jpg", Path("a.jpg"), camera, undistort=lens)


@pytest.mark.parametrize("size", [None, (1280, 960)], ids=["file's size", "twice the size"])
@pytest.mark.parametrize(
    "lens",
    [
        None,
        LENS,
        Upright(RIGHT, 640, 480, (LENS,), AS_STORED, RIGHT),
        Upright(RIGHT, 480, 640, (LENS,), RIGHT, AS_STORED),
        Upright(Turn(flips_x=True), 640, 480, (), AS_STORED, AS_STORED),
    ],
    ids=["pinhole", "lens", "turned after", "turned before", "mirrored"],
)
def test_drafts_are_drawn_where_the_reader_looks(
    lens: Undistortion | Upright | None, size: tuple[int, int] | None
) -> None:
    view = View.of("a.jpg", frame_with(lens), None)
    if size is not None:
        view = View.of("a.jpg", frame_with(lens), (2 * view.shown_size[0], 2 * view.shown_size[1]))
    points = np.array([[50.0, 60.0], [300.0, 220.0], [390.0, 60.0], [70.0, 400.0]])
    there = view.to_drawn(points)
    np.testing.assert_allclose(view.to_pinhole(view.to_file(there)), points, atol=1e-3)
    if size is not None or lens is not None:
        assert np.abs(there - points).max() > 1


def test_writers_of_other_tools_get_the_size_of_the_shown_image() -> None:
    lens = Upright(RIGHT, 640, 480, (LENS,), AS_STORED, RIGHT)
    shown, draft = on_shown_image(DRAFT, frame_with(lens))
    assert (shown.camera.width, shown.camera.height) == (480, 640)
    assert draft.key_frame.elements[0].amodal.area > 0
    (result, *_) = prediction_task(frame_with(lens), DRAFT)["predictions"][0]["result"]
    assert (result["original_width"], result["original_height"]) == (480, 640)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            {"format": "gtlayout-annotations/1", "frames": [], "drafts": 3},
            "drafts must be a list; mend it, or remove it",
        ),
        ({"format": "other", "frames": []}, "format is 'other', expected 'gtlayout-annotations/1'"),
        (
            {"format": "gtlayout-annotations/1", "image_size": [100, 400], "frames": []},
            "a.jpg has not the shape of the file's image_size (100, 400): no draft of it can stand there",
        ),
    ],
)
def test_a_file_that_takes_no_drafts_stays_as_it_is(data: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = _written(tmp_path / "annotations.json", data)
    before = path.read_bytes()
    with pytest.raises(GtlayoutError) as raised:
        native.write_drafts(path, [frame_with(None)], [DRAFT])
    assert str(raised.value).endswith(message)
    assert path.read_bytes() == before
