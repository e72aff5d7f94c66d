"""2D layouts: pixel errors counted by hand, label images and wireframes in closed form, and the two commands."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import rooms

import layout2d
from common.metrics import read_rows
from common.wireframe import Edge, segments_of, visible_edges, visible_regions
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.geometry.raster import fill, rings_of
from gtlayout.io.files import write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.quality.assess import assess
from gtlayout.results.layout_files import write_results
from gtlayout.scene import Camera, FloatArray
from layout2d import draw_wireframe, label_image, pixel_error, score_folder

SCRIPT = Path(layout2d.__file__)
Edit = Callable[[Path, Callable[[Any], object]], None]
MIDDLE = rooms.level_camera([2.0, 1.0, 1.25])
"""Sees the box room's far wall from (40, 25) to (120, 75), and the room's four long edges to its image's corners."""
CORNERS = np.array([[40.0, 25], [120, 25], [120, 75], [40, 75]])
IMAGE_CORNERS = np.array([[0.0, 0], [160, 0], [160, 100], [0, 100]])


def _layout(*surfaces: rooms.Surface) -> Layout:
    instances = rooms.instances_of(surfaces, 1)
    planes, extents = tuple(s.plane for s in surfaces), tuple(s.extent for s in surfaces)
    return Layout(instances, planes, extents, build_mesh(instances, extents), metric=True)


def _labels(*columns: int) -> npt.NDArray[np.int64]:
    """(4, 10 · columns) image of strips 10 px wide."""
    return np.repeat(np.array([columns] * 4), 10, axis=1)


TRUTH = _labels(1, 1, 2, 3)


@pytest.mark.parametrize(
    ("predicted", "expected"),
    [
        pytest.param(TRUTH, 0.0, id="itself"),
        pytest.param(_labels(7, 7, -3, 0), 0.0, id="other names, 0 among them"),
        pytest.param(_labels(1, 2, 2, 3), 1 / 4, id="one strip wrong"),
        pytest.param(_labels(1, 4, 2, 3), 1 / 4, id="a segment too many"),
        pytest.param(_labels(1, 1, 1, 3), 1 / 4, id="a segment too few"),
        pytest.param(_labels(1, 2, 1, 2), 1 / 2, id="one to one: 1 and 2 both lie half in the first segment"),
        pytest.param(_labels(0, 0, 0, 0), 1 / 2, id="empty: one segment, matched to the largest segment"),
        pytest.param(np.zeros((1, 1), dtype=np.int64), 1 / 2, id="one pixel"),
        pytest.param(TRUTH[::2, ::5], 0.0, id="smaller"),
        pytest.param(np.kron(TRUTH, np.ones((3, 2), dtype=np.int64)), 0.0, id="larger"),
    ],
)
def test_pixel_error_by_hand(predicted: npt.NDArray[np.int64], expected: float) -> None:
    assert pixel_error(TRUTH, predicted) == expected


def test_matching_is_the_best_of_all_and_not_greedy() -> None:
    """Overlaps [[3, 2], [2, 0]]: taking the largest first leaves 3 right pixels of 7, the best matching 4."""
    truth = np.array([[1, 1, 1, 1, 1, 2, 2]])
    predicted = np.array([[5, 5, 5, 6, 6, 5, 5]])
    assert pixel_error(truth, predicted) == pytest.approx(3 / 7)


def test_what_shows_nothing_is_not_scored() -> None:
    truth = _labels(0, 1, 2, 0)
    assert pixel_error(truth, _labels(5, 1, 2, 5)) == 0.0
    assert pixel_error(truth, _labels(1, 1, 1, 2)) == 0.5
    assert pixel_error(np.zeros_like(truth), truth) is None
    assert pixel_error(np.zeros_like(truth), None) is None


def test_missing_prediction_is_all_wrong() -> None:
    assert pixel_error(TRUTH, None) == 1.0


