"""The Dockerfile: it copies all that is installed, and where Docker is there, its image solves a mounted folder."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import pytest

ROOT = Path(__file__).parents[1]
DOCKERFILE = (ROOT / "Dockerfile").read_text()
COPIED = [name for line in re.findall(r"^COPY (.*) \S+$", DOCKERFILE, flags=re.MULTILINE) for name in line.split()]


def test_what_is_installed_is_copied_and_not_ignored() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    needed = {"pyproject.toml", "constraints.txt", project["project"]["readme"], *project["project"]["license-files"]}
    needed |= set(project["tool"]["setuptools"]["package-dir"].values())
    assert set(COPIED) == needed
    ignored = (ROOT / ".dockerignore").read_text().split("\n")
    assert {line.removeprefix("!") for line in ignored if line.startswith("!")} == needed


def test_its_extras_are_there() -> None:
    (extras,) = re.findall(r"^ARG EXTRAS=(.*)$", DOCKERFILE, flags=re.MULTILINE)
    optional = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(extras.split(",")) <= set(optional)


@pytest.fixture
def image() -> Iterator[str]:
    if shutil.which("docker") is None:
        pytest.skip("docker is not installed")
    if subprocess.run(["docker", "info"], capture_output=True, check=False).returncode != 0:
        pytest.skip("no docker daemon answers")
    name = f"gtlayout-test-{uuid4().hex}"
    subprocess.run(["docker", "build", "--quiet", "--tag", name, str(ROOT)], check=True)
    yield name
    subprocess.run(["docker", "image", "rm", "--force", name], check=True)


def test_the_image_solves_a_mounted_folder(image: str, room: Path, tmp_path: Path) -> None:
    shutil.copytree(room, tmp_path / "room")
    owner = f"{tmp_path.stat().st_uid}:{tmp_path.stat().st_gid}"
    command = ["docker", "run", "--rm", "--user", owner, "--volume", f"{tmp_path / 'room'}:/scene", image]
    subprocess.run(command, check=True)
    assert (tmp_path / "room/gtlayout/layout.json").is_file()
    subprocess.run([*command, "report", "/scene"], check=True)
    assert (tmp_path / "room/gtlayout/report.html").is_file()
