"""Where the seconds of a solve go, stage by stage, and the floor: what following points costs by itself."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from common.metrics import Metric
from gtlayout.api import load, save
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import read_gray
from gtlayout.method import solve
from gtlayout.observer import Observer
from gtlayout.review.review import review
from gtlayout.scene import ImageArray, Scene
from gtlayout.tracking.config import TrackingConfig
from gtlayout.tracking.klt import KltTracker
from gtlayout.tracking.track import track

IMPORTS = "import gtlayout.api, gtlayout.method, gtlayout.results.tables, gtlayout.review.review"
"""What ``gtlayout solve`` imports before it begins."""
ELAPSED, CPU = "elapsed", "CPU"


@dataclass(frozen=True)
class Seconds:
    """What something took."""

    elapsed: float = 0.0
    cpu: float = 0.0
    """Of all threads."""

    def __add__(self, other: Seconds) -> Seconds:
        return Seconds(self.elapsed + other.elapsed, self.cpu + other.cpu)


@dataclass
class _Clock(Observer):
    """Notes how long each stage takes, up to the next."""

    taken: dict[str, Seconds] = field(default_factory=dict)
    _name: str = ""
    _since: tuple[float, float] = (0.0, 0.0)

    def stage(self, name: str) -> None:
        """See ``Observer``; the empty name ends the last stage."""
        elapsed, cpu = time.perf_counter(), time.process_time()
        if self._name:
            took = Seconds(elapsed - self._since[0], cpu - self._since[1])
            self.taken[self._name] = self.taken.get(self._name, Seconds()) + took
        self._name, self._since = name, (elapsed, cpu)


def stage_rows(folder: Path, name: str, repeats: int) -> dict[str, list[Metric]]:
    """Two rows for the scene in ``folder``, elapsed and CPU seconds: each stage of ``gtlayout solve``, all, the floor.

    Of several repeats each stage's shortest counts. Raises GtlayoutError when the scene cannot be solved.
    """
    every = [_stages(folder) for _ in range(repeats)]
    floor = shortest([time_floor(load(folder)) for _ in range(repeats)])
    stages = {stage: shortest([taken[stage] for taken in every]) for stage in every[0]}
    return {f"{name}, {what}": _row(stages, floor, what) for what in (ELAPSED, CPU)}


def shortest(repeats: list[Seconds]) -> Seconds:
    """The least of each."""
    return Seconds(min(one.elapsed for one in repeats), min(one.cpu for one in repeats))


def _row(stages: dict[str, Seconds], floor: Seconds, what: str) -> list[Metric]:
    def of(one: Seconds) -> float:
        return one.elapsed if what == ELAPSED else one.cpu

    total = sum(of(one) for one in stages.values())
    return [
        *(Metric(stage, of(one), "s", False) for stage, one in stages.items()),
        Metric("all", total, "s", False),
        Metric("floor", of(floor), "s", None),
        Metric("times_the_floor", total / of(floor), "", False),
    ]


def _stages(folder: Path) -> dict[str, Seconds]:
    clock = _Clock()
    clock.taken["import"] = _in_a_child([sys.executable, "-c", IMPORTS])
    clock.stage("reading")
    scene = load(folder)
    solution = solve(scene, Config(), clock)
    clock.stage("review")
    findings = review(solution)
    clock.stage("saving")
    with tempfile.TemporaryDirectory() as out:
        save(solution, out, findings)
    clock.stage("")
    return clock.taken


def _in_a_child(command: list[str]) -> Seconds:
    import resource  # noqa: PLC0415 - Unix only, as is all that is timed here

    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True)
    elapsed, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Seconds(elapsed, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)


def time_floor(scene: Scene) -> Seconds:
    """What it takes to decode every frame once, and to follow as many points as stage 1 does to the next one and back.

    The points are those that stage 1 has in each frame. Frames that cannot be read are left out.
    """
    config = TrackingConfig()
    tracks = track(scene, config, 0)
    points_px = [tracks.points_px[tracks.frame == f] for f in range(len(scene.frames))]
    follow = KltTracker(config.window_px, config.levels, config.max_forward_backward_px)
    return _taken(lambda: _decode_and_follow(scene, points_px, follow))


def _decode_and_follow(scene: Scene, points_px: list[np.ndarray], follow: KltTracker) -> None:
    before: ImageArray | None = None
    for frame, points in zip(scene.frames, [np.empty((0, 2)), *points_px], strict=False):
        try:
            image = read_gray(frame)
        except GtlayoutError:
            continue
        if before is not None and before.shape == image.shape:
            follow(before, image, points, points)
        before = image


def _taken(work: Callable[[], None]) -> Seconds:
    elapsed, cpu = time.perf_counter(), time.process_time()
    work()
    return Seconds(time.perf_counter() - elapsed, time.process_time() - cpu)