def test_resizing_takes_the_pixel_below_the_centre() -> None:
    """Three columns from five: centres at 1/6, 1/2 and 5/6 of the width lie in columns 0, 2 and 4."""
    truth = np.array([[1, 2, 1]])
    assert pixel_error(truth, np.array([[1, 2, 2, 2, 1]])) == 0.0
    assert pixel_error(truth, np.array([[1, 2, 1, 2, 1]])) == pytest.approx(1 / 3)


def test_label_image_of_the_box_room() -> None:
    labels = label_image(_layout(*rooms.BOX), MIDDLE)
    assert labels.dtype == np.uint8
    x, y = np.meshgrid(np.arange(160) + 0.5 - 80, np.arange(100) + 0.5 - 50)
    far = (np.abs(x) < 40) & (np.abs(y) < 25)
    # Beside the far wall, the image's diagonals part floor and ceiling from the walls.
    level = np.abs(y) / 50 > np.abs(x) / 80
    expected = np.select([far, level & (y > 0), level, x < 0], [5, 1, 2, 3], default=4)
    decided = np.abs(np.abs(y) / 50 - np.abs(x) / 80) > 1e-9
    np.testing.assert_array_equal(labels[decided], expected[decided])


def test_openings_belong_to_their_walls() -> None:
    """A door in the second wall; one without a host is a segment of its own; where nothing is, 0."""
    first, second = rooms.facing(0, 0, 40, 80), rooms.facing(40, 0, 80, 80)
    hosted = rooms.Surface("door", rooms.facing(50, 20, 60, 80).corners * 1.01, host=1)
    alone = rooms.facing(85, 20, 95, 80, "door")
    layout = _layout(first, second, hosted, alone)
    labels = label_image(layout, rooms.facing_camera())
    for columns, label in ((slice(0, 40), 1), (slice(40, 80), 2), (slice(80, 85), 0), (slice(85, 95), 3)):
        assert (labels[30:, columns] == label).all()
    assert [edge.segments for edge in visible_edges(layout, rooms.facing_camera())] == [(0, 1)]


def test_more_segments_than_a_label_image_holds() -> None:
    with pytest.raises(GtlayoutError, match="256 segments"):
        label_image(_layout(*[rooms.facing(0, 0, 10, 10)] * 256), rooms.facing_camera())


def _turned(camera: Camera, yaw: float, pitch: float) -> Camera:
    """The camera, turned where it stands."""
    about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    rotation = about_x @ about_y @ camera.R_cam_from_world
    return replace(camera, R_cam_from_world=rotation, t_cam_from_world=-rotation @ camera.center_world)


@pytest.mark.parametrize("seed", range(8))
def test_visible_regions_are_what_is_rendered(seed: int) -> None:
    """A room with a recessed door and two leaning boards that cut through one another, seen from anywhere."""
    rng = np.random.default_rng(seed)
    door = rooms.Surface("door", rooms.rectangle([1.5, 5.05, 0], [1.0, 0, 0], [0, 0, 2.0]), host=4)
    boards = [
        rooms.Surface("slanted", rooms.rectangle(rng.uniform(0.5, 3, 3) * [1, 1, 0.4], *rng.normal(0, 0.8, (2, 3))))
        for _ in range(2)
    ]
    layout = _layout(*rooms.BOX, door, *boards)
    camera = _turned(rooms.level_camera(rng.uniform([1, 1, 0.5], [3, 3, 2])), *rng.uniform(-1.5, 1.5, 2))
    labels, regions = label_image(layout, camera), visible_regions(layout, camera)
    for label, members in enumerate(segments_of(layout.instances), start=1):
        found = [fill(rings_of(regions[i]), camera.height, camera.width) for i in members]
        np.testing.assert_array_equal(np.any(found, axis=0), labels == label)


def _as_set(lines: Sequence[FloatArray]) -> set[frozenset[tuple[float, float]]]:
    """Straight lines without direction, to a tenth of a pixel."""
    return {frozenset((round(float(x), 1) + 0.0, round(float(y), 1) + 0.0) for x, y in line) for line in lines}


