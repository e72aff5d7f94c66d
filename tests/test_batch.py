"""The parts of ``gtlayout batch`` that need no cluster; whole runs are in test_batch_faults.py and _cluster.py."""

from __future__ import annotations

import csv
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from gtlayout.batch import cluster, solver, solver_process
from gtlayout.batch import fingerprint as fingerprints
from gtlayout.batch.fingerprint import fingerprint, inputs_of, program
from gtlayout.batch.job import Attempt, Job, Settings
from gtlayout.batch.record import RECORD_FILE, Failure, Record, read_record, scene_folder, write_record
from gtlayout.batch.results import CannotWriteError, LeaseLostError, finished, new_work_folder, publish
from gtlayout.batch.run import _lease, _merged, _outcome, _outcomes, _split
from gtlayout.batch.run_folder import is_run, read_run, write_run, write_tables
from gtlayout.batch.scenes import find_scenes
from gtlayout.batch.worker import Outcome
from gtlayout.cli import main
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.io import load_scene
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.method import solve
from gtlayout.synth import SynthConfig, synthesize

SOLVED = Record(
    "a", "accepted", iou=0.9, seconds=2.0, stages_s={"tracking": 1.0, "mesh": 0.5}, fingerprint="f", stamp="s"
)


def _scene(folder: Path, *files: str) -> Path:
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("{}")
    return folder


class TestFindScenes:
    def test_scenes_at_any_depth_are_called_by_their_path_below_the_root(self, tmp_path: Path) -> None:
        _scene(tmp_path / "set" / "house" / "kitchen", "transforms.json", "images/0.jpg")
        _scene(tmp_path / "set" / "office", "transforms.json")
        found = find_scenes([tmp_path / "set"], tmp_path / "run")
        assert {name: path.relative_to(tmp_path).as_posix() for name, path in found.items()} == {
            "house/kitchen": "set/house/kitchen",
            "office": "set/office",
        }

    def test_a_root_that_is_a_scene_has_its_own_name(self, tmp_path: Path) -> None:
        scene = _scene(tmp_path / "office", "transforms.json")
        assert find_scenes([scene, tmp_path], tmp_path / "run") == {"office": scene}

    def test_what_lacks_cameras_is_found_where_it_is_clearly_meant_as_a_scene(self, tmp_path: Path) -> None:
        _scene(tmp_path / "good", "transforms.json")
        _scene(tmp_path / "images_only", "images/0.jpg")
        _scene(tmp_path / "no_cameras", "annotations.json")
        _scene(tmp_path / "notes", "readme.md")
        _scene(tmp_path / ".hidden", "transforms.json")
        _scene(tmp_path / "good" / "gtlayout", "transforms.json")
        _scene(tmp_path / "run" / "scenes" / "good", "transforms.json")
        assert list(find_scenes([tmp_path], tmp_path / "run")) == ["good", "images_only", "no_cameras"]

    def test_two_scenes_of_one_name_are_refused(self, tmp_path: Path) -> None:
        for root in ("a", "b"):
            _scene(tmp_path / root / "office", "transforms.json")
        with pytest.raises(GtlayoutError, match=r"a/office and .*b/office: two scenes called 'office'"):
            find_scenes([tmp_path / "a", tmp_path / "b"], tmp_path / "run")
        assert list(find_scenes([tmp_path], tmp_path / "run")) == ["a/office", "b/office"]

    def test_no_scene_is_in_the_results_of_another(self, tmp_path: Path) -> None:
        _scene(tmp_path / "a" / "house", "transforms.json")
        _scene(tmp_path / "b" / "house" / "kitchen", "transforms.json")
        with pytest.raises(GtlayoutError, match="'house/kitchen' would lie in those of 'house'"):
            find_scenes([tmp_path / "a", tmp_path / "b"], tmp_path / "run")
        assert list(find_scenes([tmp_path], tmp_path / "run")) == ["a/house", "b/house/kitchen"]

    def test_a_name_that_no_table_can_hold_is_refused(self, tmp_path: Path) -> None:
        try:
            _scene(tmp_path / os.fsdecode(b"caf\xe9"), "transforms.json")
        except OSError:
            pytest.skip("this file system takes UTF-8 only")
        with pytest.raises(GtlayoutError, match=r"caf\\udce9: the path is no UTF-8"):
            find_scenes([tmp_path], tmp_path / "run")

    def test_links_that_lead_back_are_followed_once(self, tmp_path: Path) -> None:
        _scene(tmp_path / "set" / "office", "transforms.json")
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
        scene = _scene(tmp_path / "a", "transforms.json", "images/0.jpg")
        same = _scene(tmp_path / "elsewhere" / "b", "transforms.json", "images/0.jpg", "gtlayout/layout.json", ".cache")
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
        scene = _scene(tmp_path / "a", "transforms.json")
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


