"""The page itself: the template with the data, styles and scripts in it; plotly.js in it, too, or in a file beside."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtlayout.extras import needs
from gtlayout.figures import figure, is_known, percent, short, sigma_figure
from gtlayout.io.files import write_atomic

if TYPE_CHECKING:
    from jinja2 import Environment

PLOTLY_FILE = "plotly.min.js"
"""What the pages of a run share, in its folder."""


def page(data: dict[str, Any], plotly_src: str | None = None) -> str:
    """HTML of what ``report_data`` gives. The same bytes for the same data; it asks for nothing over the network.

    ``plotly_src`` is the address, relative to the page, of what ``plotly_file`` writes; without it the page has these
    4.8 MB in it. All text is escaped, in the JSON for the 3D view, too (``tojson`` writes < > & ' as ``\\u003c`` …).
    """
    plotly_js = _plotly_js() if data["room"] is not None and plotly_src is None else ""
    return environment().get_template("template.html").render(data, plotly_js=plotly_js, plotly_src=plotly_src)


def plotly_file(folder: Path) -> None:
    """Write plotly.js into a folder unless it is there already. Raises GtlayoutError when the disk does not take it."""
    path, content = folder / PLOTLY_FILE, _plotly_js().encode()
    if not path.is_file() or path.read_bytes() != content:
        write_atomic(path, content)


@cache
def environment(*packages: str) -> Environment:
    """Templates of this package and ``packages``, compiled once a process: that takes longer than to fill one in.

    Raises MissingExtraError without Jinja2.
    """
    with needs("report", "a report"):
        from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    made = Environment(
        loader=ChoiceLoader([PackageLoader(package, "") for package in (*packages, "gtlayout.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.globals |= {
        "figure": figure,
        "sigma_figure": sigma_figure,
        "percent": percent,
        "is_known": is_known,
        "short": short,
    }
    return made


def _plotly_js() -> str:
    with needs("report", "a report"):
        from plotly.offline import get_plotlyjs
    return str(get_plotlyjs())
