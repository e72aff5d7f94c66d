"""Reading a scene folder. A format is one file in this package and one entry in a tuple below."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from gtlayout.errors import GtlayoutError
from gtlayout.io import cad_estate, colmap, cvat, native, nerfstudio, scannet
from gtlayout.io.files import read_json
from gtlayout.io.frames import build_frames
from gtlayout.io.key_frames import build_key_frames
from gtlayout.io.labels import FILE_NAME as LABELS_FILE
from gtlayout.io.labels import read_label_file
from gtlayout.io.sources import PosedImages, RawAnnotations, Reader
from gtlayout.scene import Scene

T = TypeVar("T")

CAMERA_READERS: tuple[Reader[PosedImages], ...] = (
    colmap.READER,
    nerfstudio.READER,
    cad_estate.CAMERA_READER,
    scannet.READER,
)
ANNOTATION_READERS: tuple[Reader[RawAnnotations], ...] = (
    native.READER,
    cvat.READER,
    cad_estate.ANNOTATION_READER,
)
SCENE_FILE = "scene.json"


def load_scene(root: Path) -> Scene:
    """Read the scene folder ``root``: cameras, images, annotations, optional depth; finds out by itself what is there.

    Images are looked for in ``images/`` (for COLMAP also in ``root``), depth in ``depth/<image name>.png`` (uint16,
    thousandths of the cameras' unit along z, 0 = none); CAD-Estate and ScanNet have places of their own for both.

    ScanNet is metric. COLMAP, nerfstudio and CAD-Estate do not say what their unit is: their scenes count as metric
    when depth maps come with them (they are millimetres), else not. ``scene.json`` with ``{"metric": true}`` or
    ``{"metric": false}`` overrules both.

    Raises GtlayoutError, one line that names the file, when something is missing, ambiguous or wrong beyond repair;
    what was repaired or skipped stands in ``Scene.warnings``.
    """
    if not root.is_dir():
        raise GtlayoutError(f"no scene folder {root}")
    cameras = _read_the_one(root, CAMERA_READERS, "cameras")
    annotations = _read_the_one(root, ANNOTATION_READERS, "annotations")
    metric = _metric_said(root / SCENE_FILE)
    frames, without_image, frame_warnings = build_frames(root, cameras.images)
    key_frames, key_frame_warnings = build_key_frames(
        annotations, frames, without_image, read_label_file(root / LABELS_FILE)
    )
    if metric is None:
        metric = cameras.metric
    if metric is None:
        metric = any(frame.depth_path for frame in frames)
    warnings = (*cameras.warnings, *annotations.warnings, *frame_warnings, *key_frame_warnings)
    return Scene(root, frames, key_frames, metric, warnings)


def _read_the_one(root: Path, readers: tuple[Reader[T], ...], what: str) -> T:
    """Read with the one reader that finds exactly one file."""
    found = [(reader, path) for reader in readers for path in reader.detect(root)]
    if not found:
        looked_for = "; ".join(f"{reader.looked_for} ({reader.name})" for reader in readers)
        raise GtlayoutError(f"no {what} in {root}; looked for {looked_for}")
    if len(found) > 1:
        paths = ", ".join(f"{path} ({reader.name})" for reader, path in found)
        raise GtlayoutError(f"{what} in more than one place: {paths}; leave one of them in the scene folder")
    reader, path = found[0]
    return reader.read(root, path)


def _metric_said(path: Path) -> bool | None:
    if not path.exists():
        return None
    data = read_json(path)
    if set(data) != {"metric"} or not isinstance(data["metric"], bool):
        raise GtlayoutError(f'{path} must be {{"metric": true}} or {{"metric": false}}')
    return data["metric"]
