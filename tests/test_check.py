"""What a check finds, each thing put into a scene on purpose, and nothing in scenes that are as they should be."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import shapely
from scipy.spatial.transform import Rotation
from shapely import MultiPolygon
from synth_views import camera_at

from gtlayout.check import contents, suspicions
from gtlayout.check.annotations import annotation_suspicions
from gtlayout.check.cameras import AS_GIVEN, OTHERWISE, camera_suspicions, share_explained
from gtlayout.check.images import Matches, look_through
from gtlayout.check.motion import motion_suspicions
from gtlayout.check.scale import scale_suspicions
from gtlayout.check.shared_errors import shared_error_suspicions
from gtlayout.check.two_views import triangulate_pair
from gtlayout.cli.app import main
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import Camera, FloatArray, KeyFrame, Scene

Edit = Callable[[Path, Callable[[Any], object]], None]


@pytest.fixture(scope="module")
def scene(room: Path) -> Scene:
    return load_scene(room)


@pytest.fixture(scope="module")
def matches(scene: Scene) -> list[Matches]:
    seen = look_through(scene, lambda _done, _total: None)
    assert seen.lines == []
    return seen.matches


@pytest.fixture
def folder(room: Path, tmp_path: Path) -> Path:
    """A copy of the room to break."""
    return Path(shutil.copytree(room, tmp_path / "scene"))


def with_cameras(scene: Scene, change: Callable[[int, Camera], Camera]) -> Scene:
    frames = tuple(replace(frame, camera=change(i, frame.camera)) for i, frame in enumerate(scene.frames))
    return replace(scene, frames=frames)


def scaled(scene: Scene, factor: float) -> Scene:
    return with_cameras(scene, lambda _, c: replace(c, t_cam_from_world=factor * c.t_cam_from_world))


def cam_from_world(camera: Camera) -> FloatArray:
    """(4, 4)"""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = camera.R_cam_from_world, camera.t_cam_from_world
    return matrix


def posed(camera: Camera, matrix: FloatArray) -> Camera:
    return replace(camera, R_cam_from_world=matrix[:3, :3], t_cam_from_world=matrix[:3, 3])


def with_key_frame(scene: Scene, change: Callable[[KeyFrame], KeyFrame]) -> Scene:
    """The first key frame changed."""
    first, *others = scene.key_frames
    return replace(scene, key_frames=(change(first), *others))


# --- nothing where nothing is


def test_clean_scenes_are_clean(scene: Scene, matches: list[Matches], real_clip: Path) -> None:
    # What a person left blank there is a gap, and rightly named.
    assert [line for line in suspicions(load_scene(real_clip)) if ": gap of " not in line] == []
    assert annotation_suspicions(scene) == []
    for check in (camera_suspicions, scale_suspicions, motion_suspicions):
        assert check(scene, matches) == []


def test_readers_warnings_come_first(scene: Scene) -> None:
    assert suspicions(replace(scene, warnings=("said before",))) == ["said before"]


# --- two views


def test_points_of_matches_are_where_they_are() -> None:
    source, target = (
        camera_at(np.zeros(3), np.array([0.0, 1, 0])),
        camera_at(np.array([0.3, 0.1, 0]), np.array([0.1, 1, 0])),
    )
    depths = np.array([2.0, 3.0, 5.0, -4.0])
    source_px = np.array([[90.0, 60], [110, 80], [100, 40], [80, 90]])
    points_world = source.center_world + depths[:, None] * source.rays_world(source_px)
    pair = Matches(0, 1, source_px, target.project(points_world)[0])
    errors_px, rho = triangulate_pair(pair, source, target)
    assert errors_px[:3] == pytest.approx(0, abs=1e-9)
    assert 1 / rho[:3] == pytest.approx(depths[:3])
    # A point behind the camera is as far off as its nearest point in front: at infinity.
    assert rho[3] == 0
    infinity_px, _ = target.project(1e9 * source.rays_world(source_px[3:]))
    assert errors_px[3] == pytest.approx(np.linalg.norm(infinity_px[0] - pair.target_px[3]), rel=1e-6)
    assert errors_px[3] > 5


# --- cameras


AXES = np.diag([1.0, -1, -1, 1])


@pytest.mark.parametrize(
    ("misread", "says"),
    [
        (lambda m: AXES @ m, "only with camera axes of the other kind"),
        (np.linalg.inv, "only with poses the other way round"),
        (lambda m: np.linalg.inv(AXES @ m), "only with poses the other way round"),
        (lambda m: AXES @ np.linalg.inv(m), "only with poses the other way round"),
    ],
)
def test_misread_poses(
    scene: Scene, matches: list[Matches], misread: Callable[[FloatArray], FloatArray], says: str
) -> None:
    wrong = with_cameras(scene, lambda _, c: posed(c, misread(cam_from_world(c))))
    (line,) = camera_suspicions(wrong, matches)
    assert says in line
    assert suspicions(wrong) == [line], "nothing is said about unit and motion of cameras that are wrong"


def test_right_poses_stand_out(scene: Scene, matches: list[Matches]) -> None:
    assert share_explained(scene, matches, AS_GIVEN) > 0.9
    assert max(share_explained(scene, matches, way) for way in OTHERWISE) < 0.4


def test_timestamps_off(scene: Scene, matches: list[Matches]) -> None:
    late = with_cameras(scene, lambda i, _: scene.frames[max(i - 2, 0)].camera)
    (line,) = camera_suspicions(late, matches)
    assert "with the poses of 2 frame(s) later" in line


def test_poses_of_other_images(scene: Scene, matches: list[Matches]) -> None:
    order = np.random.default_rng(0).permutation(len(scene.frames))
    (line,) = camera_suspicions(with_cameras(scene, lambda i, _: scene.frames[order[i]].camera), matches)
    assert "do not fit the images" in line


def test_wrong_focal_length(scene: Scene, matches: list[Matches]) -> None:
    (line,) = camera_suspicions(with_cameras(scene, lambda _, c: replace(c, K=c.K @ np.diag([1.5, 1.5, 1]))), matches)
    assert "a focal length about 0.7 times as long" in line


def test_slightly_wrong_focal_length_is_named_with_its_number(scene: Scene, matches: list[Matches]) -> None:
    def lengthened(_: int, camera: Camera) -> Camera:
        return replace(camera, K=camera.K * np.array([[1.05, 1, 1], [1, 1.05, 1], [1, 1, 1]]))

    assert shared_error_suspicions(scene, matches) == []
    (line,) = shared_error_suspicions(with_cameras(scene, lengthened), matches)
    given_px = 1.05 * scene.frames[0].camera.K[0, 0]
    said = re.fullmatch(rf"focal length (.*)% too long: {given_px:.0f} instead of (\d+) ± (\d+) px", line)
    assert said is not None
    share, right_px, sigma_px = (float(figure) for figure in said.groups())
    assert share == pytest.approx(100 * (given_px / right_px - 1), abs=0.3)
    assert abs(right_px - given_px / 1.05) <= 2 * sigma_px + 1


def test_points_on_the_way_are_where_they_are(scene: Scene, matches: list[Matches]) -> None:
    for m in matches:
        assert [frame for frame, _ in m.between] == list(range(m.source + 1, m.target))
        for frame, points_px in m.between:
            step = Matches(m.source, frame, m.source_px, points_px)
            errors_px, _ = triangulate_pair(step, scene.frames[m.source].camera, scene.frames[frame].camera)
            assert np.median(errors_px) < 0.5


# --- unit


@pytest.mark.parametrize(("factor", "unit"), [(1000, "looks like millimetres"), (100, "looks like centimetres")])
def test_metres_that_are_none(scene: Scene, matches: list[Matches], factor: float, unit: str) -> None:
    unit_line, depth_line = scale_suspicions(scaled(scene, factor), matches)
    assert unit in unit_line
    told = float(depth_line.split("1/")[1].split()[0])
    assert told == pytest.approx(factor, rel=0.05)


def test_tiny_rooms(scene: Scene, matches: list[Matches]) -> None:
    lines = scale_suspicions(scaled(scene, 0.001), matches)
    assert "no room is that size" in lines[0]


def test_feet_show_against_depth_maps_only(scene: Scene, matches: list[Matches]) -> None:
    feet = scaled(scene, 1 / 0.3048)
    (line,) = scale_suspicions(feet, matches)
    assert "depth maps and cameras disagree" in line
    bare = replace(feet, frames=tuple(replace(frame, depth_path=None) for frame in feet.frames))
    assert scale_suspicions(bare, matches) == []


def test_scenes_without_unit_have_any_depth(scene: Scene, matches: list[Matches]) -> None:
    frames = tuple(replace(frame, depth_path=None) for frame in scene.frames)
    assert scale_suspicions(scaled(replace(scene, frames=frames, metric=False), 1000), matches) == []


def test_unreadable_depth_map(folder: Path, matches: list[Matches]) -> None:
    broken = load_scene(folder)
    path = broken.frame_of(1).depth_path
    assert path is not None
    path.write_bytes(b"nothing")
    (line,) = scale_suspicions(broken, matches)
    assert str(path) in line


# --- motion


def test_camera_that_stands_still(scene: Scene, matches: list[Matches]) -> None:
    first = scene.frames[0].camera.center_world
    still = with_cameras(scene, lambda _, c: replace(c, t_cam_from_world=-c.R_cam_from_world @ first))
    (line,) = motion_suspicions(still, matches)
    assert "too little motion round all key frames" in line
    assert scale_suspicions(still, matches) == []


def test_jump_and_lonely_key_frame(scene: Scene, matches: list[Matches]) -> None:
    away = Rotation.from_euler("z", 120, degrees=True).as_matrix()

    def turned(camera: Camera) -> Camera:
        """As in a world turned about the vertical: neighbours that are turned alike fit each other as before."""
        return replace(camera, R_cam_from_world=camera.R_cam_from_world @ away)

    key = scene.key_frames[1].frame
    (cut,) = motion_suspicions(with_cameras(scene, lambda i, c: turned(c) if i > key else c), matches)
    assert f"first {scene.frames[key].name} to {scene.frames[key + 1].name}" in cut
    assert cut.startswith("1 of 23 steps")
    jumps, alone = motion_suspicions(with_cameras(scene, lambda i, c: turned(c) if i == key else c), matches)
    assert jumps.startswith("2 of 23 steps")
    assert f"no frame next to {scene.frames[key].name} shows the same" in alone


def test_points_that_cannot_be_followed(tiny: Path) -> None:
    lines = suspicions(load_scene(tiny))
    assert any("points could be followed to the next frame from 0 of" in line for line in lines)
    assert any(line.startswith("2 key frame(s) only") for line in lines)


# --- images


def write(path: Path, image: npt.NDArray[np.uint8]) -> None:
    assert cv2.imwrite(str(path), image)


def test_every_bad_image_is_listed(folder: Path) -> None:
    scene = load_scene(folder)
    key = scene.key_frames[1].frame
    damaged, resized, dark = scene.frames[key + 1], scene.frames[key + 2], scene.frames[key]
    stopped = [scene.frames[i] for i in (20, 21, 22)]
    damaged.image_path.write_bytes(damaged.image_path.read_bytes()[:100])
    write(resized.image_path, np.full((120, 160, 3), 100, dtype=np.uint8))
    write(dark.image_path, np.zeros((240, 320, 3), dtype=np.uint8))
    for frame in stopped[1:]:
        shutil.copy(stopped[0].image_path, frame.image_path)
    done: list[tuple[int, int]] = []
    lines = look_through(scene, lambda *step: done.append(step)).lines
    assert done == [(i, 24) for i in range(25)]
    expected = [
        f"{dark.name}: annotated, but nearly black",
        f"cannot read image {damaged.image_path}: damaged, or not an image; the frame is stepped over",
        f"{resized.image_path}: 160x120 px, its camera says 320x240; the frame is stepped over",
        f"{stopped[0].name} to {stopped[2].name}: 3 files hold the same picture",
    ]
    assert len(lines) == len(expected)
    assert all(line.startswith(start) for line, start in zip(lines, expected, strict=True)), lines


def test_damaged_key_frame_has_to_be_mended(folder: Path) -> None:
    scene = load_scene(folder)
    scene.frame_of(1).image_path.write_bytes(b"")
    (line,) = look_through(scene, lambda _done, _total: None).lines
    assert line.endswith("it is annotated: mend it")


def test_images_of_two_cameras_in_turn_are_followed_each(folder: Path) -> None:
    """A smaller image between two others ends no track."""
    scene = load_scene(folder)
    for frame in scene.frames[1::2]:
        image = cv2.imread(str(frame.image_path))
        assert image is not None
        write(frame.image_path, np.ascontiguousarray(image[:200, :300], dtype=np.uint8))
    scene = with_cameras(scene, lambda i, c: replace(c, width=300, height=200) if i % 2 else c)
    seen = look_through(scene, lambda _done, _total: None)
    assert seen.lines == []
    assert camera_suspicions(scene, seen.matches) == []


# --- annotations


def test_elements_drawn_twice(scene: Scene) -> None:
    wall = next(e for e in scene.key_frames[0].elements if e.label == "wall")
    again = replace(wall, id="again")
    (line,) = annotation_suspicions(with_key_frame(scene, lambda k: replace(k, elements=(*k.elements, again))))
    assert line == f"{scene.frame_of(0).name}: wall {wall.id} and wall again are almost the same polygon: delete one"
    left, top, right, bottom = wall.amodal.bounds
    half = MultiPolygon([shapely.box((left + right) / 2, top, right, bottom)]) & wall.amodal
    part = replace(again, amodal=MultiPolygon(shapely.get_parts(half).tolist()), visible=MultiPolygon())
    (line,) = annotation_suspicions(with_key_frame(scene, lambda k: replace(k, elements=(*k.elements, part))))
    assert "and wall again overlap by 100% of the smaller" in line
    window = replace(part, label="window")
    assert annotation_suspicions(with_key_frame(scene, lambda k: replace(k, elements=(*k.elements, window)))) == []


def test_visible_part_of_another_element(scene: Scene) -> None:
    def swap(key_frame: KeyFrame) -> KeyFrame:
        a, b = (i for i, e in enumerate(key_frame.elements) if e.label in ("floor", "ceiling"))
        elements = list(key_frame.elements)
        elements[a] = replace(elements[a], visible=key_frame.elements[b].visible)
        return replace(key_frame, elements=tuple(elements))

    (line,) = annotation_suspicions(with_key_frame(scene, swap))
    assert "100% of its visible part lies outside of it" in line


def test_key_frame_without_visible_parts(scene: Scene) -> None:
    def blind(key_frame: KeyFrame) -> KeyFrame:
        return replace(key_frame, elements=tuple(replace(e, visible=MultiPolygon()) for e in key_frame.elements))

    assert annotation_suspicions(with_key_frame(scene, blind)) == [
        f"{scene.frame_of(0).name}: no visible part drawn, so points on furniture are tracked, too"
    ]
    all_blind = replace(scene, key_frames=tuple(map(blind, scene.key_frames)))
    assert annotation_suspicions(all_blind) == [], "the reader has said so"


def test_occlusion_edge_along_nothing(scene: Scene) -> None:
    largest = max(scene.key_frames[0].elements, key=lambda e: e.amodal.area)
    middle = shapely.maximum_inscribed_circle(largest.amodal)
    (x, y), half = shapely.get_coordinates(middle)[0], middle.length / 2
    stray = np.array([[x - half, y], [x + half, y]])
    (line,) = annotation_suspicions(with_key_frame(scene, lambda k: replace(k, occlusion_edges=(stray,))))
    assert "more than 10 px from every outline" in line
    outline = shapely.get_coordinates(largest.amodal.geoms[0].exterior)
    along = with_key_frame(scene, lambda k: replace(k, occlusion_edges=(outline + 3.0,)))
    assert annotation_suspicions(along) == []


def test_few_key_frames(scene: Scene) -> None:
    (line,) = annotation_suspicions(replace(scene, key_frames=scene.key_frames[:2]))
    assert line.startswith("2 key frame(s) only")


# --- the command


def listing(folder: Path) -> dict[str, tuple[int, str]]:
    """When each file was changed and what is in it."""
    return {
        str(path): (path.stat().st_mtime_ns, hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "")
        for path in (folder, *sorted(folder.rglob("*")))
    }


def test_clean_room_exits_with_0_and_stays_as_it_was(room: Path, capfd: pytest.CaptureFixture[str]) -> None:
    before = listing(room)
    assert main(["check", str(room)]) == 0
    printed = capfd.readouterr()
    count = sum(len(frame["elements"]) for frame in json.loads((room / "annotations.json").read_text())["frames"])
    frames = len(json.loads((room / "annotations.json").read_text())["frames"])
    assert printed.out.splitlines() == [
        f"nothing suspicious: 24 frames, {frames} key frames, {count} elements, metric",
        f"next: gtlayout solve {room}",
    ]
    assert printed.err == ""
    assert listing(room) == before


def test_suspicious_room_exits_with_3(folder: Path, edit_json: Edit, capfd: pytest.CaptureFixture[str]) -> None:
    """OpenCV's axes in a file that should have OpenGL's, and a label nobody knows."""

    def turn(data: Any) -> None:
        for frame in data["frames"]:
            frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ AXES).tolist()

    edit_json(folder / "transforms.json", turn)
    edit_json(folder / "annotations.json", lambda data: data["frames"][0]["elements"][0].update(label="sky"))
    before = listing(folder)
    assert main(["check", str(folder)]) == 3
    lines = capfd.readouterr().out.splitlines()
    assert "'sky'" in lines[0]
    assert "only with camera axes of the other kind (OpenGL: x right, y up, z back" in lines[1]
    assert lines[2].startswith("000000.jpg: gap of ")  # where the one that nobody knows was drawn
    assert lines[3].startswith("3 warnings: 24 frames")
    assert listing(folder) == before


def test_unusable_room_exits_with_1(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "transforms.json").write_text("{")
    before = listing(folder)
    assert main(["check", str(folder)]) == 1
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"gtlayout: {folder / 'transforms.json'}")
    assert printed.err.count("\n") == 1
    assert listing(folder) == before


def test_lenses_that_images_are_undistorted_from_are_named(tiny: Path) -> None:
    scene = load_scene(tiny)
    assert "undistorted" not in contents(scene)
    camera = scene.frames[0].camera
    lens = Undistortion("OPENCV_FISHEYE", camera.width, camera.height, (80.0, 80.0, 50.0, 40.0, 0.01, 0.0, 0.0, 0.0))
    frames = tuple(replace(frame, undistort=lens) for frame in scene.frames)
    assert contents(replace(scene, frames=frames)).endswith(", undistorted from OPENCV_FISHEYE")
