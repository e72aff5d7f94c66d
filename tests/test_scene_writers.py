"""Scenes written in any format: images, depth, unit and names; what cannot be written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest
from shapely import MultiPolygon, box
from videos import write_video

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.exports import write_depth
from gtlayout.io.pixels.images import decode, read_depth, read_gray, read_rgb
from gtlayout.io.pixels.video import Video
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.writing.scene_writers import AnnotationFormat, CameraFormat, write_scene
from gtlayout.scene import Scene, VideoFrame

CAMERA_FORMATS: tuple[CameraFormat, ...] = get_args(CameraFormat)
ANNOTATION_FORMATS: tuple[AnnotationFormat, ...] = get_args(AnnotationFormat)
Edit = Callable[[Path, Callable[[Any], object]], None]


def _with(scene: Scene, index: int, **changes: Any) -> Scene:
    frames = [replace(frame, **changes) if i == index else frame for i, frame in enumerate(scene.frames)]
    return replace(scene, frames=tuple(frames))


def _with_a_small_frame(scene: Scene) -> Scene:
    """The second frame, which is annotated, has a camera and a size of its own."""
    camera, path = scene.frames[1].camera, scene.root / "images/001.png"
    path.write_bytes(cv2.imencode(".png", decode(path, cv2.IMREAD_COLOR)[:40, :60])[1].tobytes())
    small = replace(camera, K=camera.K + np.diag([1.0, 2.0, 0.0]), width=60, height=40)
    region = MultiPolygon([box(0, 0, 60, 40)])
    elements = tuple(replace(element, amodal=region, visible=region) for element in scene.key_frames[0].elements)
    key_frames = (replace(scene.key_frames[0], elements=elements), *scene.key_frames[1:])
    return replace(_with(scene, 1, camera=small), key_frames=key_frames)


def _with_many_elements(scene: Scene) -> Scene:
    first = scene.key_frames[0]
    elements = tuple(replace(first.elements[0], id=str(i)) for i in range(256))
    return replace(scene, key_frames=(replace(first, elements=elements),))


@pytest.mark.parametrize("cameras", CAMERA_FORMATS)
def test_images_and_unit_come_back(tiny: Path, tmp_path: Path, cameras: CameraFormat) -> None:
    """PNG files stay as they are where the format lets them; the unit is said where it does not."""
    scene = replace(load_scene(tiny), metric=cameras == "scannet")
    write_scene(scene, tmp_path / "written", cameras, "native")
    read = load_scene(tmp_path / "written")
    assert read.metric == scene.metric
    assert (tmp_path / "written/scene.json").exists() == (cameras != "scannet")
    for before, after in zip(scene.frames, read.frames, strict=True):
        if cameras in ("native", "colmap"):
            assert after.name == before.name
            assert after.image_path.read_bytes() == before.image_path.read_bytes()
        else:
            assert after.image_path.suffix == ".jpg"
            assert np.abs(read_gray(after).astype(int) - read_gray(before)).mean() < 10


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp"])
@pytest.mark.parametrize("cameras", ["native", "re10k"])
def test_distorted_images_are_written_as_their_pinhole_camera_sees_them(
    tiny: Path, tmp_path: Path, edit_json: Edit, suffix: str, cameras: CameraFormat
) -> None:
    """Without loss where the source has none; annotations lie in the pinhole image, too."""
    for image in list((tiny / "images").iterdir()):
        smooth = cv2.GaussianBlur(decode(image, cv2.IMREAD_COLOR), (0, 0), 4)
        image.unlink()
        image.with_suffix(suffix).write_bytes(cv2.imencode(suffix, smooth)[1].tobytes())

    def distort(data: Any) -> None:
        data.update(camera_model="OPENCV", k1=-0.1)
        for frame in data["frames"]:
            frame["file_path"] = frame["file_path"].replace(".png", suffix)

    edit_json(tiny / "transforms.json", distort)
    scene = load_scene(tiny)
    write_scene(scene, tmp_path / "written", cameras, "native")
    read = load_scene(tmp_path / "written")
    for before, after in zip(scene.frames, read.frames, strict=True):
        assert before.undistort is not None
        assert after.undistort is None
        np.testing.assert_allclose(after.camera.K, before.camera.K, atol=1e-9)
        error = np.abs(read_rgb(after).astype(int) - read_rgb(before)).max()
        assert error <= (0 if cameras == "native" and suffix != ".jpg" else 8)
    for key, expected in zip(read.key_frames, scene.key_frames, strict=True):
        assert key.elements[0].amodal.symmetric_difference(expected.elements[0].amodal).area < 1e-9


@pytest.mark.parametrize("cameras", ["native", "colmap", "scannet"])
def test_depth_goes_along(tiny: Path, tmp_path: Path, edit_json: Edit, cameras: CameraFormat) -> None:
    """Byte by byte, or resampled with its image."""
    (tiny / "depth").mkdir()
    ramp = np.round(2000 + 5 * np.arange(64) + 3 * np.arange(48)[:, None]).astype(np.uint16)
    (tiny / "depth/003.png").write_bytes(cv2.imencode(".png", ramp)[1].tobytes())
    for name, distorted in (("plain", False), ("distorted", True)):
        if distorted:
            edit_json(tiny / "transforms.json", lambda data: data.update(k1=-0.1))
        scene = load_scene(tiny)
        write_scene(scene, tmp_path / name, cameras, "native")
        read = load_scene(tmp_path / name)
        assert [frame.depth_path is not None for frame in read.frames] == [False, False, False, True, False]
        np.testing.assert_array_equal(read_depth(read.frames[3]), read_depth(scene.frames[3]))
        assert read.frames[3].depth_path is not None
        same = read.frames[3].depth_path.read_bytes() == (tiny / "depth/003.png").read_bytes()
        assert same != distorted
    write_depth(tmp_path / "none.png", scene.frames[0])
    assert not (tmp_path / "none.png").exists()


@pytest.mark.parametrize("cameras", CAMERA_FORMATS)
def test_frames_of_a_video_become_images(tiny: Path, tmp_path: Path, cameras: CameraFormat) -> None:
    pictures = [np.full((48, 64, 3), 20 + 40 * i, dtype=np.uint8) for i in range(5)]
    write_video(tmp_path / "video.mp4", pictures)
    video = Video(tmp_path / "video.mp4")
    scene = load_scene(tiny)
    frames = [
        replace(frame, name=f"{i}", image_path=tiny / f"{i}", video=VideoFrame(video, i))
        for i, frame in enumerate(scene.frames)
    ]
    write_scene(replace(scene, frames=tuple(frames), metric=True), tmp_path / "written", cameras, "native")
    read = load_scene(tmp_path / "written")
    assert [frame.image_path.suffix for frame in read.frames] == [".jpg"] * 5
    assert [round((read_gray(frame).mean() - 20) / 40) for frame in read.frames] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("cameras", CAMERA_FORMATS)
@pytest.mark.parametrize("annotations", ANNOTATION_FORMATS)
def test_a_scene_without_annotations_is_written_without(
    tiny: Path, tmp_path: Path, cameras: CameraFormat, annotations: AnnotationFormat
) -> None:
    scene = replace(load_scene(tiny), key_frames=(), metric=True)
    write_scene(scene, tmp_path / "written", cameras, annotations)
    read = load_scene(tmp_path / "written", annotated=False)
    assert len(read.frames) == 5
    assert read.key_frames == ()


@pytest.mark.parametrize("cameras", CAMERA_FORMATS)
@pytest.mark.parametrize("annotations", ANNOTATION_FORMATS)
def test_names_in_folders_and_with_blanks(
    tiny: Path, tmp_path: Path, cameras: CameraFormat, annotations: AnnotationFormat
) -> None:
    """Images in folders within images/; where the tool has one folder for all, their names differ."""
    scene = load_scene(tiny)
    frames = tuple(replace(frame, name=f"left eye/{i} of 5.png") for i, frame in enumerate(scene.frames))
    write_scene(replace(scene, frames=frames, metric=True), tmp_path / "a room", cameras, annotations)
    read = load_scene(tmp_path / "a room")
    assert [key.frame for key in read.key_frames] == [1, 3]
    assert [key.elements[0].label for key in read.key_frames] == ["wall", "wall"]
    if cameras in ("native", "colmap"):
        assert [frame.name for frame in read.frames] == [frame.name for frame in frames]


@pytest.mark.parametrize("annotations", ANNOTATION_FORMATS)
@pytest.mark.parametrize("cameras", ["native", "colmap"])
def test_images_of_several_sizes_and_lenses(
    tiny: Path, tmp_path: Path, cameras: CameraFormat, annotations: AnnotationFormat
) -> None:
    """As COLMAP leaves them that gave each image a camera of its own."""
    scene = _with_a_small_frame(load_scene(tiny))
    write_scene(scene, tmp_path / "written", cameras, annotations)
    read = load_scene(tmp_path / "written")
    for before, after in zip(scene.frames, read.frames, strict=True):
        np.testing.assert_allclose(after.camera.K, before.camera.K, atol=1e-9)
    assert [key.frame for key in read.key_frames] == [key.frame for key in scene.key_frames]
    for key, expected in zip(read.key_frames, scene.key_frames, strict=True):
        assert key.elements[0].amodal.area == pytest.approx(expected.elements[0].amodal.area)


@pytest.mark.parametrize(
    ("change", "cameras", "annotations", "says"),
    [
        (lambda s: replace(s, metric=False), "scannet", "native", "ScanNet's unit is the metre"),
        (_with_a_small_frame, "scannet", "native", "knows one camera"),
        (_with_a_small_frame, "re10k", "native", "knows one image size"),
        (_with_a_small_frame, "cad-estate", "native", "knows one image size"),
        (_with_many_elements, "native", "cad-estate", "cannot number 256 elements"),
        (lambda s: _with(s, 1, name="../../x.png"), "native", "native", "leads out"),
        (lambda s: _with(s, 1, image_path=Path("missing.png")), "colmap", "native", "cannot read .*missing.png"),
        (lambda s: _with(s, 1, name="eye/003.png"), "native", "cad-estate", "one name in two folders"),
        (lambda s: _with(s, 1, name="eye/003.png"), "native", "labelme", "two images of that name"),
    ],
)
def test_what_cannot_be_written_is_one_line_and_leaves_nothing(
    tiny: Path, tmp_path: Path, change: Callable[[Scene], Scene], cameras: Any, annotations: Any, says: str
) -> None:
    scene = change(replace(load_scene(tiny), metric=True))
    with pytest.raises(GtlayoutError, match=rf"^[^\n]*{says}[^\n]*$"):
        write_scene(scene, tmp_path / "new/written", cameras, annotations)
    assert not list((tmp_path / "new").iterdir())


def test_a_folder_that_is_not_empty_is_left_alone(tiny: Path) -> None:
    before = sorted(tiny.rglob("*"))
    with pytest.raises(GtlayoutError, match="is not an empty folder"):
        write_scene(load_scene(tiny), tiny, "native", "native")
    assert sorted(tiny.rglob("*")) == before
