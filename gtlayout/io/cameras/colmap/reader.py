"""COLMAP sparse models: binary ones through pycolmap, text line by line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.colmap.binary import check_lengths
from gtlayout.io.cameras.colmap.text import ModelImage, read_images
from gtlayout.io.cameras.lenses import check_lens
from gtlayout.io.cameras.poses import rigid
from gtlayout.io.files import path_inside, write_all_atomic
from gtlayout.io.image_names import FilesOnDisk
from gtlayout.io.lens import Lens, pycolmap_for
from gtlayout.io.scratch import scratch
from gtlayout.io.sources import PosedImage, PosedImages, Reader, usable
from gtlayout.scene import Frame

if TYPE_CHECKING:
    import pycolmap

PARTS = ("cameras", "images", "points3D")
Form = Literal["bin", "txt"]


def read_colmap(root: Path, model: Path) -> PosedImages:
    """Read the model in folder ``model``; its images are looked for in ``root/images``, else in ``root``.

    A folder that holds the model as text and as binary is read as binary, as COLMAP does, with a warning. Images whose
    line, camera, pose or name cannot be used are skipped, with a warning.
    Raises GtlayoutError naming the folder or the image when the model is incomplete or damaged, or nothing is left.
    """
    where = f"COLMAP model {model}"
    if _form(model) == "txt":
        images, skipped = read_images(model)
    else:
        images, skipped = model_images(open_model(model), where)
    both = (model / "images.bin").exists() and (model / "images.txt").exists()
    as_binary = (f"{model} holds text and binary: the binary model was read",) if both and _form(model) == "bin" else ()
    found = posed_images(images, root, where)
    return replace(found, warnings=(*as_binary, *skipped, *found.warnings))


def open_model(model: Path) -> pycolmap.Reconstruction:
    """The model in folder ``model``, text or binary. Raises GtlayoutError when it is incomplete or damaged."""
    form = _form(model)
    check_lengths(model)
    opened = pycolmap_for(f"COLMAP model {model}").Reconstruction()
    try:
        (opened.read_binary if form == "bin" else opened.read_text)(str(model))
    except (ValueError, IndexError, RuntimeError, MemoryError) as error:
        raise GtlayoutError(f"COLMAP model {model} cannot be read: {' '.join(str(error).split())}") from error
    if form == "txt":
        for image in read_images(model)[0]:
            opened.images[image.number].name = image.name
    return opened


def model_images(model: pycolmap.Reconstruction, where: str) -> tuple[list[ModelImage], tuple[str, ...]]:
    """The images of ``model`` that have a pose, and a warning that counts those whose pose cannot be read.

    Raises GtlayoutError, beginning with ``where``, when none is left.
    """

    cameras = {
        number: Lens(camera.model_name, camera.width, camera.height, tuple(map(float, camera.params)))
        for number, camera in model.cameras.items()
    }

    def read(number: int) -> ModelImage:
        image = model.images[number]
        try:
            pose = image.cam_from_world().matrix()
            return ModelImage(number, image.name, cameras[image.camera_id], image.camera_id, pose)
        except (ValueError, LookupError, RuntimeError) as error:
            raise GtlayoutError(f"{where}: image {number} cannot be read: {' '.join(str(error).split())}") from error

    try:
        posed = sorted(number for number, image in model.images.items() if image.has_pose)
    except (ValueError, IndexError, RuntimeError) as error:
        raise GtlayoutError(f"{where} cannot be read: {' '.join(str(error).split())}") from error
    if not posed:
        raise GtlayoutError(f"{where} holds no image with a pose")
    return usable(posed, read)


def posed_images(images: Sequence[ModelImage], root: Path, where: str) -> PosedImages:
    """Images of a model with the files they belong to; ``root`` as for ``read_colmap``.

    Raises GtlayoutError, beginning with ``where``, when none is what it should be.
    """
    folder = _image_folder(root, [image.name for image in images])

    def posed(image: ModelImage) -> PosedImage:
        file = path_inside(folder, image.name, where)
        check_lens(image.camera, f"{where}: camera {image.camera_number}")
        pose = rigid(image.cam_from_world, f"{where}: the pose of {image.name}")
        return PosedImage(file.relative_to(folder).as_posix(), file, image.camera, *pose)

    found, skipped = usable(images, posed)
    return PosedImages(tuple(found), skipped)


def write_colmap(model: Path, frames: Sequence[Frame], *, binary: bool = False) -> None:
    """Write the frames' pinhole cameras as a COLMAP model without points into folder ``model`` (made if absent).

    Frames with the same intrinsics share a camera. Raises GtlayoutError when the folder cannot be written.
    """
    pycolmap = pycolmap_for("writing a COLMAP model")
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
        with scratch(model, "model") as temporary:
            (reconstruction.write_binary if binary else reconstruction.write_text)(str(temporary))
            write_all_atomic({model / part.name: part.read_bytes() for part in sorted(temporary.iterdir())})
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
    return min((_missing(model, "bin"), _missing(model, "txt")), key=len)


def _form(model: Path) -> Form:
    """In which form to read a model. Raises GtlayoutError when it is complete in neither."""
    for form in get_args(Form):
        if not _missing(model, form):
            return form
    missing = " and no ".join(_missing_parts(model))
    raise GtlayoutError(f"COLMAP model {model} is incomplete: no {missing} as .bin or .txt")


def _missing(model: Path, form: Form) -> list[str]:
    return [part for part in PARTS if not (model / f"{part}.{form}").is_file()]


def _image_folder(root: Path, names: Sequence[str]) -> Path:
    """``images/`` in the scene folder or the scene folder itself, whichever holds an image."""
    images, files = root / "images", FilesOnDisk()
    return next((folder for folder in (images, root) if any(_is_in(folder, name, files) for name in names)), images)


def _is_in(folder: Path, name: str, files: FilesOnDisk) -> bool:
    try:
        return files.find(path_inside(folder, name, name)) is not None
    except GtlayoutError:
        return False


def _recognise(path: Path) -> list[Path]:
    """The folder of a model that was named, by itself, by one of its files, or by the folder above several."""
    if not path.is_dir():
        names = {f"{part}.{form}" for part in PARTS for form in get_args(Form)}
        return [path.parent] if path.is_file() and path.name in names else []
    folders = [path, *(p for p in sorted(path.iterdir()) if p.is_dir())]
    return [folder for folder in folders if len(_missing_parts(folder)) < len(PARTS)]


READER = Reader(
    "COLMAP",
    "sparse/0, sparse/ or the folder itself with cameras.bin/.txt",
    find_models,
    read_colmap,
    _recognise,
    in_parts=True,
)
