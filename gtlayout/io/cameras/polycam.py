"""Polycam's raw export: ``keyframes/`` with a camera (JSON), an image and a depth map per time; metric.

Facts from the format's description (Polycam's polyform, README): poses are ARKit's camera-to-world (camera axes
OpenGL's), row by row in ``t_00`` to ``t_23``; what ``corrected_*`` hold is undistorted and bundle-adjusted, and absent
for large scans; depth is in millimetres, along z as ARKit gives it, smaller than the image, and its intrinsics are the
image's, scaled. Principal points count from the corner of the first pixel, as Apple documents its intrinsic matrix
(AVCameraCalibrationData). Newer exports leave ``width`` and ``height`` out of the corrected cameras (nerfstudio,
pull request 3725): they are those of the camera before correction.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.lenses import finite, lens, pinhole, scaled
from gtlayout.io.cameras.poses import cam_from_world_opengl
from gtlayout.io.files import read_json
from gtlayout.io.lens import Lens
from gtlayout.io.pixels.images import size_of_first
from gtlayout.io.sources import PosedImage, PosedImages, Reader, usable
from gtlayout.scene import FloatArray

FOLDER = "keyframes"
CORRECTED, ORIGINAL = ("corrected_cameras", "corrected_images"), ("cameras", "images")
DEPTH = "depth"


def read_polycam(_root: Path, path: Path) -> PosedImages:
    """Read the cameras in the keyframes folder ``path``, the corrected ones if there are any with images.

    Warnings say when nothing is corrected, and count the cameras that cannot be used and were left out.
    Raises GtlayoutError naming the file when none can be used.
    """
    cameras_folder, images_folder = _folders(path)
    files = sorted(cameras_folder.glob("*.json"))
    images = [images_folder / f"{file.stem}.jpg" for file in files]
    depths = [path / DEPTH / f"{file.stem}.png" for file in files]
    depth_size = size_of_first(depths)
    if size_of_first(images) is None:
        raise GtlayoutError(
            f"{path}: no image that can be read for any of {len(files)} cameras; looked for {images[0]}"
        )

    def posed(number: int) -> PosedImage:
        file, image, depth = files[number], images[number], depths[number]
        data = read_json(file)
        pose = cam_from_world_opengl(_world_from_cam(data, file), f"{file}: the pose (t_00 to t_23)")
        camera = _camera(data, path, file)
        depth_camera = pinhole(scaled(camera, depth_size, f"{file}: depth")) if depth_size and depth.is_file() else None
        return PosedImage(image.name, image, camera, *pose, depth if depth_camera else None, depth_camera)

    found, skipped = usable(range(len(files)), posed)
    drift = f"{path}: no corrected cameras, so poses may drift and images keep a little distortion"
    uncorrected = () if cameras_folder.name == CORRECTED[0] else (drift,)
    return PosedImages(tuple(found), (*uncorrected, *skipped), metric=True)


def _camera(data: dict[str, Any], path: Path, file: Path) -> Lens:
    """The camera as the file says, for images of the size that it says."""
    if "width" not in data and "height" not in data:
        original = path / ORIGINAL[0] / file.name
        data = {**data, **{key: value for key, value in read_json(original).items() if key in ("width", "height")}}
    width, height, *params = (_number(data, key, file) for key in ("width", "height", "fx", "fy", "cx", "cy"))
    return lens("PINHOLE", (width, height), params, str(file))


def _world_from_cam(data: dict[str, Any], file: Path) -> FloatArray:
    return np.array([[_number(data, f"t_{row}{column}", file) for column in range(4)] for row in range(3)])


def _number(data: dict[str, Any], key: str, file: Path) -> float:
    number = finite(data.get(key))
    if number is None:
        raise GtlayoutError(f"{file}: {key} must be a finite number, not {data.get(key)!r}")
    return number


def _folders(path: Path) -> tuple[Path, Path]:
    """The folders of the cameras and of their images: the corrected ones when both have content."""
    cameras, images = (path / name for name in CORRECTED)
    corrected = next(cameras.glob("*.json"), None) and next(images.glob("*.jpg"), None)
    return (cameras, images) if corrected else (path / ORIGINAL[0], path / ORIGINAL[1])


def _detect(root: Path) -> list[Path]:
    """``keyframes``, in the scene folder or the scene folder itself."""
    return [path for path in (root / FOLDER, root) if next(_folders(path)[0].glob("*.json"), None)][:1]


READER = Reader("Polycam", "keyframes/ with corrected_cameras/ or cameras/", _detect, read_polycam)
