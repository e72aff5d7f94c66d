"""The requests to a solver process and its answers, as plain data that JSON can hold."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from gtlayout.batch.record import Failure

BEGUN = {"begun": True}
"""Sent by a solver process before its answer, when the scene must be solved."""


@dataclass(frozen=True)
class Settings:
    """The part of the configuration that a run can choose. All other settings have their defaults."""

    seed: int = 0
    refine_cameras: bool = True
    restarts: int = 1

    def with_program(self, program: str) -> str:
        """Everything that decides a result besides the scene, as text."""
        chosen = " ".join(f"{name}={value}" for name, value in asdict(self).items())
        return f"{program} {chosen}"


@dataclass(frozen=True)
class Job:
    """One scene, or some of its restarts."""

    scene: str
    """Name."""
    source: str
    """Its folder."""
    run: str
    """Folder of the run."""
    lease: str
    """Folder that exists as long as the result is wanted. The work is done within it."""
    settings: Settings
    program: str
    """Version and hash of the code that is to solve it."""
    timeout_s: float
    """For one attempt."""
    first_restart: int
    end_restart: int

    @property
    def configuration(self) -> str:
        """Everything that decides the result besides the scene."""
        return self.settings.with_program(self.program)

    @property
    def whole(self) -> bool:
        """Whether these are all restarts of the scene."""
        return self.end_restart - self.first_restart == self.settings.restarts


@dataclass(frozen=True)
class Attempt:
    """A job as it is sent to a solver process."""

    job: Job
    work: str
    """Folder to fill."""
    stamp: str
    """Stamp of the finished result that exists; empty when there is none. So is the fingerprint."""
    fingerprint: str


@dataclass(frozen=True)
class Answer:
    """The result of an attempt."""

    figures: dict[str, Any] = field(default_factory=dict)
    """Fields of ``Record``."""
    failure: Failure | None = None
    reason: str = ""
    same: bool = False
    """The finished result is still good: nothing was solved."""
    begun: bool = True
    """The solve had begun. False when the attempt failed before."""
    unwritable: str = ""
    """Why results cannot be written: the run must stop."""
    no_solution: bool = False
    """None of these restarts has a solution. The scene depends on its other restarts."""
