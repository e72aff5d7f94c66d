"""Reading a scene folder. A format is one file below this package and one entry in a tuple below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.extras import MissingExtraError
from gtlayout.io.annotations import labelme, native
from gtlayout.io.annotations.annotation_files import left_out
from gtlayout.io.annotations.coco import reader as coco
from gtlayout.io.annotations.cvat import reader as cvat
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.label_studio import reader as label_studio
from gtlayout.io.annotations.labels import FILE_NAME as LABELS_FILE
from gtlayout.io.annotations.labels import read_label_file
from gtlayout.io.annotations.sequence import sequence_of
from gtlayout.io.archives import archive_of
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
from gtlayout.io.files import let_in
from gtlayout.io.measurements import FILE as MEASUREMENTS_FILE
from gtlayout.io.measurements import read_measurements
from gtlayout.io.sources import PosedImages, RawAnnotations, Reader
from gtlayout.io.units import SCENE_FILE, Unit, in_metres, read_unit
from gtlayout.io.video_record import with_origins
from gtlayout.scene import Scene

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


@let_in()
def load_scene(
    root: Path, annotations: Path | None = None, *, cameras: Path | None = None, annotated: bool = True
) -> Scene:
    """Read the scene folder ``root``: cameras, images, annotations, in any known format.

    Images are looked for in ``images/`` (for COLMAP also in ``root``), depth in ``depth/<image name>.png`` (uint16
    millimetres along z, thousandths of the cameras' unit where that is not known, 0 = none). Some formats have places
    of their own for both. Cameras with timestamps (RealEstate10k, CAD-Estate) may have a video in ``root`` instead.

    ``cameras`` is the file or folder to read, ``annotations`` the file, zip or folder, as a path or within ``root``,
    where there are several or they lie elsewhere; ``labels.json`` lies beside the annotations. Several sources of
    cameras that agree need no choice (see ``gtlayout.io.choosing``). Where ``annotated`` is false and none are named, a
    scene without annotations is one without key frames.

    ScanNet and phone scans are metric. Most formats do not state their unit. Their scenes count as metric when
    depth maps come with them (they are millimetres), else not. ``scene.json`` overrules both: see
    ``gtlayout.io.units``. ``measurements.json`` holds what was measured by hand: see ``gtlayout.io.measurements``.

    Raises GtlayoutError, one line that names the file, when something is missing, ambiguous or cannot be repaired.
    ``Scene.warnings`` lists what was repaired or skipped.
    """
    posed, unit = _posed(root, cameras)
    scene = _in_unit(scene_of(root, posed, annotations, annotated=annotated), unit)
    return replace(scene, measurements=read_measurements(root / MEASUREMENTS_FILE, scene.frames))


@let_in()
def load_undrawn(root: Path, cameras: Path | None = None) -> Scene:
    """The scene without key frames, whatever is drawn; arguments and errors as for ``load_scene``."""
    posed, unit = _posed(root, cameras)
    scene, _ = _undrawn(root, posed)
    return _in_unit(scene, unit)


def _in_unit(scene: Scene, unit: Unit) -> Scene:
    metric = scene.metric if unit.metric is None else unit.metric
    return replace(scene, metric=metric, scale_sigma_share=unit.scale_sigma_share)


def _posed(root: Path, cameras: Path | None) -> tuple[PosedImages, Unit]:
    """What the cameras' source says, in metres where the unit of the scene is known."""
    if not root.is_dir():
        raise GtlayoutError(f"no scene folder {root}")
    unit = read_unit(root / SCENE_FILE)
    return in_metres(read_cameras(root, cameras)[1], unit), unit


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
    scene, without_image = _undrawn(root, cameras)
    place = root if annotations is None else named_path(root, annotations, "annotations")
    expected = annotated or annotations is not None
    raw, not_read = _read_annotations(place, expected)
    if raw is None:
        return replace(scene, warnings=(*scene.warnings, *not_read))
    own_labels = read_label_file(_folder_of(place) / LABELS_FILE)
    key_frames, warnings = build_key_frames(raw, scene.frames, without_image, own_labels)
    warnings = [*scene.warnings, *not_read, *raw.warnings, *warnings]
    return replace(scene, key_frames=key_frames, warnings=tuple(warnings), notes=raw.notes)


def _undrawn(root: Path, cameras: PosedImages) -> tuple[Scene, Sequence[str]]:
    """The scene that ``cameras`` make, without key frames, and the names of cameras without an image."""
    try:
        frames, without_image, frame_warnings = build_frames(root, cameras.images)
    except MissingExtraError:
        raise
    except GtlayoutError as error:
        raise GtlayoutError("; ".join([str(error), *cameras.warnings[:1]])) from error
    frames, origin_warnings = with_origins(root, frames)
    metric = any(frame.depth_path for frame in frames) if cameras.metric is None else cameras.metric
    return Scene(root, frames, (), metric, (*cameras.warnings, *frame_warnings, *origin_warnings)), without_image


def annotated_numbers(root: Path, annotations: Path) -> frozenset[int]:
    """Numbers in the video of the frames that the named ``annotations`` draw on; none where they are of no video.

    Arguments and errors as for ``load_scene``.
    """
    raw, _ = _read_annotations(named_path(root, annotations, "annotations"), True)
    sequence = sequence_of(raw) if raw else None
    return frozenset(sequence.video_numbers.values()) if sequence else frozenset()


def annotation_source(root: Path, annotations: Path | None = None) -> Source[RawAnnotations] | None:
    """What the scene's drawings are read from, None where there is nothing; see ``load_scene``."""
    place = root if annotations is None else named_path(root, annotations, "annotations")
    sources = sources_in(place, ANNOTATION_READERS)
    return the_one(sources, place, ANNOTATION_READERS, "annotations") if sources else None


def _read_annotations(place: Path, annotated: bool) -> tuple[RawAnnotations | None, tuple[str, ...]]:
    """The annotations in the folder, file or zip, None where there are none and need not be; and what is not read.

    The latter is a line for each file of a format that is known and refused.
    """
    sources, not_read = sources_in(place, ANNOTATION_READERS), tuple(left_out(place))
    if not sources and not annotated:
        return None, not_read
    if not sources and not_read:
        known = ", ".join(reader.name for reader in ANNOTATION_READERS)
        raise GtlayoutError(f"no annotations in {place}: {'; '.join(not_read)} (known are: {known})")
    source = the_one(sources, place, ANNOTATION_READERS, "annotations")
    return source.reader.read(_folder_of(place), source.path), not_read


def _folder_of(place: Path) -> Path:
    """The folder that annotations lie in, of a zip the one that it lies in."""
    return place if place.is_dir() else (archive_of(place) or place).parent
