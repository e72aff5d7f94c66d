"""The command ``gtlayout annotate``. Loaded only when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from gtlayout.cli.console import SceneDir, stdout
from gtlayout.extras import needs

with needs("annotate", "gtlayout annotate"):
    from gtlayout.annotate.serve import annotate as serve


def annotate(
    scene_dir: SceneDir,
    /,
    *,
    cameras: Path | None = None,
    port: Annotated[int, Parameter(validator=Number(gte=0, lte=65535))] = 0,
) -> None:
    """Draw a scene in the browser while it is solved: prints the address of the page, and serves it until Ctrl-C.

    The page is served to browsers on this machine alone. Every change is saved to annotations.json in the folder. When
    nothing has been drawn for three seconds, all is solved in full, and the results go to DIR/gtlayout.

    Parameters
    ----------
    scene_dir
        The scene folder.
    cameras
        Camera file, or folder of a COLMAP model, to read; a path, or one within the scene folder.
    port
        The port to serve the page on; any free one when not given.
    """
    serve(scene_dir, port, lambda address: stdout().print(f"{address}  (Ctrl-C stops)"), cameras)
