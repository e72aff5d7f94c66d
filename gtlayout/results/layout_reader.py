"""A solved layout, read back from its layout.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from shapely import MultiPolygon

from gtlayout.accuracy import Accuracy, Flatness
from gtlayout.errors import GtlayoutError
from gtlayout.instances import EvidenceKind, Extent, Instance, Mesh, Plane, PlaneFrame, Support
from gtlayout.io.files import let_in, read_json
from gtlayout.io.numbers import MOST, real, reals, whole
from gtlayout.layout import Layout
from gtlayout.results.cylinder_rows import read_strip
from gtlayout.results.dimension_rows import (
    read_accuracy,
    read_dimension,
    read_flatness,
    read_measurement,
    read_next,
    read_quantity,
    read_scale,
    read_sigma,
)
from gtlayout.results.layout_format import BEFORE_CURVED, FORMAT
from gtlayout.results.refined_cameras import with_refined_cameras
from gtlayout.scene import LABELS, FloatArray, Scene

UNIT_LENGTH = 1e-6
"""A normal is off by less: files hold all digits."""


@let_in()
def read_solved(scene: Scene, out_dir: Path) -> tuple[Scene, Layout]:
    """The scene with the cameras, and in the unit, that its layout in ``out_dir`` was solved with, and the layout.

    Raises:
        GtlayoutError: as ``read_layout`` and ``with_refined_cameras``.
    """
    scene = with_refined_cameras(scene, out_dir)
    layout = read_layout(out_dir, scene)
    return replace(scene, metric=layout.metric), layout


def read_layout(out_dir: Path, scene: Scene) -> Layout:
    """Read a layout of ``scene`` back from its layout.json.

    Elements are found by the names of their image and by their ids, so annotations may have been reordered since the
    solve.

    Raises:
        GtlayoutError: the file is absent, not a layout, or names elements that the scene does not have.
    """
    path = out_dir / "layout.json"
    if not path.exists():
        raise GtlayoutError(f"cannot read {path}: it is not there; solve the scene first")
    data = read_json(path)
    if data.get("format") not in (FORMAT, BEFORE_CURVED):
        raise GtlayoutError(f'{path} is not a layout: its "format" is {data.get("format")!r}, not {FORMAT!r}')
    try:
        names = [row["name"] for row in data["instances"]]
        metric = bool(data["metric"])
        parts = [_read_instance(row, names, _elements(scene), metric, path) for row in data["instances"]]
        inferred = [_read_inferred(row) for row in data["instances"] if row["extent"].get("inferred") is not None]
        if inferred and len(inferred) < len(parts):
            raise ValueError("what is inferred is given for some instances only")
        mesh = _read_mesh(data["mesh"], names)
        instances, planes, extents = zip(*parts, strict=True) if parts else ((), (), ())
        return Layout(
            instances,
            planes,
            extents,
            mesh,
            metric,
            dimensions=tuple(read_dimension(row, names) for row in data["dimensions"]),
            accuracies=_read_accuracies(data["instances"]),
            flatness=_read_flatness(data["instances"]),
            quantities=tuple(read_quantity(row, names) for row in data["quantities"]),
            scale=read_scale(data["scale"]),
            measurements=tuple(read_measurement(row) for row in data["measurements"]),
            next_measurement=read_next(data["next_measurement"], len(data["dimensions"])),
            inferred=tuple(inferred),
        )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise GtlayoutError(f"{path} is damaged: {type(error).__name__} {error}; solve the scene again") from error


def _elements(scene: Scene) -> dict[tuple[str, str], tuple[int, int]]:
    """(image, element id) → (key frame index, element index)."""
    return {
        (scene.frame_of(k).name, element.id): (k, e)
        for k, key_frame in enumerate(scene.key_frames)
        for e, element in enumerate(key_frame.elements)
    }


def _read_instance(
    row: dict[str, Any], names: list[str], elements: dict[tuple[str, str], tuple[int, int]], metric: bool, path: Path
) -> tuple[Instance, Plane, Extent]:
    drawn = [(member["image"], member["element"]) for member in row["members"]]
    for image, element in drawn:
        if (image, element) not in elements:
            raise GtlayoutError(
                f"{path} was made from other annotations: {image} has no element {element}; solve the scene again"
            )
    members = tuple(sorted(elements[each] for each in drawn))
    instance = Instance(row["name"], row["label"], members, None if row["host"] is None else names.index(row["host"]))
    plane = row["plane"]
    if row["label"] not in LABELS:
        raise ValueError(f"unknown label {row['label']!r}")
    frame = _frame(row)
    return (
        instance,
        Plane(
            _normal(plane["normal"]),
            real(plane["d"], unknown=True),
            _covariance(plane["covariance"]),
            bool(plane["observable"]),
            plane["note"],
            _read_support(plane["support"]),
            read_sigma(plane["sigma_depth"]) if metric else np.nan,
            reals(plane["anchor"], (3,)),
        ),
        Extent(
            frame,
            _region(row["extent"]["polygons"], frame),
            _region(row["extent"]["unrefined"], frame),
            real(row["extent"]["unknown_area"], most=MOST**2),
        ),
    )


def _normal(row: Any) -> FloatArray:
    """(3,) of unit length; NaN where the plane is not placed."""
    normal = reals(row, (3,), unknown=True)
    if not (np.isnan(normal).all() or abs(np.linalg.norm(normal) - 1) < UNIT_LENGTH):
        raise ValueError(f"the normal {row} is not of length 1")
    return normal


def _covariance(rows: Any) -> FloatArray:
    """(4, 4)"""
    covariance = reals(rows, (4, 4), most=np.finfo(np.float64).max, unknown=True)
    if (np.diag(covariance) < 0).any():
        raise ValueError("a covariance has a negative variance")
    return covariance


def _read_accuracies(rows: Sequence[dict[str, Any]]) -> tuple[Accuracy, ...]:
    """Of all instances; empty where nobody asked."""
    found = [accuracy for row in rows if (accuracy := read_accuracy(row["accuracy"])) is not None]
    return tuple(found) if len(found) == len(rows) else ()


def _read_flatness(rows: Sequence[dict[str, Any]]) -> tuple[Flatness | None, ...]:
    """Of all instances; empty where nobody asked."""
    found = tuple(read_flatness(row.get("flatness")) for row in rows)
    return found if any(one is not None for one in found) else ()


def _frame(row: dict[str, Any]) -> PlaneFrame:
    """Of an instance's extent; a plane that is not placed has none, and nulls."""
    if strip := read_strip(row.get("cylinder")):
        return strip
    extent = row["extent"]
    return PlaneFrame(reals(extent["origin"], (3,), unknown=True), reals(extent["axes"], (2, 3), unknown=True))