def test_wireframe_of_the_box_room() -> None:
    """Eight contact edges, each one straight segment: round the far wall, and from there to the image's corners."""
    edges = visible_edges(_layout(*rooms.BOX), MIDDLE)
    assert {edge.kind for edge in edges} == {"contact"}
    assert all(len(edge.points_px) == 2 for edge in edges)
    around = [np.array([CORNERS[k], CORNERS[(k + 1) % 4]]) for k in range(4)]
    outward = [np.array([CORNERS[k], IMAGE_CORNERS[k]]) for k in range(4)]
    assert _as_set([edge.points_px for edge in edges]) == _as_set([*around, *outward])
    floor_far = next(edge for edge in edges if edge.segments == (0, 4))
    np.testing.assert_allclose(floor_far.points_px[:, 1], 75, atol=0.05)


def test_nearer_surface_has_an_occlusion_edge_round_it() -> None:
    wall, board = rooms.facing(20, 20, 80, 60), rooms.Surface("wall", rooms.facing(30, 30, 50, 50).corners * 0.5)
    (edge,) = visible_edges(_layout(wall, board), rooms.facing_camera())
    assert edge.kind == "occlusion"
    assert edge.segments == (1, 0), "the nearer one first"
    assert _as_set([edge.points_px]) == _as_set([np.array([[30.0, 30], [50, 30], [50, 50], [30, 50]])])
    np.testing.assert_allclose(edge.points_px[0], edge.points_px[-1], atol=0.05)


def test_contact_and_occlusion_along_one_pair() -> None:
    """A partition from the left wall into the room stands on the floor, and its free end hides the right wall."""
    partition = rooms.Surface("wall", rooms.rectangle([0, 3, 0], [2, 0, 0], [0, 0, 2.5]))
    edges = {edge.segments: edge for edge in visible_edges(_layout(*rooms.BOX, partition), MIDDLE)}
    # At depth 2 its foot lies at y = 50 + 1.25 · 80 / 2 = 100, the image's border; at x = 2 its end is the middle.
    end = edges[(6, 4)]
    assert end.kind == "occlusion"
    np.testing.assert_allclose(end.points_px[:, 0], 80, atol=0.05)
    assert sorted(end.points_px[:, 1]) == pytest.approx([25, 75], abs=0.05)
    further = _layout(*rooms.BOX, rooms.Surface("wall", partition.corners + np.array([0, 1, 0])))
    kinds = {edge.segments: edge.kind for edge in visible_edges(further, MIDDLE)}
    assert kinds[(0, 6)] == kinds[(1, 6)] == kinds[(2, 6)] == "contact"
    assert kinds[(6, 4)] == "occlusion"


@pytest.mark.parametrize(("gap_px", "edges"), [(0.0, 1), (1.5, 1), (6.0, 0)])
def test_narrow_gaps_between_neighbours_are_bridged(gap_px: float, edges: int) -> None:
    left, right = rooms.facing(10, 10, 50 - gap_px / 2, 70), rooms.facing(50 + gap_px / 2, 10, 90, 70)
    found = visible_edges(_layout(left, right), rooms.facing_camera())
    assert len(found) == edges
    for edge in found:
        assert edge.kind == "contact", "coplanar neighbours touch"
        np.testing.assert_allclose(edge.points_px[:, 0], 50, atol=gap_px / 2 + 0.05)


def test_layout_behind_the_camera_and_empty_layout_have_no_edges() -> None:
    behind = rooms.level_camera([2.0, 6.0, 1.25])
    for layout in (_layout(*rooms.BOX), _layout()):
        assert visible_edges(layout, behind) == []
        assert not label_image(layout, behind).any()


