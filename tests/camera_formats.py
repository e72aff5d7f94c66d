"""The same small scene in every camera format, written from the formats' descriptions and not by our own writers."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gtlayout.io.cameras.colmap.reader import write_colmap
from gtlayout.scene import Camera, FloatArray, Frame

WIDTH, HEIGHT = 64, 48
OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
Write = Callable[[Path, Sequence[Camera]], list[Path]]
"""Scene folder and cameras → the camera files written; images and annotations are written, too."""


def cameras_in_general_position(count: int = 5) -> list[Camera]:
    rng = np.random.default_rng(1)
    K = np.array([[61.25, 0, 30.5], [0, 62.75, 25.125], [0, 0, 1]])
    rotations = [cv2.Rodrigues(rng.normal(size=3))[0].astype(np.float64) for _ in range(count)]
    return [Camera(K, rotation, rng.normal(size=3) * 3, WIDTH, HEIGHT) for rotation in rotations]


def colmap_text(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    return _colmap(root, cameras, binary=False)


def colmap_binary(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    return _colmap(root, cameras, binary=True)


def nerfstudio(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    names = _images(root, [f"images/{i:03d}.png" for i in range(len(cameras))], "images")
    frames = [
        {
            **_intrinsics(camera, ("fl_x", "fl_y", "cx", "cy"), ("w", "h")),
            "file_path": f"images/{name}",
            "transform_matrix": (_world_from_cam(camera) @ OPENGL_FROM_OPENCV).tolist(),
        }
        for name, camera in zip(names, cameras, strict=True)
    ]
    return [_json(root / "transforms.json", {"camera_model": "OPENCV", "frames": frames})]


def cad_estate(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    times = [1000 * i for i in range(len(cameras))]
    _images(root, [f"images/vid_{time}.jpg" for time in times], "images")
    frames = []
    for time, camera in zip(times, cameras, strict=True):
        x, y, z, w = Rotation.from_matrix(camera.R_cam_from_world).as_quat()
        pose = {"translation": camera.t_cam_from_world.tolist(), "rotation": [w, x, y, z]}
        intrinsics = list(_intrinsics(camera, ("fx", "fy", "cx", "cy"), ("w", "h")).values())[:4]
        frames.append({"timestamp": time, "key_frame": False, "intrinsics": intrinsics, "extrinsics": pose})
    return [_json(root / "frames.json", {"clip_name": "vid_0", "image_size": [HEIGHT, WIDTH], "frames": frames})]


def scannet(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    """Its principal points count from the centre of the first pixel."""
    _images(root, [f"color/{i}.jpg" for i in range(len(cameras))], "color")
    K = np.eye(4)
    K[:3, :3] = cameras[0].K
    K[:2, 2] -= 0.5
    files = [_matrix(root / f"pose/{i}.txt", _world_from_cam(camera)) for i, camera in enumerate(cameras)]
    return [*files, _matrix(root / "intrinsic/intrinsic_color.txt", K)]


def seven_scenes(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    stems = [f"frame-{i:06d}" for i in range(len(cameras))]
    _images(root, [f"{stem}.color.png" for stem in stems], "")
    files = [
        _matrix(root / f"{stem}.pose.txt", _world_from_cam(camera)) for stem, camera in zip(stems, cameras, strict=True)
    ]
    return [*files, _matrix(root / "camera-intrinsics.txt", cameras[0].K)]


def arkitscenes(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    times = [78067.083 + 0.1 * i for i in range(len(cameras))]
    stems = [f"42446103_{time:.3f}" for time in times]
    _images(root, [f"lowres_wide/{stem}.png" for stem in stems], "lowres_wide")
    lines, files = [], []
    for time, stem, camera in zip(times, stems, cameras, strict=True):
        angle_axis = Rotation.from_matrix(camera.R_cam_from_world).as_rotvec()
        lines.append(" ".join(map(repr, map(float, (time + 2e-4, *angle_axis, *camera.t_cam_from_world)))))
        fx, fy, cx, cy = _intrinsics(camera, ("fx", "fy", "cx", "cy"), ()).values()
        files.append(
            _text(root / f"lowres_wide_intrinsics/{stem}.pincam", f"{camera.width} {camera.height} {fx} {fy} {cx} {cy}")
        )
    return [_text(root / "lowres_wide.traj", "\n".join(lines) + "\n"), *files]


def re10k(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    times = [100_000 * i for i in range(len(cameras))]
    _images(root, [f"images/{time}.jpg" for time in times], "images")
    lines = ["https://example.org/watch?v=vid"]
    for time, camera in zip(times, cameras, strict=True):
        fx, fy, cx, cy = _intrinsics(camera, ("fx", "fy", "cx", "cy"), ()).values()
        shares = [fx / WIDTH, fy / HEIGHT, cx / WIDTH, cy / HEIGHT]
        pose = np.column_stack([camera.R_cam_from_world, camera.t_cam_from_world]).ravel().tolist()
        lines.append(" ".join([str(time), *map(repr, shares), "0", "0", *map(repr, pose)]))
    return [_text(root / "cameras.txt", "\n".join(lines) + "\n")]


def polycam(root: Path, cameras: Sequence[Camera]) -> list[Path]:
    stems = [str(262195552056 + 1000 * i) for i in range(len(cameras))]
    _images(root, [f"keyframes/corrected_images/{stem}.jpg" for stem in stems], "keyframes/corrected_images")
    files = []
    for stem, camera in zip(stems, cameras, strict=True):
        pose = _world_from_cam(camera) @ OPENGL_FROM_OPENCV
        values = {f"t_{row}{column}": float(pose[row, column]) for row in range(3) for column in range(4)}
        intrinsics = _intrinsics(camera, ("fx", "fy", "cx", "cy"), ("width", "height"))
        files.append(_json(root / f"keyframes/corrected_cameras/{stem}.json", {**intrinsics, **values}))
    return files


FORMATS: dict[str, Write] = {
    write.__name__: write
    for write in (
        *(colmap_text, colmap_binary, nerfstudio, cad_estate),
        *(scannet, seven_scenes, arkitscenes, polycam, re10k),
    )
}


def _colmap(root: Path, cameras: Sequence[Camera], *, binary: bool) -> list[Path]:
    names = _images(root, [f"images/{i:03d}.png" for i in range(len(cameras))], "images")
    frames = [Frame(name, root / "images" / name, camera) for name, camera in zip(names, cameras, strict=True)]
    write_colmap(root / "sparse/0", frames, binary=binary)
    return sorted((root / "sparse/0").iterdir())


def _images(root: Path, paths: list[str], folder: str) -> list[str]:
    """Write the images, and annotations for the second and the fourth; the images' names in their folder."""
    pixels = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    for path in paths:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(cv2.imencode(Path(path).suffix, pixels)[1].tobytes())
    names = [Path(path).relative_to(folder).as_posix() for path in paths]
    polygon = [[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]]
    wall = {"id": "e0", "label": "wall", "polygons": [polygon], "visible": [[[5, 5], [30, 5], [30, 30]]]}
    key_frames = [{"image": names[i], "elements": [wall], "occlusion_edges": []} for i in (1, 3)]
    _json(
        root / "annotations.json",
        {"format": "gtlayout-annotations/1", "image_size": [WIDTH, HEIGHT], "frames": key_frames},
    )
    return names


def _world_from_cam(camera: Camera) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3] = camera.R_cam_from_world.T
    pose[:3, 3] = camera.center_world
    return pose


def _intrinsics(camera: Camera, lens: Sequence[str], size: Sequence[str]) -> dict[str, float]:
    K = camera.K
    values = map(float, (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    return {**dict(zip(lens, values, strict=True)), **dict(zip(size, (camera.width, camera.height), strict=bool(size)))}


def _matrix(path: Path, matrix: FloatArray) -> Path:
    return _text(path, "\n".join(" ".join(map(repr, map(float, row))) for row in matrix) + "\n")


def _json(path: Path, data: object) -> Path:
    return _text(path, json.dumps(data))


def _text(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path
