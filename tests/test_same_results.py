"""The script that tells whether results are what they were."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import same_results
from same_results import FILES, main


def _results(root: Path, planes: list[float]) -> Path:
    scene = root / "clips" / "office"
    scene.mkdir(parents=True)
    for name in FILES:
        scene.joinpath(name).write_text(json.dumps({"planes": [{"d": planes}]}))
    return root


def test_the_same_and_not_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, after = _results(tmp_path / "before", [1.0]), _results(tmp_path / "after", [1.0])
    assert main(["compare", str(before), str(after)]) == 0
    assert capsys.readouterr().out == "1 scenes, 4 files: all the same\n"
    after.joinpath("clips/office/layout.ply").write_bytes(b"ply")
    after.joinpath("clips/office/quality.json").unlink()
    assert main(["compare", str(before), str(after)]) == 1
    told = capsys.readouterr().err
    assert told == "same_results: 2 of 4 files differ: clips/office/layout.ply, clips/office/quality.json\n"


def test_renamed_keys_are_no_difference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = _results(tmp_path / "before", [1.0]), _results(tmp_path / "after", [1.0])
    for name in ("layout.json", "quality.json"):
        after.joinpath("clips/office", name).write_text(json.dumps({"surfaces": [{"d": [1.0]}]}))
    assert main(["compare", str(before), str(after)]) == 1
    monkeypatch.setattr(same_results, "RENAMED", {"layout.json": {"planes": "surfaces"}})
    assert main(["compare", str(before), str(after)]) == 1
    assert "1 of 4 files differ: clips/office/quality.json" in capsys.readouterr().err.splitlines()[-1]
    monkeypatch.setattr(same_results, "RENAMED", {name: {"planes": "surfaces"} for name in FILES})
    assert main(["compare", str(before), str(after)]) == 0
    after.joinpath("clips/office/layout.json").write_text(json.dumps({"surfaces": [{"d": [2.0]}]}))
    assert main(["compare", str(before), str(after)]) == 1
    assert "1 of 4 files differ" in capsys.readouterr().err


def test_reworded_texts_are_no_difference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before, after = _results(tmp_path / "before", [1.0]), _results(tmp_path / "after", [1.0])
    for root, words in ((before, "wall_0 lies off"), (after, "wall_0 is off")):
        root.joinpath("clips/office/quality.json").write_text(json.dumps({"reasons": [words]}))
    assert main(["compare", str(before), str(after)]) == 1
    monkeypatch.setattr(same_results, "REWORDED", {"lies off": "is off"})
    assert main(["compare", str(before), str(after)]) == 0


def test_scenes_are_solved_into_folders_of_their_own(
    tmp_path: Path, room: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["make", str(room), "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"{room}: solved\n"
    folder = tmp_path / room.parent.name / room.name
    assert {path.name for path in folder.iterdir()} >= set(FILES)


def test_nothing_to_compare_is_a_problem(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(tmp_path), str(tmp_path)]) == 1
    assert capsys.readouterr().err == f"same_results: no results in {tmp_path} and {tmp_path}\n"
