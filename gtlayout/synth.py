"""Synthetic scenes with known truth: a furnished room, a hand-held camera, images, hand-drawn-like annotations."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import write_atomic, write_json_atomic
from gtlayout.io.native import write_annotations
from gtlayout.io.nerfstudio import write_transforms
from gtlayout.io.truth import FILE as TRUTH_FILE
from gtlayout.scene import Camera, FloatArray, Frame, ImageArray, KeyFrame
from gtlayout.synth_annotate import annotate
from gtlayout.synth_render import cast, shade
from gtlayout.synth_room import Room, make_room

EYE_HEIGHT_M = 1.5
STEP_DEG = 1.7
"""The camera's advance along its arc per frame."""
MAX_SWEEP_DEG = 100.0
PITCH_DEG = -5.0
SWAY_M, SWAY_DEG = 0.02, 0.6
"""σ of the hand's unsteadiness about the arc."""
SWAY_FRAMES = 8
"""… which turns about once in so many frames."""


@dataclass(frozen=True)
class SynthConfig:
    """One synthetic scene."""

    seed: int = 0
    """Room, camera path, jitter and noise follow from it."""
    frames: int = 60
    width: int = 480
    """px"""
    height: int = 360
    """px"""
    hfov_deg: float = 65.0
    """Horizontal field of view."""
    key_every: int = 8
    """Frames from one key frame to the next."""
    noise_sigma: float = 2.0
    """Image noise, grey levels."""
    jitter_sigma_px: float = 1.5
    """How far the annotator's corners are off, per axis."""
    oversample: int = 2
    """Rays per pixel and axis."""
    jpeg_quality: int = 92

    def __post_init__(self) -> None:
        """Refuse what cannot be rendered."""
        checks = {
            "seed must not be negative": self.seed >= 0,
            "frames must be at least 2": self.frames >= 2,
            "width and height must be 64 to 4096 px": 64
            <= min(self.width, self.height)
            <= max(self.width, self.height)
            <= 4096,
            "hfov_deg must lie between 20 and 120": 20 <= self.hfov_deg <= 120,
            "key_every and oversample must be at least 1": min(self.key_every, self.oversample) >= 1,
            "noise_sigma and jitter_sigma_px must not be negative": min(self.noise_sigma, self.jitter_sigma_px) >= 0,
            "jpeg_quality must be 1 to 100": 1 <= self.jpeg_quality <= 100,
        }
        for problem, fine in checks.items():
            if not fine:
                raise GtlayoutError(f"synthetic scene: {problem}")


