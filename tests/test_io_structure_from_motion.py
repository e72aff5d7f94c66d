"""Cameras for a video that has none: a real run on a synthetic room, and what is said when there is nothing to find."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from videos import write_video

from gtlayout.errors import GtlayoutError
from gtlayout.importing.frame_extraction import Extraction, extract_frames
from gtlayout.importing.sfm_verdict import Matching, no_model, spans, weaknesses
from gtlayout.importing.structure_from_motion import (
    STRAIGHTENED,
    SfmResult,
    median_parallax_deg,
    pairs_to_match,
    reconstruct,
)
from gtlayout.io.scene_folder import load_scene
from gtlayout.observer import Observer
from gtlayout.scene import FloatArray, ImageArray
from gtlayout.synth import SynthConfig, synthesize

WIDTH, HEIGHT, FRAMES = 320, 240, 15


def similarity(from_points: FloatArray, to_points: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Scale, rotation and translation that bring (N, 3) points nearest to others (Umeyama 1991)."""
    a, b = from_points - from_points.mean(axis=0), to_points - to_points.mean(axis=0)
    U, D, Vt = np.linalg.svd(b.T @ a)
    S = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    rotation = U @ S @ Vt
    scale = float(np.sum(D * np.diag(S)) / np.sum(a**2))
    return scale, rotation, to_points.mean(axis=0) - scale * rotation @ from_points.mean(axis=0)


def images_of(folder: Path) -> list[ImageArray]:
    images = [cv2.imread(str(path)) for path in sorted(folder.iterdir())]
    return [image.astype(np.uint8) for image in images if image is not None]


def film(images: list[ImageArray], folder: Path) -> Extraction:
    video = write_video(folder / "video.mp4", images, options={"crf": "14"})
    return extract_frames(video, folder / "images", 30.0)


def run(extraction: Extraction, folder: Path, name: str = "work", observer: Observer | None = None) -> SfmResult:
    (folder / name).mkdir()
    return reconstruct(folder / "images", extraction.names, folder / name, observer)


def model_bytes(model: pycolmap.Reconstruction, folder: Path) -> str:
    folder.mkdir()
    model.write_binary(folder)
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(folder.iterdir()))).hexdigest()


@pytest.fixture(scope="module")
def long_arc(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arc") / "room"
    synthesize(folder, SynthConfig(frames=3 * FRAMES, width=WIDTH, height=HEIGHT, oversample=1))
    return folder


@pytest.fixture(scope="module")
def other_room(tmp_path_factory: pytest.TempPathFactory) -> list[ImageArray]:
    folder = tmp_path_factory.mktemp("other") / "room"
    synthesize(folder, SynthConfig(seed=8, frames=13, width=WIDTH, height=HEIGHT, oversample=1))
    return images_of(folder / "images")[::2]


class _Told(Observer):
    def __init__(self) -> None:
        self.stages: dict[str, list[tuple[int, int]]] = {}

    def stage(self, name: str) -> None:
        self.stages[name] = []

    def progress(self, done: int, total: int) -> None:
        list(self.stages.values())[-1].append((done, total))


def test_cameras_of_a_synthetic_room(long_arc: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    # Every third frame: a longer path for the same work.
    images = images_of(long_arc / "images")[::3]
    told = _Told()
    found = run(film(images, tmp_path), tmp_path, observer=told)
    truth = [frame.camera for frame in load_scene(long_arc).frames][::3]

    assert len(found.registered) == FRAMES, found.warnings
    assert found.reprojection_px < 0.5
    assert found.verdict().startswith(f"{FRAMES} of {FRAMES} frames registered, reprojection error 0.")
    poses = {image.name: image.cam_from_world().matrix() for image in found.reconstruction.images.values()}
    centers = np.array([-poses[name][:, :3].T @ poses[name][:, 3] for name in found.names])
    true_centers = np.array([camera.center_world for camera in truth])
    scale, rotation, translation = similarity(centers, true_centers)
    error = np.linalg.norm(scale * centers @ rotation.T + translation - true_centers, axis=1)
    assert error.max() < 0.01 * np.linalg.norm(np.ptp(true_centers, axis=0))
    (lens,) = found.reconstruction.cameras.values()
    assert abs(lens.params[0] - truth[0].K[0, 0]) < 3 * found.sigma_focal_px

    assert list(told.stages) == ["features", "matching", "mapping"]
    for progress in told.stages.values():
        assert progress == sorted(progress)
        assert progress[-1][0] == progress[-1][1] > 0
    captured = capfd.readouterr()
    assert captured.out == captured.err == ""


def test_a_short_path_gives_a_straight_lens_and_the_same_bytes_again(long_arc: Path, tmp_path: Path) -> None:
    extraction = film(images_of(long_arc / "images")[:20:2], tmp_path)
    found, again = (run(extraction, tmp_path, work) for work in ("work", "again"))
    (lens,) = found.reconstruction.cameras.values()
    assert lens.params[3] == 0
    assert found.warnings == (STRAIGHTENED,)
    assert lens.params[0] == pytest.approx(load_scene(long_arc).frames[0].camera.K[0, 0], rel=0.03)
    assert model_bytes(found.reconstruction, tmp_path / "a") == model_bytes(again.reconstruction, tmp_path / "b")


def test_halves_of_a_video_say_how_well_the_focal_length_is_known(
    long_arc: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gtlayout.importing.structure_from_motion.MIN_HALF", 5)
    told = _Told()
    found = run(film(images_of(long_arc / "images")[:40:4], tmp_path), tmp_path, observer=told)
    (lens,) = found.reconstruction.cameras.values()
    assert told.stages["checking the lens"][-1] == (4, 4)
    assert "px from every other frame" in found.verdict()
    assert (lens.params[3] == 0) == (STRAIGHTENED in found.warnings)
    assert abs(lens.params[0] - load_scene(long_arc).frames[0].camera.K[0, 0]) < 3 * found.sigma_focal_px


def test_a_given_focal_length_stays(long_arc: Path, tmp_path: Path) -> None:
    extraction = film(images_of(long_arc / "images")[:24:4], tmp_path)
    (tmp_path / "work").mkdir()
    found = reconstruct(tmp_path / "images", extraction.names, tmp_path / "work", focal_px=300.0)
    (lens,) = found.reconstruction.cameras.values()
    assert lens.params[0] == 300.0
    assert found.verdict().endswith("focal length 300 px as given")


def test_two_rooms_in_one_video_fall_apart(long_arc: Path, other_room: list[ImageArray], tmp_path: Path) -> None:
    images = images_of(long_arc / "images")[:24:3] + other_room
    found = run(film(images, tmp_path), tmp_path)
    assert len(found.registered) == 8
    assert any("7 of 15 frames have no camera: 0.27 to 0.47 s" in warning for warning in found.warnings)
    assert any("8 frames were kept, 7 left out" in warning for warning in found.warnings)


def black(room: ImageArray) -> list[ImageArray]:
    return [np.full_like(room, 10)] * 6


def static(room: ImageArray) -> list[ImageArray]:
    rng = np.random.default_rng(0)
    return [np.clip(room + rng.normal(0, 3, room.shape), 0, 255).astype(np.uint8) for _ in range(6)]


def unrelated(room: ImageArray) -> list[ImageArray]:
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 255, room.shape, dtype=np.uint8) for _ in range(6)]
    return [cv2.GaussianBlur(each, (0, 0), 2.0).astype(np.uint8) for each in noise]


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (black, r"hardly any detail in 6 of 6 frames \(0.00 to 0.17 s\)"),
        (static, "no parallax"),
        (unrelated, "5 of 5 frames do not match the next one .* move slower"),
    ],
)
def test_no_model_says_why(
    made: Callable[[ImageArray], list[ImageArray]], words: str, long_arc: Path, tmp_path: Path
) -> None:
    images = made(images_of(long_arc / "images")[0])
    with pytest.raises(GtlayoutError, match=words):
        run(film(images, tmp_path), tmp_path)


