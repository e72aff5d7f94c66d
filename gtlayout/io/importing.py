"""From whatever there is to a scene folder in the native form: cameras found if need be, undistorted, metric if asked."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.io import load_scene, scene_of
from gtlayout.io.colmap import detect_models, read_colmap
from gtlayout.io.files import new_folder
from gtlayout.io.frame_extraction import extract_frames
from gtlayout.io.metric_scale import scale_from_depth, scale_from_distance, scaled
from gtlayout.io.scene_writers import write_scene
from gtlayout.io.structure_from_motion import reconstruct
from gtlayout.io.video import VIDEO_SUFFIXES
from gtlayout.scene import Scene
from gtlayout.visualize import Observer


@dataclass(frozen=True)
class Imported:
    """A scene as it was read, before it was written."""

    scene: Scene
    told: tuple[str, ...]
    """What was found out on the way, a line each."""


def import_scene(
    source: Path,
    out: Path,
    annotations: Path | None,
    *,
    rate_hz: float | None,
    depth_scale: Path | None,
    known_distance: Path | None,
    observer: Observer,
) -> Imported:
    """Write what ``source`` holds to the new scene folder ``out``: all of it or nothing.

    ``source`` is a folder with cameras or, where ``rate_hz`` is given, a video (that many frames a second are taken) or
    a folder of images, whose cameras COLMAP then finds. ``depth_scale`` and ``known_distance`` say how long the unit is.
    Raises GtlayoutError when something is missing, wrong, or cannot be found out; ``out`` is then not there.
    """
    if depth_scale is not None and known_distance is not None:
        raise GtlayoutError("the unit can come from --depth-scale or from --known-distance, not from both")
    if not source.exists():
        raise GtlayoutError(f"no folder or video {source}")
    with new_folder(out) as filled, tempfile.TemporaryDirectory(dir=filled.parent) as work:
        if rate_hz is not None:
            scene, model, told = _with_colmap(source, annotations, rate_hz, Path(work), observer)
        elif source.is_file():
            raise GtlayoutError(
                f"{source} has no cameras: add --colmap, or name a folder that holds it and its cameras"
            )
        else:
            scene, told = load_scene(source, annotations, annotated=False), ()
            model = next(iter(detect_models(source)), None)
        if depth_scale is not None or known_distance is not None:
            scene, line = _metric(scene, model, depth_scale, known_distance)
            told = (*told, line)
        observer.stage("writing")
        write_scene(scene, filled, "native", "native")
    if not scene.key_frames:
        told = (*told, f"not annotated yet: annotate images in {out / 'images'} and put the tool's export into {out}")
    return Imported(scene, told)
