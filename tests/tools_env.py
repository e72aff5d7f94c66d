"""Real annotation tools for tests: they live in a virtual environment of their own, their dependencies conflict."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

TESTS = Path(__file__).parent


def tools_python() -> Path:
    """Their interpreter: GTLAYOUT_TOOLS_PYTHON or that of ``.venv-tools``; skips the test where there is none."""
    path = Path(os.environ.get("GTLAYOUT_TOOLS_PYTHON") or TESTS.parent / ".venv-tools/bin/python")
    if not path.is_file():
        pytest.skip(f"no annotation tools: {path} is absent (GTLAYOUT_TOOLS_PYTHON can name another)")
    return path


def run_tool(script: str, *args: str) -> str:
    """Run ``tests/tools/<script>`` with the tools; returns what it prints, raises with what it complains of."""
    command = [str(tools_python()), str(TESTS / "tools" / script), *args]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{script} failed:\n{done.stderr}")
    return done.stdout
