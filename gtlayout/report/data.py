"""The content of the page: plain data from a scene, its layout and its quality."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gtlayout.colors import instance_colors, sigma_full
from gtlayout.errors import GtlayoutError
from gtlayout.export import unit
from gtlayout.export.floor_plan import floor_plan
from gtlayout.export.plan_drawing import draw
from gtlayout.export.svg import svg_text
from gtlayout.geometry.depth import median_depth
from gtlayout.io.measurements import SIGMA_M, measurement_entry
from gtlayout.layout import Layout
from gtlayout.measurement import MEASURED_AS, MeasuredKind, Measurement
from gtlayout.quality.assess import Quality
from gtlayout.quality.config import QualityConfig
from gtlayout.report.frames import finding_lines, key_frame_data
from gtlayout.report.next_steps import folded_reasons, next_steps
from gtlayout.report.panels import panels
from gtlayout.report.plain import data_uri, finite
from gtlayout.report.room_view import room_view
from gtlayout.results.evidence import EvidenceSeen
from gtlayout.results.tables import (
    dimension_of,
    measurement_lines,
    most_certain_first,
    quantity_of,
    shown_quantities,
)
from gtlayout.review.findings import Finding
from gtlayout.scene import ImageArray, Scene

SHOWN = 3
"""Findings of one kind that are not folded away."""


def report_data(
    scene: Scene,
    layout: Layout,
    quality: Quality,
    photos: Sequence[ImageArray | None],
    *,
    timings_s: Mapping[str, float],
    config: Mapping[str, Any],
    versions: Mapping[str, str],
    warnings: Sequence[str] = (),
    findings: Sequence[Finding] | None = None,
    evidence: EvidenceSeen | None = None,
) -> dict[str, Any]:
    """Everything the template needs, as dicts, lists, strings and numbers; no NaN.

    ``photos`` are (H, W, 3) RGB, one per key frame, None where it cannot be read. ``findings`` are those of a review of
    the drawings; None when there was none. Without ``evidence``, which earlier versions did not keep, planes have no
    panels.
    """
    colors = [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in instance_colors(range(len(layout.instances)))]
    full = sigma_full(layout.metric, median_depth(scene, layout.instances, layout.planes))
    worst = quality.elements[quality.worst_element]
    return {
        "title": scene.root.resolve().name,
        "unit": "m" if layout.metric else "u",
        "metric": layout.metric,
        "headline": asdict(quality.headline),
        "accepted": quality.accepted,
        "predicted": quality.predicted,
        "iou": quality.iou,
        "accept_iou": QualityConfig().accept_iou,
        "openings_iou": quality.openings_iou,
        "sigma_depth_share": quality.sigma_depth_share,
        "counts": {
            "frames": len(scene.frames),
            "key_frames": len(scene.key_frames),
            "instances": len(layout.instances),
            "not_ok": sum(judged.verdict != "ok" for judged in quality.instances),
        },
        "worst_frame": {"number": quality.worst_frame, "iou": finite(quality.frames[quality.worst_frame])},
        "worst_element": {
            "number": worst.key_frame,
            "instance": layout.instances[worst.instance].name,
            "id": scene.key_frames[worst.key_frame].elements[worst.element].id,
            "iou": worst.iou,
        },
        "next_steps": [asdict(step) for step in next_steps(scene, layout, quality, findings or (), evidence)],
        "reasons": folded_reasons(layout, quality),
        "warnings": list(warnings),
        "findings": None if findings is None else _folded(findings),
        "instances": _instances(layout, quality, colors),
        "dimensions": [*_dimensions(layout), *_quantities(layout)],
        "flatness": _flatness(layout),
        "wanted_loa": next((one.wanted for one in layout.accuracies), None) if layout.metric else None,
        "measured": measurement_lines(layout),
        "to_measure": _to_measure(layout),
        "frames": [
            key_frame_data(scene, layout, quality, number, photo, colors)
            | {"findings": finding_lines(findings or (), number)}
            for number, photo in enumerate(photos)
        ],
        "planes": None if evidence is None else panels(scene, layout, quality, evidence, colors),
        "room": room_view(scene, layout, full, [one.verdict == "ok" for one in quality.instances])
        if len(layout.triangles.faces)
        else None,
        "floor_plan": _floor_plan(scene, layout),
        "timings": _timings(timings_s),
        "config": flat(config),
        "versions": dict(versions),
    }


def _instances(layout: Layout, quality: Quality, colors: Sequence[str]) -> list[dict[str, Any]]:
    """One row per instance; None where nothing is known."""
    parts = zip(layout.instances, layout.planes, layout.extents, quality.instances, colors, strict=True)
    return [
        {
            "name": instance.name,
            "label": instance.label,
            "color": color,
            "host": None if instance.host is None else layout.instances[instance.host].name,
            "area": extent.region.area,
            "frames": len(instance.members),
            "tracks": plane.support.tracks,
            "sigma_normal_deg": finite(judged.sigma_normal_deg),
            "sigma_depth": finite(judged.sigma_depth),
            "level": layout.accuracies[number].level if layout.accuracies else None,
            "depth": finite(judged.depth),
            "iou": judged.iou,
            "verdict": judged.verdict,
            "reason": judged.reason,
            "causes": list(judged.causes),
        }
        for number, (instance, plane, extent, judged, color) in enumerate(parts)
    ]


def _folded(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """By kind, in their order; of a kind with many only the first are shown at once."""
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for finding in findings:
        by_kind.setdefault(finding.kind, []).append(_finding(finding))
    return [
        {"kind": kind, "shown": of[:SHOWN], "more": of[SHOWN:]}
        if len(of) > SHOWN + 1
        else {"kind": kind, "shown": of, "more": []}
        for kind, of in by_kind.items()
    ]


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "number": finding.key_frame,
        "frame": finding.frame_name,
        "kind": finding.kind,
        "message": finding.message,
    }


def _dimensions(layout: Layout) -> list[dict[str, Any]]:
    """Of each kind the most certain first."""
    return [
        {
            "kind": one.kind,
            "of": dimension_of(layout, one),
            "value": finite(one.length),
            "sigma": finite(one.sigma),
            "power": "",
            "digits": 3,
            "level": one.accuracy.level if one.accuracy else None,
            "status": one.accuracy.status if one.accuracy and layout.metric else None,
            "least": False,
        }
        for one in most_certain_first(layout.dimensions)
    ]


def _quantities(layout: Layout) -> list[dict[str, Any]]:
    """Areas and volumes; nobody has set levels of accuracy for these."""
    return [
        {
            "kind": one.kind,
            "of": quantity_of(layout, one),
            "value": finite(one.amount),
            "sigma": finite(one.sigma),
            "power": "³" if one.kind == "volume" else "²",
            "digits": 2,
            "level": None,
            "status": None,
            "least": not one.closed,
        }
        for one in shown_quantities(layout)
    ]


def _flatness(layout: Layout) -> list[dict[str, Any]]:
    """Of surfaces with tracks enough; nothing in a scene without a unit."""
    return [
        {
            "of": instance.name,
            "deviation_mm": 1000 * flat.deviation,
            "sigma_mm": 1000 * flat.sigma,
            "distance_m": flat.distance,
            "limit_mm": 1000 * flat.limit_m,
            "line": flat.line,
            "status": flat.status,
        }
        for instance, flat in zip(layout.instances, layout.flatness, strict=False)
        if flat is not None and np.isfinite([flat.deviation, flat.limit_m]).all()
    ]


def _to_measure(layout: Layout) -> str | None:
    """The entry of ``measurements.json`` for the dimension to measure next, with its length as it is known now."""
    if layout.next_measurement is None:
        return None
    one = layout.dimensions[layout.next_measurement.dimension]
    kind: MeasuredKind = MEASURED_AS[one.kind]
    names = [layout.instances[i].name for i in (one.first, one.second)]
    of = tuple(names) if kind == "between" else (names[1],)
    entry = measurement_entry(Measurement(kind, of, round(one.length, 3), SIGMA_M))
    return json.dumps([entry], ensure_ascii=False)


def _floor_plan(scene: Scene, layout: Layout) -> str | None:
    """As an image, in which nothing can run; None when the layout has no plan."""
    try:
        svg = svg_text(draw(floor_plan(scene, layout)), unit(layout.metric))
    except GtlayoutError:
        return None
    return data_uri("image/svg+xml", svg.encode())


def _timings(timings_s: Mapping[str, float]) -> list[dict[str, Any]]:
    total = sum(timings_s.values())
    return [
        {"stage": stage, "seconds": seconds, "share": seconds / total if total > 0 else 0.0}
        for stage, seconds in timings_s.items()
    ]


def flat(config: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """A nested configuration as (dotted name, value as JSON)."""
    rows: list[tuple[str, str]] = []
    for name, value in config.items():
        if isinstance(value, Mapping):
            rows += flat(value, f"{prefix}{name}.")
        else:
            rows.append((f"{prefix}{name}", json.dumps(value, ensure_ascii=False)))
    return rows
