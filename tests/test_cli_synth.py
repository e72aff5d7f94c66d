"""``gtlayout synth`` run for real: formats, flags, exit statuses, and what errors change in the files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import SHARED_DATA

from gtlayout.cli.app import main
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.io.writing.scene_writers import AnnotationFormat, CameraFormat
from gtlayout.scene import Camera
from gtlayout.synth import SynthConfig, shoot
from gtlayout.synth.room import make_room

SMALL = ("--width", "128", "--height", "96", "--oversample", "1")
CLIP = SHARED_DATA / "re10k_cameras/0c11dbe781b1c11c.txt"


def _synth(out: Path, *flags: str) -> Path:
    flags = flags if "--frames" in flags else (*flags, "--frames", "9")
    assert main(["synth", str(out), *SMALL, *flags]) == 0
    return out


def _files(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Without errors of annotator and cameras."""
    return _synth(tmp_path_factory.mktemp("plain") / "room", "--corner-error-px", "0")


@pytest.fixture(scope="module")
def true_cameras() -> tuple[Camera, ...]:
    """Of the same room."""
    return shoot(make_room(0), SynthConfig(frames=9, width=128, height=96)).cameras


@pytest.mark.parametrize(
    ("cameras", "annotations"), [("native", "native"), ("colmap", "cad-estate"), ("scannet", "native")]
)
def test_a_scene_in_any_format_reads_back_with_its_truth(
    plain: Path, true_cameras: tuple[Camera, ...], tmp_path: Path, cameras: CameraFormat, annotations: AnnotationFormat
) -> None:
    formats = ("--camera-format", cameras, "--annotation-format", annotations)
    scene = load_scene(_synth(tmp_path / "room", "--corner-error-px", "0", *formats))
    assert scene.metric
    assert [key_frame.frame for key_frame in scene.key_frames] == [0, 8]
    for number, (frame, camera) in enumerate(zip(scene.frames, true_cameras, strict=True)):
        for name in ("K", "R_cam_from_world", "t_cam_from_world"):
            np.testing.assert_allclose(getattr(frame.camera, name), getattr(camera, name), atol=1e-9, err_msg=name)
        assert frame.image_path.read_bytes() == (plain / f"images/{number:06d}.jpg").read_bytes()
    truth = read_truth(scene)
    assert truth is not None
    assert set(truth.planes) >= {"floor", "ceiling", "wall_2"}
    for k, key_frame in enumerate(scene.key_frames):
        for e, element in enumerate(key_frame.elements):
            assert truth.elements[k, e].startswith(element.label)
    assert [path.name for path in tmp_path.iterdir()] == ["room"], "nothing else is left behind"


def test_all_flags_work_together_and_the_same_flags_give_the_same_bytes(tmp_path: Path) -> None:
    flags = (
        *("--seed", "5", "--room", "l-shaped", "--camera", "dolly", "--texture", "0.5"),
        *("--noise", "4", "--blur", "0.1", "--exposure", "0.3", "--corner-error-px", "1", "--edge-error-px", "2"),
        *("--missing", "0.1", "--swapped", "0.1", "--missing-occlusion", "0.5", "--missing-visible", "0.1"),
        *("--camera-rotation-error-deg", "0.2", "--camera-position-error-m", "0.01", "--focal-error", "0.01"),
        *("--key-every", "2", "--hfov-deg", "80", "--jpeg-quality", "80", "--frames", "4"),
    )
    first, second = (_files(_synth(tmp_path / name, *flags)) for name in ("a", "b"))
    assert first == second
    assert len([name for name in first if name.startswith("depth/")]) == 2


