"""The result of a solve: the layout, and everything it was made from."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gtlayout.camera_errors.findings import CameraDoubt
from gtlayout.config import Config
from gtlayout.edges import ContactEdge
from gtlayout.errors import GtlayoutError
from gtlayout.flatness.bends import Bend
from gtlayout.geometry.raster import LabelImage
from gtlayout.geometry.render import DepthImage
from gtlayout.instances import Instance, Plane
from gtlayout.layout import Layout
from gtlayout.notebook import html_table
from gtlayout.planes.estimate import Estimate
from gtlayout.quality.assess import Quality
from gtlayout.scene import Camera, IntArray, Scene
from gtlayout.tracking.bundle_adjustment import CameraReport
from gtlayout.tracking.tracks import Tracks

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, repr=False)
class Solution:
    """The layout, and everything it was made from."""

    scene: Scene
    """The given scene, with the cameras that the planes were solved with: see ``new_cameras``. Its warnings also name
    what was skipped, joined or split, and what is wrong with the cameras.
    """
    layout: Layout
    quality: Quality
    tracks: Tracks
    track_instance: IntArray
    """(N,) instance of each track, -1 = none."""
    edges: tuple[ContactEdge, ...]
    estimate: Estimate
    timings_s: dict[str, float]
    """Seconds of each stage, all restarts together."""
    camera_doubt: CameraDoubt = field(default_factory=CameraDoubt)
    """Errors that all given cameras share, and which of them were corrected."""
    cameras: CameraReport | None = None
    """The result of refining the cameras; None without ``refine_cameras``."""
    config: Config = field(default_factory=Config)
    """The configuration of the solve."""
    bends: tuple[tuple[Bend, ...], ...] = ()
    """Of each instance how far its tracks bend, in each direction that they cover; empty after a quick solve."""

    def __repr__(self) -> str:
        headline = self.quality.headline
        return f"<Solution {headline.word}: {headline.reasons[0]}; {self.layout!r}>"

    def _repr_html_(self) -> str:
        """In notebooks: the verdict, and a row for each instance."""
        rows = [
            (instance.name, f"{judged.sigma_normal_deg:.2f}°", f"{judged.iou:.3f}", judged.verdict)
            for instance, judged in zip(self.layout.instances, self.quality.instances, strict=True)
        ]
        headline = self.quality.headline
        line = f"{headline.word}: {'; '.join(headline.reasons)}"
        return html_table(line, ("instance", "σ normal", "IoU", "verdict"), rows)

    @property
    def new_cameras(self) -> bool:
        """Whether the scene's cameras are not those given, but corrected, refined or in metres by a measurement."""
        in_metres = self.layout.scale is not None and self.layout.scale.factor != 1.0
        return in_metres or self.camera_doubt.corrected or (self.cameras is not None and self.cameras.refined)

    @property
    def planes(self) -> tuple[Plane, ...]:
        """The layout's planes, so that a solution can be used like its layout."""
        return self.layout.planes

    @property
    def instances(self) -> tuple[Instance, ...]:
        """The layout's instances."""
        return self.layout.instances

    def mesh(self) -> trimesh.Trimesh:
        """See ``Layout.mesh``."""
        return self.layout.mesh()

    def render(self, camera: Camera) -> tuple[LabelImage, DepthImage]:
        """See ``Layout.render``."""
        return self.layout.render(camera)


def best_of(run: Callable[[int], Solution], restarts: range) -> Solution:
    """The solution with the highest IoU, the first of equals. Raises GtlayoutError when there is none."""
    best: Solution | None = None
    for restart in restarts:
        # A random share of the tracks may be too few. The solve from all tracks is not affected.
        with suppress(GtlayoutError) if restart else nullcontext():
            solution = run(restart)
            best = solution if best is None or solution.quality.iou > best.quality.iou else best
    if best is None:
        raise GtlayoutError(f"too few tracks in each of the restarts {restarts.start} to {restarts.stop - 1}")
    return best
