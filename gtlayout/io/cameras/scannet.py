"""ScanNet's export of ``.sens`` files, and the layout of 7-Scenes and 3DMatch. Poses are camera-to-world, in metres.

ScanNet: ``color/N.jpg``, ``depth/N.png``, ``pose/N.txt`` and ``intrinsic/`` with ``intrinsic_color.txt`` and others.
7-Scenes and 3DMatch: ``frame-000000.{color.jpg,depth.png,pose.txt}``, with ``camera-intrinsics.txt`` (3x3, for both) in
the same folder or in the one above. Annotations are ours, in the same folder.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.archives import read_text
from gtlayout.io.cameras.lenses import lens, pinhole
from gtlayout.io.cameras.poses import cam_from_world, rigid
from gtlayout.io.files import write_all_atomic, write_atomic
from gtlayout.io.lens import Lens
from gtlayout.io.pixels.exports import depth_mm, write_depth, write_jpeg
from gtlayout.io.pixels.images import encoded, size_of_first
from gtlayout.io.pixels.registration import Pinhole, Registration
from gtlayout.io.sources import PosedImage, PosedImages, Reader, usable
from gtlayout.scene import FloatArray, Frame, Scene

HALF_PX = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
"""ScanNet's principal points (319.5 of 640) count from the centre of the first pixel, ours from its corner."""
POSE_SUFFIX = ".pose.txt"
IMAGE_SUFFIXES = (".jpg", ".png")


def read_scannet(_root: Path, path: Path) -> PosedImages:
    """Read the poses in ``path`` and what is beside them.

    Frames whose pose was lost (not finite) are left out, with a warning.

    Depth maps may have another size and other intrinsics than the images, but not another pose. They are left out,
    with a warning, where ``extrinsic_color.txt`` and ``extrinsic_depth.txt`` differ.
    Raises GtlayoutError naming the file that is absent, damaged, or no camera.
    """
    root = path.parent if path.name == "pose" else path
    read, skipped = usable(_pose_files(path), lambda file: (file, _pose(file)))
    poses = dict(read)
    found = {file: pose for file, pose in poses.items() if np.all(np.isfinite(pose))}
    if not found:
        raise GtlayoutError(f"{path}: no pose of {len(poses)} frames is finite")
    warnings = [*skipped]
    if len(found) < len(poses):
        first = next(file for file in poses if file not in found)
        warnings.append(
            f"{len(poses) - len(found)} of {len(poses)} frames lost their pose and were skipped, first {first}"
        )
    files = [_files_of(file, root) for file in found]
    size = size_of_first([image for image, _ in files])
    if size is None:
        raise GtlayoutError(
            f"{path}: no image file that can be read for any of {len(found)} poses; looked for {files[0][0]}"
        )
    depth_size = size_of_first([depth for _, depth in files])
    K, depth_K, apart = _intrinsics(root, path)
    if apart and depth_size:
        warnings.append(f"{root}: depth left out, its camera has another pose than the image's (intrinsic/extrinsic_*)")
    camera = _lens(K, size, f"{path}: the image's intrinsics")
    depth_camera = None
    if depth_size and not apart:
        try:
            depth_camera = pinhole(_lens(depth_K, depth_size, f"{path}: the depth map's intrinsics"))
        except GtlayoutError as error:
            warnings.append(f"{root}: depth left out; {error}")
    images = []
    for pose, (image, depth) in zip(found.values(), files, strict=True):
        R_cam_from_world, t_cam_from_world = cam_from_world(pose[:3, :3], pose[:3, 3])
        # A path that is no file: nothing is there, and nothing else is looked for.
        depth_path = depth if depth_camera else root
        images.append(
            PosedImage(image.name, image, camera, R_cam_from_world, t_cam_from_world, depth_path, depth_camera)
        )
    return PosedImages(tuple(images), tuple(warnings), metric=True)


def write_scannet(scene: Scene, out: Path, depth_camera: Pinhole | None = None) -> tuple[Frame, ...]:
    """Write images, depth and cameras to the folder ``out`` as ScanNet's reader exports them; returns the frames there.

    Depth is resampled to ``depth_camera``, as a sensor of its own has it, or keeps the images' when that is None.
    Raises GtlayoutError when the scene is not metric, frames differ in their intrinsics, an image cannot be read, or
    the disk does not take them.
    """
    if not scene.metric:
        raise GtlayoutError(f"cannot write {out}: ScanNet's unit is the metre, the scene has none")
    first = scene.frames[0].camera
    pinhole = Pinhole(first.K, first.width, first.height)
    for camera in (frame.camera for frame in scene.frames):
        if (camera.width, camera.height) != (first.width, first.height) or not np.allclose(camera.K, first.K):
            raise GtlayoutError(f"cannot write {out}: the format knows one camera, the scene's frames have several")
    sensor_K = pinhole.K if depth_camera is None else depth_camera.K
    texts: dict[Path, bytes | str] = {
        out / "intrinsic" / "intrinsic_color.txt": _text(_four_by_four(pinhole.K - HALF_PX)),
        out / "intrinsic" / "intrinsic_depth.txt": _text(_four_by_four(sensor_K - HALF_PX)),
        out / "intrinsic" / "extrinsic_color.txt": _text(np.eye(4)),
        out / "intrinsic" / "extrinsic_depth.txt": _text(np.eye(4)),
    }
    written = []
    for i, frame in enumerate(scene.frames):
        image, depth = out / "color" / f"{i}.jpg", out / "depth" / f"{i}.png"
        write_jpeg(image, frame)
        if depth_camera is None:
            write_depth(depth, frame)
        elif frame.depth_path is not None:
            write_atomic(depth, encoded(".png", Registration(pinhole, depth_camera)(depth_mm(frame))))
        world_from_cam = _four_by_four(frame.camera.R_cam_from_world.T)
        world_from_cam[:3, 3] = frame.camera.center_world
        texts[out / "pose" / f"{i}.txt"] = _text(world_from_cam)
        written.append(Frame(image.name, image, frame.camera))
    write_all_atomic(texts)
    return tuple(written)


