"""The folder of a run: the request in run.json, a folder per scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from gtlayout.batch.record import (
    RECORD_FILE,
    RUN_FILE,
    Record,
    read_record,
    scene_folder,
)
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json, write_json_atomic

FORMAT = "gtlayout-run/1"


@dataclass(frozen=True)
class Run:
    """The content of run.json, and the records so far."""

    folder: Path
    scenes: tuple[str, ...]
    """Names of all scenes of the run, sorted."""
    records: dict[str, Record]
    """Of those that are finished with this configuration, in the order of ``scenes``."""
    config: dict[str, Any]
    """Every setting."""
    configuration: str
    """Program and settings, as in the records."""

    @property
    def version(self) -> str:
        """Of gtlayout, with a hash of its code."""
        return self.configuration.partition(" ")[0]


def write_run(folder: Path, scenes: Sequence[str], config: Mapping[str, Any], configuration: str) -> None:
    """Write run.json. Raises GtlayoutError when the disk does not take it."""
    run = {"format": FORMAT, "configuration": configuration, "config": dict(config), "scenes": list(scenes)}
    write_json_atomic(folder / RUN_FILE, run)


def is_run(folder: Path) -> bool:
    """Whether ``gtlayout batch`` made this folder."""
    return (folder / RUN_FILE).is_file()


def check_free(folder: Path) -> None:
    """Raises GtlayoutError when a run cannot go to ``folder``, because it holds something else."""
    if folder.exists() and not is_run(folder) and (not folder.is_dir() or any(folder.iterdir())):
        raise GtlayoutError(f"{folder} holds something else than a run: name a new folder")


def read_run(folder: Path) -> Run:
    """Read run.json and the records beside the results.

    Raises GtlayoutError when it is no run or run.json is damaged. A damaged record counts as absent: the next
    run solves the scene again.
    """
    path = folder / RUN_FILE
    if not path.is_file():
        raise GtlayoutError(f"{folder} is no run: there is no {RUN_FILE}; gtlayout batch ROOT --out {folder} makes one")
    data = read_json(path)
    try:
        if data["format"] != FORMAT:
            raise ValueError(f'"format" is {data["format"]!r}, not {FORMAT!r}')
        names, config = [_scene_name(name) for name in data["scenes"]], dict(data["config"])
        configuration = str(data["configuration"])
    except (KeyError, TypeError, ValueError) as error:
        raise GtlayoutError(f"{path} is damaged: {error}; run the batch again") from error
    return Run(folder, tuple(names), recorded(folder, names, configuration), config, configuration)


def _scene_name(name: Any) -> str:
    """Raises TypeError or ValueError when it is no name of a scene."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        raise ValueError(f"the scene {name!r} leads out of the run")
    if "\0" in name:
        raise ValueError(f"the scene {name!r} can be no folder")
    name.encode()
    return str(name)


def recorded(folder: Path, scenes: Iterable[str], configuration: str) -> dict[str, Record]:
    """The records of those scenes that are finished with this configuration."""
    found = {}
    for scene in scenes:
        path = scene_folder(folder, scene) / RECORD_FILE
        try:
            record = read_record(path)
        except GtlayoutError:
            continue
        if record.configuration == configuration:
            found[scene] = record
    return found