def _read_inferred(row: dict[str, Any]) -> Extent:
    frame = _frame(row)
    region = _region(row["extent"]["inferred"], frame)
    return Extent(frame, region, region)


def _read_support(row: dict[str, Any]) -> Support:
    if row["dominant_evidence"] not in get_args(EvidenceKind):
        raise ValueError(f"unknown support {row['dominant_evidence']!r}")
    return Support(
        tracks=whole(row["tracks"]),
        survived=real(row["survived"], unknown=True),
        parallax_deg=real(row["parallax_deg"], unknown=True),
        outvoted=real(row["outvoted"], unknown=True),
        contact_edges=whole(row["contact_edges"]),
        edge_px=real(row["edge_px"], unknown=True),
        dominant_evidence=row["dominant_evidence"],
    )


def _read_mesh(data: dict[str, Any], names: list[str]) -> Mesh:
    faces = reals(data["faces"], (-1, 3)).astype(np.int64)
    owners = np.array([names.index(name) for name in data["face_instance"]], dtype=np.int64)
    vertices = reals(data["vertices"], (-1, 3))
    if len(owners) != len(faces) or not np.isin(faces, np.arange(len(vertices))).all():
        raise ValueError("the mesh's faces do not fit its vertices or instances")
    return Mesh(vertices, faces, owners)


def _region(polygons: list[list[list[list[float]]]], frame: PlaneFrame) -> MultiPolygon:
    if polygons and not (np.isfinite(frame.origin).all() and np.isfinite(frame.axes).all()):
        raise ValueError("an extent has a region and no place")
    return frame.region([[reals(ring, (-1, 3)) for ring in rings] for rings in polygons])
