"""What was found out about errors that all cameras share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gtlayout.camera_errors.models import CameraError, corrected
from gtlayout.camera_errors.path import CameraPath
from gtlayout.scene import FloatArray, Scene

Decision = Literal["corrected", "doubted", "fine"]


@dataclass(frozen=True)
class Finding:
    """One error."""

    error: CameraError
    values: FloatArray
    """(size,) that correct it, in its units; an estimate also where nothing is wrong."""
    covariance: FloatArray
    """(size, size) of the values, given the errors that were corrected."""
    decision: Decision

    @property
    def size(self) -> float:
        """Length of the values."""
        return float(np.linalg.norm(self.values))

    @property
    def sigma(self) -> float:
        """Its σ: that of the values along themselves."""
        along = self.values / max(self.size, np.finfo(float).tiny)
        return float(np.sqrt(along @ self.covariance @ along))


@dataclass(frozen=True)
class CameraDoubt:
    """All errors that were looked for; none when there was too little to judge by."""

    findings: tuple[Finding, ...] = ()
    given_px: float = np.nan
    """Median reprojection error, with the given cameras, of tracks that corrections were not found with."""
    corrected_px: float = np.nan
    """The same with corrected cameras; NaN where nothing was corrected."""

    @property
    def corrected(self) -> bool:
        """Whether any error was corrected."""
        return any(finding.decision == "corrected" for finding in self.findings)

    @property
    def values(self) -> FloatArray:
        """(P,) that correct what was decided to be corrected; 0 of all else."""
        return np.concatenate([f.values if f.decision == "corrected" else 0 * f.values for f in self.findings])

    def correct(self, scene: Scene) -> Scene:
        """The scene, as it was looked at, with corrected cameras; the scene itself where nothing was corrected."""
        return self.changed(scene, self.values) if self.corrected else scene

    def changed(self, scene: Scene, values: FloatArray) -> Scene:
        """The scene with cameras changed by (P,) values of all errors, in the order of ``findings``.

        For what an error that stays does to the results: give the corrected scene, and one value after the other.
        """
        errors: Sequence[CameraError] = [finding.error for finding in self.findings]
        return corrected(CameraPath.of(scene), errors, values).on(scene)