def test_picture_shows_the_edges_where_they_are() -> None:
    image = np.full((40, 60, 3), 90, dtype=np.uint8)
    picture = draw_wireframe(image, [Edge((0, 1), "occlusion", np.array([[30.5, 0.5], [30.5, 39.5]]))])
    np.testing.assert_allclose(picture[20, 30], layout2d.COLORS["occlusion"], atol=30)
    assert (picture[20, 29] < 90).all(), "dark rim"
    np.testing.assert_array_equal(picture[:, :26], image[:, :26])


@pytest.fixture
def solved(tiny: Path, edit_json: Edit) -> Path:
    """A scene folder with a layout in ``layout/``: two walls side by side that meet in the middle of frame 0."""
    second = {"id": "e1", "label": "wall", "polygons": [[[32, 0], [64, 0], [64, 48], [32, 48]]], "visible": []}
    edit_json(tiny / "annotations.json", lambda data: [frame["elements"].append(second) for frame in data["frames"]])
    scene = load_scene(tiny)
    # The first camera stands at the origin and looks along -z, 60 px a metre at depth 1.
    walls = [rooms.Surface("wall", rooms.rectangle([x, -2, -3], [5, 0, 0], [0, 4, 0])) for x in (-5, 0)]
    layout = replace(_layout(*walls), instances=rooms.instances_of(walls, 2))
    quality = assess(scene, layout.instances, layout.planes, layout.extents, Config().quality)
    write_results(tiny / "layout", scene, layout, quality, Config())
    return tiny


def _run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, SCRIPT, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_commands_render_and_score(solved: Path) -> None:
    true, predicted, out = solved / "true", solved / "predicted", solved / "out"
    done = _run("render", solved, "--layout", solved / "layout", "--out", true)
    assert (done.returncode, done.stderr) == (0, "")
    files = {f"{k:03d}{end}" for k in (1, 3) for end in (".png", "_wireframe.json", "_wireframe.png")}
    assert {path.name for path in true.iterdir()} == files | {"index.json"}
    index = json.loads((true / "index.json").read_text())
    assert [(e["label"], e["name"], e["class"]) for e in index["segments"]] == [
        (1, "wall_0", "wall"),
        (2, "wall_1", "wall"),
    ]
    labels = cv2.imread(str(true / "001.png"), cv2.IMREAD_UNCHANGED)
    assert labels is not None
    # The camera has moved by 0.1 m: the seam at x = 0 is seen 60 · 0.1 / 3 = 2 px left of the middle.
    np.testing.assert_array_equal(labels, np.where(np.arange(64) < 30, 1, 2)[None].repeat(48, axis=0))
    (edge,) = json.loads((true / "001_wireframe.json").read_text())["edges"]
    assert (edge["labels"], edge["kind"]) == ([1, 2], "contact")
    np.testing.assert_allclose(np.array(edge["points_px"])[:, 0], 30, atol=0.05)

    predicted.mkdir()
    # Another size, other names, in colour; a quarter of the width too far to the right. No prediction of frame 3.
    wrong = np.zeros((96, 128, 3), dtype=np.uint8)
    wrong[:, 60 + 32 :] = (10, 20, 30)
    cv2.imwrite(str(predicted / "001.png"), wrong)
    done = _run("score", true, predicted, "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == (out / "pixel_error.md").read_text()
    found = {label: [metric.value for metric in row] for label, row in read_rows(out / "pixel_error.json").items()}
    assert found == {"001.png": [0.25, 0.0], "003.png": [1.0, 1.0], "mean": [0.625, 0.5]}
    assert (out / "pixel_error.csv").read_text().splitlines()[1] == "001.png,0.25,0.0"


def test_every_frame_on_demand_and_many_scenes_at_once(solved: Path) -> None:
    true = solved / "true"
    for name in ("a", "b"):
        arguments = ["render", str(solved), "--layout", str(solved / "layout"), "--out", str(true / name)]
        assert layout2d.main([*arguments, "--frames", "all"]) == 0
    rows = score_folder(true, true)
    assert list(rows) == [f"{name}/{k:03d}.png" for name in "ab" for k in range(5)]
    assert {metric.value for row in rows.values() for metric in row} == {0.0}


def test_frame_without_any_layout_is_left_out(tmp_path: Path) -> None:
    frames = [{"image": f"{k}.jpg", "labels": f"{k}.png"} for k in range(2)]
    write_json_atomic(tmp_path / "index.json", {"format": layout2d.INDEX_FORMAT, "segments": [], "frames": frames})
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((4, 4), dtype=np.uint8))
    cv2.imwrite(str(tmp_path / "1.png"), np.ones((4, 4), dtype=np.uint8))
    assert list(score_folder(tmp_path, tmp_path)) == ["1.jpg"]
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((4, 4), dtype=np.uint8))
    with pytest.raises(GtlayoutError, match="no frame shows anything"):
        score_folder(tmp_path, tmp_path)


