"""One fault, and what is promised of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

Spoil: TypeAlias = Callable[[Path], object]
"""Changes a folder that is the case's own."""
Room: TypeAlias = Literal["small", "room", "turning", "colmap", "solved"]
"""What a case begins with: see ``faulty.folders``."""
SCENE, HERE = "SCENE", "HERE"
"""In a command: the spoiled scene, and the folder it lies in, which is the case's own, too."""


@dataclass(frozen=True)
class Case:
    """A scene folder is spoiled, a command is run on it, and the user sees one thing."""

    part: str
    """Of the program: a heading of the page."""
    fault: str
    """Its kind: missing, truncated, NaN, …"""
    what: str
    """What exactly is wrong; with ``part`` and ``fault`` the case's name."""
    spoil: Spoil
    status: int
    """Of the exit."""
    says: tuple[str, ...]
    """Words of the message that must be seen, in this order."""
    command: tuple[str, ...] = ("check", SCENE)
    room: Room = "small"
    silent: tuple[str, ...] = ()
    """Words that must not be seen."""
    way: Literal["here", "process", "nobody", "small files", "full disk", "two", "interrupted"] = "here"
    """How the command is run: see ``faulty.run``."""
    slow: bool = False
    """Only ``faults.py`` runs it."""

    @property
    def name(self) -> str:
        """Unique."""
        return f"{self.part}, {self.fault}: {self.what}"
