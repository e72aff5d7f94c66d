"""Reading a scene folder. A format is one file below this package and one entry in a tuple below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations import labelme, native
from gtlayout.io.annotations.coco import reader as coco
from gtlayout.io.annotations.cvat import reader as cvat
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.label_studio import reader as label_studio
from gtlayout.io.annotations.labels import FILE_NAME as LABELS_FILE
from gtlayout.io.annotations.labels import read_label_file
from gtlayout.io.cad_estate import reader as cad_estate
from gtlayout.io.cameras import arkitscenes, nerfstudio, polycam, re10k, scannet
from gtlayout.io.cameras.colmap import reader as colmap
from gtlayout.io.cameras.frames import build_frames
from gtlayout.io.choosing import (
    Source,
    named_path,
    named_sources,
    read_richest,
    require_some,
    sources_in,
    the_one,
)
from gtlayout.io.sources import PosedImages, RawAnnotations, Reader
from gtlayout.io.units import SCENE_FILE, in_metres, read_unit
from gtlayout.scene import Frame, KeyFrame, Scene

CAMERA_READERS: tuple[Reader[PosedImages], ...] = (
    colmap.READER,
    nerfstudio.READER,
    cad_estate.CAMERA_READER,
    scannet.READER,
    re10k.READER,
    arkitscenes.READER,
    polycam.READER,
)


ANNOTATION_READERS: tuple[Reader[RawAnnotations], ...] = (
    native.READER,
    cvat.READER,
    cad_estate.ANNOTATION_READER,
    coco.READER,
    labelme.READER,
    label_studio.READER,
)


def load_scene(
    root: Path, annotations: Path | None = None, *, cameras: Path | None = None, annotated: bool = True
) -> Scene:
    """Read the scene folder ``root``: cameras, images, annotations, in any known format.

    Images are looked for in ``images/`` (for COLMAP also in ``root``), depth in ``depth/<image name>.png`` (uint16
    millimetres along z, thousandths of the cameras' unit where that is not known, 0 = none). Some formats have places
    of their own for both. Cameras with timestamps (RealEstate10k, CAD-Estate) may have a video in ``root`` instead.

    ``cameras`` and ``annotations`` are the file or folder to read, as a path or within ``root``, where there are
    several or they lie elsewhere; ``labels.json`` lies beside the annotations. Several sources of cameras that agree
    need no choice (see ``gtlayout.io.choosing``). Where ``annotated`` is false a scene without annotations is one
    without key frames.

    ScanNet and phone scans are metric. Most formats do not state their unit. Their scenes count as metric when
    depth maps come with them (they are millimetres), else not. ``scene.json`` overrules both: see
    ``gtlayout.io.units``.

    Raises GtlayoutError, one line that names the file, when something is missing, ambiguous or cannot be repaired.
    ``Scene.warnings`` lists what was repaired or skipped.
    """
    if not root.is_dir():
        raise GtlayoutError(f"no scene folder {root}")
    unit = read_unit(root / SCENE_FILE)
    posed = in_metres(read_cameras(root, cameras)[1], unit)
    if annotations is not None:
        annotations = named_path(root, annotations, "annotations")
    scene = scene_of(root, posed, annotations, annotated=annotated)
    return scene if unit.metric is None else replace(scene, metric=unit.metric)


def read_cameras(root: Path, cameras: Path | None = None) -> tuple[Source[PosedImages], PosedImages]:
    """The source that the scene's cameras are read from, and what it says; arguments and errors as for ``load_scene``.

    In the unit of the source.
    """
    if cameras is None:
        place, sources = root, sources_in(root, CAMERA_READERS)
    else:
        place = named_path(root, cameras, "cameras")
        sources = named_sources(place, CAMERA_READERS)
    require_some(sources, place, CAMERA_READERS, "cameras")
    return read_richest(root, sources)


def scene_of(root: Path, cameras: PosedImages, annotations: Path | None, *, annotated: bool) -> Scene:
    """The scene that ``cameras`` and the annotations in the file or folder ``annotations`` make; see ``load_scene``."""
    frames, without_image, frame_warnings = build_frames(root, cameras.images)
    key_frames, annotation_warnings = _key_frames(root, annotations, frames, without_image, annotated)
    metric = any(frame.depth_path for frame in frames) if cameras.metric is None else cameras.metric
    return Scene(root, frames, key_frames, metric, (*cameras.warnings, *frame_warnings, *annotation_warnings))


def _key_frames(
    root: Path, named: Path | None, frames: Sequence[Frame], without_image: Sequence[str], annotated: bool
) -> tuple[tuple[KeyFrame, ...], tuple[str, ...]]:
    """What the annotations in the scene folder ``root``, or the ``named`` ones, make of the frames, and warnings."""
    path = root if named is None else named
    if not path.exists():
        raise GtlayoutError(f"no annotations {path}")
    sources = sources_in(root, ANNOTATION_READERS) if named is None else named_sources(named, ANNOTATION_READERS)
    if not sources and named is None and not annotated:
        return (), ()
    source = the_one(sources, path, ANNOTATION_READERS, "annotations")
    folder = path if path.is_dir() else path.parent
    raw = source.reader.read(folder, source.path)
    key_frames, warnings = build_key_frames(raw, frames, without_image, read_label_file(folder / LABELS_FILE))
    return key_frames, (*raw.warnings, *warnings)
