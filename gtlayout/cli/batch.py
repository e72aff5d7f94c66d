"""The command ``gtlayout batch``. Loaded only when it is called."""

from __future__ import annotations

import threading
from collections import Counter
from pathlib import Path
from typing import Annotated, get_args

from cyclopts import Parameter
from cyclopts.validators import Number

from gtlayout.batch.job import Settings
from gtlayout.batch.progress import RunProgress
from gtlayout.batch.run_folder import check_free
from gtlayout.batch.scenes import find_scenes
from gtlayout.cli.console import NewFolder, NotNegative, Positive, print_next, stdout
from gtlayout.extras import needs
from gtlayout.quality.headline import Word

with needs("batch", "gtlayout batch"):
    from gtlayout.batch.cluster import existing_cluster, local_cluster
    from gtlayout.batch.run import run_batch

SOME_FAILED = 3
"""Exit status when not all scenes have a layout."""
TIMEOUT_S = 3600.0


def batch(
    roots: Annotated[tuple[Path, ...], Parameter(name="ROOT", negative=())],
    /,
    *,
    out: NewFolder,
    scheduler: str | None = None,
    workers: Positive | None = None,
    memory_limit: str | None = None,
    timeout: Annotated[float, Parameter(validator=Number(gt=0, lte=threading.TIMEOUT_MAX))] = TIMEOUT_S,
    refine_cameras: bool = True,
    restarts: Positive = 1,
    seed: NotNegative = 0,
) -> int:
    """Solve every scene in folders of scenes, each in a process of its own; continue an earlier run that was
    interrupted.

    Results go to OUT/scenes/, one row per scene to OUT/run.csv and OUT/run.parquet; `gtlayout report OUT` makes a page
    of them. A scene is solved again only when its files, the settings or gtlayout have changed since. One that crashes,
    hangs or takes too much memory is recorded with the reason, and the others continue.

    Parameters
    ----------
    roots
        Folders with scenes in them, at any depth, or scene folders.
    out
        Folder of the run.
    scheduler
        Address of a Dask scheduler, as tcp://host:8786. Its workers need the same gtlayout, and the folders at the same
        paths. Without it, workers are started on this machine.
    workers
        Scenes at a time on this machine; one for each core, fewer where memory is short, when not given.
    memory_limit
        Memory that a worker on this machine may use with its scene, as 4GiB; its share of the memory when not given.
    timeout
        Seconds after which an attempt to solve a scene is stopped. Each scene has two attempts.
    refine_cameras
        As in `solve`.
    restarts
        As in `solve`. Where there are more workers than scenes left, they share a scene's restarts.
    seed
        As in `solve`.
    """
    check_free(out)
    scenes = find_scenes(roots, out)
    cluster = local_cluster(workers, memory_limit) if scheduler is None else existing_cluster(scheduler)
    with cluster as client, RunProgress() as progress:
        records = run_batch(client, scenes, out, Settings(seed, refine_cameras, restarts), timeout, progress)
    words = Counter(record.headline for record in records.values())
    counts = Counter(record.status for record in records.values())
    console = stdout()
    failures = Counter(record.failure for record in records.values() if record.failure)
    summary = ", ".join([*(f"{words[word]} {word}" for word in get_args(Word)), f"{counts['failed']} failed"])
    summary += f" ({', '.join(f'{count} {why}' for why, count in failures.most_common())})" if failures else ""
    summary += f"; {counts['accepted']} accepted by their IoU"
    console.print(f"{len(records)} scene{'s' if len(records) > 1 else ''}: {summary}")
    console.print(f"Results: {out}")
    print_next(console, "report", out)
    return SOME_FAILED if counts["failed"] else 0
