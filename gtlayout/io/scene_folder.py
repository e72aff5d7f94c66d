"""Reading a scene folder. A format is one file below this package and one entry in a tuple below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from gtlayout.errors import GtlayoutError
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
from gtlayout.io.files import read_json
from gtlayout.io.sources import PosedImages, RawAnnotations, Reader
from gtlayout.io.video_record import with_origins
from gtlayout.scene import Frame, KeyFrame, Scene

T = TypeVar("T")


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


SCENE_FILE = "scene.json"


def load_scene(root: Path, annotations: Path | None = None, *, annotated: bool = True) -> Scene:
    """Read the scene folder ``root``: cameras, images, annotations, optional depth, in any known format.

    Images are looked for in ``images/`` (for COLMAP also in ``root``), depth in ``depth/<image name>.png`` (uint16,
    thousandths of the cameras' unit along z, 0 = none); some formats have places of their own for both. Cameras with
    timestamps (RealEstate10k, CAD-Estate) may have a video file in ``root`` instead. ``annotations`` is the file, zip
    or folder that holds them when they lie elsewhere; ``labels.json`` then lies beside them. Where ``annotated`` is
    false and none are named, a scene without annotations is one without key frames.

    ScanNet and phone scans are metric. Most formats do not state their unit. Their scenes count as metric when
    depth maps come with them (they are millimetres), else not. ``scene.json`` with ``{"metric": true}`` or
    ``{"metric": false}`` overrules both.

    Raises GtlayoutError, one line that names the file, when something is missing, ambiguous or cannot be repaired.
    ``Scene.warnings`` lists what was repaired or skipped.
    """
    if not root.is_dir():
        raise GtlayoutError(f"no scene folder {root}")
    reader, camera_file = _the_one(root, _found(root, CAMERA_READERS), CAMERA_READERS, "cameras")
    metric = _declared_metric(root / SCENE_FILE)
    expected = annotated or annotations is not None
    scene = scene_of(root, reader.read(root, camera_file), annotations or root, annotated=expected)
    return scene if metric is None else replace(scene, metric=metric)


def scene_of(root: Path, cameras: PosedImages, annotations: Path, *, annotated: bool) -> Scene:
    """The scene that ``cameras`` and the annotations in the file or folder ``annotations`` make; see ``load_scene``."""
    frames, without_image, frame_warnings = build_frames(root, cameras.images)
    frames, origin_warnings = with_origins(root, frames)
    key_frames, annotation_warnings = _key_frames(annotations, frames, without_image, annotated)
    metric = any(frame.depth_path for frame in frames) if cameras.metric is None else cameras.metric
    return Scene(
        root, frames, key_frames, metric, (*cameras.warnings, *frame_warnings, *origin_warnings, *annotation_warnings)
    )


def _key_frames(
    path: Path, frames: Sequence[Frame], without_image: Sequence[str], annotated: bool
) -> tuple[tuple[KeyFrame, ...], tuple[str, ...]]:
    """What the annotations in the folder ``path``, the file or the zip ``path``, make of the frames, and warnings."""
    raw, not_read = _read_annotations(path, annotated)
    if raw is None:
        return (), not_read
    own_labels = read_label_file(_folder_of(path) / LABELS_FILE)
    key_frames, warnings = build_key_frames(raw, frames, without_image, own_labels)
    return key_frames, (*not_read, *raw.warnings, *warnings)


def annotated_numbers(annotations: Path) -> frozenset[int]:
    """Numbers in the video of the frames that a file (or the one in a folder) annotates; none where it is of no video.

    Raises GtlayoutError when there is no annotation file, or it cannot be read.
    """
    raw, _ = _read_annotations(annotations, True)
    sequence = sequence_of(raw) if raw else None
    return frozenset(sequence.video_numbers.values()) if sequence else frozenset()


def _read_annotations(path: Path, annotated: bool) -> tuple[RawAnnotations | None, tuple[str, ...]]:
    """The annotations in the folder, file or zip ``path``, None where there are none and need not be; what is not read.

    The latter is a line for each file of a format that is known and refused.
    """
    if not path.exists() and archive_of(path) is None:
        raise GtlayoutError(f"no annotations {path}")
    found, not_read = _found(path, ANNOTATION_READERS), tuple(left_out(path))
    if not found and not annotated:
        return None, not_read
    if not found and not_read:
        known = ", ".join(reader.name for reader in ANNOTATION_READERS)
        raise GtlayoutError(f"no annotations in {path}: {'; '.join(not_read)} (known are: {known})")
    reader, file = _the_one(path, found, ANNOTATION_READERS, "annotations")
    return reader.read(_folder_of(path), file), not_read


def _folder_of(path: Path) -> Path:
    """The folder that annotations lie in, of a zip the one that it lies in."""
    return path if path.is_dir() else (archive_of(path) or path).parent


def _found(root: Path, readers: Sequence[Reader[T]]) -> list[tuple[Reader[T], Path]]:
    return [(reader, path) for reader in readers for path in reader.detect(root)]


def _the_one(
    root: Path, found: Sequence[tuple[Reader[T], Path]], readers: Sequence[Reader[T]], what: str
) -> tuple[Reader[T], Path]:
    if not found:
        looked_for = "; ".join(f"{reader.looked_for} ({reader.name})" for reader in readers)
        raise GtlayoutError(f"no {what} in {root}; looked for {looked_for}")
    if len(found) > 1:
        paths = ", ".join(f"{path} ({reader.name})" for reader, path in found)
        raise GtlayoutError(f"{what} in more than one place: {paths}; leave one of them in the scene folder")
    return found[0]


def _declared_metric(path: Path) -> bool | None:
    if not path.exists():
        return None
    data = read_json(path)
    if set(data) != {"metric"} or not isinstance(data["metric"], bool):
        raise GtlayoutError(f'{path} must be {{"metric": true}} or {{"metric": false}}')
    return data["metric"]
