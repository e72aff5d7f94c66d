"""The process that solves: scene after scene, each asked for by a line of JSON on stdin, answered by one on stdout.

It is a process of its own, so that a scene that hangs, crashes or uses too much memory affects nothing else. Its
output, and a traceback when it crashes or runs out of time, go to the log in the scene's work folder. It ends when
stdin does, because then there is nobody to answer.
"""

from __future__ import annotations

import faulthandler
import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TextIO

import cv2

from gtlayout.api import load, save
from gtlayout.batch.fingerprint import Inputs, fingerprint, inputs_of, program
from gtlayout.batch.job import BEGUN, Answer, Attempt, Job, Settings
from gtlayout.batch.record import SOLVE_LOG_FILE, THUMBNAIL_FILE, Failure, Status, scene_folder
from gtlayout.batch.results import CannotWriteError
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError, one_line
from gtlayout.evaluation.evaluate import depth_error
from gtlayout.io.files import write_all_atomic
from gtlayout.method import solve
from gtlayout.report import PLOTLY_FILE, solved_page, thumbnail
from gtlayout.report.plain import finite
from gtlayout.results.names import REPORT_FILE
from gtlayout.results.tables import headline_text, measures, reasons, worst_element_name
from gtlayout.solution import Solution

IDLE_S = 300.0
"""An idle process ends after this time, because workers of an existing cluster outlive the run."""


def main() -> None:
    """Answer attempts until stdin ends, or no more come."""
    cv2.setNumThreads(1)
    # Only answers go to the pipe. All other output, also of libraries in C, goes to stderr.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    asked: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(asked,), daemon=True).start()
    print(json.dumps({"program": program()}), file=answers, flush=True)
    while True:
        try:
            data = json.loads(asked.get(timeout=IDLE_S))
        except Empty:
            os._exit(0)  # Not by returning, which would wait for the thread that listens.
        job = Job(**data["job"] | {"settings": Settings(**data["job"]["settings"])})
        came = answer(Attempt(**data | {"job": job}), lambda: print(json.dumps(BEGUN), file=answers, flush=True))
        print(json.dumps(asdict(came)), file=answers, flush=True)


def answer(attempt: Attempt, begin: Callable[[], None]) -> Answer:
    """Solve the scene into the attempt's work folder, unless its finished result is still good.

    ``begin`` is called when it is not.
    """
    try:
        with (
            # Not by its path: when the run is stopped the folder is removed, and writing to the path would create it
            # again.
            chdir(attempt.work),
            Path(SOLVE_LOG_FILE).open("a", encoding="utf-8") as log,
            _logged(log, attempt.job.timeout_s),
        ):
            return _answer(attempt, begin)
    except OSError as error:
        return Answer(unwritable=f"cannot write {attempt.work}: {error.strerror or error}")


def _answer(attempt: Attempt, begin: Callable[[], None]) -> Answer:
    job = attempt.job
    inputs: Inputs | None = None
    identity: dict[str, str] = {}
    start = time.perf_counter()
    try:
        inputs = _inputs(job)
        identity = _identity(inputs, attempt)
        if identity["fingerprint"] == attempt.fingerprint:
            return Answer(identity, same=True)
        begin()
        restarts = range(job.first_restart, job.end_restart)
        solution = solve(load(job.source), Config(**asdict(job.settings)), restarts=restarts)
        figures = _figures(solution)
        _write(solution, job)
        figures["seconds"] = time.perf_counter() - start
        answer = Answer(figures)
    except CannotWriteError as error:
        return Answer(unwritable=str(error))
    except GtlayoutError as error:
        print(error)
        answer = Answer(failure="input", reason=str(error), no_solution=job.first_restart > 0, begun=bool(identity))
    except Exception as error:
        # A bug must not stop the other scenes.
        traceback.print_exc()
        failure: Failure = "memory" if _out_of_memory(error) else "bug"
        answer = Answer(failure=failure, reason=one_line(error), begun=bool(identity))
    # A scene that changed or vanished meanwhile must be checked again.
    return replace(answer, figures=answer.figures | (identity if _unchanged(inputs, job) else {}))


def _inputs(job: Job) -> Inputs:
    """Raises GtlayoutError when the scene's files cannot be listed."""
    return inputs_of(Path(job.source), job.configuration, [Path(job.run)])


