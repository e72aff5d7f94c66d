"""What the wheel would hold, and what is pinned."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_package_is_listed() -> None:
    folders = {path.parent for top in ("gtlayout", "factors") for path in (ROOT / top).rglob("__init__.py")}
    names = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    found = {re.sub("^factors", "gtlayout.factors", name) for name in names}
    assert found == set(PROJECT["tool"]["setuptools"]["packages"])


def test_every_requirement_is_pinned_without_an_address() -> None:
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+==[A-Za-z0-9.]+", line) for line in lines)
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in lines}
    project = PROJECT["project"]
    required = {
        re.split(r"[<>=~!\[; ]", requirement)[0].lower()
        for requirements in (project["dependencies"], *project["optional-dependencies"].values())
        for requirement in requirements
    }
    assert required - {project["name"]} <= pinned
