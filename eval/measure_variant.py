"""Make one variant of a scene and measure it, in a process of its own: what it takes is then its own, too.

    python measure_variant.py forms|degradations SCENE NAME OUT.json

A known problem is one line on stderr and exit status 1.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import cv2

from common.metrics import FORMAT, read_rows
from common.runner import SceneRows
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.processes import single_threaded
from gtlayout.scene import Scene
from variants.clip_forms import forms
from variants.degradations import degradations
from variants.measures import measure
from variants.variant import Makers

VARIANTS: dict[str, Callable[[Scene], Makers]] = {"forms": forms, "degradations": degradations}


def measured_apart(kind: str, scene: Path, name: str) -> SceneRows:
    """Run this file on one variant. Raises GtlayoutError with its reason when it fails or dies."""
    with tempfile.TemporaryDirectory() as folder, single_threaded():
        out = Path(folder) / "rows.json"
        command = [sys.executable, __file__, kind, str(scene), name, str(out)]
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
        if ran.returncode != 0:
            lines = ran.stderr.strip().splitlines()
            raise GtlayoutError(lines[-1] if lines else f"the process died with status {ran.returncode}")
        return read_rows(out)


def main(kind: str, folder: str, name: str, out: str) -> int:
    """See above."""
    cv2.setNumThreads(1)
    try:
        with tempfile.TemporaryDirectory() as files:
            variant = VARIANTS[kind](load_scene(Path(folder)))[name](Path(files))
            rows = measure(variant)
        plain = {label: [asdict(metric) for metric in row] for label, row in rows.items()}
        write_json_atomic(Path(out), {"format": FORMAT, "rows": plain})
    except GtlayoutError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
