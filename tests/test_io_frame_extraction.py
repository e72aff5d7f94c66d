"""Frames taken from a video: when, how sharp, under which name."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from videos import number_in, pictures, write_video

from gtlayout.errors import GtlayoutError
from gtlayout.importing.frame_extraction import extract_frames, frame_name, sharpness, time_of
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.pixels.video import Video
from gtlayout.scene import ImageArray

COUNT = 30


def blurred(images: list[ImageArray], sharp: set[int]) -> list[ImageArray]:
    return [
        image if i in sharp else cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.uint8) for i, image in enumerate(images)
    ]


def test_the_sharpest_frame_of_each_window_is_written_under_its_time(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", blurred(pictures(COUNT), {4, 13, 27}), options={"crf": "10"})
    told: list[tuple[int, int]] = []
    found = extract_frames(video, tmp_path / "images", 3.0, lambda done, total: told.append((done, total)))
    assert found.video_frames == (4, 13, 27)
    assert found.names == ("000000133333.jpg", "000000433333.jpg", "000000900000.jpg")
    assert [path.name for path in sorted((tmp_path / "images").iterdir())] == list(found.names)
    for name, index in zip(found.names, found.video_frames, strict=True):
        image = cv2.imread(str(tmp_path / "images" / name))
        assert image is not None
        assert number_in(image.astype(np.uint8)) == index
    assert told[-1] == (COUNT, COUNT)
    assert found.warnings == ()


def test_windows_are_of_time_not_of_frames(tmp_path: Path) -> None:
    stamps_ms = [0, 10, 20, 990, 1000, 1010, 5000, 5010]
    video = write_video(tmp_path / "a.mp4", pictures(8), stamps_ms=stamps_ms)
    found = extract_frames(video, tmp_path / "images", 1.0)
    windows = [stamps_ms[i] // 1000 for i in found.video_frames]
    assert windows == [0, 1, 5]


def test_a_rate_above_the_videos_takes_every_frame(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", pictures(5))
    assert extract_frames(video, tmp_path / "images", 1000.0).video_frames == (0, 1, 2, 3, 4)


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), float("inf")])
def test_the_rate_must_be_positive(rate_hz: float, tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", pictures(2))
    with pytest.raises(GtlayoutError, match="positive"):
        extract_frames(video, tmp_path / "images", rate_hz)
    assert not (tmp_path / "images").exists()


@pytest.mark.parametrize("content", [b"", b"no video", bytes(10_000)])
def test_what_is_no_video_is_named(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(content)
    with pytest.raises(GtlayoutError, match=r"a\.mp4"):
        extract_frames(tmp_path / "a.mp4", tmp_path / "images", 3.0)
    assert not (tmp_path / "images").exists()


def test_names_say_the_time_and_sort_by_it() -> None:
    assert frame_name(12.345678) == "000012345678.jpg"
    assert time_of("000012345678.jpg") == 12.345678
    assert time_of("000010.jpg") is None
    assert time_of("frame-000000000001.jpg") is None
    assert sorted(map(frame_name, (10.0, 9.0, 100.0))) == list(map(frame_name, (9.0, 10.0, 100.0)))


def test_sharpness_falls_with_blur_at_any_size() -> None:
    rng = np.random.default_rng(0)
    small = cv2.GaussianBlur(rng.integers(0, 255, (240, 320, 3), dtype=np.uint8), (0, 0), 1.0)
    for size in ((320, 240), (1600, 1200)):
        image = cv2.resize(small, size, interpolation=cv2.INTER_CUBIC).astype(np.uint8)
        soft = cv2.GaussianBlur(image, (0, 0), 0.01 * size[0]).astype(np.uint8)
        assert sharpness(image) > 2 * sharpness(soft)


def test_annotated_frames_are_taken_instead_of_the_sharpest(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", blurred(pictures(COUNT), {4, 13, 27}), options={"crf": "10"})
    found = extract_frames(video, tmp_path / "images", 3.0, annotated={1, 8, 15, 99})
    assert found.video_frames == (1, 8, 15, 27)
    assert found.warnings == ()
    assert [origin.time_s for origin in found.origins] == pytest.approx([i / 30 for i in (1, 8, 15, 27)], abs=1e-3)
    assert {(origin.video_name, origin.frame_count) for origin in found.origins} == {("a.mp4", COUNT)}
    image = cv2.imread(str(tmp_path / "images" / found.names[1]))
    assert image is not None
    assert number_in(image.astype(np.uint8)) == 8


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_origins_know_how_the_video_is_turned(degrees: int, tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", pictures(3), options={"crf": "10"}, display_degrees=degrees)
    origin = extract_frames(video, tmp_path / "images", 100.0).origins[1]
    assert isinstance(origin.resampled, Upright)
    shown = Video(video).frame(1)
    assert origin.resampled.shown_size == shown.shape[1::-1]
    assert origin.resampled.size == (160, 96)
    stored = origin.resampled.shown.inverse.image(shown)
    assert stored[:32, :48].mean() > 200  # the corner that is white as it was encoded
    assert np.array_equal(origin.resampled(stored), shown)