class TestResults:
    @pytest.fixture
    def lease(self, tmp_path: Path) -> Path:
        (tmp_path / "lease").mkdir()
        return tmp_path / "lease"

    def _work(self, lease: Path, text: str) -> Path:
        work = new_work_folder(lease)
        (work / "layout.json").write_text(text)
        (work / "log.txt").write_text("log")
        return work

    def test_new_results_take_the_place_of_old_ones_as_a_whole(self, tmp_path: Path, lease: Path) -> None:
        place = tmp_path / "scenes" / "a"
        first = self._work(lease, "old")
        (first / "cameras.json").write_text("only of the old ones")
        publish(SOLVED, first, place)
        record = publish(SOLVED, self._work(lease, "new"), place)
        assert sorted(path.name for path in place.iterdir()) == ["layout.json", "log.txt", "record.json"]
        assert (place / "layout.json").read_text() == "new"
        assert finished(place) == record == read_record(place / RECORD_FILE)
        assert list(lease.iterdir()) == []

    def test_of_a_failed_scene_only_the_log_is_kept(self, tmp_path: Path, lease: Path) -> None:
        publish(Record("a", "failed", "bug"), self._work(lease, "half of it"), tmp_path / "a")
        assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["log.txt", "record.json"]

    @pytest.mark.parametrize(("failure", "good"), [("input", True), ("bug", True), ("timeout", False), ("died", False)])
    def test_failures_that_may_pass_are_not_finished(
        self, tmp_path: Path, lease: Path, failure: Failure, good: bool
    ) -> None:
        publish(replace(SOLVED, status="failed", failure=failure), new_work_folder(lease), tmp_path / "a")
        assert (finished(tmp_path / "a") is not None) == good

    @pytest.mark.parametrize(
        "wrong",
        [{"iou": "high"}, {"weak": True}, {"stages_s": {"mesh": "x"}}, {"files": 3}, {"attempts": None}, {"z": 1}],
    )
    def test_a_record_of_something_else_is_none(self, tmp_path: Path, wrong: dict[str, object]) -> None:
        """No table could be written with it."""
        write_record(tmp_path / RECORD_FILE, SOLVED)
        assert read_record(tmp_path / RECORD_FILE) == SOLVED
        write_json_atomic(tmp_path / RECORD_FILE, {**read_json(tmp_path / RECORD_FILE), **wrong})
        with pytest.raises(GtlayoutError, match="is damaged"):
            read_record(tmp_path / RECORD_FILE)
        assert finished(tmp_path) is None

    @pytest.mark.parametrize("damage", ["absent", "changed", "record"])
    def test_results_that_are_not_as_written_are_not_finished(self, tmp_path: Path, lease: Path, damage: str) -> None:
        publish(SOLVED, self._work(lease, "{}"), tmp_path / "a")
        if damage == "absent":
            (tmp_path / "a" / "layout.json").unlink()
        else:
            (tmp_path / "a" / ("layout.json" if damage == "changed" else RECORD_FILE)).write_text("[]")
        assert finished(tmp_path / "a") is None

    def test_results_without_their_record_are_replaced(self, tmp_path: Path, lease: Path) -> None:
        publish(SOLVED, self._work(lease, "old"), tmp_path / "a")
        (tmp_path / "a" / RECORD_FILE).unlink()
        assert finished(tmp_path / "a") is None
        publish(SOLVED, self._work(lease, "new"), tmp_path / "a")
        assert (tmp_path / "a" / "layout.json").read_text() == "new"

    def test_what_an_attempt_left_half_written_is_not_kept(self, tmp_path: Path, lease: Path) -> None:
        work = self._work(lease, "{}")
        (work / ".layout.json.17.tmp").write_text('{"form')
        record = publish(SOLVED, work, tmp_path / "a")
        assert sorted(record.files) == ["layout.json", "log.txt"]
        assert not (tmp_path / "a" / ".layout.json.17.tmp").exists()

    def test_a_lost_lease_is_told_once_though_dask_has_sent_it(self, lease: Path) -> None:
        with pytest.raises(LeaseLostError) as lost:
            new_work_folder(lease / "gone")
        assert str(pickle.loads(pickle.dumps(lost.value))) == str(lost.value)

    def test_without_the_lease_nothing_is_put_into_its_place(self, tmp_path: Path, lease: Path) -> None:
        publish(SOLVED, self._work(lease, "of the session that goes on"), tmp_path / "a")
        left = self._work(lease, "of one that was given up")
        lease.rename(tmp_path / "gone")
        with pytest.raises(LeaseLostError):
            publish(SOLVED, left, tmp_path / "a")
        with pytest.raises(LeaseLostError):
            new_work_folder(lease)
        assert (tmp_path / "a" / "layout.json").read_text() == "of the session that goes on"

    def test_a_stopped_run_leaves_nothing_to_solvers_that_are_still_writing(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Its folder goes while results are being written: none may make it anew, with some of them missing."""
        synthesize(tmp_path / "a", SynthConfig(frames=12, width=160, height=120, oversample=1))
        lease = tmp_path / "lease"
        lease.mkdir()
        work = new_work_folder(lease)

        def stopped(*_: object) -> bytes:
            lease.rename(tmp_path / "gone")
            return b""

        monkeypatch.setattr(solver, "thumbnail", stopped)
        monkeypatch.setattr(solver, "_logged", lambda *_: nullcontext())
        job = Job("a", str(tmp_path / "a"), str(tmp_path), str(lease), Settings(), "", 60.0, 0, 1)
        solver.answer(Attempt(job, str(work), "", ""), lambda: None)
        assert not lease.exists()
        with pytest.raises(LeaseLostError):
            publish(SOLVED, work, scene_folder(tmp_path, "a"))
        assert not lease.exists()
        assert not scene_folder(tmp_path, "a").exists()

    def test_a_session_takes_over_from_another_which_then_leaves_it_alone(self, tmp_path: Path) -> None:
        both = ExitStack()
        with _lease(tmp_path) as first:
            work = self._work(first, "{}")
            second = both.enter_context(_lease(tmp_path))
            with pytest.raises(LeaseLostError):
                publish(SOLVED, work, tmp_path / "a")
        assert second.is_dir()
        both.close()
        assert not [*tmp_path.iterdir()]

    def test_what_is_no_result_is_never_replaced(self, tmp_path: Path, lease: Path) -> None:
        (tmp_path / "a").mkdir()
        (tmp_path / "a" / "thesis.txt").write_text("ten years")
        with pytest.raises(CannotWriteError, match="no result of a scene"):
            publish(SOLVED, self._work(lease, "{}"), tmp_path / "a")
        assert (tmp_path / "a" / "thesis.txt").read_text() == "ten years"


class TestLostWork:
    """What is there is only replaced when it is known to be out of date."""

    @pytest.mark.parametrize(("said", "begun"), [("", False), (solver_process.BEGUN_LINE, True)])
    def test_a_process_that_dies_says_whether_it_had_begun(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: str, begun: bool
    ) -> None:
        program = f'import os, sys; print(\'{{"program": "p"}}\', flush=True); input(); sys.stdout.write({said!r}); '
        program += "sys.stdout.flush(); os._exit(7)"
        start = subprocess.Popen

        def stand_in(_command: object, **options: Any) -> subprocess.Popen[str]:
            return start([sys.executable, "-c", program], **options)

        monkeypatch.setattr(subprocess, "Popen", stand_in)
        job = Job("a", "src", "run", str(tmp_path), Settings(), "p", 60.0, 0, 1)
        came, _ = solver_process.SolverProcess().solve(Attempt(job, str(tmp_path), "", ""), lambda: np.inf)
        assert (came.failure, came.begun) == ("died", begun)
        assert came.reason.startswith("its process ended with status 7")

    @pytest.mark.parametrize("there", [True, False])
    def test_a_lost_worker_costs_no_finished_scene(self, tmp_path: Path, there: bool) -> None:
        lease, place = tmp_path / "lease", scene_folder(tmp_path, "a")
        lease.mkdir()
        if there:
            publish(SOLVED, new_work_folder(lease), place)
        job = Job("a", "src", str(tmp_path), str(lease), Settings(), "p", 60.0, 0, 1)

        class Lost:
            status = "error"

            def exception(self) -> Exception:
                return ImportError("no gtlayout here")

        came = _outcome(Lost(), job)  # type: ignore[arg-type]
        assert came is not None
        record, _ = _merged(job, [came])
        assert (record.failure, record.reason) == ("worker", "no gtlayout here")
        assert read_record(place / RECORD_FILE).status == ("accepted" if there else "failed")

    def test_an_answer_that_is_lost_with_its_worker_is_waited_for_again(self) -> None:
        came = Outcome(SOLVED, same=True)

        class Lost:
            """Dask tells of it when it is done; then its worker goes, and it is done again."""

            key, status = "solve", "pending"

            def add_done_callback(self, callback: Callable[[Lost], None]) -> None:
                self.status = "lost" if self.status == "pending" else "finished"
                callback(self)

            def exception(self) -> None:
                assert self.status == "finished"

            def result(self) -> Outcome:
                return came

        class Stub:
            status = "running"

            def nthreads(self) -> dict[str, int]:
                return {"a worker": 1}

            def submit(self, *_: object, **__: object) -> Lost:
                return Lost()

        job = Job("a", "src", "run", "lease", Settings(), "p", 60.0, 0, 1)
        assert list(_outcomes(Stub(), [job])) == [(SOLVED, True)]  # type: ignore[arg-type]

    @pytest.mark.parametrize("vanishes", ["before", "meanwhile"])
    def test_a_scene_that_cannot_be_looked_at_leaves_what_is_there_and_is_tried_again(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, vanishes: str
    ) -> None:
        """As when the disk of the scenes is gone for a while; the work folder is there."""
        scene = _scene(tmp_path / "a", "transforms.json")
        work = tmp_path / "work"
        work.mkdir()

        def vanish() -> None:
            scene.rename(tmp_path / "elsewhere")

        if vanishes == "before":
            vanish()
        monkeypatch.setattr(solver, "_logged", lambda *_: nullcontext())
        job = Job("a", str(scene), str(tmp_path / "run"), str(tmp_path), Settings(), "", 60.0, 0, 1)
        came = solver.answer(Attempt(job, str(work), "", "of the finished result"), vanish)
        assert (came.failure, came.begun) == ("input", vanishes == "meanwhile")
        assert "fingerprint" not in came.figures


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
        assert str(table.schema.field("metric").type) == "bool"
        assert list(rows[0]) == table.column_names
        assert "files" not in table.column_names

    def test_a_run_is_what_was_asked_for_and_what_is_done(self, tmp_path: Path) -> None:
        write_run(tmp_path, ["a", "b", "c"], {"seed": 0}, "0.1.0+abc")
        write_record(scene_folder(tmp_path, "a") / RECORD_FILE, SOLVED)
        write_record(scene_folder(tmp_path, "left") / RECORD_FILE, replace(SOLVED, scene="left"))
        (tmp_path / "scenes" / "b").mkdir()
        (tmp_path / "scenes" / "b" / RECORD_FILE).write_text('{"format": "gtlayout-record/1", "scene": 3}')
        run = read_run(tmp_path)
        assert (run.scenes, run.records, run.config) == (("a", "b", "c"), {"a": SOLVED}, {"seed": 0})

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

    def test_parts_solved_apart_come_to_what_all_come_to_together(self, room: Path) -> None:
        scene, config = load_scene(room), Config(restarts=3)
        together = solve(scene, config)
        apart = [solve(scene, config, restarts=restarts) for restarts in (range(1), range(1, 3))]
        best = max(apart, key=lambda solution: solution.quality.iou)
        assert best.quality.iou == together.quality.iou
        for one, other in zip(best.planes, together.planes, strict=True):
            assert np.array_equal(one.normal, other.normal)
            assert one.d == other.d
        assert len({solution.quality.iou for solution in apart}) == 2


class TestCommand:
    """What is refused before anything is started or written."""

    @pytest.fixture
    def scenes(self, tmp_path: Path) -> str:
        return str(_scene(tmp_path / "set" / "office", "transforms.json").parent)

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
        assert "Error" in capsys.readouterr().err

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
