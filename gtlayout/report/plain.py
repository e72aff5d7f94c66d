"""Values in a form that HTML and JSON can hold."""

from __future__ import annotations

import base64
import math


def finite(value: float) -> float | None:
    """The number, None for NaN and infinity."""
    return value if math.isfinite(value) else None


def data_uri(media_type: str, content: bytes) -> str:
    """A file as an address that holds it."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"
