"""The results of a solve as files: layout.json, .ply, .glb, quality.json, config.json, cameras.json, timings.json."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_args

import numpy as np
from shapely import MultiPolygon

from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.export.glb import glb_bytes
from gtlayout.export.ply import ply_bytes
from gtlayout.instances import Dimension, EvidenceKind, Extent, Instance, Mesh, Plane, PlaneFrame, Support
from gtlayout.io.files import json_text, read_json, write_all_atomic
from gtlayout.layout import Layout
from gtlayout.mesh import vertex_sigma
from gtlayout.quality.assess import Quality
from gtlayout.results.layout_format import FORMAT, InstanceRow, LayoutFile
from gtlayout.results.names import LOG_FILE, REPORT_FILE, REVIEW_FILE, TIMINGS_FILE
from gtlayout.results.refined_cameras import FILE as CAMERAS_FILE
from gtlayout.results.refined_cameras import refined_cameras_text
from gtlayout.results.review_file import review_text
from gtlayout.review.findings import Finding
from gtlayout.scene import LABELS, FloatArray, Scene
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
) -> None:
    """Write all result files. All are complete before the first takes its place. Those of an earlier solve are removed.

    ``new_cameras``: the scene's cameras are not those it was read with, and are written, too. ``timings_s``:
    seconds of each stage; in a file of their own, because all others are the same bytes for the same input.
    ``findings``: those of a review of the drawings, if there was one.

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
    for stale in (LOG_FILE, REPORT_FILE, CAMERAS_FILE, TIMINGS_FILE, REVIEW_FILE):
        if out_dir / stale not in optional:
            (out_dir / stale).unlink(missing_ok=True)


@cache
def package_versions() -> dict[str, str]:
    """The versions of gtlayout, Python and the packages that decide a result."""
    return {"gtlayout": __version__, "python": platform.python_version()} | {p: version(p) for p in _PACKAGES}


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
        dimensions = tuple(_read_dimension(row, names) for row in data["dimensions"])
        mesh = _read_mesh(data["mesh"], names)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise GtlayoutError(f"{path} is damaged: {type(error).__name__} {error}; solve the scene again") from error
    instances, planes, extents = zip(*parts, strict=True) if parts else ((), (), ())
    return Layout(instances, planes, extents, mesh, metric, dimensions, inferred=tuple(inferred))


def _layout(scene: Scene, layout: Layout, quality: Quality, config: Config) -> LayoutFile:
    rows: list[InstanceRow] = []
    parts = zip(layout.instances, layout.planes, layout.extents, quality.instances, strict=True)
    for i, (instance, plane, extent, judged) in enumerate(parts):
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
                    "inferred": extent.frame.rings_to_world(layout.inferred[i].region) if layout.inferred else None,
                },
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
        "dimensions": [
            {
                "kind": dimension.kind,
                "between": [layout.instances[i].name for i in (dimension.first, dimension.second)],
                "length": dimension.length,
                "sigma": dimension.sigma,
                "ends": dimension.ends_world,
            }
            for dimension in layout.dimensions
        ],
        "mesh": {
            "vertices": layout.triangles.vertices,
            "vertex_sigma": vertex_sigma(layout.triangles, layout.planes),
            "faces": layout.triangles.faces,
            "face_instance": [layout.instances[i].name for i in layout.triangles.face_instance],
        },
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
    frame = PlaneFrame(_numbers(row["extent"]["origin"]).reshape(3), _numbers(row["extent"]["axes"]).reshape(2, 3))
    return (
        instance,
        Plane(
            _numbers(plane["normal"]).reshape(3),
            float(_numbers(plane["d"])),
            _numbers(plane["covariance"]).reshape(4, 4),
            bool(plane["observable"]),
            plane["note"],
            _read_support(plane["support"]),
            float(_numbers(plane["sigma_depth"])) if metric else np.nan,
            _numbers(plane["anchor"]).reshape(3),
        ),
        Extent(
            frame,
            _region(row["extent"]["polygons"], frame),
            _region(row["extent"]["unrefined"], frame),
            float(row["extent"]["unknown_area"]),
        ),
    )


def _read_inferred(row: dict[str, Any]) -> Extent:
    frame = PlaneFrame(_numbers(row["origin"]).reshape(3), _numbers(row["axes"]).reshape(2, 3))
    region = _region(row["inferred"], frame)
    return Extent(frame, region, region)


def _read_support(row: dict[str, Any]) -> Support:
    if row["dominant_evidence"] not in get_args(EvidenceKind):
        raise ValueError(f"unknown support {row['dominant_evidence']!r}")
    return Support(
        tracks=int(row["tracks"]),
        survived=float(_numbers(row["survived"])),
        parallax_deg=float(_numbers(row["parallax_deg"])),
        outvoted=float(_numbers(row["outvoted"])),
        contact_edges=int(row["contact_edges"]),
        edge_px=float(_numbers(row["edge_px"])),
        dominant_evidence=row["dominant_evidence"],
    )


def _read_dimension(row: dict[str, Any], names: list[str]) -> Dimension:
    if row["kind"] not in ("height", "width"):
        raise ValueError(f"unknown kind of dimension {row['kind']!r}")
    first, second = (names.index(name) for name in row["between"])
    length, sigma = float(_numbers(row["length"])), float(_numbers(row["sigma"]))
    return Dimension(first, second, row["kind"], length, sigma, _numbers(row["ends"]).reshape(2, 3))


def _read_mesh(data: dict[str, Any], names: list[str]) -> Mesh:
    faces = np.array(data["faces"], dtype=np.int64).reshape(-1, 3)
    owners = np.array([names.index(name) for name in data["face_instance"]], dtype=np.int64)
    vertices = _numbers(data["vertices"]).reshape(-1, 3)
    if len(owners) != len(faces) or not np.isin(faces, np.arange(len(vertices))).all():
        raise ValueError("the mesh's faces do not fit its vertices or instances")
    return Mesh(vertices, faces, owners)


def _numbers(value: Any) -> FloatArray:
    """An array in which JSON's null is NaN."""
    return np.asarray(value, dtype=object).astype(np.float64)


def _region(polygons: list[list[list[list[float]]]], frame: PlaneFrame) -> MultiPolygon:
    return frame.region([[np.asarray(ring, dtype=np.float64) for ring in rings] for rings in polygons])


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