@pytest.mark.parametrize(
    ("spoil", "names"),
    [
        (lambda true: (true / "index.json").unlink(), "index.json"),
        (lambda true: (true / "index.json").write_text('{"format": "x"}'), "index.json"),
        (
            lambda true: (true / "index.json").write_text('{"format": "gtlayout-layout2d/1", "frames": [1]}'),
            "index.json",
        ),
        (lambda true: (true / "001.png").write_bytes(b"no image"), "001.png"),
        (lambda true: (true / "001.png").unlink(), "001.png"),
    ],
    ids=["no index", "other format", "damaged index", "damaged image", "no image"],
)
def test_spoilt_truth_is_one_clear_line(
    solved: Path, capfd: pytest.CaptureFixture[str], spoil: Callable[[Path], object], names: str
) -> None:
    true = solved / "true"
    assert layout2d.main(["render", str(solved), "--layout", str(solved / "layout"), "--out", str(true)]) == 0
    spoil(true)
    assert layout2d.main(["score", str(true), str(true), "--out", str(solved / "out")]) == 1
    message = capfd.readouterr().err
    assert names in message
    assert message.count("\n") == 1
    assert not (solved / "out").exists()


def test_no_prediction_at_all_and_wrong_usage(solved: Path, capfd: pytest.CaptureFixture[str]) -> None:
    true = str(solved / "true")
    assert layout2d.main(["render", str(solved), "--layout", str(solved / "layout"), "--out", true]) == 0
    assert layout2d.main(["score", true, str(solved / "images"), "--out", str(solved / "out")]) == 0
    assert layout2d.main(["score", true, str(solved / "layout"), "--out", str(solved / "out")]) == 1
    assert "holds no prediction" in capfd.readouterr().err
    assert layout2d.main(["score", true]) == 2
    assert layout2d.main(["render", str(solved), "--layout", str(solved), "--out", true]) == 1
    assert "layout.json" in capfd.readouterr().err


def test_frames_that_differ_in_their_suffix_only(solved: Path) -> None:
    scene = load_scene(solved)
    frames = [replace(scene.frames[0], name=name) for name in ("a/0.jpg", "a/0.png")]
    with pytest.raises(GtlayoutError, match=r"several frames are called a/0"):
        layout2d.write_truth(scene, _layout(), frames, solved / "true")


def test_image_of_a_distorting_lens_is_written_too(solved: Path) -> None:
    scene = load_scene(solved)
    frames = [replace(scene.frames[0], undistort=lambda image: image[:, ::-1])]
    layout2d.write_truth(scene, _layout(rooms.facing(0, 0, 10, 10)), frames, solved / "true")
    index = json.loads((solved / "true/index.json").read_text())
    assert index["frames"][0]["undistorted"] == "000_image.png"
    image, original = cv2.imread(str(solved / "true/000_image.png")), cv2.imread(str(solved / "images/000.png"))
    assert image is not None
    assert original is not None
    np.testing.assert_array_equal(image, original[:, ::-1])
