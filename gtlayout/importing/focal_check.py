"""The focal length found several times: from all of a video and from either half, with distortion and without.

Its σ from one bundle adjustment is that of the noise of points. On a short path distortion and focal length make up for
each other, and the mapping ends where it began: then 445 ± 2 px come out for a true 496.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtlayout.importing.mapping import FREE, STRAIGHT, largest, map_images

if TYPE_CHECKING:
    import pycolmap

MUCH_BETTER = 0.5
"""A lens without distortion is taken when halves disagree by less than this share of what they do with distortion …"""
HARDLY_WORSE = 1.05
"""… and points lie at most so many times as far off."""


@dataclass(frozen=True)
class Mapped:
    """What one model says."""

    focal_px: float
    images: int
    """That have a pose."""
    reprojection_px: float
    """Mean."""


@dataclass(frozen=True)
class FocalCheck:
    """How much the models agree."""

    straight: bool
    """Whether the lens is to have no distortion."""
    sigma_px: float
    """What they disagree by; 0 when there is nothing to compare with."""
    says: str
    """What each of them found, to follow the focal length."""


def checked_models(
    database: Path,
    images: Path,
    work: Path,
    names: Sequence[str],
    models: list[pycolmap.Reconstruction],
    progress: Callable[[int, int], None],
) -> tuple[list[pycolmap.Reconstruction], FocalCheck]:
    """The models with the lens that the halves of the video agree on, and what each of them says.

    ``models`` are those of all images ``names`` with a free lens; ``database`` and ``work`` are as for ``map_images``.
    """
    straight = map_images(database, images, work, names, STRAIGHT)
    found = {FREE: [_mapped(models, names)], STRAIGHT: [_mapped(straight, names)]}
    runs = [(lens, names[start::2]) for lens in found for start in (0, 1)]
    for done, (lens, half) in enumerate(runs):
        progress(done, len(runs))
        found[lens].append(_mapped(map_images(database, images, work, half, lens), half))
    progress(len(runs), len(runs))
    check = check_focal(found[FREE], found[STRAIGHT])
    return straight if check.straight else models, check


def _mapped(models: Sequence[pycolmap.Reconstruction], names: Sequence[str]) -> Mapped | None:
    """What the largest model of some images says; None when it has less than half of them."""
    model = models[largest(models)] if models else None
    if model is None or 2 * model.num_reg_images() < len(names):
        return None
    (camera,) = model.cameras.values()
    return Mapped(float(camera.params[0]), model.num_reg_images(), float(model.compute_mean_reprojection_error()))


def check_focal(free: Sequence[Mapped | None], straight: Sequence[Mapped | None]) -> FocalCheck:
    """Compare models of (all images, one half, the other half), found with distortion and without.

    None stands for a model that was not found; that of all images with distortion there must be.
    """
    chosen, other = free, straight
    takes_straight = _is_better(straight, free)
    if takes_straight:
        chosen, other = straight, free
    assert chosen[0] is not None
    halves_px = [half.focal_px for half in chosen[1:] if half is not None]
    # Half of the difference of two halves is σ of their mean; a half alone differs from the whole by as much.
    parts = [np.ptp(halves_px) / 2 if len(halves_px) == 2 else abs(px - chosen[0].focal_px) for px in halves_px[:1]]
    if other[0] is not None:
        parts.append(abs(other[0].focal_px - chosen[0].focal_px) / 2)
    lines = [" and ".join(f"{px:.0f}" for px in halves_px) + " px from every other frame"] if halves_px else []
    if other[0] is not None:
        lines.append(f"{other[0].focal_px:.0f} px with{'' if takes_straight else 'out'} distortion")
    says = f" ({', '.join(lines)})" if lines else ""
    return FocalCheck(takes_straight, float(np.linalg.norm(parts)) if parts else 0.0, says)


def _is_better(straight: Sequence[Mapped | None], free: Sequence[Mapped | None]) -> bool:
    """Whether halves agree much better without distortion, with hardly larger errors and no fewer images."""
    if straight[0] is None or free[0] is None or straight[0].images < free[0].images:
        return False
    if straight[0].reprojection_px > HARDLY_WORSE * free[0].reprojection_px:
        return False
    return _disagreement_px(straight) < MUCH_BETTER * _disagreement_px(free)


def _disagreement_px(models: Sequence[Mapped | None]) -> float:
    """Of the halves; infinite when one was not found."""
    halves_px = [half.focal_px for half in models[1:] if half is not None]
    return float(np.ptp(halves_px)) if len(halves_px) == len(models) - 1 else np.inf
