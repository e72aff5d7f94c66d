"""ARKitScenes: a scan of the raw or 3dod release, with the poses and intrinsics that Apple published for it.

``<kind>.traj`` holds a pose a line: time in seconds, axis-angle in radians, translation in metres. The data set's
documentation (DATA.md) leaves out the rest: its own loader (tenFpsDataLoader.py) inverts the pose to get
camera-to-world, and the camera's axes are x right, y down, z forward (its issue 81). ``<kind>_intrinsics`` holds a
``.pincam`` an image: width, height, fx, fy, cx, cy. Poses come at 10 Hz, images at up to 60.
"""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.archives import read_text
from gtlayout.io.cameras.lenses import lens, pinhole
from gtlayout.io.cameras.poses import rigid
from gtlayout.io.cameras.timestamps import match_times
from gtlayout.io.lens import Lens
from gtlayout.io.pixels.registration import Pinhole
from gtlayout.io.sources import PosedImage, PosedImages, Reader
from gtlayout.scene import FloatArray

Stamped = tuple[FloatArray, list[Path]]
"""Times in seconds, and the file of each."""
Pose = tuple[FloatArray, FloatArray]
"""(3, 3) rotation and (3,) translation of ``cam_from_world``."""
KINDS = ("wide", "vga_wide", "lowres_wide")
"""Image folders, best first: one lens at three resolutions, so that any trajectory serves all (issue 32)."""
DEPTH, DEPTH_INTRINSICS = "lowres_depth", "lowres_wide_intrinsics"
TOLERANCE_S = 0.001
"""Between pose and image: the names of images are rounded to milliseconds."""
INTRINSICS_TOLERANCE_S = 0.1
"""One step of 10 Hz: the focus moves slowly."""
MAX_ANGLE = 1e3
"""Radians; an axis-angle beyond it is damage, not many turns."""
TIME = re.compile(r"(?:.*_)?(\d+(?:\.\d+)?)")
"""The stem of an image or of a .pincam: the scan's id, if any, and the time in seconds."""


def read_arkitscenes(_root: Path, path: Path) -> PosedImages:
    """Read the trajectory ``path`` and the images beside it that have a pose and intrinsics; metric.

    Images come from the first of ``wide``, ``vga_wide`` and ``lowres_wide`` of which any has both; depth from
    ``lowres_depth``. Images without, and lines that are no pose, are counted in a warning each.
    Raises GtlayoutError naming the file when no image is left.
    """
    times, poses, warnings = _read_trajectory(path)
    folder = path.parent
    tried = []
    for kind in KINDS:
        stamped = _by_time(folder / kind, ".png")
        images, problems = _posed_images(stamped, times, poses, folder, kind)
        if images:
            if _by_time(folder / DEPTH, ".png")[1] and not any(image.depth_path for image in images):
                warnings.append(
                    f"{folder / DEPTH} was left out: no map has an image and a .pincam in {DEPTH_INTRINSICS}"
                )
            if problems:
                warnings.append(
                    f"{len(problems)} of {len(stamped[1])} images of {folder / kind} were skipped, {problems[0]}"
                )
            return PosedImages(tuple(images), tuple(warnings), metric=True)
        tried.extend(problems[:1])
    if not tried:
        raise GtlayoutError(f"{folder} has no images; looked for {', '.join(KINDS)} with <scan>_<seconds>.png")
    raise GtlayoutError(f"{path}: no image has a pose and intrinsics; {'; '.join(tried)}")


