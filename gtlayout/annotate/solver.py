"""The solve behind the page: at once after a change, in full when nobody has drawn for a while."""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

from gtlayout.annotate.advice import Advice, advice, before_a_room
from gtlayout.api import save
from gtlayout.errors import GtlayoutError, one_line
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.order import next_frames
from gtlayout.proposals.proposal import Proposal
from gtlayout.proposals.propose import Proposer
from gtlayout.review.findings import Finding
from gtlayout.review.review import review
from gtlayout.scene import ImageArray, KeyFrame, Scene
from gtlayout.session.session import Session
from gtlayout.solution import Solution

Work = Literal["quick", "full"]
WORKS: tuple[Work, ...] = get_args(Work)
LEAST_FRAMES = 2
"""Drawn frames for a verdict: one alone fits its own drawing, whatever that is."""
SUGGESTED = 3
"""Frames that are suggested to be drawn next."""
FULL_AFTER_S = 3.0
"""Without a change, until the full solve begins."""

END_S = 0.5
"""So long the end waits for a solve."""

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
    """Of the last full solve, worst first."""
    reviewed: tuple[KeyFrame, ...]
    """The drawings that they are of."""
    proposer: Proposer
    _proposals: dict[int, Proposal] = field(default_factory=dict)
    """Those that were asked for, by frame."""

    def propose(self, frame: int, image: Callable[[], ImageArray]) -> Proposal:
        """What would be drawn in a frame, index into the scene's, whose (H, W, 3) BGR pixels ``image`` gives."""
        if frame not in self._proposals:
            self._proposals[frame] = self.proposer.propose(frame, image())
        return self._proposals[frame]


@dataclass(frozen=True)
class State:
    """What the solver does, and the last room."""

    at_work: Work | None = None
    problem: str = ""
    """Why the drawings as they are make no room; empty when they do."""
    warnings: tuple[str, ...] = ()
    """What was repaired or left out of the drawings when they were read."""
    solved: Solved | None = None
    advice: tuple[Advice, ...] = ()
    next_frames: tuple[int, ...] = ()


class Solver:
    """Two threads that solve the latest drawings: one at once, and one in full behind it.

    ``state`` may be read at any time. A quick solve may run beside a full one, which is then of older drawings: it is
    what the next quick one goes on from, and is not shown.
    """

    def __init__(self, scene: Scene, session: Session, drawings: Drawings, results: Path) -> None:
        self._state = State()
        self._scene, self._session, self._drawings, self._results = scene, session, drawings, results
        self._change = threading.Condition()
        self._closed = False
        self._saving = threading.Lock()
        self._running: set[Work] = set()
        self._quick_is_due = False
        self._threads = [threading.Thread(target=self._work, args=(work,), daemon=True, name=work) for work in WORKS]
        self._full_is_due_at: float | None = time.monotonic()
        for thread in self._threads:
            thread.start()

    @property
    def state(self) -> State:
        """What is found so far."""
        with self._change:
            return replace(self._state, at_work=next((work for work in WORKS if work in self._running), None))

    def changed(self) -> None:
        """Something was drawn."""
        with self._change:
            self._quick_is_due = True
            self._full_is_due_at = time.monotonic() + FULL_AFTER_S
            self._change.notify_all()

    def close(self) -> bool:
        """No more solves, and nothing half-written. Returns whether the last one has ended: none can be stopped."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        for thread in self._threads:
            thread.join(timeout=END_S)
        self._saving.acquire()  # and never given back: from here on nothing is written
        return not any(thread.is_alive() for thread in self._threads)

    def _work(self, work: Work) -> None:
        while self._begin(work):
            try:
                self._solve(full=work == "full")
            except GtlayoutError as error:
                self._update(problem=str(error))
            except Exception as error:  # a bug in a solve must not take the page with it
                traceback.print_exc(file=sys.stderr)
                self._update(problem=one_line(error))
            finally:
                with self._change:
                    self._running.discard(work)
                    self._change.notify_all()

    def _begin(self, work: Work) -> bool:
        """Wait until there is something to do. Returns whether there is: not at the end."""
        with self._change:
            while not self._closed and not self._is_due(work):
                due = self._full_is_due_at
                self._change.wait(None if work == "quick" or due is None else max(due - time.monotonic(), 0.01))
            if self._closed:
                return False
            self._running.add(work)
            if work == "quick" or self._state.solved is None:
                self._quick_is_due = False
            if work == "full":
                self._full_is_due_at = None
            return True

    def _is_due(self, work: Work) -> bool:
        if work == "quick":
            return self._quick_is_due and self._state.solved is not None
        due = self._full_is_due_at
        return due is not None and time.monotonic() >= due and not self._running

    def _solve(self, *, full: bool) -> None:
        """Solve the drawings as they are now."""
        key_frames, warnings = self._drawings()
        following = next_frames(replace(self._scene, key_frames=key_frames), SUGGESTED)
        self._update(warnings=warnings, next_frames=following)
        last = self.state.solved
        if last is None or not key_frames:
            self._update(problem="", solved=None, advice=before_a_room(len(key_frames), following))
        if not key_frames:
            return
        start = time.perf_counter()
        solution = self._session.solve(key_frames) if full else self._session.quick(key_frames)
        seconds = time.perf_counter() - start
        outdated = self._drawings()[0] is not key_frames
        if full and outdated:
            self._again()
            if last is not None:
                return
        number = last.number + 1 if last else 1
        if full or last is None:
            findings, reviewed = review(solution), key_frames
        else:
            findings, reviewed = last.findings, last.reviewed
        proposer = Proposer(solution, ProposalConfig())
        solved = Solved(number, solution, full, seconds, findings, reviewed, proposer)
        if full and not outdated:
            self._save(solution)
        enough = len(key_frames) >= LEAST_FRAMES
        said = advice(solution, following, thorough=full) if enough else before_a_room(len(key_frames), following)
        self._update(problem="", solved=solved, advice=said)

    def _again(self) -> None:
        """Something was drawn during a full solve."""
        with self._change:
            self._quick_is_due = True
            self._full_is_due_at = self._full_is_due_at or time.monotonic()
            self._change.notify_all()

    def _save(self, solution: Solution) -> None:
        with self._saving:
            save(solution, self._results)

    def _update(self, **values: Any) -> None:
        with self._change:
            self._state = replace(self._state, **values)
