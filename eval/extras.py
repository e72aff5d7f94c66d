"""Extras: what each set of packages weighs, and whether it does what it is for, each in an environment of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from common.command_line import exit_status, new_app
from common.metrics import Metric, write_tables
from gtlayout.errors import GtlayoutError

ROOT = Path(__file__).parents[1]
CORE = "core"
MB = 1_000_000
NOT_COUNTED = ("pip", "setuptools", "gtlayout")
"""There before, and what is asked about."""
PROBES = {
    "annotate": "import gtlayout.cli.annotate, gtlayout.cli.serve",
    "batch": "import gtlayout.cli.batch, gtlayout.batch.solver",
    "colmap": "import gtlayout.importing.structure_from_motion",
    "cvat": "import gtlayout.serve.cvat",
    "dxf": "import gtlayout.export.dxf",
    "heic": "import pillow_heif",
    "ifc": "import gtlayout.export.ifc",
    "raft": "from gtlayout.tracking.raft import _torch; _torch()",
    "report": "from gtlayout.report.page import environment; environment().get_template('template.html')",
    "usd": "import gtlayout.export.usd",
    "video": "import av",
    "view": "import gtlayout.viewer.rerun_log",
}
"""What must run with an extra."""

app = new_app("extras", __doc__)


@dataclass(frozen=True)
class Installed:
    """One environment."""

    packages: tuple[str, ...]
    """Names, sorted, without ``NOT_COUNTED``."""
    size_bytes: int


@app.default
def measure(
    *extras: Annotated[str, Parameter(name="EXTRA")],
    out: Path,
    constraints: Path = ROOT / "constraints.txt",
) -> None:
    """Install gtlayout from this checkout, by itself and with each extra, and use what was installed.

    Each environment solves, evaluates and exports the example room, and imports what the extra is for. Needs the
    network, and space for the largest set; environments are removed again.

    Parameters
    ----------
    extras
        Extras to install; "core" is none of them. All when not given.
    out
        Where the table goes.
    constraints
        Versions to install.
    """
    rows: dict[str, list[Metric]] = {}
    for extra in extras or (CORE, *user_extras()):
        with tempfile.TemporaryDirectory() as folder:
            try:
                installed = install(Path(folder), extra, constraints)
                use(Path(folder), extra)
            except subprocess.CalledProcessError as error:
                raise GtlayoutError(f"{extra}: {last_line(error.stderr)}") from error
        rows[extra] = metrics(installed)
        write_tables(out, "extras", rows, "installed")
    print((out / "extras.md").read_text(encoding="utf-8"))


def user_extras() -> list[str]:
    """The extras that are not for those who work on gtlayout, sorted; ``all`` last."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [*sorted(PROBES.keys() & project["optional-dependencies"].keys()), "all"]


def install(folder: Path, extra: str, constraints: Path) -> Installed:
    """Make an environment in ``folder`` and install gtlayout with ``extra`` there."""
    venv.create(folder, with_pip=True)
    wanted = str(ROOT) if extra == CORE else f"{ROOT}[{extra}]"
    python(folder, "-m", "pip", "install", "--quiet", "--constraint", str(constraints), wanted)
    listed = python(folder, "-m", "pip", "list", "--format", "json")
    site = Path(python(folder, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    return Installed(counted(json.loads(listed)), size_of(site))


def use(folder: Path, extra: str) -> None:
    """Solve, evaluate and export the example room, and import what ``extra`` is for."""
    with tempfile.TemporaryDirectory() as results:
        scene = str(ROOT / "examples/room")
        python(folder, "-m", "gtlayout", "solve", scene, "--out", results)
        python(folder, "-m", "gtlayout", "evaluate", scene, "--layout", results)
        python(folder, "-m", "gtlayout", "export", scene, "--layout", results, "--to", "obj")
    for name in PROBES if extra == "all" else [extra]:
        if name != CORE:
            python(folder, "-c", PROBES[name])


def python(environment: Path, *arguments: str) -> str:
    """What Python of an environment prints; away from the checkout, whose gtlayout it must not see."""
    bare = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    command = [str(environment / "bin/python"), *arguments]
    return subprocess.run(command, cwd=environment, env=bare, capture_output=True, text=True, check=True).stdout


def counted(listed: Sequence[dict[str, str]]) -> tuple[str, ...]:
    """Names of the packages that ``pip list`` names, without ``NOT_COUNTED``, sorted."""
    return tuple(sorted(package["name"] for package in listed if package["name"] not in NOT_COUNTED))


def size_of(site: Path) -> int:
    """Bytes of all that lies in a folder of packages, but for what was there before."""
    ours = (path for path in site.iterdir() if path.name.partition("-")[0] not in NOT_COUNTED)
    files = (file for path in ours for file in ([path] if path.is_file() else path.rglob("*")))
    return sum(file.stat().st_size for file in files if file.is_file() and not file.is_symlink())


def metrics(installed: Installed) -> list[Metric]:
    """The row of one set."""
    return [
        Metric("packages", len(installed.packages), "", False),
        Metric("size", installed.size_bytes / MB, "MB", False),
    ]


def last_line(text: str) -> str:
    """Of what a program printed when it failed."""
    return (text.strip().splitlines() or ["failed without a word"])[-1]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
