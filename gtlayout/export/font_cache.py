"""Keeps ezdxf away from the user's fonts and cache."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gtlayout.errors import GtlayoutError

VARIABLE = "XDG_CACHE_HOME"
EMPTY_CACHE = {"version": 2, "font-faces": []}
"""What ezdxf 1.4 reads as: there are no fonts."""


@contextmanager
def without_font_cache() -> Iterator[None]:
    """For the import of ezdxf, which looks through all fonts of the machine and writes their list to the home folder.

    It reads an empty list instead, from a folder that is gone afterwards: no file is left, no damaged list is read, and
    no width of a text depends on which fonts there are. Raises GtlayoutError when there is no place for that folder.
    """
    before = os.environ.get(VARIABLE)
    try:
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "ezdxf").mkdir()
            (Path(folder) / "ezdxf/font_manager_cache.json").write_text(json.dumps(EMPTY_CACHE))
            os.environ[VARIABLE] = folder
            yield
    except OSError as error:
        raise GtlayoutError(f"cannot write a temporary file: {error.strerror or error}") from error
    finally:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before