def _detect(root: Path) -> list[Path]:
    if (root / "pose").is_dir() and (root / "intrinsic").is_dir():
        return [root / "pose"]
    return [root] if next(root.glob(f"frame-*{POSE_SUFFIX}"), None) else []


def _pose_files(path: Path) -> list[Path]:
    if path.name == "pose":
        return sorted(path.glob("*.txt"))
    return sorted(path.glob(f"frame-*{POSE_SUFFIX}"))


def _files_of(pose: Path, root: Path) -> tuple[Path, Path]:
    """The image (the one that is there, or the one that should be) and the depth map of a pose."""
    if pose.name.endswith(POSE_SUFFIX):
        stem = pose.name.removesuffix(POSE_SUFFIX)
        images = [root / f"{stem}.color{suffix}" for suffix in IMAGE_SUFFIXES]
        depth = root / f"{stem}.depth.png"
    else:
        images = [root / "color" / f"{pose.stem}{suffix}" for suffix in IMAGE_SUFFIXES]
        depth = root / "depth" / f"{pose.stem}.png"
    return next((image for image in images if image.is_file()), images[0]), depth


def _intrinsics(root: Path, path: Path) -> tuple[FloatArray, FloatArray, bool]:
    """(3, 3) intrinsics of the image and of the depth map, and whether these have different poses."""
    if path.name != "pose":
        here, above = root / "camera-intrinsics.txt", root.resolve().parent / "camera-intrinsics.txt"
        if not here.exists() and not above.exists():
            # 7-Scenes comes without; 525 is what its users take for the colour camera, 585 the depth camera's own.
            raise GtlayoutError(
                f"no intrinsics for the frames in {root}: write {here} with the image's 3x3 matrix, three lines "
                "'fx 0 cx', '0 fy cy', '0 0 1' (for 7-Scenes '525 0 320', '0 525 240', '0 0 1')"
            )
        K = _camera_matrix(here if here.exists() else above, 3)
        return K, K, False
    folder = root / "intrinsic"
    K = _camera_matrix(folder / "intrinsic_color.txt", 4) + HALF_PX
    depth_file = folder / "intrinsic_depth.txt"
    depth_K = _camera_matrix(depth_file, 4) + HALF_PX if depth_file.exists() or (root / "depth").is_dir() else K
    files = [folder / f"extrinsic_{camera}.txt" for camera in ("color", "depth")]
    color, depth = (_matrix(file, (4, 4)) if file.exists() else np.eye(4) for file in files)
    return K, depth_K, not np.allclose(color, depth, atol=1e-6)


def _lens(K: FloatArray, size: tuple[int, int], where: str) -> Lens:
    """A camera for images of ``size``; the files do not say for which they are."""
    return lens("PINHOLE", size, [K[0, 0], K[1, 1], K[0, 2], K[1, 2]], where, size_is_stated=False)


def _camera_matrix(file: Path, size: int) -> FloatArray:
    K = _matrix(file, (size, size))[:3, :3]
    if not np.all(np.isfinite(K)) or min(K[0, 0], K[1, 1]) <= 0 or np.any(np.abs(K[[0, 1, 2, 2], [1, 0, 0, 1]]) > 1e-6):
        raise GtlayoutError(f"{file} holds no pinhole intrinsics without skew")
    return K


def _pose(file: Path) -> FloatArray:
    """(4, 4) camera-to-world, the rotation made orthonormal; not finite where it was lost."""
    pose = _matrix(file, (4, 4))
    if np.all(np.isfinite(pose)):
        pose[:3, :3], pose[:3, 3] = rigid(pose, f"{file}: the pose")
    return pose


def _matrix(file: Path, shape: tuple[int, int]) -> FloatArray:
    try:
        return np.array([float(word) for word in read_text(file).split()]).reshape(shape)
    except ValueError as error:
        raise GtlayoutError(f"{file} must hold {shape[0]}x{shape[1]} numbers") from error


def _four_by_four(matrix: FloatArray) -> FloatArray:
    result = np.eye(4)
    result[:3, :3] = matrix
    return result


def _text(matrix: FloatArray) -> str:
    """Rows of numbers that read back exactly."""
    return "".join(" ".join(repr(float(value)) for value in row) + "\n" for row in matrix)


READER = Reader("ScanNet", "pose/ and intrinsic/, or frame-*.pose.txt", _detect, read_scannet)