def _posed_images(
    stamped: Stamped, times: FloatArray, poses: list[Pose], folder: Path, kind: str
) -> tuple[list[PosedImage], list[str]]:
    """The images of ``kind`` that have all they need, and what the others lack."""
    intrinsics = _by_time(folder / f"{kind}_intrinsics", ".pincam")
    depths, depth_intrinsics = _by_time(folder / DEPTH, ".png"), _by_time(folder / DEPTH_INTRINSICS, ".pincam")
    seconds, files = stamped
    pose_of = match_times(seconds, times, TOLERANCE_S)
    depth_of = match_times(seconds, depths[0], TOLERANCE_S)
    images, problems = [], []
    for time, file, i_pose, i_depth in zip(seconds, files, pose_of, depth_of, strict=True):
        if i_pose < 0:
            problems.append(f"{file.name}: no pose within {TOLERANCE_S * 1000:g} ms")
            continue
        camera_file = _nearest(intrinsics, time)
        if camera_file is None:
            problems.append(f"{file.name}: no .pincam of about its time in {folder / f'{kind}_intrinsics'}")
            continue
        try:
            camera = _read_pincam(camera_file)
        except GtlayoutError as error:
            problems.append(f"{file.name}: {error}")
            continue
        depth_camera = _depth_camera(depth_intrinsics, time) if i_depth >= 0 else None
        depth = depths[1][i_depth] if depth_camera else None
        R_cam_from_world, t_cam_from_world = poses[i_pose]
        images.append(PosedImage(file.name, file, camera, R_cam_from_world, t_cam_from_world, depth, depth_camera))
    return images, problems


def _read_trajectory(path: Path) -> tuple[FloatArray, list[Pose], list[str]]:
    """Times in seconds, the pose of each, and a warning if lines were bad."""
    times, poses, bad = [], [], []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        values = _floats(line)
        if values is not None and len(values) == 7 and np.all(np.abs(values[1:4]) <= MAX_ANGLE):
            times.append(values[0])
            rotation = cv2.Rodrigues(values[1:4])[0]
            poses.append(rigid(np.column_stack([rotation, values[4:]]), f"{path}, line {number}: the pose"))
        elif line.strip():
            bad.append(number)
    if not poses:
        raise GtlayoutError(f"{path} holds no pose; a line is: seconds, axis-angle (3), translation (3)")
    many = f"{path}: {len(bad)} lines are no pose and were skipped, first line {bad[0]}" if bad else ""
    return np.array(times), poses, [many] if many else []


def _read_pincam(path: Path) -> Lens:
    """The camera; its principal point counts from the corner of the first pixel.

    DATA.md does not say so: it is an assumption, from how Apple documents its intrinsic matrix elsewhere
    (AVCameraCalibrationData).
    """
    values = _floats(read_text(path))
    if values is None or len(values) != 6:
        raise GtlayoutError(f"{path} must hold 6 finite numbers: width, height, fx, fy, cx, cy")
    width, height, *params = (float(value) for value in values)
    return lens("PINHOLE", (width, height), params, str(path))


def _depth_camera(intrinsics: Stamped, time: float) -> Pinhole | None:
    """The camera of a depth map; None, so that the map is not used, when it is not there or damaged."""
    file = _nearest(intrinsics, time)
    if file is None:
        return None
    try:
        return pinhole(_read_pincam(file))
    except GtlayoutError:
        return None


def _by_time(folder: Path, suffix: str) -> Stamped:
    """The files of a folder, which need not exist, in order of the times in their names."""
    matches = [(TIME.fullmatch(file.stem), file) for file in folder.glob(f"*{suffix}")]
    stamped = sorted((float(match[1]), file) for match, file in matches if match)
    return np.array([time for time, _ in stamped]), [file for _, file in stamped]


def _nearest(stamped: Stamped, time: float) -> Path | None:
    """The file nearest in time, which neighbours may share; None when it is too far."""
    times, files = stamped
    if not files:
        return None
    nearest = int(np.abs(times - time).argmin())
    return files[nearest] if abs(times[nearest] - time) <= INTRINSICS_TOLERANCE_S else None


def _floats(text: str) -> FloatArray | None:
    """The words of a text as finite numbers; None when one is none."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    return values if np.all(np.isfinite(values)) else None


def _detect(root: Path) -> list[Path]:
    """The trajectory in the scan's folder, or one level down in ``<scan>_frames`` as 3dod has it."""
    folders = [root, *sorted(folder for folder in root.glob("*_frames") if folder.is_dir())]
    found = ([folder / f"{kind}.traj" for kind in reversed(KINDS)] for folder in folders)
    return [first for files in found if (first := next(filter(Path.is_file, files), None))]


def _recognise(path: Path) -> list[Path]:
    return [path] if path.is_file() and path.suffix == ".traj" else []


READER = Reader("ARKitScenes", "lowres_wide.traj", _detect, read_arkitscenes, _recognise)
