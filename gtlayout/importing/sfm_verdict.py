"""The result of structure from motion, as messages that say what to film differently."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import groupby

from gtlayout.importing.frame_extraction import time_of

FEW_FEATURES = 100
"""An image with fewer shows hardly anything that could be found again."""
LINKED = 15
"""Matches that agree with one motion; COLMAP takes no pair of images with fewer."""
MIN_PARALLAX_DEG = 3.0
"""Below, depths are hardly more than guesses."""
MAX_FOCAL_SIGMA = 0.03
"""As a share; a wrong focal length bends and stretches the room."""
OTHER_MODEL = 3
"""Images that another model must add to be mentioned."""
SPANS = 4
"""More stretches of the video are only counted."""


@dataclass(frozen=True)
class Matching:
    """Features and matches of the images, before any camera is found."""

    names: tuple[str, ...]
    """Images in the order of the video."""
    features: tuple[int, ...]
    """Of each image."""
    inliers: dict[tuple[int, int], int]
    """Matches that agree with one motion, per pair of images (first < second)."""


def no_model(matching: Matching) -> str:
    """A reason why there is no model, and what to film differently."""
    names, count = matching.names, len(matching.names)
    bare = [i for i, features in enumerate(matching.features) if features < FEW_FEATURES]
    if 2 * len(bare) >= count:
        return (
            f"no cameras found: hardly any detail in {len(bare)} of {count} frames ({spans(names, bare)}); "
            "film textured things, in focus and in good light"
        )
    broken = [i for i in range(count - 1) if matching.inliers.get((i, i + 1), 0) < LINKED]
    if 2 * len(broken) >= count - 1:
        return (
            f"no cameras found: {len(broken)} of {count - 1} frames do not match the next one "
            f"({spans(names, broken)}); move slower, take more frames a second, or film more texture"
        )
    return (
        "no cameras found: the frames match one another but show no parallax; "
        "the camera must move sideways, not only turn or stand still"
    )


def weaknesses(
    matching: Matching,
    registered: Collection[str],
    others: Sequence[Collection[str]],
    parallax_deg: float,
    focal_sigma_share: float,
) -> list[str]:
    """What is doubtful about a model of the images ``registered``; ``others`` are further models not joined to it."""
    names, messages = matching.names, []
    lost = [i for i, name in enumerate(names) if name not in registered]
    if lost:
        few = 2 * len(lost) > len(names)
        messages.append(
            f"{len(lost)} of {len(names)} frames have no camera: {spans(names, lost)}"
            + ("; most of the video is lost: move slower, take more frames a second, or film more texture" * few)
        )
    apart = sorted((len(set(other) - set(registered)) for other in others), reverse=True)
    apart = [added for added in apart if added >= OTHER_MODEL]
    if apart:
        sizes = " and ".join(map(str, apart))
        messages.append(
            f"the video falls into parts that share too little to be joined: {len(registered)} frames were kept, "
            f"{sizes} left out; film without cuts and with views that overlap"
        )
    if parallax_deg < MIN_PARALLAX_DEG:
        messages.append(
            f"points are seen from directions only {parallax_deg:.1f}° apart (median): depths are doubtful; "
            "move the camera sideways, further"
        )
    if not focal_sigma_share <= MAX_FOCAL_SIGMA:
        messages.append(
            f"the focal length is good to {focal_sigma_share:.0%} only: the room may come out stretched; "
            "film longer, from more different places"
        )
    return messages


def spans(names: Sequence[str], indices: Sequence[int]) -> str:
    """The runs of consecutive ``indices``, in order: ``1.20 to 3.40 s, 5.00 s``; of a video the longest of them."""
    # Along a run of consecutive indices, index minus position stays the same.
    groups = groupby(enumerate(indices), key=lambda each: each[1] - each[0])
    runs = [[index for _, index in group] for _, group in groups]
    most = len(runs) if time_of(names[0]) is None else SPANS
    longest = sorted(sorted(runs, key=len, reverse=True)[:most])
    more = f" and {len(runs) - most} shorter parts" if len(runs) > most else ""
    return ", ".join(_span(names[run[0]], names[run[-1]]) for run in longest) + more


def _span(first: str, last: str) -> str:
    start_s, end_s = time_of(first), time_of(last)
    if start_s is None or end_s is None:
        return first if first == last else f"{first} to {last}"
    return f"{start_s:.2f} s" if first == last else f"{start_s:.2f} to {end_s:.2f} s"
