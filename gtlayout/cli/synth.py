"""The command ``gtlayout synth``; its flags are the fields of ``SynthConfig``. Loaded only when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number
from dask.system import CPU_COUNT

from gtlayout.cli.console import print_next, progress_bars, stdout
from gtlayout.synth import synthesize
from gtlayout.synth.config import SynthConfig
from gtlayout.synth.data_set import make_data_set

DEFAULT = SynthConfig()


def synth(
    out: Annotated[Path, Parameter(name="OUT")],
    /,
    *,
    count: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    config: Annotated[SynthConfig, Parameter(name="*")] = DEFAULT,
    given: Annotated[tuple[str, ...], Parameter(show=False)] = (),
) -> None:
    """Make a synthetic furnished room with known truth: images, cameras, annotations, depth and true planes.

    Parameters
    ----------
    out
        Folder to make; it must not exist or be empty. With --count it may hold rooms made with the same flags.
    count
        Make a data set of so many rooms, OUT/room_0000 …, on all cores. Room, camera (orbit or dolly), images, trim and
        errors vary from clean to poor; flags that are given hold for all rooms. Rooms that exist are not
        changed: the same command again makes those that are missing, and a greater number adds rooms.
    config
        The settings of the room.
    given
        Fields of ``config`` that are given on the command line.
    """
    with progress_bars() as progress:
        if count is None:
            progress.stage("synthesis")
            synthesize(out, config, progress.progress)
            stdout().print(f"Scene: {out}")
            print_next(stdout(), "check", out)
        else:
            progress.stage("rooms")
            made = make_data_set(out, count, config, given, CPU_COUNT, progress.progress)
            stdout().print(f"Rooms: {out} ({made} made, {count - made} were there)")
