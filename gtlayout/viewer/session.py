"""Where a solve is logged to: nowhere, to a file, or to a rerun viewer; rerun is imported only when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from gtlayout.extras import needs
from gtlayout.observer import Observer
from gtlayout.results.names import LOG_FILE
from gtlayout.viewer.process import require_display, require_viewer, rerun_command

RerunMode = Literal["off", "save", "spawn", "connect"]


@contextmanager
def rerun_observer(mode: RerunMode, log: Path, progress: Observer) -> Iterator[Observer]:
    """The observer that ``mode`` asks for; stages and progress always go to ``progress``.

    * ``off``: ``progress`` itself, rerun is not even imported;
    * ``save``: the log appears as ``log`` when the block ends well, and not at all when it raises;
    * ``spawn``: opens a viewer; ``connect``: sends to the one that listens on this machine.

    Raises ``GtlayoutError`` when there is no viewer to send to, ``MissingExtraError`` without rerun.
    """
    if mode == "off":
        yield progress
        return
    # Importing rerun takes most of a second, which only those who ask for it should pay.
    with needs("view", f"--rerun {mode}"):
        import rerun as rr
    if mode == "spawn":
        require_display()
    elif mode == "connect":
        require_viewer()
    from gtlayout.io.files import write_atomic
    from gtlayout.viewer.rerun_log import APPLICATION, RerunObserver

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
