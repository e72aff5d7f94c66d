"""Older processors, imitated: commands do run on them, and a room comes out the same."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import machines
import processors
from common.metrics import read_rows
from gtlayout.scene import FloatArray
from machines import Found, compare, worst_of

PROCESSORS = Path(processors.__file__)
FEATURES = """
import numpy as np
from threadpoolctl import threadpool_info
print(*np.show_config(mode="dicts")["SIMD Extensions"].get("found", []), threadpool_info()[0]["architecture"])
"""
PROMISED = 1e-9
"""Normals and offsets of all processors with AVX2 are so near each other."""


def _run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(PROCESSORS), *command], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("kind", "core"), [("avx2", "Haswell"), ("sse", "Nehalem")])
def test_a_command_runs_without_what_the_older_processor_lacks(kind: str, core: str) -> None:
    if processors.imitation(kind) is None:
        pytest.skip(f"this processor has nothing that one of kind {kind} lacks")
    done = _run(
        kind, sys.executable, "-c", f"{FEATURES}\nimport processors\nassert not processors.later_features({kind!r})"
    )
    said, found = done.stdout.splitlines()
    assert said.startswith(f"as on an older processor ({kind}): NPY_DISABLE_CPU_FEATURES=")
    assert found.split()[-1] == core
    assert _run(kind, sys.executable, "-c", "raise SystemExit(7)").returncode == 7


def test_wrong_usage_is_one_line() -> None:
    for command in ([], ["avx2"], ["6502", "true"]):
        done = _run(*command)
        assert (done.returncode, done.stderr) == (1, "usage: processors.py avx2|sse COMMAND [ARGUMENT ...]\n")


@pytest.mark.parametrize("found", [["X86_V3"], ["AVX", "F16C", "FMA3", "AVX2"], ["ASIMDHP"], []])
def test_where_there_is_nothing_to_leave_out_nothing_is(found: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(np, "show_config", lambda mode: {"SIMD Extensions": {"found": found}})
    assert processors.imitation("avx2") is None
    assert (processors.imitation("sse") is None) == (found in (["ASIMDHP"], []))


def test_a_library_alone_gets_its_own_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        np, "show_config", lambda mode: {"SIMD Extensions": {"found": ["AVX2", "AVX512F", "AVX512_SKX", "X86_V4"]}}
    )
    assert processors.imitation("avx2", ["numpy"]) == {"NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512_SKX X86_V4"}
    assert processors.imitation("sse", ["openblas"]) == {"OPENBLAS_CORETYPE": "Nehalem"}


@pytest.fixture(scope="module")
def tables(room: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``machines.py`` writes for a room, made and solved as on a processor of before AVX-512.

    Where this one is such a processor itself: all libraries but OpenCV as on one of before AVX2.
    """
    older = processors.imitation("avx2") or processors.imitation("sse", ["numpy", "openblas", "libc"])
    if older is None:
        pytest.skip("this processor has nothing that an older one lacks")
    out = tmp_path_factory.mktemp("machines")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(machines, "imitations", lambda: {"older": older})
        assert machines.main([str(room), "--out", str(out), "--rooms", "1"]) == 0
    return out


def _row(path: Path) -> dict[tuple[str, str], float]:
    (row,) = read_rows(path).values()
    return {(metric.key, metric.unit): metric.value for metric in row}


def test_an_older_processor_decides_alike_and_puts_planes_in_the_same_place(tables: Path) -> None:
    row = _row(tables / "solved.json")
    assert row["scenes", ""] == 1
    assert (
        row["decided otherwise", ""]
        == row["other decisions", ""]
        == row["moved observations", ""]
        == row["points", "px"]
        == 0
    )
    assert row["normals", ""] < PROMISED
    assert row["offsets", "u"] < PROMISED
    assert row["offsets", "σ"] < PROMISED
    assert row["corners", "u"] < 1e-6


def test_an_older_processor_makes_the_same_images_of_a_room(tables: Path) -> None:
    row = _row(tables / "rooms.json")
    assert row["images", ""] == 10
    assert row["other images", ""] == 0


def _found(planes: FloatArray, points: FloatArray, verdict: str = "ok") -> Found:
    stages = {
        "observations": np.arange(len(points)),
        "points_px": points,
        "planes": planes,
        "sigma_offsets": np.full(len(planes), 0.5),
        "centroids": np.tile([0.0, 0.0, 2.0], (len(planes), 1)),
        "corners": np.zeros((4, 3)),
        "ious": np.ones(3),
    }
    return Found({"layout.json": planes.tobytes()}, stages, {"verdicts": [verdict]})


def test_differences_are_told_in_numbers_and_names() -> None:
    plane, points = np.array([[0.0, 0.0, 1.0, -2.0], [np.nan] * 4]), np.array([[1.0, 2.0], [3.0, 4.0]])
    one = _found(plane, points)
    row, decided = compare(one, one)
    assert decided == []
    assert {metric.value for metric in row} == {0.0}

    moved = _found(plane + np.array([0.0, 0.0, 0.0, 1e-3]), points + np.array([[0.0, 0.0], [0.25, -0.5]]), "weak")
    row, decided = compare(one, moved)
    assert decided == ["verdicts"]
    values = {(metric.key, metric.unit): metric.value for metric in row}
    assert values["other files", ""] == values["other decisions", ""] == values["moved observations", ""] == 1
    assert values["points", "px"] == 0.5
    assert values["offsets", "u"] == pytest.approx(1e-3)
    assert values["offsets", "σ"] == pytest.approx(2e-3)

    fewer = replace(one, stages=one.stages | {"points_px": points[:1], "observations": np.zeros(1, dtype=np.int64)})
    row, decided = compare(one, fewer)
    assert decided == ["observations", "points_px"]
    assert [metric.key for metric in row if np.isnan(metric.value)] == ["moved observations", "points"]


def test_the_worst_scene_counts() -> None:
    plane, points = np.array([[0.0, 0.0, 1.0, -2.0]]), np.array([[1.0, 2.0]])
    one = _found(plane, points)
    moved = [
        _found(plane + np.array([0.0, 0.0, 0.0, d]), points, verdict) for d, verdict in ((0.5, "ok"), (0.25, "weak"))
    ]
    none = replace(one, stages=one.stages | {"planes": plane[:0]})
    row = worst_of([compare(one, other)[0] for other in (*moved, none)])
    values = {(metric.key, metric.unit): metric.value for metric in row}
    assert (values["scenes", ""], values["decided otherwise", ""]) == (3, 2)
    assert values["offsets", "u"] == 0.5


def test_without_anything_to_compare_it_says_so(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(machines, "imitation", lambda kind, libraries: None)
    assert machines.main([str(room), "--out", str(tmp_path)]) == 1
    assert "there is nothing to compare" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
