"""The calibration of uncertainties: a run on a small room, and what tables make of planes that are known."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
import rooms

import calibration
from calibration import Row
from common.metrics import Metric, read_rows
from common.runner import scenes_by_folder
from gtlayout.errors import GtlayoutError
from gtlayout.instances import Plane
from gtlayout.io.files import write_json_atomic
from gtlayout.io.truth import read_truth
from gtlayout.solution import Solution


def row(
    folder: str = "orbit-clean", scene: str = "a", label: str = "wall", verdict: str = "ok", **values: float
) -> Row:
    """One plane of a scene."""
    metrics = [Metric(key, value, "", None) for key, value in values.items()]
    (made,) = calibration.rows_of(folder, scene, {f"p|{label}|{verdict}": metrics}, None)
    return made


def metrics_of(rows: list[Row]) -> dict[str, float]:
    return {metric.key: metric.value for metric in calibration.summary_row(rows)}


def test_a_small_room_end_to_end(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A room of the benchmark beside a clip without truth, which fails and has a row that says so."""
    shutil.copytree(room, tmp_path / "orbit-clean/box-0")
    shutil.copytree(room, tmp_path / "clips/blind")
    (tmp_path / "clips/blind/gt_planes.json").unlink()
    arguments = [str(tmp_path / "orbit-clean/box-0"), str(tmp_path / "clips"), "--out", str(tmp_path / "out")]
    assert calibration.main(arguments) == 0
    out = tmp_path / "out"
    printed = capsys.readouterr()
    assert printed.out.startswith("| group | scenes | failed ↓ | missing ↓ | unobservable | planes | nees_mean |")
    assert "blind: " in printed.err
    summary = {group: {m.key: m.value for m in of} for group, of in read_rows(out / "summary.json").items()}
    assert list(summary) == [
        *("rooms", "orbit", "clean", "orbit, clean"),
        *("rooms, room surfaces", "rooms, openings", "orbit, room surfaces", "orbit, openings"),
        "clips",
    ]
    assert (summary["clips"]["scenes"], summary["clips"]["failed"], summary["clips"]["planes"]) == (1, 1, 0)
    assert summary["rooms"]["failed"] == 0
    assert summary["rooms"]["planes"] == (
        summary["rooms, room surfaces"]["planes"] + summary["rooms, openings"]["planes"]
    )
    assert 0 < summary["rooms"]["nees_mean"] < 10
    assert summary["rooms"]["coverage_95"] > 0.5
    with (out / "planes.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert {line["plane"] for line in table if line["kind"] == "orbit"} >= {"floor", "ceiling"}
    assert {(line["scene"], line["level"]) for line in table} == {("orbit-clean/box-0", "clean"), ("clips/blind", "")}
    (failed,) = (line for line in table if line["verdict"] == "failed")
    assert "gt_planes.json" in failed["note"]
    assert failed["nees"] == ""
    assert all(float(line["nees"]) > 0 for line in table if line["verdict"] == "ok")
    for picture in ("reliability.png", "sigma_depth_orbit.png"):
        assert (out / picture).read_bytes().startswith(b"\x89PNG")

    # A second run solves only what failed, and says the same.
    before = (out / "planes.csv").read_bytes()
    monkeypatch.setattr(calibration, "solve", lambda *_: pytest.fail("solved again"))
    assert calibration.main(arguments) == 0
    assert (out / "planes.csv").read_bytes() == before


def test_figures_are_those_of_the_verdict(room_solution: Solution) -> None:
    solved = room_solution
    """σ of the depth at the centroid is what the verdict was made from; the error is against the truth's depth."""
    truth = read_truth(solved.scene)
    assert truth is not None
    judged = dict(zip([i.name for i in solved.layout.instances], solved.quality.instances, strict=True))
    rows = calibration.compare(solved, truth)
    assert {key.split("|")[0] for key in rows} == {name for name, plane in truth.planes.items() if plane.scored}
    sigmas = {quality.sigma_depth for quality in judged.values()}
    for metrics in rows.values():
        values = {metric.key: metric.value for metric in metrics}
        assert min(abs(values["depth_sigma"] - sigma) for sigma in sigmas) < 1e-12
        assert values["offset_ratio"] == pytest.approx(values["offset_error"] / values["offset_sigma"])
        assert 0 <= values["depth_error"] < 0.3


def test_depth_errors_in_closed_form() -> None:
    """A wall at 10 m that truly is at 12.5 m, seen straight on: 2.5 m off, a fifth of the depth; σ of d is its σ."""
    camera = rooms.facing_camera()
    covariance = np.zeros((4, 4))
    covariance[3, 3] = 0.3**2
    wall = Plane(np.array([0.0, -1.0, 0.0]), 10.0, covariance, observable=True)
    behind = Plane(np.array([0.0, -1.0, 0.0]), 12.5, covariance, observable=True)
    pixels = np.array([[50.0, 40.0], [10.0, 70.0]])
    np.testing.assert_allclose(calibration.depth_errors(wall, behind, camera, pixels), [[2.5, 0.3, 0.2, 0.03]] * 2)
    away = Plane(np.array([0.0, 1.0, 0.0]), 12.5, covariance, observable=True)
    missed = calibration.depth_errors(wall, away, camera, pixels[:1])[0]
    assert np.isnan(missed[0]), "the ray misses the true plane"
    assert missed[2] == pytest.approx(1 + 10 / 12.5)
    assert np.isnan(calibration.depth_errors(away, wall, camera, pixels)).all()


def test_groups() -> None:
    assert row("orbit-clean", label="wall").groups == (
        *("rooms", "orbit", "clean", "orbit, clean"),
        *("rooms, room surfaces", "orbit, room surfaces"),
    )
    assert row("dolly-poor", label="window").groups[-1] == "dolly, openings"
    assert row("real-clips", label="floor").groups == ("real-clips", "real-clips, room surfaces")
    (failed,) = calibration.rows_of("re10k-typical", "b", None, "no luck")
    assert failed.groups == ("rooms", "re10k", "typical", "re10k, typical")
    assert (failed.verdict, failed.note) == ("failed", "no luck")


def test_real_clips_and_rooms_share_no_group() -> None:
    rows = [row("clips", nees=9.0), row("orbit-clean", nees=1.0), row("dolly-clean", nees=2.0)]
    means = {
        group: next(m.value for m in of if m.key == "nees_mean") for group, of in calibration.summary_rows(rows).items()
    }
    assert list(means)[:3] == ["rooms", "orbit", "dolly"]
    assert list(means)[-2:] == ["clips", "clips, room surfaces"]
    assert (means["rooms"], means["clips"], means["clean"], means["dolly"]) == (1.5, 9.0, 1.5, 2.0)


def test_wrong_and_sure() -> None:
    """More than 0.1 m off: one that says 1 cm and is ok, one that says 20 cm, one that is called weak."""
    rows = [
        row(offset_error=0.3, offset_sigma=0.01),
        row(offset_error=0.3, offset_sigma=0.2),
        row(offset_error=0.3, offset_sigma=0.01, verdict="weak"),
        row(offset_error=0.09, offset_sigma=0.01),
    ]
    found = metrics_of(rows)
    assert (found["badly_wrong"], found["wrong_and_sure"]) == (3, 1)
    assert found["wrong_and_sure_share"] == pytest.approx(1 / 3)
    assert np.isnan(metrics_of(rows[3:])["wrong_and_sure_share"])


def test_counts_and_quantiles() -> None:
    """χ²₃ holds half below 2.366 and 95 % below 7.815."""
    rows = [row(nees=x, offset_ratio=x, normal_ratio=2 * x) for x in (1.0, 2.0, 3.0, 8.0)]
    rows += [row(scene="b", verdict="missing"), row(scene="b", verdict="unobservable")]
    rows += calibration.rows_of("orbit-clean", "c", None, "no luck")
    found = metrics_of(rows)
    counts = [found[key] for key in ("scenes", "failed", "missing", "unobservable", "planes")]
    assert counts == [3, 1, 1, 1, 4]
    assert (found["nees_mean"], found["nees_median"]) == (3.5, 2.5)
    assert (found["coverage_50"], found["coverage_90"], found["coverage_95"]) == (0.5, 0.75, 0.75)
    assert (found["offset_ratio_50"], found["offset_ratio_90"]) == pytest.approx((2.5, 6.5))
    assert found["normal_ratio_50"] == 5.0
    (of_rooms, *_) = calibration.coverage_rows(rows).values()
    values = {metric.key: metric.value for metric in of_rooms}
    assert values["planes"] == 4
    assert 0 < values["coverage_90_low"] < 0.75 < values["coverage_90_high"] < 1


def test_planes_that_nothing_can_be_said_of(tmp_path: Path) -> None:
    calibration.write(tmp_path, calibration.rows_of("orbit-clean", "c", None, "no luck"))
    assert (tmp_path / "planes.csv").read_text().splitlines() == [
        "scene,kind,level,plane,label,verdict,note",
        "orbit-clean/c,orbit,clean,,,failed,no luck",
    ]
    assert "| rooms | 1 | 1 | 0 | 0 | 0 | – |" in (tmp_path / "summary.md").read_text()


def test_scenes_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    for name in ("x/orbit-clean/a", "x/orbit-poor/a", "y/orbit-clean/a"):
        write_json_atomic(tmp_path / name / "transforms.json", {})
    found = scenes_by_folder([tmp_path / "x/orbit-clean/a", tmp_path / "x/orbit-poor", tmp_path / "x/orbit-clean"])
    assert {folder: list(scenes) for folder, scenes in found.items()} == {"orbit-clean": ["a"], "orbit-poor": ["a"]}
    with pytest.raises(GtlayoutError, match="two scenes of one name"):
        scenes_by_folder([tmp_path / "x/orbit-clean", tmp_path / "y/orbit-clean"])
    with pytest.raises(GtlayoutError, match="name at least one"):
        scenes_by_folder([])
