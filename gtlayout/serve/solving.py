"""From a scene folder to proposals: at once, and again in the background whenever its drawings have changed."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from threading import Lock, Thread

from gtlayout.errors import GtlayoutError, one_line
from gtlayout.io.annotations.annotation_files import kinds_at
from gtlayout.io.annotations.labels import FILE_NAME as LABELS_FILE
from gtlayout.io.choosing import named_path
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.serve.solved_room import SolvedRoom

LOG = logging.getLogger(__name__)
Stamp = tuple[tuple[str, int, int], ...]


def solve_folder(root: Path, cameras: Path | None = None, annotations: Path | None = None) -> SolvedRoom | None:
    """Proposals for the scene folder ``root``; None when nothing is drawn in it yet.

    ``cameras`` and ``annotations`` are those of ``load_scene``. Raises GtlayoutError when the scene cannot be read or
    solved.
    """
    scene = load_scene(root, annotations, cameras=cameras, annotated=False)
    return SolvedRoom(solve(scene)) if scene.key_frames else None


def drawings_stamp(root: Path, annotations: Path | None = None) -> Stamp:
    """(path, time of change in ns, size) of each annotation file: another one when any has changed.

    Raises GtlayoutError when the folder cannot be read.
    """
    place = _place(root, annotations)
    paths = [*kinds_at(place), labels_file(root, annotations)]
    try:
        stats = [(str(path), path.stat()) for path in paths if path.is_file()]
    except OSError as error:
        raise GtlayoutError(f"cannot read {place}: {error.strerror or error}") from error
    return tuple((path, stat.st_mtime_ns, stat.st_size) for path, stat in stats)


def labels_file(root: Path, annotations: Path | None = None) -> Path:
    """Where ``labels.json`` lies, if there is one. Raises GtlayoutError when the annotations that are named do not."""
    place = _place(root, annotations)
    return (place if place.is_dir() else place.parent) / LABELS_FILE


def _place(root: Path, annotations: Path | None) -> Path:
    return root if annotations is None else named_path(root, annotations, "annotations")


class BackgroundSolves:
    """The proposals that are there, and new ones made behind them: one solve at a time, the last drawings count.

    When a solve fails, what was there before stays, and ``problem`` says why.
    """

    def __init__(self, make: Callable[[], SolvedRoom | None], stamp: Callable[[], Stamp]) -> None:
        """``make`` is ``solve_folder`` and ``stamp`` is ``drawings_stamp``, of one folder."""
        self.room: SolvedRoom | None = None
        self.problem = ""
        self._make, self._stamp = make, stamp
        self._lock = Lock()
        self._thread: Thread | None = None
        self._seen: Stamp | None = None

    @property
    def state(self) -> str:
        """In a word or two."""
        if self.is_solving:
            return "solving"
        if self.problem:
            return "failed"
        return "ready" if self.room is not None else "nothing drawn"

    @property
    def is_solving(self) -> bool:
        """Whether a solve runs now."""
        return self._thread is not None

    def refresh(self) -> bool:
        """Begin a solve if the drawings have changed since the last one began. Returns whether they have.

        While a solve runs, another follows it.
        """
        with self._lock:
            changed = self._newer_stamp() is not None
            if changed and self._thread is None:
                self._thread = Thread(target=self._work, daemon=True, name="solve")
                self._thread.start()
            return changed

    def wait(self) -> None:
        """Return when no solve runs."""
        while (thread := self._thread) is not None:
            thread.join()

    def _newer_stamp(self) -> Stamp | None:
        try:
            stamp = self._stamp()
        except GtlayoutError as error:
            self.problem = str(error)
            return None
        return None if stamp == self._seen else stamp

    def _work(self) -> None:
        while True:
            with self._lock:
                newer = self._newer_stamp()
                if newer is None:
                    self._thread = None
                    return
                # Taken before reading: what changes meanwhile is seen as changed.
                self._seen = newer
            self._solve()

    def _solve(self) -> None:
        try:
            self.room = self._make()
            self.problem = ""
            LOG.warning("%s", "nothing is drawn yet" if self.room is None else self.room.version)
        except GtlayoutError as error:
            self.problem = str(error)
            LOG.warning("cannot solve: %s", error)
        except Exception as error:  # A bug must not end the server; the next drawing may avoid it.
            self.problem = one_line(error)
            LOG.exception("cannot solve")