def test_two_frames_are_too_few(tmp_path: Path) -> None:
    with pytest.raises(GtlayoutError, match="at least 3"):
        reconstruct(tmp_path, ["a.jpg", "b.jpg"], tmp_path)


def test_pairs_reach_far_without_being_many() -> None:
    assert pairs_to_match(4) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    pairs = pairs_to_match(1000)
    assert (0, 512) in pairs
    assert len(pairs) < 11 * 1000
    assert len(set(pairs)) == len(pairs)


def test_parallax_is_the_angle_between_the_outermost_rays() -> None:
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(camera_id=1, model="PINHOLE", width=10, height=10, params=[5, 5, 5, 5])
    )
    for image_id, x in enumerate((-1.0, 0.0, 1.0), start=1):
        image = pycolmap.Image(name=f"{x}", camera_id=1, image_id=image_id, points2D=[pycolmap.Point2D([5, 5])])
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(), [-x, 0, 0]))
    track = pycolmap.Track([pycolmap.TrackElement(i, 0) for i in (1, 2, 3)])
    model.add_point3D([0, 0, 1], track)
    assert median_parallax_deg(model) == pytest.approx(90.0)
    assert median_parallax_deg(pycolmap.Reconstruction()) == 0.0


NAMES = tuple(f"{i:012d}.jpg" for i in range(0, 1_000_000, 100_000))


def test_spans_name_the_longest_runs_in_order() -> None:
    assert spans(NAMES, [0, 1, 2, 5]) == "0.00 to 0.20 s, 0.50 s"
    assert spans(NAMES, [0, 2, 4, 6, 8, 9]) == "0.00 s, 0.20 s, 0.40 s, 0.80 to 0.90 s and 1 shorter parts"
    assert spans(["a.png", "b.png", "c.png"], [0, 1]) == "a.png to b.png"
    photos = [f"{i}.png" for i in range(9)]
    assert spans(photos, [0, 2, 4, 6, 8]) == "0.png, 2.png, 4.png, 6.png, 8.png"  # images have to be found


def test_a_good_model_has_no_weakness() -> None:
    matching = Matching(NAMES, (500,) * 10, {})
    assert weaknesses(matching, set(NAMES), [], 8.0, 0.01) == []


def test_weaknesses_in_words() -> None:
    matching = Matching(NAMES, (500,) * 10, {})
    lost, apart, parallax, focal = weaknesses(matching, set(NAMES[:4]), [set(NAMES[5:9])], 1.0, 0.1)
    assert lost.startswith("6 of 10 frames have no camera: 0.40 to 0.90 s; most of the video is lost")
    assert "4 frames were kept, 4 left out" in apart
    assert "1.0° apart" in parallax
    assert "good to 10% only" in focal


def test_frames_that_break_the_chain_are_named() -> None:
    linked = {(i, i + 1): 100 for i in range(3)}
    assert "6 of 9 frames do not match the next one (0.30 to 0.80 s)" in no_model(Matching(NAMES, (500,) * 10, linked))
    assert "3" not in no_model(Matching(NAMES, (500,) * 10, {(i, i + 1): 100 for i in range(9)}))
