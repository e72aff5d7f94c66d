"""The notebooks: committed without outputs, run as they are, and what they find."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, wanted: str) -> Any:
    """Execute a copy of a notebook beside ``examples`` and return what the expression ``wanted`` is in the end."""
    (folder / "notebooks").mkdir()
    (folder / "examples").symlink_to(ROOT / "examples")
    notebook = nbformat.read(shutil.copy(ROOT / "notebooks" / name, folder / "notebooks"), as_version=4)
    notebook.cells.append(nbformat.v4.new_code_cell(f"import json; print(json.dumps({wanted}))"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("TMPDIR", str(folder))
    before = snapshot(ROOT / "examples")
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(folder / "notebooks")}}).execute()
    assert snapshot(ROOT / "examples") == before
    return json.loads(notebook.cells[-1].outputs[0].text)


def snapshot(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_committed_without_outputs(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert notebook.cells[0].source.startswith("# ")
    for cell in notebook.cells:
        assert cell.cell_type == "markdown" or not (cell.outputs or cell.execution_count), cell.id


def test_quickstart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = """{
        "labels": sorted(instance.label for instance in layout.instances),
        "errors_cm": [100 * error.offset for error in evaluation.planes],
        "depth_cm": 100 * evaluation.depth.median,
    }"""
    found = run("01_quickstart.ipynb", tmp_path, monkeypatch, wanted)
    assert found["labels"] == ["ceiling", "door", "floor", "wall", "wall", "wall", "window"]
    assert len(found["errors_cm"]) == 7
    assert max(found["errors_cm"]) < 3
    assert found["depth_cm"] < 1


def test_reading_the_uncertainty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = """{
        "within": within,
        "sigmas_cm": {name: np.median([100 * p.sigma_depth_m for p in s.layout.planes]) for name, s in solved.items()},
        "dominant_evidence": [[s.layout.planes[i].support.dominant_evidence for i in walls] for s in held.values()],
        "observable": [[s.layout.planes[i].observable for i in walls] for s in held.values()],
        "shares": sigmas,
        "refusal": refusal,
    }"""
    found = run("02_reading_the_uncertainty.ipynb", tmp_path, monkeypatch, wanted)
    assert found["within"] >= 0.85
    assert found["sigmas_cm"]["poor"] > 1.1 * found["sigmas_cm"]["good"]
    assert found["dominant_evidence"][0] == ["tracks", "tracks"]
    assert "contact edges" in found["dominant_evidence"][1]
    assert "tracks" not in found["dominant_evidence"][2]
    assert found["observable"][1] == [True, True]
    assert False in found["observable"][2]
    assert found["shares"][0] > 2 * found["shares"][-1]
    assert "all planes are unobservable" in found["refusal"]


def test_own_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = run(
        "03_own_data.ipynb",
        tmp_path,
        monkeypatch,
        '{"status": status, "errors_m": errors_m, "plan": (folder / "plan.svg").read_text()}',
    )
    assert found["status"] == 0
    assert set(found["errors_m"]) == {"height", "width"}
    assert all(abs(error) < 0.06 for error in found["errors_m"].values())
    assert "<svg" in found["plan"]
    assert "±" in found["plan"]


def test_factor_graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = run("04_factor_graph.ipynb", tmp_path, monkeypatch, '{"worst": worst, "costs": costs, "inside": inside}')
    assert len(found["worst"]) == 7
    assert max(found["worst"].values()) < 1e-6
    assert found["costs"][-1] < 0.1 * found["costs"][0]
    assert all(0.88 < share < 1 for share in found["inside"])


def test_dimensions_one_may_sign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = """{
        "factor": solved.layout.scale.factor,
        "used": [one.used for one in solved.layout.measurements],
        "slip": [one.used for one in wrong.layout.measurements],
        "levels": [one.accuracy.level for one in solved.layout.dimensions],
    }"""
    found = run("05_dimensions_one_may_sign.ipynb", tmp_path, monkeypatch, wanted)
    assert found["factor"] == pytest.approx(2.5, rel=0.01)
    assert found["used"] == [True, True, True]
    assert found["slip"] == [True, True, False]
    assert sum(level >= 30 for level in found["levels"]) >= 3
