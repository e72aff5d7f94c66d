"""What a solve reports while it runs. The stages know nothing of progress bars or viewers.

``gtlayout.method.solve`` calls an :class:`Observer` between them. This class ignores everything.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gtlayout.edges import ContactEdge
    from gtlayout.instances import Extent, Instance, Mesh
    from gtlayout.layout import Layout
    from gtlayout.planes.estimate import Estimate
    from gtlayout.quality.assess import Quality
    from gtlayout.scene import IntArray, Scene
    from gtlayout.tracking.tracks import Tracks


class Observer:
    """Ignores all reports. Subclasses override the methods they need. The methods are called in this order."""

    def stage(self, name: str) -> None:
        """A stage begins."""

    def progress(self, done: int, total: int) -> None:
        """``done`` of ``total`` steps of the current stage are finished."""

    def scene(self, scene: Scene) -> None:
        """The scene that is solved."""

    def tracks(self, tracks: Tracks) -> None:
        """Result of stage 1."""

    def cameras(self, scene: Scene) -> None:
        """The scene with refined cameras; called only when there are any."""

    def instances(self, instances: tuple[Instance, ...], track_instance: IntArray) -> None:
        """Result of stage 2."""

    def edges(self, edges: tuple[ContactEdge, ...]) -> None:
        """Result of stage 3."""

    def estimate(self, estimate: Estimate) -> None:
        """Result of stage 4 (of the run that was kept)."""

    def extents(self, extents: tuple[Extent, ...]) -> None:
        """Result of stage 5."""

    def mesh(self, mesh: Mesh) -> None:
        """Result of stage 6."""

    def quality(self, layout: Layout, quality: Quality) -> None:
        """Result of stage 7; the last call of a solve."""

    def inferred(self, layout: Layout) -> None:
        """What closes the room, after the solve; called only when that was asked for."""

    def solved(self, layout: Layout, quality: Quality, estimate: Estimate) -> None:
        """Stages 4 to 7 of the run that is kept, one call each."""
        self.estimate(estimate)
        self.extents(layout.extents)
        self.mesh(layout.triangles)
        self.quality(layout, quality)


@dataclass(frozen=True)
class Stages:
    """Announces stages to an observer and adds up the time each takes."""

    observer: Observer = field(default_factory=Observer)
    timings_s: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """A stage, from its announcement to its end."""
        self.observer.stage(name)
        start = time.perf_counter()
        yield
        self.timings_s[name] = self.timings_s.get(name, 0.0) + time.perf_counter() - start
