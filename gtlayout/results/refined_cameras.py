"""Corrected or refined cameras beside the results: ``cameras.json``, in nerfstudio's form of ``transforms.json``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.nerfstudio import file_path, read_transforms, transforms
from gtlayout.io.files import json_text
from gtlayout.scene import Scene

FILE = "cameras.json"


def refined_cameras_text(scene: Scene) -> str:
    """The cameras of ``scene`` as the file holds them: image paths relative to the scene folder, no distortion."""
    return json_text(transforms(scene.root, scene.frames))


def with_refined_cameras(scene: Scene, folder: Path) -> Scene:
    """The scene with the cameras that its layout in ``folder`` was solved with; unchanged when they are the given ones.

    Raises GtlayoutError when the file is damaged or lacks a frame of the scene.
    """
    path = folder / FILE
    if not path.exists():
        return scene
    poses = {image.image_path: image for image in read_transforms(scene.root, path).images}
    frames = []
    for frame in scene.frames:
        pose = poses.get(scene.root / file_path(scene.root, frame))
        if pose is None:
            raise GtlayoutError(f"{path} has no camera for {frame.name}; solve the scene again")
        camera = replace(
            frame.camera,
            K=pose.camera.K,
            R_cam_from_world=pose.R_cam_from_world,
            t_cam_from_world=pose.t_cam_from_world,
        )
        frames.append(replace(frame, camera=camera))
    return replace(scene, frames=tuple(frames))
