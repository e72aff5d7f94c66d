"""The evidence of a solution as a file: evidence.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import json_text, read_json
from gtlayout.layout import Layout
from gtlayout.planes.trail import EvidenceAlone, PlaneTrail
from gtlayout.results.evidence import EdgeSeen, EvidenceSeen, TracksSeen
from gtlayout.results.names import EVIDENCE_FILE
from gtlayout.scene import FloatArray, Scene

FORMAT = "gtlayout-evidence/1"
_DIGITS = 6
"""Significant ones of what is not in pixels: more would only show the last bits of a processor."""


def evidence_text(scene: Scene, layout: Layout, evidence: EvidenceSeen) -> str:
    """The text of the file: images and instances by name, null = not known."""
    names = [instance.name for instance in layout.instances]
    return json_text(
        {
            "format": FORMAT,
            "planes": [
                {
                    "name": name,
                    "middle": [_rounded(value) for value in trail.middle.tolist()],
                    "alone": [{f.name: _rounded(getattr(one, f.name)) for f in fields(one)} for one in trail.alone],
                }
                for name, trail in zip(names, evidence.trails, strict=True)
            ],
            "tracks": [
                {
                    "image": scene.frame_of(one.key_frame).name,
                    "instance": names[one.instance],
                    "x_px": one.points_px[:, 0],
                    "y_px": one.points_px[:, 1],
                    "weight": one.weight,
                }
                for one in evidence.tracks
            ],
            "edges": [
                {
                    "image": scene.frame_of(one.key_frame).name,
                    "instances": [names[i] for i in one.instances],
                    "drawn_px": one.drawn_px,
                    "expected_px": one.expected_px,
                    "misfit_px": one.misfit_px,
                    "used": one.used,
                }
                for one in evidence.edges
            ],
        }
    )


def read_evidence(folder: Path, scene: Scene, layout: Layout) -> EvidenceSeen | None:
    """The evidence in a folder of results; None when there is none, as of a solve by an earlier version.

    Raises GtlayoutError when the file is damaged, or not of this scene and layout.
    """
    path = folder / EVIDENCE_FILE
    if not path.exists():
        return None
    data = read_json(path)
    if data.get("format") != FORMAT:
        raise GtlayoutError(f'{path} is no evidence: its "format" is {data.get("format")!r}, not {FORMAT!r}')
    instance = {one.name: i for i, one in enumerate(layout.instances)}
    key_frame = {scene.frame_of(k).name: k for k in range(len(scene.key_frames))}
    try:
        if [row["name"] for row in data["planes"]] != list(instance):
            raise GtlayoutError(f"{path} is of another layout than the one beside it: solve the scene again")
        return EvidenceSeen(
            tuple(
                PlaneTrail(_numbers(row["middle"], (3,)), tuple(_alone(one) for one in row["alone"]))
                for row in data["planes"]
            ),
            tuple(_tracks(row, key_frame, instance) for row in data["tracks"]),
            tuple(_edge(row, key_frame, instance) for row in data["edges"]),
        )
    except KeyError as error:
        raise GtlayoutError(f"{path} is damaged or of other annotations ({error}): solve the scene again") from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise GtlayoutError(f"{path} is damaged: {type(error).__name__} {error}; solve the scene again") from error


def _alone(row: dict[str, Any]) -> EvidenceAlone:
    kind, measurements = str(row["kind"]), int(_numbers(row["measurements"], ()))
    freedom = int(_numbers(row["freedom"], ()))
    if not 0 <= freedom <= 3:
        raise ValueError(f"{freedom} degrees of freedom")
    names = ("offset", "sigma_offset", "tilt_deg", "sigma_normal_deg", "chi2")
    figures = {name: float(_numbers(row[name], ())) for name in names}
    return EvidenceAlone(kind=kind, measurements=measurements, freedom=freedom, **figures)


def _tracks(row: dict[str, Any], key_frame: Mapping[str, int], instance: Mapping[str, int]) -> TracksSeen:
    points_px = np.stack([_numbers(row["x_px"]), _numbers(row["y_px"])], axis=1)
    weight = _numbers(row["weight"], (len(points_px),))
    if not (np.isfinite(points_px).all() and np.isfinite(weight).all()):
        raise ValueError("a track without place or weight")
    return TracksSeen(key_frame[row["image"]], instance[row["instance"]], points_px, weight)


def _edge(row: dict[str, Any], key_frame: Mapping[str, int], instance: Mapping[str, int]) -> EdgeSeen:
    first, second = (instance[name] for name in row["instances"])
    return EdgeSeen(
        key_frame[row["image"]],
        (first, second),
        _numbers(row["drawn_px"], (2, 2)),
        _numbers(row["expected_px"], (2, 2)),
        float(_numbers(row["misfit_px"], ())),
        bool(row["used"]),
    )


def _numbers(value: Any, shape: tuple[int, ...] | None = None) -> FloatArray:
    """An array in which JSON's null is NaN; a list of any length where no shape is given."""
    numbers = np.asarray(value, dtype=object).astype(np.float64)
    if numbers.shape != shape and (shape is not None or numbers.ndim != 1):
        raise ValueError(f"numbers of shape {numbers.shape}")
    if np.isinf(numbers).any():
        raise ValueError("a number that is not finite")
    return numbers


def _rounded(value: float | str) -> float | str:
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
