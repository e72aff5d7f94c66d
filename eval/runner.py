"""Measuring many scenes: in parallel, with a progress bar; a run that was cut short goes on where it was."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from gtlayout.batch.fingerprint import fingerprint, inputs_of, program
from gtlayout.batch.scenes import has_cameras
from gtlayout.errors import GtlayoutError, one_line
from gtlayout.io import CAMERA_READERS
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.threads import single_threaded
from metrics import FORMAT, Metric, read_rows

SceneRows = dict[str, list[Metric]]
"""Label of a row (a method, a variant) → what was measured for it in one scene."""
Measure = Callable[[Path], Mapping[str, list[Metric]]]
SCENES = "scenes"
"""Folder of the results of each scene, inside the folder of all results."""


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
    for name in scenes:
        if Path(name).name != name or name.startswith("."):
            raise GtlayoutError(f"scene {name!r} cannot be a file name: call it otherwise")
    files = {name: out_dir / SCENES / f"{name}.json" for name in scenes}
    decides = repr((program(), settings))
    fingerprints = {name: fingerprint(inputs_of(path, decides, [out_dir]), decides) for name, path in scenes.items()}
    done = {name: rows for name in scenes if (rows := _finished(files[name], fingerprints[name])) is not None}
    todo = {name: path for name, path in scenes.items() if name not in done}
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        bar = bars.add_task("scenes", total=len(scenes), completed=len(done))
        for name, outcome in _in_processes(todo, measure, jobs) if jobs > 1 else _here(todo, measure):
            metrics = {label: [asdict(metric) for metric in row] for label, row in outcome.rows.items()}
            record = {"format": FORMAT, "fingerprint": fingerprints[name], "error": outcome.error, "rows": metrics}
            write_json_atomic(files[name], record)
            if outcome.error is None:
                done[name] = outcome.rows
            else:
                print(f"{name}: {outcome.error}", file=sys.stderr)
            bars.advance(bar)
    return {name: done[name] for name in scenes if name in done}


def errors_of(scenes: Mapping[str, Path], out_dir: Path) -> dict[str, str]:
    """Scene → reason, for those that failed in the last run into ``out_dir``. Raises GtlayoutError on damaged files."""
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


def _attempt(measure: Measure, path: Path) -> _Outcome:
    try:
        return _Outcome(dict(measure(path)))
    except GtlayoutError as error:
        return _Outcome({}, str(error))
    except Exception as error:
        # A bug in one scene must not cost the night's other scenes.
        return _Outcome({}, one_line(error))


def _here(scenes: Mapping[str, Path], measure: Measure) -> Iterator[tuple[str, _Outcome]]:
    for name, path in scenes.items():
        yield name, _attempt(measure, path)


def _in_processes(scenes: Mapping[str, Path], measure: Measure, jobs: int) -> Iterator[tuple[str, _Outcome]]:
    """Outcomes as they come."""
    unfinished = dict(scenes)
    for name, outcome in _in_one_pool(scenes, measure, jobs):
        if outcome is not None:
            unfinished.pop(name)
            yield name, outcome
    # A process that died took its pool with it, and which scene it was is not said: one pool each tells.
    for name, path in unfinished.items():
        for _, outcome in _in_one_pool({name: path}, measure, 1):
            yield name, outcome or _Outcome({}, "the process died: out of memory, or a crash")


def _in_one_pool(scenes: Mapping[str, Path], measure: Measure, jobs: int) -> Iterator[tuple[str, _Outcome | None]]:
    """Outcomes as they come; None for scenes whose pool died before they were finished."""
    with single_threaded():
        # Spawned, because OpenCV's and GTSAM's threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=cv2.setNumThreads, initargs=(1,))
        names: dict[Future[_Outcome], str] = {}
        try:
            with suppress(BrokenProcessPool):
                for name, path in scenes.items():
                    names[pool.submit(_attempt, measure, path)] = name
            for future in as_completed(names):
                error = future.exception()
                outcome = future.result() if error is None else _Outcome({}, repr(error))
                yield names[future], None if isinstance(error, BrokenProcessPool) else outcome
        finally:
            pool.shutdown(cancel_futures=True)
