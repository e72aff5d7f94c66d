"""Cameras and images matched by time."""

from __future__ import annotations

import numpy as np
import pytest

from gtlayout.io.cameras.timestamps import common_offset_s, distances_s, match_times


def test_each_takes_the_nearest_within_the_tolerance() -> None:
    available_s = [0.0, 0.040, 0.080, 0.120]
    assert match_times([0.001, 0.0371, 0.0769, 0.5, -0.003], available_s, 0.003).tolist() == [0, 1, -1, -1, -1]
    assert match_times([0.081], available_s, 0.0).tolist() == [-1]
    assert match_times([0.080], available_s, 0.0).tolist() == [2]


def test_the_tolerance_itself_is_within_whatever_the_rounding() -> None:
    us = np.arange(50) * 33_367 + 71_234_000
    assert (match_times((us + 3000) / 1e6, us / 1e6, 0.003) == np.arange(50)).all()
    assert (match_times((us + 3001) / 1e6, us / 1e6, 0.003) == -1).all()


def test_nothing_is_given_away_twice() -> None:
    assert match_times([1.002, 1.001, 1.0015], [1.0], 0.003).tolist() == [-1, 0, -1]
    assert match_times([0.999, 1.001], [1.0], 0.003).tolist().count(0) == 1


def test_order_equal_and_missing_times() -> None:
    assert match_times([3.0, 1.0, 2.0], [2.0, 3.0, 1.0, 1.0], 0.1).tolist() == [1, 2, 0]
    assert match_times([np.nan, np.inf, 1.0], [np.nan, 1.0, np.inf], 0.1).tolist() == [-1, -1, 1]
    assert match_times([1.0], [], 0.1).tolist() == [-1]
    assert match_times([], [1.0], 0.1).tolist() == []


def test_matches_those_of_a_plain_search() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        wanted, available = rng.random(30), rng.random(60)
        found = match_times(wanted, available, 0.01)
        for i, index in enumerate(found):
            nearest = int(np.argmin(np.abs(available - wanted[i])))
            rivals = [j for j, w in enumerate(wanted) if np.argmin(np.abs(available - w)) == nearest]
            wins = i == min(rivals, key=lambda j: abs(available[nearest] - wanted[j]))
            assert index == (nearest if wins and abs(available[nearest] - wanted[i]) <= 0.01 else -1)


@pytest.mark.parametrize("offset_s", [0.04, -0.02, 12.5])
def test_a_common_offset_is_found(offset_s: float) -> None:
    rng = np.random.default_rng(1)
    wanted = np.cumsum(rng.uniform(0.03, 0.2, 40))
    available = np.delete(wanted + offset_s, [0, 7])
    found = common_offset_s(wanted, available, 0.003)
    assert found == pytest.approx(offset_s, abs=1e-9)


def test_distances_are_those_to_the_nearest() -> None:
    assert distances_s([1.5, 1.5, 9.0, np.nan], [2.0, 1.25]).tolist() == [0.25, 0.25, 7.0, np.inf]
    assert distances_s([1.0], []).tolist() == [np.inf]


def test_no_offset_where_none_helps() -> None:
    times = np.arange(10) / 30
    assert common_offset_s(times, times, 0.003) is None
    assert common_offset_s(times, [], 0.003) is None
    assert common_offset_s([], times, 0.003) is None
