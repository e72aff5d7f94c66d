"""``eval/dimension_accuracy.py``: true lengths in closed form, and what a table says of made results."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rooms
from test_solved_room import DOOR, WINDOW, room_of

import dimension_accuracy
from common.metrics import Metric
from gtlayout.dimensions.take import all_dimensions
from gtlayout.errors import GtlayoutError
from gtlayout.io.truth import TruePlane


def true_of(surface: rooms.Surface, shift: float = 0.0) -> TruePlane:
    plane = surface.plane
    return TruePlane(plane.normal, plane.d + shift, True, ((surface.corners,),))


def test_true_lengths_are_between_the_true_planes_and_across_true_outlines() -> None:
    surfaces = (*rooms.BOX, DOOR, WINDOW)
    taken = {(one.kind, one.second): one for one, _ in all_dimensions(room_of(surfaces))}
    true = {i: true_of(surface) for i, surface in enumerate(surfaces)}
    for one in taken.values():
        assert dimension_accuracy.true_length(one, true) == pytest.approx(one.length)
    true[0] = true_of(rooms.FLOOR, 0.02)
    height = next(one for one in taken.values() if one.kind == "height")
    assert dimension_accuracy.true_length(height, true) == pytest.approx(rooms.HEIGHT_M + 0.02), (
        "the floor lies 2 cm lower"
    )
    assert dimension_accuracy.true_length(taken["sill", 7], true) == pytest.approx(0.92)
    wider = rooms.Surface("door", rooms.rectangle([1.4, rooms.DEPTH_M, 0.0], [1.1, 0, 0], [0, 0, 2.0]), host=4)
    true[6] = true_of(wider)
    assert dimension_accuracy.true_length(taken["opening width", 6], true) == pytest.approx(1.1)
    del true[1]
    assert np.isnan(dimension_accuracy.true_length(height, true)), "nobody knows where the ceiling is"


def test_the_table_counts_what_is_called_and_what_is() -> None:
    def row(error: float, deviations: float, called: float) -> list[Metric]:
        values = {"error": error, "deviations": deviations, "called": called, "true": float(error <= 0.05)}
        return [Metric(key, value, "", None) for key, value in values.items()]

    def plain(**values: float) -> list[Metric]:
        return [Metric(key.replace("_", " "), value, "", None) for key, value in values.items()]

    scenes = [
        {"height a b": row(0.01, 0.5, 1.0), "width a b": row(0.04, 2.5, 0.0)},
        {
            "sill a b": row(0.06, 1.0, 1.0),
            "measured": plain(within_before=0.5, within_after=1.0, named=0.25),
            "false": plain(is_named=1.0, another_named=0.0, deviations_of_it=4.0, drag=1.5),
        },
    ]
    found = {metric.key: metric.value for metric in dimension_accuracy.summary(scenes)}
    assert found["dimensions"] == 3
    assert found["median error"] == 0.04
    assert found["within 2 σ"] == pytest.approx(2 / 3)
    assert found["called LOA20"] == pytest.approx(2 / 3)
    assert found["… and it is"] == 0.5
    assert found["of those that are LOA20 called so"] == 0.5
    assert (found["share called before measuring"], found["… after 3"]) == (0.5, 1.0)
    assert (found["5 cm off: named"], found["… drag above 1 σ"]) == (1.0, 1.0)


def test_a_scene_without_truth_is_refused(tiny: Path) -> None:
    with pytest.raises(GtlayoutError, match="so nothing to compare dimensions with"):
        dimension_accuracy.measure(tiny)
