"""The result: a solved room."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gtlayout.accuracy import Accuracy, Flatness
from gtlayout.colors import LABEL_COLORS
from gtlayout.cylinder import Cylinder
from gtlayout.geometry.raster import LabelImage
from gtlayout.geometry.render import DepthImage, render
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Dimension, Extent, Instance, Mesh, NextMeasurement, Plane, Quantity
from gtlayout.measurement import Checked, Scale
from gtlayout.mesh import build_mesh, vertex_sigma
from gtlayout.notebook import html_table
from gtlayout.scene import Camera

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, repr=False)
class Layout:
    """A solved room. ``instances``, ``planes`` and ``extents`` have the same order."""

    instances: tuple[Instance, ...]
    planes: tuple[Plane, ...]
    """Doors and windows have planes of their own, because leaves and panes sit back in the wall."""
    extents: tuple[Extent, ...]
    """Empty regions for unobservable planes."""
    triangles: Mesh
    """The triangles of all extents; ``mesh()`` converts them to trimesh."""
    metric: bool
    """True when world units are metres."""
    dimensions: tuple[Dimension, ...] = ()
    """Heights and widths of the room, and what doors and windows measure."""
    accuracies: tuple[Accuracy, ...] = ()
    """Of each instance, over its whole extent; empty where nobody asked for them."""
    flatness: tuple[Flatness | None, ...] = ()
    """Of each instance; None for doors and windows. Empty where nobody asked."""
    quantities: tuple[Quantity, ...] = ()
    """Areas and volumes."""
    scale: Scale | None = None
    """Of the given cameras, where measurements or the scene tell it; planes and cameras are in metres then."""
    measurements: tuple[Checked, ...] = ()
    """What was measured by hand, beside what everything else says."""
    next_measurement: NextMeasurement | None = None
    """The dimension to measure by hand next; None when all are as accurate as wanted."""
    inferred: tuple[Extent, ...] = ()
    """What closes the room where nobody looked, in the order of the instances and in the frames of ``extents``: a layer
    of its own, of which nothing was seen. Empty where nobody asked for it."""

    def __repr__(self) -> str:
        labels = Counter(instance.label for instance in self.instances)
        counted = ", ".join(f"{count} {label}" for label, count in labels.items())
        counted += f"; {len(self.curved)} of them curved" if self.curved else ""
        return f"<Layout: {len(self.instances)} instances ({counted}), {'metric' if self.metric else 'without a unit'}>"

    @property
    def curved(self) -> dict[int, Cylinder]:
        """The cylinders of the walls that are curved, by their index. Their extents lie on these, and not on the plane
        of the same index, which is only the best one."""
        return {i: strip.cylinder for i, extent in enumerate(self.extents) if (strip := strip_of(extent))}

    def _repr_html_(self) -> str:
        """In notebooks: what there is, and a row for each instance."""
        unit = "m²" if self.metric else "u²"
        rows = [
            (instance.name, f"{extent.region.area:.2f} {unit}", f"{plane.sigma_normal_deg:.2f}°")
            if plane.observable
            else (instance.name, "unobservable", "")
            for instance, plane, extent in zip(self.instances, self.planes, self.extents, strict=True)
        ]
        return html_table(repr(self).strip("<>"), ("instance", "area", "σ normal"), rows)

    def mesh(self) -> trimesh.Trimesh:
        """``triangles`` as a trimesh, with label colours on its faces.

        World frame and unit of the cameras. ``vertex_attributes["sigma"]`` is σ along the normal,
        ``face_attributes["instance"]`` the index of each face's instance.
        """
        made = as_trimesh(self)
        made.face_attributes["instance"] = self.triangles.face_instance
        return made

    def inferred_mesh(self) -> Mesh:
        """The triangles of all that is inferred; none where nobody asked for it."""
        return build_mesh([replace(instance, host=None) for instance in self.instances], self.inferred or ())

    def render(self, camera: Camera) -> tuple[LabelImage, DepthImage]:
        """What a camera sees.

        Returns (H, W) instance indices, -1 where there is nothing, and (H, W) depths along the camera's z, world unit,
        NaN where there is nothing.
        """
        return render(self.planes, self.extents, self.instances, camera)


def as_trimesh(layout: Layout) -> trimesh.Trimesh:
    """The mesh in the world frame and unit of the input cameras: a colour per face by label, ``sigma`` per vertex."""
    import trimesh

    mesh = layout.triangles
    colors = np.array([LABEL_COLORS[instance.label] for instance in layout.instances], dtype=np.uint8)
    made = trimesh.Trimesh(mesh.vertices, mesh.faces, face_colors=colors[mesh.face_instance], process=False)
    made.vertex_attributes["sigma"] = vertex_sigma(mesh, layout.planes, layout.extents).astype(np.float32)
    return made
