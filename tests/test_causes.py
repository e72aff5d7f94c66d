"""What is said of a weak plane, and in which order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtlayout.instances import Instance, Plane, Support
from gtlayout.quality.causes import causes
from gtlayout.quality.config import QualityConfig

SOUND = Support(
    tracks=100, survived=0.6, parallax_deg=8.0, outvoted=0.0, contact_edges=3, edge_px=1.0, dominant_evidence="tracks"
)
WALL = Instance("wall_0", "wall", ((0, 0),))


def _causes(support: Support, instance: Instance = WALL) -> tuple[str, ...]:
    plane = Plane(np.array([1.0, 0, 0]), 0.0, np.zeros((4, 4)), observable=True, support=support)
    return causes(instance, plane, QualityConfig())


def test_nothing_is_said_of_sound_support() -> None:
    assert _causes(SOUND) == ()
    assert _causes(replace(SOUND, dominant_evidence="")) == ()


@pytest.mark.parametrize(
    ("support", "said"),
    [
        (replace(SOUND, dominant_evidence="priors"), "nothing but weak priors holds it"),
        (replace(SOUND, dominant_evidence="right angles"), "mostly right angles hold it"),
        (replace(SOUND, dominant_evidence="contact edges"), "mostly contact edges hold it"),
        (replace(SOUND, outvoted=0.6), "its tracks and contact edges disagree"),
        (replace(SOUND, edge_px=5.1), "its tracks and contact edges disagree"),
        (replace(SOUND, parallax_deg=1.36), "seen under 1.4° of parallax"),
        (replace(SOUND, tracks=4), "held by 4 tracks"),
        (replace(SOUND, tracks=1), "held by 1 track"),
        (replace(SOUND, survived=0.031), "only 3 % of the points on it could be followed"),
        (replace(SOUND, contact_edges=0, edge_px=np.nan), "no contact edge"),
    ],
)
def test_each_cause_in_words(support: Support, said: str) -> None:
    assert _causes(support) == (said,)


def test_nothing_at_all() -> None:
    assert _causes(Support()) == ("no point on it could be tracked", "no contact edge")
    assert _causes(Support(), replace(WALL, label="door", host=0)) == ("no point on it could be tracked",)


def test_the_most_important_comes_first() -> None:
    assert _causes(Support(4, 0.05, 0.5, 0.75, 2, 9.0, "right angles")) == (
        "mostly right angles hold it",
        "its tracks and contact edges disagree",
        "seen under 0.5° of parallax",
        "held by 4 tracks",
        "only 5 % of the points on it could be followed",
    )


def test_without_tracks_the_edges_disagree_with_one_another() -> None:
    support = Support(contact_edges=2, edge_px=9.0)
    assert _causes(support) == ("its contact edges disagree", "no point on it could be tracked")


def test_tracks_without_edges_have_nothing_to_disagree_with() -> None:
    assert _causes(replace(SOUND, outvoted=0.9, contact_edges=0, edge_px=np.nan)) == ("no contact edge",)
