"""The command ``gtlayout synth``; its flags are the fields of ``SynthConfig``. Loaded only when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gtlayout.cli import progress_bars, stdout
from gtlayout.synth import synthesize
from gtlayout.synth.config import SynthConfig

DEFAULT = SynthConfig()


def synth(
    out: Annotated[Path, Parameter(name="OUT")],
    /,
    *,
    config: Annotated[SynthConfig, Parameter(name="*")] = DEFAULT,
) -> None:
    """Make a synthetic furnished room with known truth: images, cameras, annotations, depth and true planes.

    Parameters
    ----------
    out
        Folder to make; it must not exist or be empty.
    """
    with progress_bars() as progress:
        progress.stage("synthesis")
        synthesize(out, config, progress.progress)
    stdout().print(f"Scene: {out}")
