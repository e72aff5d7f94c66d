"""The solve behind the page: at once after a change, in full when nobody has drawn for a while."""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from gtlayout.annotate.advice import Advice, advice, before_a_room
from gtlayout.annotate.assistant import Assistant, Finding, Session
from gtlayout.api import save
from gtlayout.errors import GtlayoutError, one_line
from gtlayout.scene import KeyFrame, Scene
from gtlayout.solution import Solution

FULL_AFTER_S = 3.0
"""Without a change, until the full solve begins."""

END_S = 0.5
"""A solve that has just begun its last steps may take so long at the end."""

Drawings = Callable[[], tuple[tuple[KeyFrame, ...], tuple[str, ...]]]


@dataclass(frozen=True)
class Solved:
    """A solved room, and what is said of it."""

    number: int
    """Counts up from 1."""
    solution: Solution
    full: bool
    """Whether it is of the full solve; its results are then in the scene's results folder."""
    seconds: float
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class State:
    """What the solver does, and the last room."""

    at_work: Literal["", "quick", "full"] = ""
    problem: str = ""
    """Why the drawings as they are make no room; empty when they do."""
    warnings: tuple[str, ...] = ()
    """What was repaired or left out of the drawings when they were read."""
    solved: Solved | None = None
    advice: tuple[Advice, ...] = ()
    next_frames: tuple[int, ...] = ()


class Solver:
    """One thread that solves the latest drawings; ``state`` may be read at any time."""

    def __init__(self, scene: Scene, assistant: Assistant, drawings: Drawings, results: Path) -> None:
        self.state = State()
        self._scene, self._assistant, self._drawings, self._results = scene, assistant, drawings, results
        self._session: Session = assistant.session(scene)
        self._changed = threading.Event()
        self._closed = False
        self._saving = threading.Lock()
        self._thread = threading.Thread(target=self._work, daemon=True, name="solver")
        self._thread.start()
        self.changed()

    def changed(self) -> None:
        """Something was drawn."""
        self._changed.set()

    def close(self) -> bool:
        """No more solves, and nothing half-written. Returns whether the last one has ended: none can be stopped."""
        self._closed = True
        self._changed.set()
        self._thread.join(timeout=END_S)
        self._saving.acquire()  # and never given back: from here on nothing is written
        return not self._thread.is_alive()

    def _work(self) -> None:
        full_is_due = False
        while not self._closed:
            if self._changed.wait(FULL_AFTER_S if full_is_due else None):
                self._changed.clear()
                if self._closed:
                    return
                full_is_due = self._solve(full=self.state.solved is None) and not self._is_full
            else:
                self._solve(full=True)
                full_is_due = False

    @property
    def _is_full(self) -> bool:
        return self.state.solved is not None and self.state.solved.full

    def _solve(self, *, full: bool) -> bool:
        """Solve the drawings as they are now. Returns whether there is a room; any problem is in ``state``."""
        self.state = replace(self.state, at_work="full" if full else "quick")
        try:
            key_frames, warnings = self._drawings()
            drawn = replace(self._scene, key_frames=key_frames)
            following = tuple(self._assistant.next_frames(drawn, 3))
            self.state = replace(self.state, warnings=warnings, next_frames=following)
            if not key_frames:
                self.state = replace(State(), advice=before_a_room(0, following), next_frames=following)
                return False
            if self.state.solved is None:
                self.state = replace(self.state, advice=before_a_room(len(key_frames), following))
            self.state = replace(self.state, problem="", solved=self._solved(key_frames, full))
            assert self.state.solved is not None
            self.state = replace(self.state, advice=advice(self.state.solved.solution, following))
            return True
        except GtlayoutError as error:
            self._failed(str(error))
        except Exception as error:  # a bug in a solve must not take the page with it
            traceback.print_exc(file=sys.stderr)
            self._failed(one_line(error))
        finally:
            self.state = replace(self.state, at_work="")
        return False

    def _solved(self, key_frames: Sequence[KeyFrame], full: bool) -> Solved:
        start = time.perf_counter()
        solution = self._session.solve(key_frames) if full else self._session.quick(key_frames)
        seconds = time.perf_counter() - start
        if full:
            with self._saving:
                save(solution, self._results)
        last = self.state.solved
        findings = tuple(self._assistant.review(solution))
        return Solved(last.number + 1 if last else 1, solution, full, seconds, findings)

    def _failed(self, problem: str) -> None:
        self.state = replace(self.state, problem=problem)
