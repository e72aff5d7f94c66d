"""Where results of a batch run go, which of them are still good, and what replaces them."""

from __future__ import annotations

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
import pytest
from batch_records import SOLVED, scene_with

from gtlayout.batch import solver, solver_process
from gtlayout.batch.job import Attempt, Job, Settings
from gtlayout.batch.record import RECORD_FILE, Failure, Record, read_record, scene_folder, write_record
from gtlayout.batch.results import CannotWriteError, LeaseLostError, finished, new_work_folder, publish
from gtlayout.batch.run import _lease, _merged, _outcome, _outcomes
from gtlayout.batch.worker import Outcome
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.synth import SynthConfig, synthesize


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
        [
            {"iou": "high"},
            {"weak": True},
            {"stages_s": {"mesh": "x"}},
            {"files": 3},
            {"attempts": None},
            {"headline": "fine"},
            {"z": 1},
        ],
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

    @pytest.mark.parametrize("edited", [True, False])
    def test_a_scene_that_is_edited_while_it_is_solved_is_solved_again(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, edited: bool
    ) -> None:
        synthesize(tmp_path / "a", SynthConfig(frames=12, width=160, height=120, oversample=1))
        work = tmp_path / "work"
        work.mkdir()

        def edit() -> None:
            if edited:
                os.utime(tmp_path / "a" / "annotations.json", (1, 1))

        monkeypatch.setattr(solver, "_logged", lambda *_: nullcontext())
        job = Job("a", str(tmp_path / "a"), str(tmp_path / "run"), str(tmp_path), Settings(), "", 60.0, 0, 1)
        came = solver.answer(Attempt(job, str(work), "", ""), edit)
        assert came.failure is None
        assert ("fingerprint" in came.figures) != edited

    @pytest.mark.parametrize("vanishes", ["before", "meanwhile"])
    def test_a_scene_that_cannot_be_looked_at_leaves_what_is_there_and_is_tried_again(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, vanishes: str
    ) -> None:
        """As when the disk of the scenes is gone for a while; the work folder is there."""
        scene = scene_with(tmp_path / "a", "transforms.json")
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