def test_trim_is_asked_for_by_flags(plain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flags = (
        *("--baseboard-height-m", "0.08", "--baseboard-thickness-m", "0.02", "--baseboards", "1"),
        *("--window-reveal-m", "0.1", "--door-reveal-m", "0.06", "--kitchen", "1", "--plinth-height-m", "0.12"),
        *("--plinth-recess-m", "0.05", "--worktop-overhang-m", "0.03", "--corner-error-px", "0"),
    )
    made = _synth(tmp_path / "room", *flags)
    before, after = (json.loads((root / "gt_planes.json").read_text())["planes"] for root in (plain, made))
    assert after["window_0"]["d"] - before["window_0"]["d"] == pytest.approx(0.1, rel=1 / 3)
    for name in ("floor", "wall_2"):
        assert (after[name]["d"], after[name]["normal"]) == (before[name]["d"], before[name]["normal"])
    assert main(["synth", "--help"]) == 0
    printed = capsys.readouterr().out
    assert "Trim" in printed
    assert all(flag in printed for flag in flags if flag.startswith("--"))


def test_errors_of_cameras_change_the_cameras_and_nothing_else(plain: Path, tmp_path: Path) -> None:
    errors = ("--camera-rotation-error-deg", "0.5", "--camera-position-error-m", "0.05", "--focal-error", "0.02")
    off = _synth(tmp_path / "off", "--corner-error-px", "0", *errors)
    before, after = _files(plain), _files(off)
    assert {name for name in before if before[name] != after[name]} == {"transforms.json"}
    pairs = list(zip(load_scene(plain).frames, load_scene(off).frames, strict=True))
    shifts_m = np.array([b.camera.center_world - a.camera.center_world for a, b in pairs])
    assert 0.01 < shifts_m.std() < 0.1
    turns = [b.camera.R_cam_from_world @ a.camera.R_cam_from_world.T for a, b in pairs]
    angles_deg = np.rad2deg([np.arccos((np.trace(turn) - 1) / 2) for turn in turns])
    assert 0.2 < np.mean(angles_deg) < 2
    assert 0 < abs(pairs[0][1].camera.K[0, 0] / pairs[0][0].camera.K[0, 0] - 1) < 0.08


def test_errors_of_the_annotator_change_the_annotations_and_not_the_truth(plain: Path, tmp_path: Path) -> None:
    off = _synth(tmp_path / "off", "--edge-error-px", "3", "--swapped", "1")
    before, after = _files(plain), _files(off)
    assert {name for name in before if before[name] != after[name]} == {"annotations.json"}
    fewer = _synth(tmp_path / "fewer", "--missing", "0.5")
    frames = json.loads((fewer / "annotations.json").read_text())["frames"]
    drawn = {frame["image"]: {element["id"] for element in frame["elements"]} for frame in frames}
    truth = json.loads((fewer / "gt_planes.json").read_text())
    assert {image: set(names) for image, names in truth["elements"].items()} == drawn
    assert set(truth["planes"]) == {name for names in truth["elements"].values() for name in names.values()}


def test_true_extents_lie_on_their_planes(plain: Path) -> None:
    planes = json.loads((plain / "gt_planes.json").read_text())["planes"]
    for plane in planes.values():
        for polygon in plane["extent"]:
            for ring in polygon:
                np.testing.assert_allclose(np.array(ring) @ plane["normal"] + plane["d"], 0, atol=1e-9)


def test_a_recorded_path_is_replayed(tmp_path: Path) -> None:
    if not CLIP.is_file():
        pytest.skip(f"RealEstate10k cameras {CLIP.name} are not beside the checkout")
    scene = load_scene(_synth(tmp_path / "room", "--camera", "dolly", "--replay", str(CLIP)))
    assert scene.frames[0].camera.K[0, 0] == pytest.approx(0.485388169 * 128)


@pytest.mark.parametrize(
    ("flags", "status", "message"),
    [
        (("--room", "hut"), 2, "hut"),
        (("--camera", "drone"), 2, "drone"),
        (("--noise", "-1"), 2, "--noise"),
        (("--missing", "1.5"), 2, "--missing"),
        (("--door-reveal-m", "-0.1"), 2, "--door-reveal-m"),
        (("--camera-rotation-error-deg", "much"), 2, "much"),
        (("--frames", "1"), 1, "gtlayout: synthetic scene: frames must be at least 2"),
        (("--hfov-deg", "170"), 1, "gtlayout: synthetic scene: hfov_deg must lie between 20 and 120"),
        (("--replay", "clip.txt"), 1, "gtlayout: synthetic scene: only a dolly replays a file: add --camera dolly"),
        (("--camera", "dolly", "--replay", "no.txt"), 1, "gtlayout: cannot read no.txt: No such file or directory"),
    ],
)
def test_wrong_flags_are_one_clear_line_and_write_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], flags: tuple[str, ...], status: int, message: str
) -> None:
    assert main(["synth", str(tmp_path / "out"), *flags]) == status
    printed = capfd.readouterr().err
    assert message in printed
    if status == 1:
        assert printed == f"{message}\n"
    assert not list(tmp_path.iterdir())
