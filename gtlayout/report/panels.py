"""The evidence of each plane as the page shows it: what each kind says alone, and the frames it is seen in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gtlayout.figures import NOTHING, figure, short
from gtlayout.layout import Layout
from gtlayout.planes.trail import EvidenceAlone
from gtlayout.quality.assess import Quality
from gtlayout.report.crops import dots, line, window
from gtlayout.report.frames import path_of
from gtlayout.report.help import Viewpoints, helps
from gtlayout.results.evidence import EvidenceSeen
from gtlayout.scene import Scene

_ON, _OUTVOTED = 0.5, 0.1
"""Weights from which a track lies on its plane, and below which it has no say."""
_WIDEST = 8.0
"""The scale ends at so many of the joint answer's σ: what lies beyond is drawn at its end."""


def panels(
    scene: Scene, layout: Layout, quality: Quality, seen: EvidenceSeen, colors: Sequence[str]
) -> list[dict[str, Any]]:
    """One panel per instance, in their order."""
    views = Viewpoints.of(scene)
    tracks = {(one.key_frame, one.instance): one for one in seen.tracks}
    found = []
    for i, (instance, plane, trail) in enumerate(zip(layout.instances, layout.planes, seen.trails, strict=True)):
        sigma = float(plane.sigma_offset(trail.middle))
        full = _full(sigma, trail.alone)
        found.append(
            {
                "name": instance.name,
                "color": colors[i],
                "verdict": quality.instances[i].verdict,
                "says": _says(trail.alone),
                "joint": {
                    "sigma": _length(sigma, layout.metric),
                    "sigma_normal": figure(plane.sigma_normal_deg, 2, "°"),
                    "bar": _bar(0.0, sigma, full),
                },
                "kinds": [_kind(one, layout.metric, full) for one in trail.alone],
                "help": helps(scene, layout, quality, seen, i, views),
                "views": [
                    _view(scene, layout, seen, k, e, i)
                    | {
                        name: dots(one.points_px[(one.weight >= low) & (one.weight < high)])
                        for one in [tracks.get((k, i))]
                        if one is not None
                        for name, low, high in (
                            ("on", _ON, np.inf),
                            ("beside", _OUTVOTED, _ON),
                            ("off", -np.inf, _OUTVOTED),
                        )
                    }
                    for k, e in instance.members
                ],
            }
        )
    return found


def _says(alone: Sequence[EvidenceAlone]) -> str:
    """Whether the kinds agree, in a few words."""
    if not alone:
        return "nothing places it"
    compared = [one for one in alone if one.agrees is not None]
    against = [one.kind for one in compared if not one.agrees]
    if against:
        return f"disagreement: {', '.join(against)} against the rest"
    return "all evidence agrees" if compared else f"only {alone[0].kind}"


def _kind(one: EvidenceAlone, metric: bool, full: float) -> dict[str, Any]:
    return {
        "kind": one.kind,
        "count": one.measurements,
        "offset": _length(one.offset, metric, signed=True),
        "sigma": _length(one.sigma_offset, metric),
        "tilt": figure(one.tilt_deg, 2, "°"),
        "sigma_normal": figure(one.sigma_normal_deg, 2, "°"),
        "chi2": figure(one.chi2, 1) if one.freedom else NOTHING,
        "freedom": one.freedom,
        "agrees": one.agrees,
        "bar": _bar(one.offset, one.sigma_offset, full),
    }


def _full(sigma: float, alone: Sequence[EvidenceAlone]) -> float:
    """Half the width of the scale of offsets, world unit."""
    reach = [abs(one.offset) + one.sigma_offset for one in alone if np.isfinite(one.offset)]
    return max(min(max([sigma, *reach]), _WIDEST * sigma), 1e-9) if np.isfinite(sigma) else 1.0


def _bar(offset: float, sigma: float, full: float) -> dict[str, float] | None:
    """Middle and ends of offset ± σ on a scale from 0 to 100, cut off there; None when it is not known."""
    if not (np.isfinite(offset) and np.isfinite(sigma)):
        return None
    middle, low, high = (50 + 50 * float(np.clip(x / full, -1, 1)) for x in (offset, offset - sigma, offset + sigma))
    return {"middle": round(middle, 1), "low": round(low, 1), "width": round(max(high - low, 0.5), 1)}


def _length(value: float, metric: bool, signed: bool = False) -> str:
    """``+1.2 cm``; in the scene's unit where that is not the metre."""
    if metric:
        return figure(100 * value, 1, " cm", signed=signed)
    return f"{'+' if signed and value > 0 else ''}{short(value)} u" if np.isfinite(value) else NOTHING


def _view(scene: Scene, layout: Layout, seen: EvidenceSeen, k: int, e: int, i: int) -> dict[str, Any]:
    """Instance ``i`` in a key frame: where to look, its outline and its contact edges."""
    element, frame = scene.key_frames[k].elements[e], scene.frame_of(k)
    edges = [edge for edge in seen.edges if edge.key_frame == k and i in edge.instances]
    return {
        "number": k,
        "frame": frame.name,
        "id": element.id,
        "window": window(frame.camera, element.amodal),
        "outline": path_of(element.amodal),
        "on": "",
        "beside": "",
        "off": "",
        "edges": [
            {
                "drawn": line(edge.drawn_px),
                "expected": line(edge.expected_px),
                "used": edge.used,
                "title": f"{' – '.join(layout.instances[j].name for j in edge.instances)}: "
                + (f"{figure(edge.misfit_px, 1)} px" if edge.used else "no contact, by the solve"),
            }
            for edge in edges
        ],
    }