def _identity(inputs: Inputs, attempt: Attempt) -> dict[str, str]:
    """Stamp and fingerprint of the scene. Raises GtlayoutError when a file of it cannot be read."""
    seen = inputs.stamp and inputs.stamp == attempt.stamp
    fingerprinted = attempt.fingerprint if seen else fingerprint(inputs, attempt.job.configuration)
    return {"stamp": inputs.stamp, "fingerprint": fingerprinted}


def _unchanged(inputs: Inputs | None, job: Job) -> bool:
    """Whether names, sizes and times of the scene's files are unchanged."""
    try:
        return inputs is not None and _inputs(job).look == inputs.look
    except GtlayoutError:
        return False


def _figures(solution: Solution) -> dict[str, Any]:
    """The fields of the record of a solved scene; also printed, for the log."""
    scene, layout, quality = solution.scene, solution.layout, solution.quality
    worst_name, worst = worst_element_name(scene, layout, quality), quality.elements[quality.worst_element]
    why = quality.headline.reasons
    reasons_given = [*(why if quality.headline.word != "trust" else ()), *reasons(layout, quality)]
    try:
        depth = depth_error(scene, layout)
    except GtlayoutError as error:
        depth = None
        reasons_given.append(f"not compared with depth: {error}")
    status: Status = "accepted" if quality.accepted else "not accepted"
    verdicts = [judged.verdict for judged in quality.instances]
    warned = [*(f"warning: {one}" for one in scene.warnings), *(f"note: {one}" for one in scene.notes)]
    print(headline_text(quality.headline), *warned, measures(scene, layout, quality), sep="\n")
    return {
        "status": status,
        "headline": quality.headline.word,
        "headline_reason": "; ".join(why),
        "reason": "; ".join(reasons_given),
        "predicted": quality.predicted,
        "iou": finite(quality.iou),
        "openings_iou": quality.openings_iou,
        "sigma_depth_share": quality.sigma_depth_share,
        "depth_error_mean": None if depth is None else depth.mean,
        "depth_error_trimmed_mean": None if depth is None else depth.trimmed_mean,
        "depth_error_median": None if depth is None else depth.median,
        "metric": layout.metric,
        "frames": len(scene.frames),
        "key_frames": len(scene.key_frames),
        "instances": len(verdicts),
        "weak": verdicts.count("weak"),
        "unobservable": verdicts.count("unobservable"),
        "worst_frame": scene.frame_of(quality.worst_frame).name,
        "worst_frame_iou": finite(quality.frames[quality.worst_frame]),
        "worst_element": worst_name,
        "worst_element_iou": worst.iou,
        "warnings": len(scene.warnings),
        "stages_s": dict(solution.timings_s),
    }


def _write(solution: Solution, job: Job) -> None:
    """Into the working directory. Raises CannotWriteError."""
    work, run = Path(), Path(job.run)
    plotly = os.path.relpath(run / PLOTLY_FILE, scene_folder(run, job.scene))
    page = solved_page(solution, Path(plotly).as_posix())
    small = thumbnail(solution.scene, solution.layout, solution.quality)
    try:
        save(solution, work)
        write_all_atomic({work / REPORT_FILE: page, work / THUMBNAIL_FILE: small})
    except GtlayoutError as error:
        raise CannotWriteError(f"{job.run}: {error}") from error


def _out_of_memory(error: Exception) -> bool:
    return isinstance(error, MemoryError) or getattr(error, "code", None) == cv2.Error.StsNoMem


def _listen(asked: SimpleQueue[str]) -> None:
    for line in sys.stdin:
        asked.put(line)
    os._exit(0)


@contextmanager
def _logged(log: TextIO, timeout_s: float) -> Iterator[None]:
    """All output goes to ``log``, with a traceback when the process crashes or time is up. Then it ends by itself."""
    before = os.dup(2)
    try:
        sys.stdout.flush()
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        faulthandler.enable(log)
        # From a thread in C: it works even when Python hangs in a library.
        faulthandler.dump_traceback_later(timeout_s, exit=True, file=log)
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        sys.stdout.flush()
        sys.stderr.flush()
        os.dup2(before, 1)
        os.dup2(before, 2)
        os.close(before)


if __name__ == "__main__":
    main()
