"""The results of a solve as files: layout.json, .ply, .glb, quality.json, config.json, cameras.json, timings.json."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from gtlayout.config import Config
from gtlayout.export.glb import glb_bytes
from gtlayout.export.ply import ply_bytes
from gtlayout.io.files import check_stays, json_text, write_all_atomic
from gtlayout.layout import Layout
from gtlayout.mesh import vertex_sigma
from gtlayout.quality.assess import Quality
from gtlayout.results.cylinder_rows import cylinder_row
from gtlayout.results.dimension_rows import (
    accuracy_row,
    dimension_rows,
    flatness_row,
    measurement_rows,
    next_row,
    quantity_rows,
    scale_row,
)
from gtlayout.results.evidence import EvidenceSeen
from gtlayout.results.evidence_file import evidence_text
from gtlayout.results.layout_format import FORMAT, InstanceRow, LayoutFile
from gtlayout.results.names import EVIDENCE_FILE, LOG_FILE, REPORT_FILE, REVIEW_FILE, TIMINGS_FILE
from gtlayout.results.refined_cameras import FILE as CAMERAS_FILE
from gtlayout.results.refined_cameras import refined_cameras_text
from gtlayout.results.review_file import review_text
from gtlayout.review.findings import Finding
from gtlayout.scene import Scene
from gtlayout.solution import Solution
from gtlayout.version import __version__

_OPTIONAL = (LOG_FILE, REPORT_FILE, CAMERAS_FILE, TIMINGS_FILE, REVIEW_FILE, EVIDENCE_FILE)
_ALWAYS = ("layout.ply", "layout.glb", "quality.json", "config.json", "layout.json")
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
        GtlayoutError: the folder or disk does not take them, or a file there is a link that leads out of the folder.
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
    check_stays(out_dir, (*_OPTIONAL, *_ALWAYS))
    write_all_atomic(
        {
            **optional,
            out_dir / "layout.ply": ply_bytes(layout),
            out_dir / "layout.glb": glb_bytes(layout),
            out_dir / "quality.json": json_text(_quality(scene, layout, quality)),
            out_dir / "config.json": json_text({"versions": package_versions(), "config": asdict(config)}),
            # Last, because its presence means that the scene is solved.
            out_dir / "layout.json": json_text(_layout(scene, layout, quality, config)),
        },
        remove=[out_dir / stale for stale in _OPTIONAL if out_dir / stale not in optional],
    )


@cache
def package_versions() -> dict[str, str]:
    """The versions of gtlayout, Python and the packages that decide a result."""
    found = {"gtlayout": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        with suppress(PackageNotFoundError):  # pycolmap is an extra.
            found[package] = version(package)
    return found


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
                "cylinder": cylinder_row(extent),
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
                "flatness": flatness_row(layout.flatness[number] if layout.flatness else None),
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
            "vertex_sigma": vertex_sigma(layout.triangles, layout.planes, layout.extents),
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
        "flatness": {
            instance.name: flatness_row(flat)
            for instance, flat in zip(layout.instances, layout.flatness, strict=False)
            if flat is not None
        },
        "scale": scale_row(layout),
        "measurements": measurement_rows(layout),
        "next_measurement": next_row(layout),
        "findings": [{"kind": one.kind, "line": one.line} for one in findings],
        "notes": list(solution.scene.notes),
        "seconds": dict(solution.timings_s),
    }


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
