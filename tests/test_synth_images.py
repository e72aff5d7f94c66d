"""Motion blur, exposure and noise of synthetic images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gtlayout.scene import Camera
from gtlayout.synth.images import GAMMA, cameras_along, developed, exposures, gains, picture
from gtlayout.synth.motion import CameraPath, looking
from gtlayout.synth.room import Room, make_room
from gtlayout.synth.textures import Texture

K = np.array([[200.0, 0, 120], [0, 200, 90], [0, 0, 1]])


@pytest.fixture(scope="module")
def furnished() -> Room:
    return make_room(1)


def _pan(step_deg: float, frames: int = 7) -> tuple[CameraPath, tuple[Camera, ...]]:
    """A camera that turns rightwards on the spot."""
    R_cam_from_world = np.stack([looking(np.deg2rad(step_deg) * n, 0, 0) for n in range(frames)])
    path = CameraPath(R_cam_from_world, np.tile([2.0, 1.0, 1.5], (frames, 1)))
    return path, cameras_along(path, K, 240, 180)


def _detail(image: Texture) -> tuple[float, float]:
    """How much the picture changes from pixel to pixel along x and along y."""
    gray = image.mean(axis=2)
    return float(np.abs(np.diff(gray, axis=1)).mean()), float(np.abs(np.diff(gray, axis=0)).mean())


def test_motion_blur_smears_along_the_motion_and_not_across(furnished: Room) -> None:
    path, cameras = _pan(2.0)  # 7 px from frame to frame
    opened = exposures(path, cameras, 0.8)
    sharp = picture(furnished.surfaces, cameras[3:4], 1)
    blurred = picture(furnished.surfaces, opened[3], 1)
    (sharp_x, sharp_y), (blurred_x, blurred_y) = _detail(sharp), _detail(blurred)
    assert blurred_x < 0.45 * sharp_x
    assert blurred_y > 0.7 * sharp_y
    # What a turn about the camera does to a picture is the mean of its shifts, or nearly so this close to its middle.
    middle = np.s_[70:110, 90:150]
    kernel = np.ones((1, 6), np.float32) / 6
    for shift_px, is_right in ((0, True), (3, False), (-3, False)):
        expected = cv2.filter2D(np.roll(sharp, shift_px, axis=1), -1, kernel)
        correlation = np.corrcoef(expected[middle].ravel(), blurred[middle].ravel())[0, 1]
        assert (correlation > 0.98) == is_right, "the frame's camera is that of the middle of the exposure"


def test_as_many_pictures_are_averaged_as_the_motion_asks_for() -> None:
    for step_deg, counts in ((0.0, {1}), (0.5, {1, 2}), (2.0, {4, 5, 6}), (30.0, {16})):
        path, cameras = _pan(step_deg)
        opened = exposures(path, cameras, 0.8)
        assert {len(each) for each in opened} <= counts
        for camera, during in zip(cameras, opened, strict=True):
            turns = [each.R_cam_from_world @ camera.R_cam_from_world.T for each in during]
            yaws_deg = np.rad2deg([np.arctan2(turn[0, 2], turn[0, 0]) for turn in turns])
            assert np.mean(yaws_deg) == pytest.approx(0, abs=1e-6)
            assert np.ptp(yaws_deg) == pytest.approx(0.8 * step_deg * (1 - 1 / len(during)), rel=1e-3, abs=1e-6)


def test_a_frame_without_blur_leaves_the_exposures_after_it_where_they_were() -> None:
    yaws_rad = np.deg2rad([0.0, 0.0, 0.0, 0.0, 1.0, 4.0, 9.0, 16.0, 25.0])
    R_cam_from_world = np.stack([looking(yaw, 0, 0) for yaw in yaws_rad])
    path = CameraPath(R_cam_from_world, np.tile([2.0, 1.0, 1.5], (len(yaws_rad), 1)))
    cameras = cameras_along(path, K, 240, 180)
    opened = exposures(path, cameras, 0.3)
    assert len(opened[1]) == 1 < len(opened[-2])
    for camera, during in zip(cameras, opened, strict=True):
        turns = [each.R_cam_from_world @ camera.R_cam_from_world.T for each in during]
        yaws_deg = np.rad2deg([np.arctan2(turn[0, 2], turn[0, 0]) for turn in turns])
        assert np.mean(yaws_deg) == pytest.approx(0, abs=0.1)


def test_no_shutter_time_no_blur() -> None:
    path, cameras = _pan(2.0)
    assert exposures(path, cameras, 0.0) == tuple((camera,) for camera in cameras)


def test_exposure_changes_brightness_as_configured() -> None:
    rng = np.random.default_rng(0)
    many = np.stack([gains(30, 0.5, rng) for _ in range(1500)])
    stops = np.log2(many) * GAMMA
    np.testing.assert_allclose(stops.std(axis=0), 0.5, rtol=0.1)
    assert np.diff(stops, axis=1).std() < 0.15, "smooth"
    np.testing.assert_array_equal(gains(30, 0.0, rng), 1)
    gray = np.full((60, 80, 3), 100, np.float32)
    for gain in many[0]:
        assert developed(gray, gain, 0.0, rng).mean() == pytest.approx(100 * gain, abs=0.5)
    # One stop more of light, through the usual gamma, is clipped where it is too much.
    assert developed(gray, 2 ** (1 / GAMMA), 0.0, rng).mean() == 137
    assert developed(gray * 2, 2 ** (1 / GAMMA), 0.0, rng).mean() == 255


def test_noise_is_as_strong_as_configured() -> None:
    gray = np.full((120, 160, 3), 100, np.float32)
    noisy = developed(gray, 1.0, 4.0, np.random.default_rng(0)).astype(float)
    assert noisy.mean() == pytest.approx(100, abs=0.1)
    assert noisy.std() == pytest.approx(4, rel=0.03)
