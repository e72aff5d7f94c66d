"""From any known input to a scene folder in the native form: undistorted; on demand with cameras and unit found."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gtlayout.errors import GtlayoutError
from gtlayout.importing.frame_extraction import extract_frames
from gtlayout.importing.image_list import list_images
from gtlayout.importing.key_frame_choice import choose_key_frames, points_by_image
from gtlayout.importing.key_frame_files import LIST, SHEET, write_key_frame_files
from gtlayout.importing.known_distance import scale_from_distance
from gtlayout.importing.metric_scale import Scale, scale_from_depth, sparse_depths
from gtlayout.importing.structure_from_motion import reconstruct
from gtlayout.io.cameras.colmap.reader import READER as COLMAP
from gtlayout.io.cameras.colmap.reader import model_images, open_model, posed_images
from gtlayout.io.files import new_folder
from gtlayout.io.pixels.exports import is_copied
from gtlayout.io.pixels.images import read_rgb
from gtlayout.io.scene_folder import annotated_numbers, load_scene, read_cameras, scene_of
from gtlayout.io.video_record import write_video_record
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.observer import Observer
from gtlayout.scene import Frame, Scene, scaled

if TYPE_CHECKING:
    import pycolmap


@dataclass(frozen=True)
class Imported:
    """A scene as it was read, before it is written."""

    scene: Scene
    messages: tuple[str, ...]
    """Results on the way, one line each."""


def import_scene(
    source: Path,
    out: Path,
    annotations: Path | None,
    *,
    cameras: Path | None = None,
    rate_hz: float | None,
    focal_px: float | None = None,
    depth_scale: Path | None,
    known_distance: Path | None,
    observer: Observer,
) -> Imported:
    """Write what ``source`` holds to the new scene folder ``out``: all of it or nothing.

    ``source`` is a folder with cameras or, where ``rate_hz`` is given, a video (that many frames a second are taken) or
    a folder of images, whose cameras COLMAP then finds, with the focal length ``focal_px`` where that is known.
    ``cameras`` and ``annotations`` choose, as for ``load_scene``; ``depth_scale`` and ``known_distance`` are files that
    determine the unit.

    Raises GtlayoutError when something is missing, wrong, or cannot be determined. ``out`` is then not created.
    """
    if depth_scale is not None and known_distance is not None:
        raise GtlayoutError("the unit can come from --depth-scale or from --known-distance, not from both")
    _check_cameras_asked_for(cameras, rate_hz, focal_px)
    if not source.exists():
        raise GtlayoutError(f"no folder or video {source}")
    if rate_hz is None and source.is_file():
        raise GtlayoutError(f"{source} has no cameras: add --colmap, or name a folder that holds it and its cameras")
    with new_folder(out) as filled, tempfile.TemporaryDirectory(dir=filled.parent) as work:
        model = None
        if rate_hz is not None:
            scene, model, messages = _with_colmap(source, annotations, rate_hz, focal_px, Path(work), observer)
        else:
            scene, messages = load_scene(source, annotations, cameras=cameras, annotated=False), ()
        scene = _without_unreadable(scene)
        to_annotate = [] if scene.key_frames else choose_key_frames(scene, points_by_image(model) if model else {})
        scale = None
        if depth_scale is not None:
            scale = scale_from_depth(sparse_depths(model or _model_of(source, cameras)), depth_scale)
        elif known_distance is not None:
            scale = scale_from_distance(scene, known_distance)
        if scale is not None:
            scene, messages = _metric(scene, scale), (*messages, _says(scale))
        if rate_hz is not None or scale is not None:
            # True planes in the folder are in the unit and the world of other cameras.
            scene = replace(scene, root=Path(work))
        observer.stage("writing")
        names = write_scene(scene, filled, "native", "native")
        if to_annotate:
            write_key_frame_files(filled, scene, to_annotate, names)
    if not scene.key_frames:
        messages = (
            *messages,
            f"not annotated yet: annotate images in {out / 'images'}, best the {len(to_annotate)} that {out / LIST} "
            f"names and {SHEET} shows, and put the tool's export into {out}",
        )
    return Imported(scene, messages)


def _check_cameras_asked_for(cameras: Path | None, rate_hz: float | None, focal_px: float | None) -> None:
    if focal_px is not None and rate_hz is None:
        raise GtlayoutError("--focal is the focal length that --colmap uses: add --colmap")
    if cameras is not None and rate_hz is not None:
        raise GtlayoutError("the cameras can come from --colmap or from --cameras, not from both")


def _with_colmap(
    source: Path,
    annotations: Path | None,
    rate_hz: float,
    focal_px: float | None,
    work: Path,
    observer: Observer,
) -> tuple[Scene, pycolmap.Reconstruction, tuple[str, ...]]:
    """The scene with the cameras that COLMAP finds, COLMAP's model, and messages."""
    root = work if source.is_file() else source
    # Read here already, so that a file that cannot be read is refused before COLMAP runs.
    annotated = annotated_numbers(root, annotations) if annotations else frozenset()
    if source.is_file():
        images = work / "images"
        observer.stage("frames")
        extraction = extract_frames(source, images, rate_hz, observer.progress, annotated)
        names, warnings = extraction.names, extraction.warnings
        write_video_record(root, dict(zip(names, extraction.origins, strict=True)))
    else:
        images, names, warnings = list_images(source)
    try:
        found = reconstruct(images, names, work, observer, focal_px)
    except GtlayoutError as error:
        # Frames of a video lie in a folder that nobody finds any more.
        raise GtlayoutError(str(error).replace(str(images), str(source))) from error
    model, skipped = model_images(found.reconstruction, "COLMAP's result")
    posed = posed_images(model, root, "COLMAP's result")
    posed = replace(posed, warnings=(*warnings, *found.warnings, *skipped, *posed.warnings), metric=False)
    scene = scene_of(root, posed, annotations, annotated=False)
    # Their unit is not that of the cameras just found.
    frames = tuple(replace(frame, depth_path=None) for frame in scene.frames)
    return replace(scene, frames=frames), found.reconstruction, (found.verdict(),)


