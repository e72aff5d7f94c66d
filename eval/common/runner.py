"""Measuring many scenes: in parallel, with a progress bar; a run that was cut short goes on where it was."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from common.metrics import FORMAT, Metric, read_rows
from gtlayout.batch.fingerprint import fingerprint, inputs_of, program
from gtlayout.batch.scenes import has_cameras
from gtlayout.errors import GtlayoutError, one_line
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.io.scene_folder import CAMERA_READERS
from gtlayout.processes import Died, outcomes

SceneRows = dict[str, list[Metric]]
"""Label of a row (a method, a variant) → what was measured for it in one scene."""
Measure = Callable[[Path], Mapping[str, list[Metric]]]
_Todo = Mapping[str, Callable[[], Mapping[str, list[Metric]]]]
SCENES = "scenes"
"""Folder of the results of each scene, inside the folder of all results."""


@dataclass(frozen=True)
class Task:
    """Something to measure of a scene, with a result of its own."""

    scene: Path
    measure: Callable[[], Mapping[str, list[Metric]]]
    """With several processes a function that can be pickled."""
    settings: str
    """Whatever else decides the result, in words."""


@dataclass(frozen=True)
class _Outcome:
    rows: SceneRows
    error: str | None = None
    """Why the scene failed; None when it did not."""


def find_scenes(root: Path) -> dict[str, Path]:
    """Name → folder of ``root`` itself when cameras of a known format are in it, else of each sub-folder with some.

    Raises GtlayoutError when there is none.
    """
    if not root.is_dir():
        raise GtlayoutError(f"no folder {root}")
    if has_cameras(root):
        return {root.resolve().name: root}
    below = sorted(path for path in root.iterdir() if path.is_dir() and not path.name.startswith("."))
    scenes = {path.name: path for path in below if has_cameras(path)}
    if not scenes:
        looked_for = "; ".join(f"{reader.looked_for} ({reader.name})" for reader in CAMERA_READERS)
        raise GtlayoutError(f"no scene in {root} and its folders; looked for {looked_for}")
    return scenes


def scenes_by_folder(roots: Sequence[Path]) -> dict[str, dict[str, Path]]:
    """Name of the folder that scenes lie in → scene → its folder. Raises GtlayoutError when names are not unique."""
    if not roots:
        raise GtlayoutError("name at least one scene folder, or folder of scene folders")
    found: dict[str, dict[str, Path]] = {}
    for root in roots:
        for name, path in find_scenes(root).items():
            scenes = found.setdefault(path.resolve().parent.name, {})
            if scenes.setdefault(name, path).resolve() != path.resolve():
                raise GtlayoutError(f"{scenes[name]} and {path}: two scenes of one name in folders of one name")
    return found


def run_scenes(
    scenes: Mapping[str, Path], out_dir: Path, measure: Measure, settings: str, jobs: int = 1
) -> dict[str, SceneRows]:
    """Measure each scene, or take the result of an earlier run when nothing it depends on has changed since.

    The result of each scene goes to ``out_dir/scenes/<name>.json`` as soon as it is there. It is taken again while
    ``settings``, gtlayout's code and the scene's files are the same. Changes in the scripts here are not noticed:
    remove the folder then.

    A scene that fails is named on stderr, with the reason in its file, and tried again by the next run; the others
    go on.

    Args:
        scenes: name → folder.
        out_dir: folder of the results; made if absent.
        measure: what is run on the folder of each scene; with ``jobs`` > 1 a function that can be pickled.
        settings: whatever else decides the result, in words.
        jobs: processes, of one thread each; 1 = this process, with its threads.

    Returns:
        Scene → label of the row → metrics, in the order of ``scenes``; without the scenes that failed.

    Raises:
        GtlayoutError: a name is no file name, or results cannot be written.
    """
    tasks = {name: Task(path, partial(measure, path), settings) for name, path in scenes.items()}
    return run_tasks(tasks, out_dir, jobs)


def run_tasks(tasks: Mapping[str, Task], out_dir: Path, jobs: int = 1) -> dict[str, SceneRows]:
    """The same for several things to measure of each scene: the result of each goes to a file of its own."""
    for name in tasks:
        if Path(name).name != name or name.startswith("."):
            raise GtlayoutError(f"scene {name!r} cannot be a file name: call it otherwise")
    files = {name: out_dir / SCENES / f"{name}.json" for name in tasks}
    fingerprints = _fingerprints(tasks, out_dir)
    done = {name: rows for name in tasks if (rows := _finished(files[name], fingerprints[name])) is not None}
    todo = {name: task.measure for name, task in tasks.items() if name not in done}
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        bar = bars.add_task("scenes", total=len(tasks), completed=len(done))
        for name, outcome in _in_processes(todo, jobs) if jobs > 1 else _here(todo):
            metrics = {label: [asdict(metric) for metric in row] for label, row in outcome.rows.items()}
            record = {"format": FORMAT, "fingerprint": fingerprints[name], "error": outcome.error, "rows": metrics}
            write_json_atomic(files[name], record)
            if outcome.error is None:
                done[name] = outcome.rows
            else:
                print(f"{name}: {outcome.error}", file=sys.stderr)
            bars.advance(bar)
    return {name: done[name] for name in tasks if name in done}


def errors_of(scenes: Iterable[str], out_dir: Path) -> dict[str, str]:
    """Name → reason, for those that failed in the last run into ``out_dir``. Raises GtlayoutError on damaged files."""
    found = {name: read_json(out_dir / SCENES / f"{name}.json").get("error") for name in scenes}
    return {name: str(error) for name, error in found.items() if error is not None}


def _finished(path: Path, fingerprint: str) -> SceneRows | None:
    """The result in a file; None when there is none that may be taken again."""
    if not path.exists():
        return None
    try:
        record = read_json(path)
        return read_rows(path) if record.get("fingerprint") == fingerprint and record.get("error") is None else None
    except GtlayoutError:
        return None  # Damaged: it will be written anew.


def _fingerprints(tasks: Mapping[str, Task], out_dir: Path) -> dict[str, str]:
    """Name → hash of all that its result depends on. Raises GtlayoutError when a scene's files cannot be read."""
    code = program()
    scenes = {task.scene for task in tasks.values()}
    contents = {scene: fingerprint(inputs_of(scene, code, [out_dir]), code) for scene in scenes}
    return {
        name: hashlib.sha256(repr((contents[task.scene], task.settings)).encode()).hexdigest()
        for name, task in tasks.items()
    }


def _attempt(measure: Callable[[], Mapping[str, list[Metric]]]) -> _Outcome:
    try:
        return _Outcome(dict(measure()))
    except GtlayoutError as error:
        return _Outcome({}, str(error))
    except Exception as error:
        # A bug in one scene must not cost the night's other scenes.
        return _Outcome({}, one_line(error))


def _here(todo: _Todo) -> Iterator[tuple[str, _Outcome]]:
    for name, measure in todo.items():
        yield name, _attempt(measure)


def _in_processes(todo: _Todo, jobs: int) -> Iterator[tuple[str, _Outcome]]:
    """Outcomes as they come."""
    names, measures = list(todo), list(todo.values())
    for number, outcome in outcomes(_attempt, measures, jobs):
        if isinstance(outcome, Died):
            yield names[number], _Outcome({}, "the process died: out of memory, or a crash")
        else:
            yield names[number], outcome
