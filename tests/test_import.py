"""``gtlayout import`` run for real: what it writes solves like what it read; what cannot be read leaves nothing."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from videos import cvat_video, write_video

from gtlayout.cli.app import main
from gtlayout.importing import importing
from gtlayout.io.annotations.cvat.writer import write_cvat
from gtlayout.io.cameras.colmap.reader import write_colmap
from gtlayout.io.pixels.images import read_depth, read_gray, read_rgb
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.method import solve
from gtlayout.scene import LABELS, scaled
from gtlayout.solution import Solution
from gtlayout.synth import SynthConfig, synthesize


def _import(*arguments: Path | str) -> int:
    return main(["import", *map(str, arguments)])


def _planes(solution: Solution) -> list[tuple[str, list[float]]]:
    layout = solution.layout
    named = zip(layout.instances, layout.planes, strict=True)
    return [(instance.name, [*plane.normal.tolist(), plane.d]) for instance, plane in named]


def test_a_scene_in_parts_becomes_one(room: Path, room_solution: Solution, tmp_path: Path) -> None:
    """COLMAP cameras, annotations of another tool that lie elsewhere, labels in other words."""
    scene = load_scene(room)
    source, elsewhere = tmp_path / "source", tmp_path / "elsewhere"
    shutil.copytree(room / "images", source / "images")
    write_colmap(source / "sparse/0", scene.frames, binary=True)
    elsewhere.mkdir()
    write_cvat(elsewhere / "job.xml", scene.frames, scene.key_frames)
    text = (elsewhere / "job.xml").read_text()
    (elsewhere / "job.xml").write_text(text.replace('"wall"', '"Wand 2"'))
    (elsewhere / "labels.json").write_text('{"Wand": "wall"}')
    assert _import(source, tmp_path / "out", "--annotations", elsewhere / "job.xml") == 0
    imported = load_scene(tmp_path / "out")
    assert imported.warnings == ()
    assert not imported.metric
    assert [p.name for p in sorted((tmp_path / "out").iterdir())] == [
        "annotations.json", "images", "scene.json", "transforms.json",
    ]  # fmt: skip
    expected = dict(_planes(room_solution))
    for name, plane in _planes(solve(imported)):
        np.testing.assert_allclose(plane, expected[name], atol=2e-3)  # CVAT keeps two decimals of a pixel
    for before, after in zip(scene.frames, imported.frames, strict=True):
        assert before.image_path.read_bytes() == after.image_path.read_bytes()


def test_depth_truth_and_unit_come_along(
    room: Path, room_solution: Solution, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert _import(room, tmp_path / "out") == 0
    assert capfd.readouterr().out.startswith(f"Scene: {tmp_path / 'out'}\nnext: gtlayout ")
    before, after = load_scene(room), load_scene(tmp_path / "out")
    assert after.metric
    for (name, plane), (other_name, other) in zip(_planes(room_solution), _planes(solve(after)), strict=True):
        assert name == other_name
        np.testing.assert_allclose(plane, other, atol=1e-9)
    truths = [read_truth(scene) for scene in (before, after)]
    assert truths[0] is not None
    assert truths[1] is not None
    assert truths[0].elements == truths[1].elements
    depths = [[read_depth(f) for f in scene.frames if f.depth_path is not None] for scene in (before, after)]
    np.testing.assert_array_equal(np.array(depths[0]), np.array(depths[1]))


@pytest.fixture
def distorted(room: Path, tmp_path: Path) -> Path:
    """The room as if a lens with distortion had seen it."""
    source = tmp_path / "source"
    shutil.copytree(room / "images", source / "images")
    write_colmap(source / "sparse/0", load_scene(room).frames)
    model = pycolmap.Reconstruction(source / "sparse/0")
    for camera in model.cameras.values():
        fx, _, cx, cy = camera.params
        camera.model = pycolmap.CameraModelId.SIMPLE_RADIAL
        camera.params = [fx, cx, cy, -0.08]
    model.write_text(source / "sparse/0")
    shutil.copy(room / "annotations.json", source)
    return source


def test_a_frame_that_cannot_be_read_costs_only_itself(
    distorted: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    before = load_scene(distorted)
    key = before.key_frames[1].frame
    before.frames[key].image_path.write_bytes(b"broken")
    before.frames[key + 1].image_path.write_bytes(b"")
    assert _import(distorted, tmp_path / "out") == 0
    assert capfd.readouterr().out.count(": left out") == 2
    after = load_scene(tmp_path / "out")
    assert [f.name for f in after.frames] == [f.name for i, f in enumerate(before.frames) if i - key not in (0, 1)]
    names = [before.frame_of(k).name for k in range(len(before.key_frames)) if k != 1]
    assert [after.frame_of(k).name for k in range(len(after.key_frames))] == names


def test_distortion_is_removed(distorted: Path, tmp_path: Path) -> None:
    source = distorted
    assert _import(source, tmp_path / "out") == 0
    before, after = load_scene(source), load_scene(tmp_path / "out")
    for one, other in zip(before.frames, after.frames, strict=True):
        assert one.undistort is not None
        assert other.undistort is None
        np.testing.assert_allclose(other.camera.K, one.camera.K, atol=1e-9)
        difference = read_gray(one).astype(np.int64) - read_gray(other)
        assert np.abs(difference).mean() < 1.5  # JPEG, once more
    for key, other_key in zip(before.key_frames, after.key_frames, strict=True):
        for element, other_element in zip(key.elements, other_key.elements, strict=True):
            assert (element.amodal ^ other_element.amodal).area < 1e-6 * element.amodal.area + 1e-6


def test_without_annotations_it_says_what_to_do(room: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "source"
    shutil.copytree(room, source)
    (source / "annotations.json").unlink()
    assert _import(source, tmp_path / "out") == 0
    assert f"not annotated yet: annotate images in {tmp_path / 'out/images'}" in capfd.readouterr().out
    assert not (tmp_path / "out/annotations.json").exists()
    assert main(["solve", str(tmp_path / "out")]) == 1
    assert "no annotations in" in capfd.readouterr().err


@pytest.fixture(scope="module")
def unit_less(room: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The room in units of 2.5 m, as a COLMAP model with points; ``depth`` beside it in millimetres."""
    folder = tmp_path_factory.mktemp("unit") / "scene"
    scene = scaled(load_scene(room), 1 / 2.5)
    frames = tuple(replace(frame, depth_path=None) for frame in scene.frames)
    write_scene(replace(scene, frames=frames, metric=False), folder, "colmap", "native")
    (folder / "gt_planes.json").unlink()
    model = pycolmap.Reconstruction(folder / "sparse/0")
    in_metres = load_scene(room)
    rng = np.random.default_rng(0)
    for image in model.images.values():
        frame, small = in_metres.frames[image.image_id - 1], scene.frames[image.image_id - 1]
        if frame.depth_path is None:
            continue
        depth = read_depth(frame)
        v, u = rng.integers(5, depth.shape[0] - 5, 60), rng.integers(5, depth.shape[1] - 5, 60)
        points_px = np.column_stack([u, v]) + 0.5
        world = small.camera.center_world + depth[v, u, None] / 2.5 * small.camera.rays_world(points_px)
        image.points2D = [pycolmap.Point2D(point) for point in points_px]
        for i, point in enumerate(world):
            if np.isfinite(point).all():
                track = pycolmap.Track([pycolmap.TrackElement(image.image_id, i)])
                model.add_point3D(point, track, np.zeros(3, dtype=np.uint8))
    model.write_text(folder / "sparse/0")
    shutil.copytree(room / "depth", folder.parent / "depth")
    return folder


