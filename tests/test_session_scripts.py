"""The scripts session.py and annotator.py, end to end on a small room."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

import annotator
import session
from common.metrics import Metric, read_rows
from gtlayout.io.scene_folder import load_scene
from gtlayout.synth import SynthConfig, synthesize


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("session scripts") / "box"
    synthesize(folder, SynthConfig(frames=12, key_every=4, width=160, height=120, oversample=1))
    return folder


def by_key(row: list[Metric]) -> dict[str, float]:
    return {metric.key: metric.value for metric in row}


def test_the_cost_of_a_change(box: Path, tmp_path: Path) -> None:
    assert session.main([str(box), "--out", str(tmp_path), "--changes", "1"]) == 0
    rows = {label: by_key(row) for label, row in read_rows(tmp_path / "session.json").items()}
    assert sorted(rows) == ["box, moved vertex", "box, new key frame"]
    for row in rows.values():
        assert 0 < row["quick_median"] <= row["quick_95"]
        assert row["same_instances"] == 1.0
        assert row["depth_difference_median"] <= row["depth_difference_95"] <= row["depth_difference_largest"] < 0.05
        assert 0.5 < row["sigma_ratio_least"] <= row["sigma_ratio_5"]
    assert rows["box, moved vertex"]["quick_share"] < rows["box, moved vertex"]["full_share"] < 1


def test_the_annotator(box: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(annotator, "REACHES_PX", (5.0,))
    assert annotator.main([str(box), "--out", str(tmp_path)]) == 0
    rows = {label: by_key(row) for label, row in read_rows(tmp_path / "annotator.json").items()}
    assert sorted(rows) == ["box, by hand", "box, proposals, 5 px"]
    by_hand, with_proposals = (rows[label] for label in sorted(rows))
    assert by_hand["edges"] == with_proposals["edges"] > 0
    assert by_hand["untouched"] == 0 < with_proposals["untouched"] < with_proposals["untouched_of_proposed"] <= 1
    assert with_proposals["clicks"] < 0.8 * by_hand["clicks"]
    assert with_proposals["iou"] == pytest.approx(by_hand["iou"], abs=0.05)
    assert with_proposals["depth_error_trimmed"] < 0.1
    assert 1 <= with_proposals["key_frames_needed"] <= 3
    assert 0 < with_proposals["wait"] <= with_proposals["longest_wait"]


def test_a_moved_vertex_moves_in_all_outlines_that_share_it(box: Path) -> None:
    scene = load_scene(box)
    changed = session.with_moved_vertex(scene.key_frames, np.random.default_rng(3))
    steps = []
    for before, after in zip(scene.key_frames, changed, strict=True):
        for a, b in zip(before.elements, after.elements, strict=True):
            assert b == replace(a, amodal=b.amodal)
            moved = shapely.get_coordinates(b.amodal) - shapely.get_coordinates(a.amodal)
            steps += moved[np.abs(moved).max(axis=1) > 0].tolist()
    assert len(steps) > 1
    assert np.ptp(np.array(steps), axis=0).max() < 1e-9
