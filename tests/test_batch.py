"""The parts of ``gtlayout batch`` that need no cluster; whole runs are in test_batch_faults.py and _cluster.py."""

from __future__ import annotations

import csv
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from batch_records import SOLVED, scene_with

from gtlayout.batch import cluster
from gtlayout.batch import fingerprint as fingerprints
from gtlayout.batch.fingerprint import fingerprint, inputs_of, program
from gtlayout.batch.job import Job, Settings
from gtlayout.batch.progress import RunProgress
from gtlayout.batch.record import RECORD_FILE, Record, scene_folder, write_record
from gtlayout.batch.run import _merged, _split
from gtlayout.batch.run_folder import is_run, read_run, write_run
from gtlayout.batch.run_tables import write_tables
from gtlayout.batch.scenes import find_scenes
from gtlayout.batch.worker import Outcome
from gtlayout.cli.app import main
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve


class TestFindScenes:
    def test_scenes_at_any_depth_are_called_by_their_path_below_the_root(self, tmp_path: Path) -> None:
        scene_with(tmp_path / "set" / "house" / "kitchen", "transforms.json", "images/0.jpg")
        scene_with(tmp_path / "set" / "office", "transforms.json")
        found = find_scenes([tmp_path / "set"], tmp_path / "run")
        assert {name: path.relative_to(tmp_path).as_posix() for name, path in found.items()} == {
            "house/kitchen": "set/house/kitchen",
            "office": "set/office",
        }

    def test_a_root_that_is_a_scene_has_its_own_name(self, tmp_path: Path) -> None:
        scene = scene_with(tmp_path / "office", "transforms.json")
        assert find_scenes([scene, tmp_path], tmp_path / "run") == {"office": scene}

    def test_what_lacks_cameras_is_found_where_it_is_clearly_meant_as_a_scene(self, tmp_path: Path) -> None:
        scene_with(tmp_path / "good", "transforms.json")
        scene_with(tmp_path / "images_only", "images/0.jpg")
        scene_with(tmp_path / "no_cameras", "annotations.json")
        scene_with(tmp_path / "notes", "readme.md")
        scene_with(tmp_path / ".hidden", "transforms.json")
        scene_with(tmp_path / "good" / "gtlayout", "transforms.json")
        scene_with(tmp_path / "run" / "scenes" / "good", "transforms.json")
        assert list(find_scenes([tmp_path], tmp_path / "run")) == ["good", "images_only", "no_cameras"]

    def test_two_scenes_of_one_name_are_refused(self, tmp_path: Path) -> None:
        for root in ("a", "b"):
            scene_with(tmp_path / root / "office", "transforms.json")
        with pytest.raises(GtlayoutError, match=r"a/office and .*b/office: two scenes called 'office'"):
            find_scenes([tmp_path / "a", tmp_path / "b"], tmp_path / "run")
        assert list(find_scenes([tmp_path], tmp_path / "run")) == ["a/office", "b/office"]

    def test_no_scene_is_in_the_results_of_another(self, tmp_path: Path) -> None:
        scene_with(tmp_path / "a" / "house", "transforms.json")
        scene_with(tmp_path / "b" / "house" / "kitchen", "transforms.json")
        with pytest.raises(GtlayoutError, match="'house/kitchen' would lie in those of 'house'"):
            find_scenes([tmp_path / "a", tmp_path / "b"], tmp_path / "run")
        assert list(find_scenes([tmp_path], tmp_path / "run")) == ["a/house", "b/house/kitchen"]

    def test_a_name_that_no_table_can_hold_is_refused(self, tmp_path: Path) -> None:
        try:
            scene_with(tmp_path / os.fsdecode(b"caf\xe9"), "transforms.json")
        except OSError:
            pytest.skip("this file system takes UTF-8 only")
        with pytest.raises(GtlayoutError, match=r"caf\\udce9: the path is no UTF-8"):
            find_scenes([tmp_path], tmp_path / "run")

    def test_links_that_lead_back_are_followed_once(self, tmp_path: Path) -> None:
        scene_with(tmp_path / "set" / "office", "transforms.json")
        (tmp_path / "set" / "again").symlink_to(tmp_path / "set", target_is_directory=True)
        assert len(find_scenes([tmp_path / "set"], tmp_path / "run")) == 1

    @pytest.mark.parametrize(("name", "said"), [("absent", "no folder"), ("empty", "no scene in")])
    def test_a_root_without_scenes_is_an_error(self, tmp_path: Path, name: str, said: str) -> None:
        (tmp_path / "empty").mkdir()
        with pytest.raises(GtlayoutError, match=said):
            find_scenes([tmp_path / name], tmp_path / "run")