def synthesize(
    out: Path, config: SynthConfig, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> None:
    """Write the scene ``config`` describes to the folder ``out``: all of it or nothing, the same bytes every time.

    ``images/``, ``transforms.json``, ``annotations.json``, and the truth: ``gt_planes.json`` and, for key frames,
    ``depth/`` of what is seen, furniture included. ``progress`` is told (frames done, frames in all).
    Raises GtlayoutError when ``out`` is not an empty or new folder or cannot be written.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise GtlayoutError(f"{out} exists and is not an empty folder: name a new one")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
            scene = Path(folder) / "scene"
            scene.mkdir()
            _write_scene(scene, config, progress)
            if out.exists():
                out.rmdir()
            scene.rename(out)
    except OSError as error:
        raise GtlayoutError(f"cannot write {out}: {error.strerror or error}") from error


def arc_path(room: Room, config: SynthConfig) -> tuple[Camera, ...]:
    """Hand-held arc through the near half of a room, looking in: rightwards from the left, leftwards from the right."""
    rng = np.random.default_rng([config.seed, 1])
    floor = next(surface for surface in room.surfaces if surface.label == "floor")
    width_m, length_m = floor.corners_world[:, :2].max(axis=0)
    sweep_deg = min(MAX_SWEEP_DEG, STEP_DEG * (config.frames - 1)) * rng.choice([-1, 1])
    arc_deg = np.linspace(-sweep_deg / 2, sweep_deg / 2, config.frames)
    x = (0.5 + 0.3 * np.sin(np.deg2rad(arc_deg))) * width_m
    y = (0.5 - 0.33 * np.cos(np.deg2rad(arc_deg))) * length_m
    sway = _sway(config.frames, rng)
    centers = np.column_stack([x, y, np.full(config.frames, EYE_HEIGHT_M)]) + SWAY_M * sway[:, :3]
    angles_deg = np.column_stack([-arc_deg, np.full(config.frames, PITCH_DEG), np.zeros(config.frames)])
    angles_deg += SWAY_DEG * sway[:, 3:]
    focal_px = config.width / 2 / np.tan(np.deg2rad(config.hfov_deg) / 2)
    K = np.array([[focal_px, 0, config.width / 2], [0, focal_px, config.height / 2], [0, 0, 1]])
    rotations = [looking(*np.deg2rad(each)) for each in angles_deg]
    return tuple(
        Camera(K, R_cam_from_world, -R_cam_from_world @ center, config.width, config.height)
        for R_cam_from_world, center in zip(rotations, centers, strict=True)
    )


def looking(yaw_rad: float, pitch_rad: float, roll_rad: float) -> FloatArray:
    """(3, 3) ``R_cam_from_world``: yaw from the world's y towards x, pitch upwards, roll clockwise; z is up."""
    forward = np.array([np.sin(yaw_rad) * np.cos(pitch_rad), np.cos(yaw_rad) * np.cos(pitch_rad), np.sin(pitch_rad)])
    right = np.array([np.cos(yaw_rad), -np.sin(yaw_rad), 0.0])
    down = np.cross(forward, right)
    cos, sin = np.cos(roll_rad), np.sin(roll_rad)
    return np.stack([cos * right + sin * down, cos * down - sin * right, forward])


def _sway(frames: int, rng: np.random.Generator) -> FloatArray:
    """(frames, 6) smooth unit noise."""
    knots = np.arange(0, frames + 2 * SWAY_FRAMES, SWAY_FRAMES)
    spline = CubicSpline(knots, rng.standard_normal((len(knots), 6)))
    return np.asarray(spline(np.arange(frames)), np.float64)


def _write_scene(root: Path, config: SynthConfig, progress: Callable[[int, int], None]) -> None:
    room = make_room(config.seed)
    frames: list[Frame] = []
    key_frames: list[KeyFrame] = []
    elements: dict[str, dict[str, str]] = {}
    progress(0, config.frames)
    for number, camera in enumerate(arc_path(room, config)):
        rng = np.random.default_rng([config.seed, 2, number])
        picture = shade(room.surfaces, camera, cast(room.surfaces, camera, config.oversample))
        picture += rng.normal(0, config.noise_sigma, picture.shape)
        frame = Frame(f"{number:06d}.jpg", root / "images" / f"{number:06d}.jpg", camera)
        pixels = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        write_atomic(frame.image_path, _encode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality]))
        frames.append(frame)
        if number % config.key_every == 0:
            hits = cast(room.surfaces, camera)
            key_frame, elements[frame.name] = annotate(room, camera, hits, number, config.jitter_sigma_px, rng)
            key_frames.append(key_frame)
            depth_mm = np.rint(np.where(hits.depth < 65.0, hits.depth, 0) * 1000).astype(np.uint16)
            write_atomic(root / "depth" / f"{number:06d}.png", _encode(".png", depth_mm, []))
        progress(number + 1, config.frames)
    write_transforms(root / "transforms.json", frames)
    write_annotations(root / "annotations.json", frames, key_frames)
    write_json_atomic(root / TRUTH_FILE, _truth(room, elements))


def _truth(room: Room, elements: dict[str, dict[str, str]]) -> dict[str, object]:
    """The contents of gt_planes.json: the planes that some key frame shows."""
    shown = {name for names in elements.values() for name in names.values()}
    planes = {
        surface.name: {"label": surface.label, "normal": surface.normal, "d": surface.d, "from_depth": True}
        for surface in room.structure
        if surface.name in shown
    }
    note = "n.X + d = 0, unit normal towards the cameras, metres; exact. elements: key frame -> element id -> plane."
    return {"format": "gtlayout-truth/1", "note": note, "planes": planes, "elements": elements}


def _encode(extension: str, image: ImageArray | np.ndarray, parameters: list[int]) -> bytes:
    _, data = cv2.imencode(extension, image, parameters)
    return data.tobytes()
