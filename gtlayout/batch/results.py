"""The results of a scene, from the folder they were made in to their place; which of them are still good."""

from __future__ import annotations

import platform
import shutil
import uuid
from dataclasses import replace
from pathlib import Path

from gtlayout.batch.fingerprint import sha256
from gtlayout.batch.record import PASSING, RECORD_FILE, SOLVE_LOG_FILE, Record, read_record, record_text
from gtlayout.errors import GtlayoutError

TRIES = 10
"""Attempts to put a scene into its place. Two workers may do so at once, when one of them was taken for lost."""


class CannotWriteError(Exception):
    """Results cannot be written. This would be the same for every other scene, so the run must stop."""


class LeaseLostError(CannotWriteError):
    """The folder for work in progress is gone, so the result is no longer wanted."""


def lease_lost(lease: Path) -> LeaseLostError:
    """The error to raise. Not a constructor of its own: Dask sends exceptions, and would call it with the message."""
    return LeaseLostError(
        f"{platform.node()} sees no {lease}: was another gtlayout batch started into the same folder, "
        "or is the folder not on a disk that all machines share?"
    )


def new_work_folder(lease: Path) -> Path:
    """A folder to fill, in ``lease``. Raises CannotWriteError."""
    work = lease / uuid.uuid4().hex
    try:
        work.mkdir()
    except FileNotFoundError:
        raise lease_lost(lease) from None
    except OSError as error:
        raise CannotWriteError(f"cannot write {work}: {error.strerror or error}") from error
    return work


def finished(place: Path) -> Record | None:
    """The record of a finished scene whose files are all unchanged; None when the scene must be checked again."""
    try:
        record = read_record(place / RECORD_FILE)
        whole = all(sha256(place / name) == digest for name, digest in record.files.items())
    except (GtlayoutError, OSError):
        return None
    return record if whole and record.failure not in PASSING else None


def publish(record: Record, work: Path, place: Path) -> Record:
    """Put the folder ``work`` with its record into ``place``, instead of what may be there, and return the record.

    Of a failed scene only the log is kept. Files that an attempt left half-written are removed. If the process is
    killed at any moment, the old results, the new ones or none are there, never some of both. Raises CannotWriteError.
    """
    try:
        for path in list(work.iterdir()):
            if path.name.startswith(".") or (record.status == "failed" and path.name != SOLVE_LOG_FILE):
                path.unlink()
        record = replace(record, files={path.name: sha256(path) for path in sorted(work.iterdir())})
        # Not with write_record: that would make the folder anew if it has just gone.
        (work / RECORD_FILE).write_text(record_text(record), encoding="utf-8")
        place.parent.mkdir(parents=True, exist_ok=True)
        _swap(work, place)
    except (OSError, GtlayoutError) as error:
        if not work.parent.is_dir():
            raise lease_lost(work.parent) from error
        raise CannotWriteError(f"cannot write {place}: {getattr(error, 'strerror', None) or error}") from error
    return record


def _swap(work: Path, place: Path) -> None:
    names = {path.name for path in place.iterdir()} if place.exists() else set()
    if names and names.isdisjoint((RECORD_FILE, SOLVE_LOG_FILE)):  # one of which may have been removed
        raise CannotWriteError(f"{place} holds something that is no result of a scene; move it elsewhere")
    for tries_left in reversed(range(TRIES)):
        old = work.with_name(uuid.uuid4().hex)
        try:
            if place.exists():
                place.rename(old)
            work.rename(place)
        except OSError:
            if tries_left == 0 or not work.exists():
                raise
        else:
            break
        finally:
            shutil.rmtree(old, ignore_errors=True)