def _model_of(source: Path, cameras: Path | None) -> pycolmap.Reconstruction:
    chosen, _ = read_cameras(source, cameras)
    if chosen.reader is not COLMAP:
        raise GtlayoutError(
            f"{chosen.path} is no COLMAP model, whose points --depth-scale compares with: use --colmap, or name one "
            "with --cameras"
        )
    return open_model(chosen.path)


def _metric(scene: Scene, scale: Scale) -> Scene:
    if scene.metric:
        raise GtlayoutError(f"{scene.root} is metric already; say otherwise in its scene.json to give it another unit")
    # Depth maps of a scene without unit are thousandths of what was its unit.
    frames = tuple(replace(frame, depth_path=None) for frame in scene.frames)
    return replace(scaled(replace(scene, frames=frames), scale.factor), scale_sigma_share=scale.sigma_share)


def _without_unreadable(scene: Scene) -> Scene:
    """Without frames that cannot be read and so not be undistorted, and a warning for each."""
    problems = {i: problem for i, frame in enumerate(scene.frames) if (problem := _unreadable(frame))}
    kept = [i for i in range(len(scene.frames)) if i not in problems]
    index = {old: new for new, old in enumerate(kept)}
    return replace(
        scene,
        frames=tuple(scene.frames[i] for i in kept),
        key_frames=tuple(replace(key, frame=index[key.frame]) for key in scene.key_frames if key.frame in index),
        warnings=(*scene.warnings, *(f"{problem}: left out" for problem in problems.values())),
    )


def _unreadable(frame: Frame) -> str | None:
    if is_copied(frame):
        return None
    try:
        read_rgb(frame)
    except GtlayoutError as error:
        return str(error)
    return None


def _says(scale: Scale) -> str:
    return f"metric by {scale.how}: 1 unit = {scale.factor:.4g} m ± {100 * scale.sigma_share:.1f} %"