def test_depth_maps_give_the_unit(
    unit_less: Path, room: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert not load_scene(unit_less).metric
    assert _import(unit_less, tmp_path / "out", "--depth-scale", unit_less.parent / "depth") == 0
    assert "metric by" in (said := capfd.readouterr().out)
    assert "1 unit = 2.5" in said
    imported, truth = load_scene(tmp_path / "out"), load_scene(room)
    assert imported.metric
    baselines = [
        np.linalg.norm(s.frames[-1].camera.center_world - s.frames[0].camera.center_world) for s in (imported, truth)
    ]
    assert baselines[0] == pytest.approx(baselines[1], rel=0.01)


def test_a_known_distance_gives_the_unit(unit_less: Path, room: Path, tmp_path: Path) -> None:
    scene = load_scene(room)
    key = scene.frames[scene.key_frames[1].frame]
    depth = read_depth(key)
    corners_px = np.array([[40.5, 60.5], [280.5, 200.5]])
    points = key.camera.center_world + depth[[60, 200], [40, 280], None] * key.camera.rays_world(corners_px)
    seen = [(f.name, f.camera.project(points)[0]) for f in scene.frames]
    marks = [
        {name: px[i].round(1).tolist() for name, px in seen if 0 < px[i, 0] < 320 and 0 < px[i, 1] < 240}
        for i in (0, 1)
    ]
    file = tmp_path / "door.json"
    file.write_text(json.dumps({"metres": float(np.linalg.norm(points[1] - points[0])), "points": marks}))
    assert _import(unit_less, tmp_path / "out", "--known-distance", file) == 0
    imported = load_scene(tmp_path / "out")
    np.testing.assert_allclose(
        [f.camera.center_world for f in imported.frames], [f.camera.center_world for f in scene.frames], atol=0.02
    )


def test_a_video_gets_its_cameras(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    synthesize(tmp_path / "room", SynthConfig(frames=16, width=320, height=240, seed=1))
    frames = load_scene(tmp_path / "room").frames
    images = [cv2.cvtColor(read_rgb(frame), cv2.COLOR_RGB2BGR).astype(np.uint8) for frame in frames]
    video = write_video(tmp_path / "clip.mp4", images, options={"crf": "12"})
    # COLMAP's threads: once, on a busy machine, it found no model of these frames, and did when asked again.
    tries = (_import(video, tmp_path / "out", "--colmap", "--rate", "30") for _ in range(2))
    assert 0 in tries
    said = capfd.readouterr().out
    assert "16 of 16 frames registered, reprojection error 0." in said
    assert "not annotated yet" in said
    scene = load_scene(tmp_path / "out", annotated=False)
    assert len(scene.frames) == 16
    assert all(frame.undistort is None for frame in scene.frames)
    assert not scene.metric
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []
    names = [line for line in (tmp_path / "out/key_frames.txt").read_text().splitlines() if not line.startswith("#")]
    assert len(names) == 8
    assert set(names) <= {frame.name for frame in scene.frames}
    # Drawn on the video itself, by CVAT's numbers: on the rays that the truth has there.
    number, drawn_px = 9, np.array([[60.0, 50.0], [250.0, 60.0], [240.0, 190.0], [70.0, 180.0]])
    (tmp_path / "out/annotations.xml").write_text(cvat_video({number: drawn_px}, (320, 240), 16))
    annotated = load_scene(tmp_path / "out")
    (key,) = annotated.key_frames
    frame = annotated.frames[key.frame]
    assert frame.origin is not None
    assert frame.origin.number == number
    corners = np.array(key.elements[0].amodal.geoms[0].exterior.coords)[:-1]
    found = frame.camera.rays_world(corners) @ frame.camera.R_cam_from_world.T
    true = frames[number].camera.rays_world(drawn_px) @ frames[number].camera.R_cam_from_world.T
    # COLMAP's focal length is not the true one: the rays' directions agree up to it.
    zoom = frame.camera.K[0, 0] / frames[number].camera.K[0, 0]
    off_px = np.linalg.norm(found[:, None, :2] * zoom - true[None, :, :2], axis=2).min(axis=0) * frame.camera.K[0, 0]
    assert off_px.max() < 3


@pytest.mark.parametrize(
    ("break_it", "flags", "says"),
    [
        (shutil.rmtree, (), "no folder or video"),
        (lambda root: (root / "transforms.json").unlink(), (), "no cameras in"),
        (lambda root: (root / "annotations.json").write_text("{"), (), "annotations.json is not valid JSON"),
        (lambda root: None, ("--annotations", "nowhere.xml"), "no annotations nowhere.xml"),
        (lambda root: None, ("--depth-scale", "a.png"), "use --colmap"),
        (lambda root: None, ("--depth-scale", "a.png", "--known-distance", "a.json"), "not from both"),
        (lambda root: None, ("--known-distance", "nowhere.json"), "cannot read nowhere.json"),
    ],
)
def test_what_cannot_be_read_leaves_nothing(
    tiny: Path, capfd: pytest.CaptureFixture[str], break_it: Callable[[Path], None], flags: tuple[str, ...], says: str
) -> None:
    root = tiny / "source"
    root.mkdir()
    for path in [*tiny.iterdir()]:
        if path != root:
            path.rename(root / path.name)
    break_it(root)
    assert _import(root, tiny / "out", *flags) == 1
    printed = capfd.readouterr().err
    assert says in printed
    assert printed.count("\n") == 1
    assert [p.name for p in tiny.iterdir() if p != root] == []


def test_a_video_needs_cameras(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "clip.mp4").write_bytes(b"no video")
    assert _import(tmp_path / "clip.mp4", tmp_path / "out") == 1
    assert "has no cameras: add --colmap" in capfd.readouterr().err
    assert _import(tmp_path / "clip.mp4", tmp_path / "out", "--colmap") == 1
    assert "clip.mp4" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("of_video", [False, True])
def test_bad_annotations_are_refused_before_colmap_runs(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], of_video: bool
) -> None:
    def runs(*_arguments: object) -> None:
        raise AssertionError("COLMAP runs, or frames are extracted")

    monkeypatch.setattr(importing, "reconstruct", runs)
    monkeypatch.setattr(importing, "extract_frames", runs)
    source = tiny
    (tiny / "notes.xml").write_text("<notes/>")
    bad = tiny / "notes.xml"
    if of_video:
        source = tmp_path / "video.mp4"
        source.write_bytes(b"never opened")
    for named, says in ((bad, "notes.xml is no file of a known tool"), ("nowhere.zip", "no annotations nowhere.zip")):
        assert _import(source, tmp_path / "out", "--colmap", "--annotations", named) == 1
        assert says in capfd.readouterr().err
        assert not (tmp_path / "out").exists()


def test_a_rate_is_for_a_video_and_colmap(tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    video = write_video(tmp_path / "clip.mp4", [np.zeros((48, 64, 3), dtype=np.uint8)] * 3)
    assert _import(video, tmp_path / "out", "--rate", "5") == 1
    assert "--rate is how many frames a second --colmap takes from a video: add --colmap" in capfd.readouterr().err
    assert _import(tiny, tmp_path / "out", "--rate", "5", "--colmap") == 1
    assert f"to take from a video, and {tiny} is a folder" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_video_without_cameras_is_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    video = write_video(tmp_path / "dark.mp4", [np.zeros((48, 64, 3), dtype=np.uint8)] * 4)
    assert _import(video, tmp_path / "out", "--colmap", "--rate", "30") == 1
    assert f"gtlayout: {video}: no cameras found: hardly any detail" in capfd.readouterr().err


def test_frames_that_a_file_annotates_are_taken_from_the_video(room: Path, tmp_path: Path) -> None:
    images = [cv2.cvtColor(read_rgb(frame), cv2.COLOR_RGB2BGR).astype(np.uint8) for frame in load_scene(room).frames]
    video = write_video(tmp_path / "clip.mp4", images, options={"crf": "12"})
    square = np.array([[60.0, 50.0], [250.0, 60.0], [240.0, 190.0], [70.0, 180.0]])
    (tmp_path / "task.xml").write_text(cvat_video({5: square, 14: square}, (320, 240), len(images)))
    flags = ("--colmap", "--rate", "12", "--focal", "250", "--annotations", str(tmp_path / "task.xml"))
    assert _import(video, tmp_path / "out", *flags) == 0
    scene = load_scene(tmp_path / "out")
    assert [scene.frame_of(k).origin.number for k in range(len(scene.key_frames))] == [5, 14]  # type: ignore[union-attr]
    assert not (tmp_path / "out/key_frames.txt").exists()


def test_nothing_is_overwritten(tiny: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert _import(tiny, tiny / "images") == 1
    assert "exists and is not an empty folder" in capfd.readouterr().err


@pytest.mark.parametrize("tool", ["cvat", "label-studio"])
def test_label_configurations_are_printed(tool: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "--label-config", tool]) == 0
    said = capfd.readouterr().out
    assert all(f'"{label}"' in said for label in (*LABELS, "visible", "blank", "occlusion_edge"))


def test_source_and_target_are_needed(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["import"]) == 2
    assert main(["import", "only-one"]) == 2
    assert "SRC and OUT are needed" in capfd.readouterr().err
