"""Undistortion against the lens models' own formulas."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.undistort import Undistortion, undistortion
from gtlayout.io.lens import Lens
from gtlayout.io.pixels.images import read_gray
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import FloatArray

WIDTH, HEIGHT, F, CX, CY = 120, 100, 110.0, 58.0, 51.5


def _simple_radial(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    radial = 1 - 0.1 * (x**2 + y**2)
    return x * radial, y * radial


def _opencv(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    k1, k2, p1, p2 = -0.1, 0.02, 0.003, -0.002
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y**2)


def _fisheye(k1: float) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    def distort(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        r = np.hypot(x, y)
        theta = np.arctan(r)
        return x / r * (theta + k1 * theta**3), y / r * (theta + k1 * theta**3)

    return distort


LENSES = [
    pytest.param("SIMPLE_RADIAL", [F, CX, CY, -0.1], _simple_radial, id="simple_radial"),
    pytest.param("OPENCV", [F, F, CX, CY, -0.1, 0.02, 0.003, -0.002], _opencv, id="opencv"),
    pytest.param("OPENCV_FISHEYE", [F, F, CX, CY, 0.05, 0, 0, 0], _fisheye(0.05), id="fisheye"),
    pytest.param("OPENCV_FISHEYE", [F, F, CX, CY, 0, 0, 0, 0], _fisheye(0.0), id="fisheye without coefficients"),
]
Distort = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def _lens(model: str, params: list[float]) -> Undistortion:
    found = undistortion(Lens(model, WIDTH, HEIGHT, tuple(params)))
    assert found is not None
    return found


def _distorted_px(lens: Undistortion, pinhole_px: FloatArray, distort: Distort) -> FloatArray:
    K = lens.target.K
    x, y = distort((pinhole_px[:, 0] - K[0, 2]) / K[0, 0], (pinhole_px[:, 1] - K[1, 2]) / K[1, 1])
    return np.column_stack([F * x + CX, F * y + CY])


@pytest.mark.parametrize(("model", "params", "distort"), LENSES)
def test_points_follow_the_formula(model: str, params: list[float], distort: Distort) -> None:
    lens = _lens(model, params)
    pinhole_px = np.random.default_rng(0).uniform(5, 95, (50, 2))
    np.testing.assert_allclose(lens.points(_distorted_px(lens, pinhole_px, distort)), pinhole_px, atol=1e-6)


@pytest.mark.parametrize(("model", "params", "distort"), LENSES)
@pytest.mark.parametrize("axis", [0, 1])
def test_images_are_sampled_at_pixel_centres(model: str, params: list[float], distort: Distort, axis: int) -> None:
    """A ramp whose value at px u is 2 (u - 0.5): half a pixel's slip would be off by 1, rounding by 0.5."""
    lens = _lens(model, params)
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    ramp = (2 * (columns, rows)[axis]).astype(np.uint8)
    straight = lens(ramp)
    width, height = lens.target.width, lens.target.height
    assert straight.shape == (height, width)
    u, v = np.meshgrid(np.arange(10, width - 10) + 0.5, np.arange(10, height - 10) + 0.5)
    source_px = _distorted_px(lens, np.column_stack([u.ravel(), v.ravel()]), distort)
    got = straight[10:-10, 10:-10].ravel().astype(np.float64)
    assert np.abs(got - 2 * (source_px[:, axis] - 0.5)).max() < 0.6


@pytest.mark.parametrize(("model", "params", "distort"), LENSES)
def test_depth_is_never_mixed(model: str, params: list[float], distort: Distort) -> None:
    lens = _lens(model, params)
    ids = np.arange(1, WIDTH * HEIGHT + 1, dtype=np.uint16).reshape(HEIGHT, WIDTH)
    straight = lens(ids)
    centre_px = np.array([[40.5, 30.5], [70.5, 60.5], [20.5, 80.5]])
    columns, rows = np.floor(_distorted_px(lens, centre_px, distort)).astype(int).T
    found = straight[centre_px[:, 1].astype(int), centre_px[:, 0].astype(int)]
    assert found.tolist() == ids[rows, columns].tolist()


def test_pinholes_are_left_alone() -> None:
    for model, params in {"PINHOLE": [F, F, CX, CY], "OPENCV": [F, F, CX, CY, 0, 0, 0, 0]}.items():
        assert undistortion(Lens(model, WIDTH, HEIGHT, tuple(params))) is None


def test_panorama_is_a_known_problem() -> None:
    with pytest.raises(GtlayoutError, match="EQUIRECTANGULAR"):
        undistortion(Lens("EQUIRECTANGULAR", 200, 100, (200.0, 100.0)))


@pytest.mark.parametrize("k1", [-0.1, 0.1])
def test_scene_comes_out_undistorted(tiny: Path, k1: float) -> None:
    """Frames and annotations of a distorted clip: the pinhole image, and a vertex where the formula puts it."""
    data = json.loads((tiny / "transforms.json").read_text())
    data.update(k1=k1)
    (tiny / "transforms.json").write_text(json.dumps(data))
    scene = load_scene(tiny)
    frame, element = scene.frame_of(0), scene.key_frames[0].elements[0]
    camera = frame.camera
    assert read_gray(frame).shape == (camera.height, camera.width)
    # It was the whole image; the border of a pincushion bends outwards.
    assert element.amodal.area == pytest.approx(camera.width * camera.height, rel=2e-3)
    pinhole_px = np.array(element.visible.geoms[0].exterior.coords)
    x, y = ((pinhole_px - camera.K[:2, 2]) / 60).T
    radial = 1 + k1 * (x**2 + y**2)
    drawn_px = np.column_stack([60 * x * radial + 32, 60 * y * radial + 24])
    assert {tuple(p) for p in drawn_px.round(5)} == {(5.0, 5.0), (30.0, 5.0), (30.0, 30.0)}
