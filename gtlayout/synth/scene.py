"""One synthetic scene, from its parameters to a folder."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gtlayout.io.annotations.annotation_files import NATIVE_FILE
from gtlayout.io.annotations.native import write_annotations
from gtlayout.io.cameras.nerfstudio import FILE_NAME as TRANSFORMS_FILE
from gtlayout.io.cameras.nerfstudio import write_transforms
from gtlayout.io.cameras.re10k import read_cameras
from gtlayout.io.files import new_folder, write_atomic, write_json_atomic
from gtlayout.io.pixels.images import encoded
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import FILE as TRUTH_FILE
from gtlayout.io.units import SCENE_FILE
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.scene import Camera, FloatArray, Frame, KeyFrame
from gtlayout.synth.annotate import annotate
from gtlayout.synth.arcs import Arc
from gtlayout.synth.config import HFOV_DEG, SynthConfig
from gtlayout.synth.errors import disturb, disturb_cameras
from gtlayout.synth.extents import seen_extents
from gtlayout.synth.images import cameras_along, developed, exposures, gains, picture
from gtlayout.synth.motion import CameraPath
from gtlayout.synth.paths import dolly_path, orbit_path, replay_path, rotation_path
from gtlayout.synth.render import cast
from gtlayout.synth.room import Room, make_room

MAX_DEPTH_M = 65.0
"""As far as 16 bits of millimetres reach."""


@dataclass(frozen=True)
class Shot:
    """The true cameras of a video."""

    path: CameraPath
    cameras: tuple[Camera, ...]
    """One per frame, along ``path``."""


def synthesize(
    out: Path, config: SynthConfig, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> None:
    """Write the scene ``config`` describes to the folder ``out``: all of it or nothing, the same bytes every time on
    one kind of processor.

    Images, cameras, annotations, and the truth: ``gt_planes.json`` and, where the format knows depth, maps for the key
    frames of what is seen, furniture included. Images, depth and planes are of the true world, whatever errors the
    written cameras have. ``progress`` is called with (frames done, frames in all).
    Raises GtlayoutError when ``out`` is not an empty or new folder or cannot be written, and when the recorded path to
    replay cannot be read.
    """
    with new_folder(out) as folder, tempfile.TemporaryDirectory(dir=folder.parent) as aside:
        native = (config.camera_format, config.annotation_format) == ("native", "native")
        made = folder if native else Path(aside)
        _write_scene(made, config, progress)
        if not native:
            write_scene(load_scene(made), folder, config.camera_format, config.annotation_format)


def shoot(room: Room, config: SynthConfig) -> Shot:
    """The camera's path through the room.

    A replayed file lends its horizontal field of view and principal point, too, unless ``config`` has one; pixels are
    square. Raises GtlayoutError when the file cannot be read or the room has no place for the path.
    """
    rng = np.random.default_rng([config.seed, 1])
    hfov_rad = np.deg2rad(config.hfov_deg or HFOV_DEG)
    focal_share, center_shares = 0.5 / np.tan(hfov_rad / 2), (0.5, 0.5)
    if config.replay is not None:
        recorded = read_cameras(config.replay)
        last_s = (recorded[-1].timestamp_us - recorded[0].timestamp_us) / 1e6
        path = replay_path(room, recorded, np.linspace(0, last_s, config.frames), rng)
        if config.hfov_deg is None:
            focal_share, center_shares = recorded[0].focal_shares[0], recorded[0].center_shares
    else:
        make = {"orbit": orbit_path, "dolly": dolly_path, "rotation": rotation_path}[config.camera]
        path = make(room, config.frames, rng)
    focal_px = config.width * focal_share
    cx, cy = config.width * center_shares[0], config.height * center_shares[1]
    K = np.array([[focal_px, 0, cx], [0, focal_px, cy], [0, 0, 1]])
    return Shot(path, cameras_along(path, K, config.width, config.height))


def _write_scene(root: Path, config: SynthConfig, progress: Callable[[int, int], None]) -> None:
    room = make_room(config.seed, config.room, config.texture, config.trim)
    shot = shoot(room, config)
    opened = exposures(shot.path, shot.cameras, config.shutter_share)
    factors = gains(config.frames, config.exposure_sigma_ev, np.random.default_rng([config.seed, 3]))
    reported = disturb_cameras(shot.cameras, config.camera_errors, np.random.default_rng([config.seed, 4]))
    frames: list[Frame] = []
    key_frames: list[KeyFrame] = []
    views: list[tuple[Camera, KeyFrame, dict[str, str]]] = []
    progress(0, config.frames)
    for number, camera in enumerate(shot.cameras):
        rng = np.random.default_rng([config.seed, 2, number])
        light = picture(room.surfaces, opened[number], config.oversample)
        pixels = developed(light, factors[number], config.noise_sigma, rng)
        frames.append(Frame(f"{number:06d}.jpg", root / "images" / f"{number:06d}.jpg", reported[number]))
        jpeg = encoded(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality])
        write_atomic(frames[-1].image_path, jpeg)
        if number % config.key_every == 0:
            hits = cast(room.surfaces, camera)
            exact, names = annotate(room, camera, hits, number, rng)
            views.append((camera, exact, names))
            hand = np.random.default_rng([config.seed, 5, number])
            key_frames.append(disturb(exact, camera, config.annotator, hand))
            depth_mm = np.rint(np.where(hits.depth < MAX_DEPTH_M, hits.depth, 0) * 1000).astype(np.uint16)
            write_atomic(root / "depth" / f"{number:06d}.png", encoded(".png", depth_mm))
        progress(number + 1, config.frames)
    write_transforms(root / TRANSFORMS_FILE, frames)
    write_annotations(root / NATIVE_FILE, frames, key_frames)
    write_json_atomic(root / SCENE_FILE, {"metric": True})
    elements = {
        frames[drawn.frame].name: {element.id: names[element.id] for element in drawn.elements}
        for drawn, (_, _, names) in zip(key_frames, views, strict=True)
    }
    write_json_atomic(root / TRUTH_FILE, _truth(room, elements, seen_extents(room, views)))


def _truth(
    room: Room, elements: Mapping[str, Mapping[str, str]], extents: Mapping[str, Sequence[Sequence[FloatArray]]]
) -> dict[str, object]:
    """The contents of gt_planes.json: the planes that some element was drawn of."""
    drawn = {name for names in elements.values() for name in names.values()}
    planes: dict[str, dict[str, object]] = {
        surface.name: {
            "label": surface.label,
            "normal": surface.normal,
            "d": surface.d,
            "from_depth": True,
            "extent": extents[surface.name],
            "outline": surface.corners_world,
        }
        for surface in room.structure
        if surface.name in drawn and surface.arc is None
    }
    planes |= {
        surface.name: _round_wall(surface.arc, room)
        for surface in room.structure
        if surface.name in drawn and surface.arc is not None
    }
    note = (
        "n.X + d = 0, unit normal towards the cameras, metres; exact. extent: what the annotated frames show of the "
        "surface, furniture thought away, as polygons, each a shell and its holes; outline: its corners. "
        "A round wall has no plane but a cylinder: a point of its upright axis, its radius, and its ends on the floor. "
        "elements: annotated frame -> element id -> plane it truly is on, whatever label was drawn."
    )
    return {"format": "gtlayout-truth/1", "note": note, "planes": planes, "elements": elements}


def _round_wall(arc: Arc, room: Room) -> dict[str, object]:
    """What gt_planes.json holds of a round wall."""
    return {
        "label": "wall",
        "normal": None,
        "d": None,
        "from_depth": False,
        "cylinder": {
            "axis_point": [*arc.center_xy, 0.0],
            "axis": [0.0, 0.0, 1.0],
            "radius": arc.radius_m,
            "ends": [[*end, 0.0] for end in arc.points_xy()[[0, -1]]],
            "height": room.height_m,
        },
    }
