"""eval/extras.py: what is counted of an environment, and what is said where a package does not do what it is for."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import extras
from extras import CORE, MB, PROBES, Installed, counted, last_line, main, metrics, python, size_of, use, user_extras


def test_every_extra_of_a_user_has_something_to_do() -> None:
    names = user_extras()
    assert names[-1] == "all"
    assert names[:-1] == sorted(PROBES)
    assert not {"dev", "docs", "eval"} & set(names)


def test_packages_are_counted_without_those_that_were_there() -> None:
    listed = [{"name": name, "version": "1"} for name in ("scipy", "pip", "numpy", "gtlayout", "setuptools")]
    assert counted(listed) == ("numpy", "scipy")


def test_size_is_that_of_all_files_but_what_was_there_and_links(tmp_path: Path) -> None:
    sizes = {"numpy/core/a.so": 1000, "six.py": 20, "numpy-2.0.dist-info/METADATA": 3}
    sizes |= {"pip/big.py": 5000, "pip-24.dist-info/RECORD": 5000, "gtlayout/__init__.py": 5000}
    for name, size in sizes.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(bytes(size))
    (tmp_path / "numpy/link.so").symlink_to(tmp_path / "numpy/core/a.so")
    assert size_of(tmp_path) == 1000 + 20 + 3


def test_a_row_has_the_number_of_packages_and_their_size() -> None:
    row = metrics(Installed(("numpy", "scipy"), 3 * MB))
    assert [(one.key, one.value, one.unit) for one in row] == [("packages", 2, ""), ("size", 3.0, "MB")]


def test_the_last_line_of_a_failure() -> None:
    assert last_line("Traceback\n  File\nModuleNotFoundError: no x\n\n") == "ModuleNotFoundError: no x"
    assert last_line(" \n") == "failed without a word"


@pytest.fixture
def environment(tmp_path: Path) -> Path:
    """A folder whose ``bin/python`` is the one of the tests."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/python").symlink_to(sys.executable)
    return tmp_path


def test_the_environment_s_python_sees_neither_the_checkout_nor_its_paths(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", "/somewhere")
    monkeypatch.setenv("KEPT", "yes")
    code = "import json, os; print(json.dumps([os.getcwd(), os.environ.get('PYTHONPATH'), os.environ['KEPT']]))"
    assert json.loads(python(environment, "-c", code)) == [str(environment), None, "yes"]
    with pytest.raises(subprocess.CalledProcessError):
        python(environment, "-c", "raise SystemExit(1)")


@pytest.mark.parametrize(
    ("extra", "probed"), [(CORE, []), ("view", [PROBES["view"]]), ("all", list(PROBES.values()))], ids=str
)
def test_a_set_is_used_for_what_it_is_for(
    extra: str, probed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[tuple[str, ...]] = []
    monkeypatch.setattr(extras, "python", lambda _folder, *arguments: ran.append(arguments))
    use(tmp_path, extra)
    assert [arguments[2] for arguments in ran if arguments[0] == "-m"] == ["solve", "evaluate", "export"]
    assert [arguments[1] for arguments in ran if arguments[0] == "-c"] == probed


def test_what_does_not_work_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(extras, "install", lambda *_: Installed(("numpy",), MB))

    def fails(_folder: Path, extra: str) -> None:
        if extra == "view":
            raise subprocess.CalledProcessError(1, "python", stderr="Traceback\nImportError: no rerun\n")

    monkeypatch.setattr(extras, "use", fails)
    assert main([CORE, "view", "--out", str(tmp_path)]) == 1
    assert capfd.readouterr().err.strip().endswith("view: ImportError: no rerun")
    assert "core" in (tmp_path / "extras.md").read_text()  # what was measured before stays
