"""COLMAP sparse models, text and binary, through pycolmap."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.colmap.binary import check_lengths
from gtlayout.io.cameras.lenses import check_lens
from gtlayout.io.cameras.poses import nearest_rotation
from gtlayout.io.files import path_inside
from gtlayout.io.image_names import FilesOnDisk
from gtlayout.io.sources import PosedImage, PosedImages, Reader
from gtlayout.scene import FloatArray, Frame

PARTS = ("cameras", "images", "points3D")


def read_colmap(root: Path, model: Path) -> PosedImages:
    """Read the model in folder ``model``; its images are looked for in ``root/images``, else in ``root``.

    A folder that holds the model as text and as binary is read as binary, as COLMAP does, with a warning.
    Raises GtlayoutError naming the folder or the image when the model is incomplete, damaged or not finite.
    """
    images = posed_images(open_model(model), root, f"COLMAP model {model}")
    both = (model / "images.bin").exists() and (model / "images.txt").exists()
    return PosedImages(images, (f"{model} holds text and binary: the binary model was read",) if both else ())


def open_model(model: Path) -> pycolmap.Reconstruction:
    """The model in folder ``model``, text or binary. Raises GtlayoutError when it is incomplete or damaged."""
    missing = _missing_parts(model)
    if missing:
        raise GtlayoutError(f"COLMAP model {model} is incomplete: no {' and no '.join(missing)} as .bin or .txt")
    check_lengths(model)
    try:
        return pycolmap.Reconstruction(str(model))
    except (ValueError, IndexError, RuntimeError, MemoryError) as error:
        raise GtlayoutError(f"COLMAP model {model} cannot be read: {' '.join(str(error).split())}") from error


def posed_images(model: pycolmap.Reconstruction, root: Path, where: str) -> tuple[PosedImage, ...]:
    """The images of ``model`` that have a pose; ``root`` as for ``read_colmap``.

    Raises GtlayoutError, beginning with ``where``, when there is none or one is not what it should be.
    """
    try:
        posed = [image for image in model.images.values() if image.has_pose]
        names = [image.name for image in posed]
        poses = [image.cam_from_world().matrix() for image in posed]
    except (ValueError, IndexError, RuntimeError) as error:
        raise GtlayoutError(f"{where} cannot be read: {' '.join(str(error).split())}") from error
    if not posed:
        raise GtlayoutError(f"{where} holds no image with a pose")
    for camera in model.cameras.values():
        check_lens(camera, f"{where}: camera {camera.camera_id}")
    folder = _image_folder(root, [path_inside(root, name, where) for name in names])
    return tuple(
        PosedImage(name, path_inside(folder, name, where), image.camera, *_rotation_translation(pose, where, name))
        for image, name, pose in zip(posed, names, poses, strict=True)
    )


def write_colmap(model: Path, frames: Sequence[Frame], *, binary: bool = False) -> None:
    """Write the frames' pinhole cameras as a COLMAP model without points into folder ``model`` (made if absent).

    Frames with the same intrinsics share a camera. Raises GtlayoutError when the folder cannot be written.
    """
    reconstruction = pycolmap.Reconstruction()
    camera_ids: dict[tuple[float, ...], int] = {}
    for image_id, frame in enumerate(frames, start=1):
        K, camera = frame.camera.K, frame.camera
        key = (camera.width, camera.height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        if key not in camera_ids:
            camera_ids[key] = len(camera_ids) + 1
            reconstruction.add_camera_with_trivial_rig(
                pycolmap.Camera(
                    camera_id=camera_ids[key], model="PINHOLE", width=key[0], height=key[1], params=list(key[2:])
                )
            )
        cam_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(camera.R_cam_from_world), camera.t_cam_from_world)
        image = pycolmap.Image(name=frame.name, camera_id=camera_ids[key], image_id=image_id)
        reconstruction.add_image_with_trivial_frame(image, cam_from_world)
    try:
        model.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=model, prefix=".tmp") as temporary:
            (reconstruction.write_binary if binary else reconstruction.write_text)(temporary)
            for part in sorted(Path(temporary).iterdir()):
                part.replace(model / part.name)
    except OSError as error:
        raise GtlayoutError(f"cannot write {model}: {error.strerror or error}") from error


def find_models(root: Path) -> list[Path]:
    """Folders that hold a part of a model: the root, ``sparse``, ``sparse/0``, ``sparse/1`` …"""
    sparse = root / "sparse"
    below = sorted(p for p in sparse.iterdir() if p.is_dir()) if sparse.is_dir() else []
    models = [folder for folder in (sparse, *below) if len(_missing_parts(folder)) < len(PARTS)]
    # In the scene folder itself other formats, too, have a cameras.txt.
    return [root, *models] if "images" not in _missing_parts(root) else models


def _missing_parts(model: Path) -> list[str]:
    """The parts that are there neither in the one form nor in the other, for the more complete form."""
    by_form = [[part for part in PARTS if not (model / f"{part}.{form}").is_file()] for form in ("bin", "txt")]
    return min(by_form, key=len)


def _image_folder(root: Path, in_root: list[Path]) -> Path:
    """``images/`` in the scene folder or the scene folder itself, whichever holds an image."""
    images, files = root / "images", FilesOnDisk()
    if any(files.find(images / path.relative_to(root)) for path in in_root):
        return images
    return root if any(map(files.find, in_root)) else images


def _rotation_translation(cam_from_world: FloatArray, where: str, name: str) -> tuple[FloatArray, FloatArray]:
    if not np.all(np.isfinite(cam_from_world)):
        raise GtlayoutError(f"{where}: the pose of {name} is not finite")
    # Text quaternions are normalised by pycolmap, binary ones are taken as they are.
    rotation = nearest_rotation(cam_from_world[:, :3], f"{where}: the pose of {name}")
    return rotation, np.ascontiguousarray(cam_from_world[:, 3])


READER = Reader("COLMAP", "sparse/0, sparse/ or the folder itself with cameras.bin/.txt", find_models, read_colmap)
