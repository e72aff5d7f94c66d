"""Errors of cameras in words, with their numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gtlayout.camera_errors.findings import CameraDoubt, Finding
from gtlayout.figures import with_sigma
from gtlayout.scene import Scene

_UNSEEN = "points that it was not found with do not prove it"


def camera_error_lines(scene: Scene, doubt: CameraDoubt) -> tuple[str, ...]:
    """A line for each error that was corrected or is doubted; ``scene`` has the given cameras."""
    lines = []
    for finding in doubt.findings:
        if finding.decision != "fine":
            end = "corrected" if finding.decision == "corrected" else f"not corrected: {_UNSEEN}"
            lines.append(f"{_SAID[finding.error.name](scene, finding)}; {end}")
    return tuple(lines)


def _focal(scene: Scene, finding: Finding) -> str:
    given_px = float(np.median([frame.camera.K[0, 0] for frame in scene.frames]))
    factor = float(np.exp(finding.values[0]))
    how = "short" if factor > 1 else "long"
    right = with_sigma(factor * given_px, finding.sigma * factor * given_px, 0, " px")
    return f"focal length {abs(1 / factor - 1):.1%} too {how}: {given_px:.0f} instead of {right}"


def _principal_point(scene: Scene, finding: Finding) -> str:
    width_px = scene.frames[0].camera.width
    x, y = -width_px * finding.values
    off = with_sigma(width_px * finding.size, width_px * finding.sigma, 0, " px")
    return f"principal point {off} off: it lies {round(x):+d} px in x and {round(y):+d} px in y from where it should"


def _roll(_scene: Scene, finding: Finding) -> str:
    return f"cameras rolled about their optical axes by {_degrees(finding)}"


def _heading(_scene: Scene, finding: Finding) -> str:
    return f"the heading drifts by {_degrees(finding)} from the first frame to the last"


def _scale(_scene: Scene, finding: Finding) -> str:
    share = 100 * (np.exp(finding.size) - 1)
    where = ("end", "start") if finding.values[0] < 0 else ("start", "end")
    off = with_sigma(share, 100 * finding.sigma, 0, " %")
    return f"the camera's steps at the {where[0]} of the video are {off} too long against those at its {where[1]}"


def _delay(_scene: Scene, finding: Finding) -> str:
    how = "late" if finding.values[0] > 0 else "early"
    return f"poses {with_sigma(finding.size, finding.sigma, 1)} frames {how}"


def _degrees(finding: Finding) -> str:
    return with_sigma(float(np.rad2deg(finding.size)), float(np.rad2deg(finding.sigma)), 1, "°")


_SAID: dict[str, Callable[[Scene, Finding], str]] = {
    "focal length": _focal,
    "principal point": _principal_point,
    "roll": _roll,
    "heading": _heading,
    "scale": _scale,
    "delay": _delay,
}
