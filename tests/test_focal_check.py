"""Whether the focal length of a video is known: what halves of it and lenses disagree by, and which lens is taken."""

from __future__ import annotations

from pathlib import Path

import pytest

from gtlayout.errors import GtlayoutError
from gtlayout.importing.focal_check import Mapped, check_focal
from gtlayout.importing.importing import import_scene
from gtlayout.observer import Observer


def found(*focal_px: float | None, reprojection_px: float = 0.6) -> list[Mapped | None]:
    """All images, one half, the other half."""
    return [None if px is None else Mapped(px, 40, reprojection_px) for px in focal_px]


def test_models_that_agree_add_little() -> None:
    check = check_focal(found(500, 502, 498), found(501, 503, 499))
    assert not check.straight
    assert check.sigma_px == pytest.approx((2**2 + 0.5**2) ** 0.5)
    assert check.says == " (502 and 498 px from every other frame, 501 px without distortion)"


def test_halves_that_disagree_are_sigma() -> None:
    check = check_focal(found(500, 530, 470), found(500, 550, 460))
    assert not check.straight
    assert check.sigma_px == pytest.approx(30)


def test_distortion_that_halves_disagree_about_is_none() -> None:
    # As measured on 50 frames of a re-encoded video, true 496 px.
    check = check_focal(found(445, 387, 602, reprojection_px=0.80), found(501, 551, 495, reprojection_px=0.65))
    assert check.straight
    assert check.sigma_px == pytest.approx((28**2 + 28**2) ** 0.5)
    assert check.says == " (551 and 495 px from every other frame, 445 px with distortion)"


def test_a_lens_that_distorts_keeps_its_distortion() -> None:
    assert not check_focal(found(500, 560, 440), found(520, 521, 519, reprojection_px=0.7)).straight
    fewer: list[Mapped | None] = [Mapped(520, 30, 0.5), *found(521, 519)]
    assert not check_focal(found(500, 560, 440), fewer).straight


def test_without_a_half_the_other_is_compared_with_the_whole() -> None:
    check = check_focal(found(500, None, 480), found(None, None, None))
    assert not check.straight
    assert check.sigma_px == pytest.approx(20)
    assert check.says == " (480 px from every other frame)"
    alone = check_focal(found(500, None, None), found(None, 490, 480))
    assert (alone.straight, alone.sigma_px, alone.says) == (False, 0.0, "")
    assert check_focal(found(500, None, 480), found(505, 506, 504)).straight, "which lens both halves know"


def test_a_focal_length_needs_colmap(tmp_path: Path) -> None:
    with pytest.raises(GtlayoutError, match="add --colmap"):
        import_scene(
            tmp_path,
            tmp_path / "out",
            None,
            rate_hz=None,
            focal_px=500.0,
            depth_scale=None,
            known_distance=None,
            observer=Observer(),
        )
