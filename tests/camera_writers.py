"""Camera formats that are read but not written by gtlayout: a folder as the tool leaves it, for scenes in metres.

Each writes images, depth and cameras, and returns the frames as they are called there.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np

from gtlayout.io.colmap import write_colmap
from gtlayout.io.exports import write_depth, write_image, write_jpeg
from gtlayout.io.files import write_atomic, write_json_atomic
from gtlayout.io.images import read_gray
from gtlayout.io.scene_writers import CAMERA_WRITERS
from gtlayout.scene import Frame, Scene

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def write_colmap_binary(scene: Scene, out: Path) -> tuple[Frame, ...]:
    """As the text format, but binary."""
    frames = CAMERA_WRITERS["colmap"](scene, out)
    shutil.rmtree(out / "sparse")
    write_colmap(out / "sparse/0", frames, binary=True)
    return frames


def write_seven_scenes(scene: Scene, out: Path) -> tuple[Frame, ...]:
    """``frame-000000.{color.jpg,depth.png,pose.txt}`` and one 3x3 matrix of intrinsics for all."""
    written = []
    for i, frame in enumerate(scene.frames):
        stem = f"frame-{i:06d}"
        image = write_image(out, Frame(f"{stem}.color.jpg", frame.image_path, frame.camera))
        write_depth(out / f"{stem}.depth.png", frame)
        _save_matrix(out / f"{stem}.pose.txt", _world_from_cam(frame))
        written.append(Frame(image.name, image, frame.camera))
    _save_matrix(out / "camera-intrinsics.txt", scene.frames[0].camera.K)
    return tuple(written)


def write_arkitscenes(scene: Scene, out: Path) -> tuple[Frame, ...]:
    """``lowres_wide.traj``, and an image, a depth map and a ``.pincam`` per time; images are PNG, here grey ones.

    Grey is what a JPEG decodes to when grey is asked for: converted from colour it would differ by rounding.
    """
    written, trajectory = [], []
    for i, frame in enumerate(scene.frames):
        camera, seconds = frame.camera, 5.0 + 0.1 * i
        name = f"41_{seconds:.3f}"
        image = out / "lowres_wide" / f"{name}.png"
        write_atomic(image, cv2.imencode(".png", read_gray(frame))[1].tobytes())
        write_depth(out / "lowres_depth" / image.name, frame)
        K = camera.K
        pincam = [camera.width, camera.height, *(float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))]
        write_atomic(out / "lowres_wide_intrinsics" / f"{name}.pincam", " ".join(map(repr, pincam)))
        axis_angle = cv2.Rodrigues(camera.R_cam_from_world)[0].ravel()
        pose = [seconds, *axis_angle.tolist(), *camera.t_cam_from_world.tolist()]
        trajectory.append(" ".join(map(repr, pose)))
        written.append(Frame(image.name, image, camera))
    write_atomic(out / "lowres_wide.traj", "\n".join(trajectory) + "\n")
    return tuple(written)


def write_polycam(scene: Scene, out: Path) -> tuple[Frame, ...]:
    """``keyframes/`` with corrected images and cameras, and depth."""
    written = []
    for i, frame in enumerate(scene.frames):
        camera, stem = frame.camera, str(1_000_000_000 + 33_333_333 * i)
        image = out / "keyframes/corrected_images" / f"{stem}.jpg"
        write_jpeg(image, frame)
        write_depth(out / "keyframes/depth" / f"{stem}.png", frame)
        K, pose = camera.K, _world_from_cam(frame) @ OPENGL_FROM_OPENCV
        intrinsics = {"width": camera.width, "height": camera.height, "fx": K[0, 0], "fy": K[1, 1]}
        rows = {f"t_{row}{column}": pose[row, column] for row in range(3) for column in range(4)}
        path = out / "keyframes/corrected_cameras" / f"{stem}.json"
        write_json_atomic(path, {**intrinsics, "cx": K[0, 2], "cy": K[1, 2], **rows})
        written.append(Frame(image.name, image, camera))
    return tuple(written)


def _world_from_cam(frame: Frame) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = frame.camera.R_cam_from_world.T
    result[:3, 3] = frame.camera.center_world
    return result


def _save_matrix(path: Path, matrix: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, matrix, fmt="%.17g")
