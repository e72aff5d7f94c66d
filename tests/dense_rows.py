"""Rows written out, to check against them what is worked out block by block."""

from __future__ import annotations

import numpy as np

from gtlayout.planes.arrow_rows import Rows
from gtlayout.scene import FloatArray


def dense(rows: Rows) -> FloatArray:
    """(R, 3N)."""
    written = np.zeros((len(rows.unknown), len(rows.tree), 3))
    for side in range(2):
        written[np.arange(len(written)), rows.unknown[:, side]] += rows.jacobian[:, side]
    written[rows.linked, rows.link] += rows.by_link
    return written.reshape(len(written), 3 * len(rows.tree))
