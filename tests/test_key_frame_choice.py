"""Which frames ``import`` says to annotate, and the files that say it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from videos import pictures

from gtlayout.cli.app import main
from gtlayout.geometry.overlap import overlap, share_seen
from gtlayout.importing.key_frame_choice import COUNT, MIN_OVERLAP, MOST, SECOND_OVERLAP, Choice, choose_key_frames
from gtlayout.importing.key_frame_files import contact_sheet
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import Camera, FloatArray, Frame, Scene, VideoOrigin

WIDTH, HEIGHT, FOCAL = 160, 96, 100.0
K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])


def turned(yaw_deg: float, x: float = 0.0) -> Camera:
    """A camera at x that looks along z, turned to the right."""
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    R = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    return Camera(K, R, -R @ np.array([x, 0, 0.0]), WIDTH, HEIGHT)


def scene_of(folder: Path, cameras: list[Camera], blurred: frozenset[int] = frozenset()) -> Scene:
    """One image for all frames, except those blurred."""
    folder.mkdir(exist_ok=True)
    sharp = pictures(1)[0]
    soft = cv2.GaussianBlur(sharp, (0, 0), 3)
    frames = []
    for i, camera in enumerate(cameras):
        path = folder / f"{i:03d}.png"
        cv2.imwrite(str(path), soft if i in blurred else sharp)
        frames.append(Frame(path.name, path, camera))
    return Scene(folder, tuple(frames), (), metric=True)


def test_the_path_is_covered_evenly_and_the_second_overlaps_the_first(tmp_path: Path) -> None:
    # Stands still for half of the frames, then turns by 210°.
    yaws = [0.0] * 60 + list(np.linspace(0, 210, 60))
    scene = scene_of(tmp_path, [turned(yaw) for yaw in yaws])
    chosen = choose_key_frames(scene, {})
    assert COUNT <= len(chosen) <= MOST
    indices = [each.frame for each in chosen]
    assert indices == sorted(set(indices))
    at = [yaws[index] for index in indices]
    assert at[0] < 15
    assert at[-1] > 195
    assert sum(yaw == 0 for yaw in at) <= 2  # not half of them, as there are frames
    steps = np.diff(at)[1:]
    assert steps.max() < 2 * steps.mean()
    assert chosen[0].shared is None
    assert chosen[1].shared is not None
    assert chosen[1].shared >= SECOND_OVERLAP
    assert all(each.shared is not None and each.shared >= MIN_OVERLAP for each in chosen[1:])


def test_more_are_taken_where_eight_would_not_overlap(tmp_path: Path) -> None:
    def chosen(degrees: float) -> list[Choice]:
        blurred = frozenset(i for i in range(80) if i % 5)
        cameras = [turned(yaw) for yaw in np.linspace(0, degrees, 80)]
        return choose_key_frames(scene_of(tmp_path, cameras, blurred), {})

    assert len(chosen(90)) == COUNT
    far = chosen(400)
    assert COUNT < len(far) <= MOST
    assert far[1].shared is not None
    assert far[2].shared is not None
    assert far[2].shared < SECOND_OVERLAP <= far[1].shared


def test_the_sharpest_around_a_place_is_taken(tmp_path: Path) -> None:
    cameras = [turned(0, x) for x in np.linspace(0, 3, 80)]
    blurred = frozenset(i for i in range(80) if i % 4 != 1)
    chosen = choose_key_frames(scene_of(tmp_path, cameras, blurred), {})
    assert all(each.frame % 4 == 1 for each in chosen), [each.frame for each in chosen]
    assert all(each.sharpest_of > 1 for each in chosen)


def test_points_say_what_two_frames_share(tmp_path: Path) -> None:
    cameras = [turned(0, 0.1 * i) for i in range(4)]
    scene = replace(scene_of(tmp_path, cameras), metric=False)
    near = np.array([[x, y, 0.2] for x in np.linspace(-0.1, 0.1, 6) for y in np.linspace(-0.05, 0.05, 6)])
    points: dict[str, FloatArray] = {f"{i:03d}.png": near + np.array([0.1 * i, 0, 0]) for i in range(4)}
    close = [each.shared for each in choose_key_frames(scene, points)]
    far = [each.shared for each in choose_key_frames(scene, {n: p + np.array([0, 0, 50.0]) for n, p in points.items()})]
    assert close[1] is not None
    assert far[1] is not None
    assert close[1] < 0.9 < far[1]


def test_few_frames_are_all_taken_and_unreadable_ones_are_not(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, [turned(0, 0.1 * i) for i in range(5)])
    assert [each.frame for each in choose_key_frames(scene, {})] == [0, 1, 2, 3, 4]
    (tmp_path / "000.png").write_bytes(b"no image")
    (tmp_path / "003.png").write_bytes(b"no image")
    assert [each.frame for each in choose_key_frames(scene, {})] == [1, 2, 4]
    for path in tmp_path.iterdir():
        path.write_bytes(b"no image")
    assert choose_key_frames(scene, {}) == []


def test_overlap_of_cameras_is_that_of_their_points() -> None:
    assert overlap(turned(0), turned(0), 0.5) == 1
    assert overlap(turned(0), turned(180), 0.5) == 0
    assert overlap(turned(0), turned(20), 0.0) == pytest.approx(0.6, abs=0.15)
    assert share_seen(np.array([[0, 0, 1.0], [0, 0, -1.0]]), turned(0)) == 0.5


def test_import_names_them_with_reasons_and_shows_them(tiny: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tiny / "annotations.json").unlink()
    assert main(["import", str(tiny), str(tiny / "out")]) == 0
    said = " ".join(capfd.readouterr().out.split())
    assert f"annotate images in {tiny / 'out/images'}, best the 5 that {tiny / 'out/key_frames.txt'} names" in said
    lines = (tiny / "out/key_frames.txt").read_text().splitlines()
    names = [line for line in lines if not line.startswith("#")]
    assert names == [f"{i:03d}.png" for i in range(5)]
    assert all((tiny / "out/images" / name).is_file() for name in names)
    for reason, name in pairwise(lines[2:]):
        assert reason.startswith("#") != name.startswith("#")
    assert "start of the path" in lines[2]
    assert "% of what it shows is in the one before" in lines[4]
    assert main(["import", str(tiny), str(tiny / "again")]) == 0
    for name in ("key_frames.txt", "key_frames.jpg"):
        assert (tiny / "out" / name).read_bytes() == (tiny / "again" / name).read_bytes()
    assert load_scene(tiny / "out", annotated=False).key_frames == ()  # neither is taken for annotations
    with Image.open(tiny / "out/key_frames.jpg") as sheet:
        assert sheet.format == "JPEG"


def test_reasons_name_the_frame_of_the_video(tiny: Path) -> None:
    from gtlayout.importing.key_frame_files import write_key_frame_files  # noqa: PLC0415

    scene = load_scene(tiny)
    frames = tuple(replace(f, origin=VideoOrigin("clip.mp4", 10 * i, i / 3, 50)) for i, f in enumerate(scene.frames))
    scene = replace(scene, frames=frames)
    write_key_frame_files(tiny, scene, choose_key_frames(scene, {}), [f.name for f in frames])
    assert "frame 20 of clip.mp4, 0.667 s\n002.png\n" in (tiny / "key_frames.txt").read_text()


def test_the_contact_sheet_shows_every_picture_with_its_name_below(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, [turned(0)] * 6)
    names = ["a.png", "b.png", "ü" * 60 + ".png", "d.png", "e.png", "f.png"]
    (tmp_path / "sheet.jpg").write_bytes(contact_sheet(list(zip(scene.frames, names, strict=True))))
    image = cv2.imread(str(tmp_path / "sheet.jpg"))
    assert image is not None
    rows = [slice(8 + row * (96 + 38), 8 + row * (96 + 38) + 96) for row in (0, 1)]
    for index in range(8):
        left = 8 + index % 4 * 368
        picture = image[rows[index // 4], left : left + 160]
        caption = image[rows[index // 4].stop + 2 : rows[index // 4].stop + 30, left : left + 360]
        assert (picture.std() > 20) == (index < 6)
        assert (caption.min() < 100) == (index < 6)
