"""``room_structure.npz`` of the CAD-Estate release: a layout as triangles, element by element."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from shapely import MultiPolygon, Polygon

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.raster import LabelImage
from gtlayout.geometry.render import render
from gtlayout.instances import Extent, Instance, Plane, PlaneFrame
from gtlayout.io.files import write_atomic
from gtlayout.limits import FILE_MB
from gtlayout.scene import Camera, FloatArray, IntArray, Label

FILE_NAME = "room_structure.npz"
LABELS: tuple[Label | None, ...] = (None, "wall", "floor", "ceiling", "slanted")
"""By the release's numbers; None is what it says to ignore."""
WINDOW_FLAG, DOOR_FLAG = 1, 2
"""Doors and windows are not separate there: their triangles belong to the wall they lie in."""


@dataclass(frozen=True)
class RoomStructure:
    """The file's contents. Element 0 is the background, which has no triangles."""

    clip_name: str
    triangles: FloatArray
    """(T, 3, 3) corners in the world, those of one element after another."""
    triangle_element: IntArray
    """(T,) element of each."""
    triangle_flags: IntArray
    """(T,) WINDOW_FLAG, DOOR_FLAG or 0."""
    labels: tuple[Label | None, ...]
    """One per element."""
    annotated_timestamps: IntArray
    """(N,) µs."""

    def render(self, camera: Camera) -> LabelImage:
        """(H, W) element that each pixel shows; 0 where there is none. The nearest triangle wins."""
        corners = self.triangles
        area_vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        proper = np.flatnonzero(np.linalg.norm(area_vectors, axis=1) > 0)
        surfaces = [_surface(corners[t], area_vectors[t]) for t in proper]
        instances = [Instance(f"triangle_{t}", "wall", ()) for t in proper]
        seen, _ = render([plane for plane, _ in surfaces], [extent for _, extent in surfaces], instances, camera)
        # The last one is what index -1, nothing, stands for.
        return np.append(self.triangle_element[proper], 0).astype(np.int32)[seen]


def read_room_structure(path: Path) -> RoomStructure:
    """Read the file; per-triangle flags may be (T,) or, as documented, (T, 3).

    Raises GtlayoutError when the file is absent, no such file, or its parts do not fit together.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            FILE_MB.check(sum(part.file_size for part in archive.infolist()) / 1e6, f"cannot read {path}")
        with np.load(path, allow_pickle=False) as data:
            clip_name = str(data["clip_name"])
            triangles = np.asarray(data["layout_triangles"], dtype=np.float64)
            flags = _integers(data["layout_triangle_flags"])
            counts = _integers(data["layout_num_tri"])
            labels = _integers(data["layout_labels"])
            timestamps = _integers(data["annotated_timestamps"])
    except OSError as error:
        raise GtlayoutError(f"cannot read {path}: {error.strerror or error}") from error
    except GtlayoutError:
        raise
    except KeyError as error:
        raise GtlayoutError(f"{path} has no part {error}: it is no {FILE_NAME} of CAD-Estate") from error
    except Exception as error:  # zipfile, NumPy and the parser of Python that it asks raise what they raise.
        raise GtlayoutError(f"{path} is damaged or no {FILE_NAME}: {' '.join(str(error).split())}") from error
    if flags.ndim == 2:
        flags = np.bitwise_or.reduce(flags, axis=1)
    problems = {
        f"layout_triangles must be (T, 3, 3), not {triangles.shape}": triangles.shape[1:] != (3, 3),
        "layout_triangles must be finite numbers": not np.all(np.isfinite(triangles)),
        "there must be as many layout_triangle_flags as triangles": flags.shape != triangles.shape[:1],
        "layout_num_tri must be counts that add up to the triangles": counts.ndim != 1
        or bool(np.any(counts < 0))
        or counts.sum() != len(triangles),
        f"layout_labels must be 0 to {len(LABELS) - 1}, one per element": labels.shape != counts.shape
        or bool(np.any((labels < 0) | (labels >= len(LABELS)))),
        "element 0 must be the background, without triangles": counts.ndim != 1 or len(counts) == 0 or counts[0] != 0,
    }
    for problem, found in problems.items():
        if found:
            raise GtlayoutError(f"{path}: {problem}")
    return RoomStructure(
        clip_name,
        triangles,
        np.repeat(np.arange(len(counts)), counts),
        flags,
        tuple(LABELS[label] for label in labels),
        timestamps.ravel(),
    )


def write_room_structure(path: Path, structure: RoomStructure) -> None:
    """Write the file. Raises GtlayoutError when the folder or disk does not take it."""
    content = io.BytesIO()
    np.savez(
        content,
        clip_name=np.array(structure.clip_name),
        layout_triangles=structure.triangles.astype(np.float32),
        layout_triangle_flags=structure.triangle_flags,
        layout_num_tri=np.bincount(structure.triangle_element, minlength=len(structure.labels)).astype(np.int64),
        layout_labels=_label_numbers(structure.labels),
        annotated_timestamps=structure.annotated_timestamps,
    )
    write_atomic(path, content.getvalue())


def _label_numbers(labels: Sequence[Label | None]) -> IntArray:
    return np.array([LABELS.index(label) for label in labels], dtype=np.int64)


def _integers(values: Any) -> IntArray:
    if not np.issubdtype(values.dtype, np.integer):
        raise ValueError(f"whole numbers are expected, not {values.dtype}")
    return np.asarray(values, dtype=np.int64)


def _surface(corners: FloatArray, area_vector: FloatArray) -> tuple[Plane, Extent]:
    normal = area_vector / np.linalg.norm(area_vector)
    e_u = corners[1] - corners[0]
    e_u = e_u / np.linalg.norm(e_u)
    frame = PlaneFrame(corners[0], np.stack([e_u, np.cross(normal, e_u)]))
    region = MultiPolygon([Polygon(frame.to_plane(corners))])
    plane = Plane(normal, -float(normal @ corners[0]), np.zeros((4, 4)), observable=True)
    return plane, Extent(frame, region, region)
