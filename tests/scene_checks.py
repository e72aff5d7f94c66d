"""What several tests of readers ask of a scene."""

from __future__ import annotations

import re
from collections.abc import Sequence

import pytest

from gtlayout.scene import Scene


def assert_same_drawings(scene: Scene, again: Scene) -> None:
    """The same elements in the same frames; what is left of areas is rounding."""
    for before, after in zip(scene.key_frames, again.key_frames, strict=True):
        assert (before.frame, [e.id for e in before.elements]) == (after.frame, [e.id for e in after.elements])
        for one, other in zip(before.elements, after.elements, strict=True):
            assert one.label == other.label
            assert one.amodal.symmetric_difference(other.amodal).area == pytest.approx(0, abs=1e-6)
            assert one.visible.symmetric_difference(other.visible).area == pytest.approx(0, abs=1e-6)


def assert_one_camera_skipped(warnings: Sequence[str], says: str) -> None:
    """One warning tells of it, on one line, for the reason that matches ``says``."""
    (warning,) = [line for line in warnings if "cannot be used and were skipped" in line]
    assert re.search(says, warning), warning
    assert warning.isprintable()
