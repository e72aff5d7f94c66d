"""The command ``gtlayout serve``. Loaded only when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from gtlayout.cli.console import FROM_THE_FOLDER, Sources, stdout
from gtlayout.extras import needs

with needs("annotate", "gtlayout serve"):
    from gtlayout.guard import LOOPBACK
    from gtlayout.serve.server import PORT, serve_label_studio


def serve(
    *,
    label_studio: Annotated[Path, Parameter(name="--label-studio")],
    host: str = LOOPBACK,
    port: Annotated[int, Parameter(validator=Number(gte=0, lte=65535))] = PORT,
    sources: Sources = FROM_THE_FOLDER,
) -> None:
    """Propose drawings in Label Studio: a backend for its models, until Ctrl-C.

    The scene is solved first, and again behind the server whenever its annotation file changes. With BASIC_AUTH_USER
    and BASIC_AUTH_PASS in the environment the server asks for them.

    Parameters
    ----------
    label_studio
        The scene folder.
    host
        The address to serve on. Any but this machine's own lets other machines, and containers on this one, in: the
        two variables must be set then. What they see is what is drawn and proposed; nothing encrypts it on its way.
    port
        The port to serve on; 0 takes a free one.
    """
    serve_label_studio(label_studio, stdout().print, host=host, port=port, **vars(sources))
