"""What is asked of a solver process and what it answers: plain data that JSON can say."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from gtlayout.batch.record import Failure

BEGUN = {"begun": True}
"""Said by a solver process before its answer, when the scene must be solved."""


@dataclass(frozen=True)
class Settings:
    """What of the configuration a run can choose; all else is the default."""

    seed: int = 0
    refine_cameras: bool = False
    restarts: int = 1

    def with_program(self, program: str) -> str:
        """All that decides a result besides the scene, in words."""
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
    """Folder that is there as long as somebody waits for the result; work goes on within it."""
    settings: Settings
    program: str
    """Version and hash of the code that is to solve it."""
    timeout_s: float
    """For one attempt."""
    first_restart: int
    end_restart: int

    @property
    def configuration(self) -> str:
        """All that decides the result besides the scene."""
        return self.settings.with_program(self.program)

    @property
    def whole(self) -> bool:
        """Whether these are all restarts of the scene."""
        return self.end_restart - self.first_restart == self.settings.restarts


@dataclass(frozen=True)
class Attempt:
    """A job as its solver process is asked for it."""

    job: Job
    work: str
    """Folder to fill."""
    stamp: str
    """Of the finished result that is there, like the fingerprint; empty when there is none."""
    fingerprint: str


@dataclass(frozen=True)
class Answer:
    """What came of an attempt."""

    figures: dict[str, Any] = field(default_factory=dict)
    """Fields of ``Record``."""
    failure: Failure | None = None
    reason: str = ""
    same: bool = False
    """The finished result is still good: nothing was solved."""
    begun: bool = True
    """It was found out that the scene must be solved; false for what went wrong before."""
    unwritable: str = ""
    """Why results cannot be written: the run must stop."""
    no_solution: bool = False
    """None of these restarts came to a solution, which leaves the scene to the others."""
