"""The page itself: the template with the data, styles, scripts and plotly.js in it."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from plotly.offline import get_plotlyjs


def page(data: dict[str, Any]) -> str:
    """HTML of what ``report_data`` gives. The same bytes for the same data; it asks for nothing over the network.

    All text is escaped, in the JSON for the 3D view, too (``tojson`` writes < > & ' as ``\\u003c`` …).
    """
    environment = Environment(
        loader=PackageLoader("gtlayout.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    plotly_js = get_plotlyjs() if data["room"] is not None else ""  # 4.8 MB
    return environment.get_template("template.html").render(data, plotly_js=plotly_js)