class TestFingerprint:
    def _of(self, scene: Path, settings: str = "") -> str:
        return fingerprint(inputs_of(scene, settings), settings)

    def test_follows_content_names_and_settings_and_nothing_else(self, tmp_path: Path) -> None:
        scene = scene_with(tmp_path / "a", "transforms.json", "images/0.jpg")
        same = scene_with(
            tmp_path / "elsewhere" / "b", "transforms.json", "images/0.jpg", "gtlayout/layout.json", ".cache"
        )
        before = self._of(scene)
        assert self._of(same) == before
        assert self._of(scene, "seed 1") != before
        (scene / "images" / "0.jpg").write_text("[]")  # as long as it was
        changed = self._of(scene)
        assert changed != before
        (scene / "images" / "0.jpg").rename(scene / "images" / "1.jpg")
        assert self._of(scene) not in (before, changed)

    def test_the_stamp_stays_while_no_file_is_touched_and_is_none_while_one_is_fresh(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        scene = scene_with(tmp_path / "a", "transforms.json")
        assert inputs_of(scene, "").stamp == ""
        monkeypatch.setattr(fingerprints, "SETTLED_S", -1.0)
        before = inputs_of(scene, "").stamp
        assert before == inputs_of(scene, "").stamp != ""
        assert inputs_of(scene, "seed 1").stamp != before
        os.utime(scene / "transforms.json", (1, 1))
        assert inputs_of(scene, "").stamp != before

    def test_the_program_is_its_version_and_its_code(self) -> None:
        version, code = program().split("+")
        assert (version, len(code)) == ("0.1.0", 12)


class TestRunFolder:
    def test_tables_have_one_row_a_scene_and_a_column_a_stage(self, tmp_path: Path) -> None:
        records = [replace(SOLVED, scene="b", reason='σ, "quoted"'), Record("a", "failed", "died", "died of SIGSEGV")]
        write_tables(tmp_path, records)
        table = pyarrow.parquet.read_table(tmp_path / "run.parquet")
        with (tmp_path / "run.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        assert table.column("scene").to_pylist() == [row["scene"] for row in rows] == ["a", "b"]
        assert table.column("seconds_tracking").to_pylist() == [None, 1.0]
        assert [row["iou"] for row in rows] == ["", "0.9"]
        assert rows[1]["reason"] == 'σ, "quoted"'
        assert [row["headline"] for row in rows] == ["", "trust"]
        assert table.column("headline_reason").to_pylist() == ["", "IoU 0.900"]
        assert str(table.schema.field("metric").type) == "bool"
        assert list(rows[0]) == table.column_names
        assert "files" not in table.column_names

    def test_a_run_is_what_was_asked_for_and_what_is_done(self, tmp_path: Path) -> None:
        write_run(tmp_path, ["a", "b", "c", "d"], {"seed": 0}, SOLVED.configuration)
        write_record(scene_folder(tmp_path, "a") / RECORD_FILE, SOLVED)
        other = replace(SOLVED, scene="d", configuration="0.1.0+abc seed=1")
        write_record(scene_folder(tmp_path, "d") / RECORD_FILE, other)
        write_record(scene_folder(tmp_path, "left") / RECORD_FILE, replace(SOLVED, scene="left"))
        (tmp_path / "scenes" / "b").mkdir()
        (tmp_path / "scenes" / "b" / RECORD_FILE).write_text('{"format": "gtlayout-record/2", "scene": 3}')
        run = read_run(tmp_path)
        assert (run.scenes, run.records, run.config) == (("a", "b", "c", "d"), {"a": SOLVED}, {"seed": 0})
        assert run.version == "0.1.0+abc"

    def test_a_folder_without_run_json_is_no_run(self, tmp_path: Path) -> None:
        assert not is_run(tmp_path)
        with pytest.raises(GtlayoutError, match="is no run"):
            read_run(tmp_path)

    @pytest.mark.parametrize("text", ["{}", '{"format": "gtlayout-run/0"}', "[]", "nonsense"])
    def test_a_damaged_run_is_said_to_be(self, tmp_path: Path, text: str) -> None:
        (tmp_path / "run.json").write_text(text)
        with pytest.raises(GtlayoutError, match=r"run\.json"):
            read_run(tmp_path)


class TestRestarts:
    JOB = Job("a", "src", "run", "lease", Settings(restarts=7), "0", 60.0, 0, 7)

    @pytest.mark.parametrize(("workers", "parts"), [(0, 1), (1, 1), (3, 3), (100, 7)])
    def test_each_is_in_one_part(self, workers: int, parts: int) -> None:
        split = _split(self.JOB, workers)
        assert len(split) == parts
        assert [r for job in split for r in range(job.first_restart, job.end_restart)] == list(range(7))
        assert all(job.whole == (parts == 1) for job in split)

    def _part(self, tmp_path: Path, name: str, iou: float) -> Outcome:
        (tmp_path / "lease" / name).mkdir(parents=True)
        (tmp_path / "lease" / name / "layout.json").write_text(name)
        return Outcome(replace(SOLVED, iou=iou), work=str(tmp_path / "lease" / name))

    def test_the_best_of_the_parts_counts_and_the_first_of_equals(self, tmp_path: Path) -> None:
        parts = [self._part(tmp_path, name, iou) for name, iou in (("0", 0.7), ("1", 0.9), ("2", 0.9))]
        record, same = _merged(replace(self.JOB, run=str(tmp_path)), parts)
        assert (tmp_path / "scenes" / "a" / "layout.json").read_text() == "1"
        assert (record.iou, record.seconds, record.stages_s, same) == (0.9, 6.0, {"tracking": 3.0, "mesh": 1.5}, False)

    def test_a_part_that_failed_fails_the_scene(self, tmp_path: Path) -> None:
        parts = [self._part(tmp_path, "0", 0.7), self._part(tmp_path, "1", 0.9)]
        parts[1] = replace(parts[1], record=Record("a", "failed", "died", "died of SIGSEGV"))
        record, _ = _merged(replace(self.JOB, run=str(tmp_path)), parts)
        assert record.failure == "died"
        assert not (tmp_path / "scenes" / "a" / "layout.json").exists()

    def test_parts_solved_apart_come_to_what_all_come_to_together(self, small_room: Path) -> None:
        scene, config = load_scene(small_room), Config(restarts=3)
        together = solve(scene, config)
        apart = [solve(scene, config, restarts=restarts) for restarts in (range(1), range(1, 3))]
        best = max(apart, key=lambda solution: solution.quality.iou)
        assert best.quality.iou == together.quality.iou
        for one, other in zip(best.planes, together.planes, strict=True):
            assert np.array_equal(one.normal, other.normal)
            assert one.d == other.d
        assert len({solution.quality.iou for solution in apart}) == 2


def test_progress_counts_scenes_by_their_headline() -> None:
    progress = RunProgress()
    progress.begin(5, 2, "http://127.0.0.1")
    done = [SOLVED, SOLVED, replace(SOLVED, headline="redo"), Record("a", "failed", "died", "died of SIGSEGV")]
    for record in done:
        progress.done(record, same=True)
    assert progress.line().startswith("4/5 done, 2 trust, 0 check, 1 redo, 1 failed, 4 as before")


class TestCommand:
    """What is refused before anything is started or written."""

    @pytest.fixture
    def scenes(self, tmp_path: Path) -> str:
        return str(scene_with(tmp_path / "set" / "office", "transforms.json").parent)

    @pytest.mark.parametrize(
        "arguments",
        [
            [],
            ["--out", "run", "--scheduler", "tcp://x:1", "--workers", "2"],
            ["--out", "run", "--timeout", "0"],
            ["--out", "run", "--timeout", "inf"],
        ],
    )
    def test_wrong_usage(self, scenes: str, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["batch", scenes, *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("gtlayout: ")
        assert line.endswith("(gtlayout batch --help says more)")

    def test_known_problems(
        self, scenes: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(cluster, "CONNECT_S", 1)
        run = str(tmp_path / "run")
        for arguments, said in [
            ([scenes, "--out", scenes], f"{scenes} holds something else than a run"),
            ([f"{scenes}/nothing", "--out", run], f"no folder {scenes}/nothing"),
            ([scenes, "--out", run, "--memory-limit", "lots"], "'lots' is no size of memory; write it as 4GiB"),
            (
                [scenes, "--out", run, "--scheduler", "tcp://127.0.0.1:1"],
                "no Dask scheduler answers at tcp://127.0.0.1:1",
            ),
            (
                [scenes, "--out", run, "--scheduler", "tls://127.0.0.1:1"],
                "no Dask scheduler answers at tls://127.0.0.1:1: TLS expects",
            ),
        ]:
            assert main(["batch", *arguments]) == 1
            assert capsys.readouterr().err.startswith(f"gtlayout: {said}")
        assert not (tmp_path / "run").exists()
