"""What a solve tells while it runs: an observer that ignores everything, and the one that logs to rerun.

The stages know nothing of progress bars or viewers; ``gtlayout.method.solve`` calls an :class:`Observer` between
them. ``gtlayout.rerun_log.RerunObserver`` has the same face and logs to rerun, imported only when it is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Literal

from gtlayout.results import LOG_FILE
from gtlayout.viewer import require_display, require_viewer, rerun_command

if TYPE_CHECKING:
    from gtlayout.edges import ContactEdge
    from gtlayout.estimation import Estimate
    from gtlayout.layout import Extent, Instance, Layout, Mesh
    from gtlayout.quality import Quality
    from gtlayout.scene import IntArray, Scene
    from gtlayout.tracking import Tracks

RerunMode = Literal["off", "save", "spawn", "connect"]


class Observer:
    """Ignores what it is told. Subclasses override what they care for; the methods are called in this order."""

    def stage(self, name: str) -> None:
        """A stage begins."""

    def progress(self, done: int, total: int) -> None:
        """``done`` of ``total`` steps of the current stage are finished."""

    def scene(self, scene: Scene) -> None:
        """What is solved."""

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
        """Result of stage 7; the last call."""


@contextmanager
def rerun_observer(mode: RerunMode, log: Path, progress: Observer) -> Iterator[Observer]:
    """The observer that ``mode`` asks for; stages and progress always go to ``progress``.

    * ``off``: ``progress`` itself, rerun is not even imported;
    * ``save``: the log appears as ``log`` when the block ends well, and not at all when it raises;
    * ``spawn``: opens a viewer; ``connect``: sends to the one that listens on this machine.

    Raises ``GtlayoutError`` when there is no viewer to send to.
    """
    if mode == "off":
        yield progress
        return
    if mode == "spawn":
        require_display()
    elif mode == "connect":
        require_viewer()
    # Importing rerun takes most of a second, which only those who ask for it should pay.
    import rerun as rr

    from gtlayout.io.files import write_atomic
    from gtlayout.rerun_log import APPLICATION, RerunObserver

    recording = rr.RecordingStream(APPLICATION)
    with TemporaryDirectory() as folder:
        unfinished = Path(folder) / LOG_FILE
        if mode == "save":
            recording.save(unfinished)
        elif mode == "spawn":
            rr.spawn(executable_path=rerun_command(), recording=recording)
        else:
            recording.connect_grpc()
        try:
            yield RerunObserver(recording, progress)
            recording.flush()
        finally:
            recording.disconnect()
        if mode == "save":
            write_atomic(log, unfinished.read_bytes())
