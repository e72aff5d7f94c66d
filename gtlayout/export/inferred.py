"""What closes a room where nobody looked, in files: parts with a name and a material of their own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, IntArray

INFERRED = "inferred"
"""Name of the material."""
INFERRED_COLOR = (170, 170, 170)
"""RGB: grey, which no label has."""
INFERRED_OPACITY = 110
"""Of 255: what was seen shows through."""


def inferred_parts(layout: Layout) -> Iterator[tuple[str, FloatArray, IntArray]]:
    """For each instance of which something is inferred: ``inferred_`` and its name, (V, 3) world and (F, 3) indices."""
    mesh = layout.inferred_mesh()
    for i, instance in enumerate(layout.instances):
        faces = mesh.faces[mesh.face_instance == i]
        if len(faces):
            used, renumbered = np.unique(faces, return_inverse=True)
            yield f"{INFERRED}_{instance.name}", mesh.vertices[used], renumbered.reshape(-1, 3)
