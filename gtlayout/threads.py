"""Work in several threads, for what spends its time in OpenCV and NumPy, which let others run meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import cv2

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_threads(work: Callable[[Item], Result], items: Sequence[Item], *, alone: bool = False) -> Iterator[Result]:
    """The results of ``work`` for each item, in the order of ``items``, as they come.

    As many threads work as OpenCV may use; none besides the caller's where that is one, or ``alone`` is asked for. What
    ``work`` raises is raised at its item's place, and what has not begun by then is left out.
    """
    workers = 1 if alone else min(cv2.getNumThreads(), len(items))
    if workers < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(work, items)
