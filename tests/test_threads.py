"""Work in threads: in order, whatever comes first, and what goes wrong at its place."""

from __future__ import annotations

import time
from threading import get_ident

import cv2
import pytest

from gtlayout.threads import in_threads


@pytest.fixture(autouse=True, params=[1, 3])
def threads(request: pytest.FixtureRequest) -> int:
    """As many as OpenCV may use."""
    before = cv2.getNumThreads()
    request.addfinalizer(lambda: cv2.setNumThreads(before))
    cv2.setNumThreads(request.param)
    return int(request.param)


def test_results_come_in_order(threads: int) -> None:
    def slow(number: int) -> tuple[int, int]:
        time.sleep(0.02 * (3 - number))
        return number, get_ident()

    found = list(in_threads(slow, range(3)))
    assert [number for number, _ in found] == [0, 1, 2]
    assert ({thread for _, thread in found} == {get_ident()}) == (threads == 1)
    assert {thread for _, thread in in_threads(slow, range(3), alone=True)} == {get_ident()}
    assert list(in_threads(slow, [])) == []


def test_what_is_raised_is_raised_at_its_place() -> None:
    def fails(number: int) -> int:
        if number == 1:
            raise ValueError("the second")
        return number

    found = in_threads(fails, range(4))
    assert next(found) == 0
    with pytest.raises(ValueError, match="the second"):
        next(found)
