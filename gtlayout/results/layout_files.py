"""The results of a solve as files: layout.json, .ply, .glb, quality.json, config.json, cameras.json, timings.json."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, get_args

import numpy as np
from shapely import MultiPolygon

from gtlayout.accuracy import Accuracy
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.export.glb import glb_bytes
from gtlayout.export.ply import ply_bytes
from gtlayout.instances import EvidenceKind, Extent, Instance, Mesh, Plane, PlaneFrame, Support
from gtlayout.io.files import json_text, read_json, write_all_atomic
from gtlayout.io.numbers import MOST, real, reals, whole
from gtlayout.layout import Layout
from gtlayout.mesh import vertex_sigma
from gtlayout.quality.assess import Quality
from gtlayout.results.dimension_rows import (
    accuracy_row,
    dimension_rows,
    measurement_rows,
    next_row,
    quantity_rows,
    read_accuracy,
    read_dimension,
    read_measurement,
    read_next,
    read_quantity,
    read_scale,
    read_sigma,
    scale_row,
)
from gtlayout.results.evidence import EvidenceSeen
from gtlayout.results.evidence_file import evidence_text
from gtlayout.results.layout_format import FORMAT, InstanceRow, LayoutFile
from gtlayout.results.names import EVIDENCE_FILE, LOG_FILE, REPORT_FILE, REVIEW_FILE, TIMINGS_FILE
from gtlayout.results.refined_cameras import FILE as CAMERAS_FILE
from gtlayout.results.refined_cameras import refined_cameras_text, with_refined_cameras
from gtlayout.results.review_file import review_text
from gtlayout.review.findings import Finding
from gtlayout.scene import LABELS, Scene
from gtlayout.solution import Solution
from gtlayout.version import __version__

_PACKAGES = ("gtsam", "numpy", "opencv-python-headless", "pycolmap", "scipy", "shapely", "trimesh")


def write_results(
    out_dir: Path,
    scene: Scene,
    layout: Layout,
    quality: Quality,
    config: Config,
    new_cameras: bool = False,
    timings_s: Mapping[str, float] | None = None,
    findings: Sequence[Finding] | None = None,
    evidence: EvidenceSeen | None = None,
) -> None:
    """Write all result files. All are complete before the first takes its place. Those of an earlier solve are removed.

    ``new_cameras``: the scene's cameras are not those it was read with, and are written, too. ``timings_s``:
    seconds of each stage; in a file of their own, because all others are the same bytes for the same input.
    ``findings``: those of a review of the drawings, if there was one. ``evidence``: what the planes are made of.

    Raises:
        GtlayoutError: the folder or disk does not take them.
    """
    optional: dict[Path, bytes | str] = {}
    if new_cameras:
        optional[out_dir / CAMERAS_FILE] = refined_cameras_text(scene)
    if timings_s is not None:
        optional[out_dir / TIMINGS_FILE] = json_text({"seconds": dict(timings_s)})
    if findings is not None:
        optional[out_dir / REVIEW_FILE] = review_text(findings)
    if evidence is not None:
        optional[out_dir / EVIDENCE_FILE] = evidence_text(scene, layout, evidence)
    write_all_atomic(
        {
            **optional,
            out_dir / "layout.ply": ply_bytes(layout),
            out_dir / "layout.glb": glb_bytes(layout),
            out_dir / "quality.json": json_text(_quality(scene, layout, quality)),
            out_dir / "config.json": json_text({"versions": package_versions(), "config": asdict(config)}),
            # Last, because its presence means that the scene is solved.
            out_dir / "layout.json": json_text(_layout(scene, layout, quality, config)),
        }
    )
    for stale in (LOG_FILE, REPORT_FILE, CAMERAS_FILE, TIMINGS_FILE, REVIEW_FILE, EVIDENCE_FILE):
        if out_dir / stale not in optional:
            (out_dir / stale).unlink(missing_ok=True)


@cache
def package_versions() -> dict[str, str]:
    """The versions of gtlayout, Python and the packages that decide a result."""
    found = {"gtlayout": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        with suppress(PackageNotFoundError):  # pycolmap is an extra.
            found[package] = version(package)
    return found


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
    data = read_json(path)
    if data.get("format") != FORMAT:
        raise GtlayoutError(f'{path} is not a layout: its "format" is {data.get("format")!r}, not {FORMAT!r}')
    try:
        names = [row["name"] for row in data["instances"]]
        metric = bool(data["metric"])
        parts = [_read_instance(row, names, _elements(scene), metric, path) for row in data["instances"]]
        inferred = [
            _read_inferred(row["extent"]) for row in data["instances"] if row["extent"].get("inferred") is not None
        ]
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
            quantities=tuple(read_quantity(row, names) for row in data["quantities"]),
            scale=read_scale(data["scale"]),
            measurements=tuple(read_measurement(row) for row in data["measurements"]),
            next_measurement=read_next(data["next_measurement"], len(data["dimensions"])),
            inferred=tuple(inferred),
        )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise GtlayoutError(f"{path} is damaged: {type(error).__name__} {error}; solve the scene again") from error


def _layout(scene: Scene, layout: Layout, quality: Quality, config: Config) -> LayoutFile:
    rows: list[InstanceRow] = []
    inferred = layout.inferred
    parts = zip(layout.instances, layout.planes, layout.extents, quality.instances, strict=True)
    for number, (instance, plane, extent, judged) in enumerate(parts):
        rows.append(
            {
                "name": instance.name,
                "label": instance.label,
                "host": None if instance.host is None else layout.instances[instance.host].name,
                "members": [
                    {"image": scene.frame_of(k).name, "element": scene.key_frames[k].elements[e].id}
                    for k, e in instance.members
                ],
                "plane": {
                    "normal": plane.normal,
                    "d": plane.d,
                    "covariance": plane.covariance,
                    "anchor": plane.anchor,
                    "observable": plane.observable,
                    "note": plane.note,
                    "support": asdict(plane.support),
                    "sigma_normal_deg": judged.sigma_normal_deg,
                    "sigma_depth": judged.sigma_depth,
                },
                "extent": {
                    "area": extent.region.area,
                    "origin": extent.frame.origin,
                    "axes": extent.frame.axes,
                    "polygons": extent.frame.rings_to_world(extent.region),
                    "unrefined": extent.frame.rings_to_world(extent.unrefined),
                    "unknown_area": extent.unknown_area,
                    "inferred": extent.frame.rings_to_world(inferred[number].region) if inferred else None,
                },
                "accuracy": accuracy_row(layout.accuracies[number] if layout.accuracies else None),
                "iou": judged.iou,
                "verdict": judged.verdict,
                "reason": judged.reason,
                "causes": judged.causes,
            }
        )
    return {
        "format": FORMAT,
        "version": __version__,
        "seed": config.seed,
        "metric": layout.metric,
        "unit": "m" if layout.metric else "scene unit",
        "convention": "n·X + d = 0, unit n towards the cameras; covariance of (n, n·anchor + d); "
        "world frame of the input cameras; vertex_sigma along the normal, the largest of the instances that share "
        "the vertex",
        "headline": {"word": quality.headline.word, "reasons": quality.headline.reasons},
        "accepted": quality.accepted,
        "predicted": quality.predicted,
        "sigma_depth_share": quality.sigma_depth_share,
        "instances": rows,
        "dimensions": dimension_rows(layout),
        "quantities": quantity_rows(layout),
        "scale": scale_row(layout),
        "measurements": measurement_rows(layout),
        "next_measurement": next_row(layout),
        "mesh": {
            "vertices": layout.triangles.vertices,
            "vertex_sigma": vertex_sigma(layout.triangles, layout.planes),
            "faces": layout.triangles.faces,
            "face_instance": [layout.instances[i].name for i in layout.triangles.face_instance],
        },
    }


def solution_record(solution: Solution, findings: Sequence[Finding], out_dir: Path) -> dict[str, Any]:
    """What ``gtlayout solve --json`` prints: ``quality.json``, and what else its text says."""
    layout = solution.layout
    return {
        "results": str(out_dir),
        **_quality(solution.scene, layout, solution.quality),
        "unit": "m" if layout.metric else "scene unit",
        "dimensions": dimension_rows(layout),
        "quantities": quantity_rows(layout),
        "scale": scale_row(layout),
        "measurements": measurement_rows(layout),
        "next_measurement": next_row(layout),
        "findings": [{"kind": one.kind, "line": one.line} for one in findings],
        "notes": list(solution.scene.notes),
        "seconds": dict(solution.timings_s),
    }


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
    frame = _frame(row["extent"])
    return (
        instance,
        Plane(
            reals(plane["normal"], (3,), unknown=True),
            real(plane["d"], unknown=True),
            reals(plane["covariance"], (4, 4), most=np.finfo(np.float64).max, unknown=True),
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


def _read_accuracies(rows: Sequence[dict[str, Any]]) -> tuple[Accuracy, ...]:
    """Of all instances; empty where nobody asked."""
    found = [accuracy for row in rows if (accuracy := read_accuracy(row["accuracy"])) is not None]
    return tuple(found) if len(found) == len(rows) else ()


def _frame(row: dict[str, Any]) -> PlaneFrame:
    """Of an extent; a plane that is not placed has none, and nulls."""
    return PlaneFrame(reals(row["origin"], (3,), unknown=True), reals(row["axes"], (2, 3), unknown=True))


def _read_inferred(row: dict[str, Any]) -> Extent:
    frame = _frame(row)
    region = _region(row["inferred"], frame)
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
    return frame.region([[reals(ring, (-1, 3)) for ring in rings] for rings in polygons])


def _quality(scene: Scene, layout: Layout, quality: Quality) -> dict[str, Any]:
    def name(k: int) -> str:
        return scene.frame_of(k).name

    worst = quality.elements[quality.worst_element]
    return {
        "headline": asdict(quality.headline),
        "iou": quality.iou,
        "accepted": quality.accepted,
        "sigma_depth_share": quality.sigma_depth_share,
        "predicted": quality.predicted,
        "known_share": quality.known_share,
        "openings_iou": quality.openings_iou,
        "worst_frame": {"image": name(quality.worst_frame), "iou": quality.frames[quality.worst_frame]},
        "worst_element": {
            "image": name(worst.key_frame),
            "element": scene.key_frames[worst.key_frame].elements[worst.element].id,
            "instance": layout.instances[worst.instance].name,
            "iou": worst.iou,
        },
        "frames": [
            {
                "image": name(k),
                "iou": iou,
                "elements": [
                    {
                        "element": scene.key_frames[k].elements[e.element].id,
                        "instance": layout.instances[e.instance].name,
                        "iou": e.iou,
                    }
                    for e in quality.elements
                    if e.key_frame == k
                ],
            }
            for k, iou in enumerate(quality.frames)
        ],
        "instances": [
            {"name": instance.name, **asdict(judged)}
            for instance, judged in zip(layout.instances, quality.instances, strict=True)
        ],
        "warnings": list(scene.warnings),
    }
