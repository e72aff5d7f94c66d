"""The scripts real_clips.py and degraded.py, end to end on a small room; and what their tables make of known rows."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest

import degraded
import real_clips
from common.metrics import Metric, read_rows
from common.runner import SceneRows
from gtlayout.errors import GtlayoutError
from gtlayout.io.scene_folder import load_scene
from gtlayout.synth import SynthConfig, synthesize
from measure_variant import VARIANTS
from variants import tables as variant_tables
from variants.measures import WHOLE, measure
from variants.tables import Outcome

SMALL = SynthConfig(frames=12, key_every=4, width=160, height=120, oversample=1)


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of one small room."""
    root = tmp_path_factory.mktemp("variants") / "clips"
    synthesize(root / "box", SMALL)
    return root


def measured_here(kind: str, scene: Path, name: str) -> SceneRows:
    """As in a process apart, without the time to start one."""
    return measure(VARIANTS[kind](load_scene(scene))[name](scene / ".files"))


def values(path: Path) -> dict[str, dict[str, float]]:
    return {label: {metric.key: metric.value for metric in of} for label, of in read_rows(path).items()}


def test_real_clips_end_to_end(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clip in two forms beside one that cannot be read and one with damaged images: each has a row that says so."""
    monkeypatch.setattr(variant_tables, "measured_apart", measured_here)
    root, out = tmp_path / "clips", tmp_path / "out"
    shutil.copytree(clips / "box", root / "box")
    shutil.copytree(clips / "box", root / "grey")
    for image in (root / "grey/images").iterdir():
        image.write_bytes(b"no image")
    shutil.copytree(clips / "box", root / "lost")
    (root / "lost/transforms.json").write_text("{}")
    forms = ["as it is", "cameras × 1000"]
    arguments = [str(root), "--out", str(out), "--form", *forms]
    assert real_clips.main(arguments) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("| variant | variants | failed ↓ | iou ↑ | iou_worst ↑ |")
    assert "0 of 5 rows end wrong and certain (0 planes), 3 failed" in printed
    rows = values(out / "rows.json")
    assert list(rows) == [
        *(f"clips/{clip}: {form}" for clip in ("box", "grey") for form in forms),
        "clips/lost: unreadable",
    ]
    own, scaled = rows["clips/box: as it is"], rows["clips/box: cameras × 1000"]
    assert own["iou"] > 0.8
    assert own["depth_error_median"] < 0.1
    assert scaled["planes"] == own["planes"] > 3
    assert rows["clips/grey: as it is"]["failed"] == 1
    assert rows["clips/grey: as it is"]["iou"] == 0
    with (out / "failed.csv").open(newline="") as file:
        reasons = {(row["scene"], row["variant"]): row["reason"] for row in csv.DictReader(file)}
    assert set(reasons) == {
        ("clips/grey", "as it is"),
        ("clips/grey", "cameras × 1000"),
        ("clips/lost", variant_tables.UNREADABLE),
    }
    assert "image" in reasons["clips/grey", "as it is"]
    assert "transforms.json" in reasons["clips/lost", variant_tables.UNREADABLE]
    assert (out / "variants.png").read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in out.iterdir()} == {
        *(f"{name}.{end}" for name in ("rows", "summary", "wrong_and_certain") for end in ("md", "csv", "json")),
        *("planes.csv", "failed.csv", "variants.png", "clips"),
    }

    # Nothing changed: a second run solves only what failed, and says the same.
    before, again = (out / "rows.csv").read_bytes(), []

    def measured(_kind: str, scene: Path, name: str) -> SceneRows:
        again.append((scene.name, name))
        raise GtlayoutError("still no image")

    monkeypatch.setattr(variant_tables, "measured_apart", measured)
    assert real_clips.main(arguments) == 0
    assert again == [("grey", name) for name in forms]
    assert (out / "rows.csv").read_bytes() == before
    # Another input: only that clip is measured again.
    again.clear()
    (root / "box/transforms.json").write_text((root / "box/transforms.json").read_text() + "\n")
    assert real_clips.main(arguments) == 0
    assert again[:2] == [("box", name) for name in forms]


def test_unknown_forms_are_told(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert real_clips.main([str(clips), "--out", str(tmp_path), "--form", "cameras × 2"]) == 1
    assert "no form 'cameras × 2'; there are: as it is, without a unit" in capsys.readouterr().err


def test_degraded_end_to_end(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three of the degradations: the lens, a drawing left out, and a drawing of another time; in this process."""
    monkeypatch.setattr(variant_tables, "measured_apart", measured_here)
    every, wanted = VARIANTS["degradations"], ("focal length + 5 %", "element left out", "drawing of another time")
    monkeypatch.setitem(
        VARIANTS, "degradations", lambda scene: {n: make for n, make in every(scene).items() if n.startswith(wanted)}
    )
    assert degraded.main([str(clips), "--out", str(tmp_path)]) == 0
    assert "of 4 rows end wrong and certain" in capsys.readouterr().out
    rows = values(tmp_path / "rows.json")
    assert [label.split(": ")[1] for label in rows] == [
        *("focal length + 5 %", "element left out", "element left out everywhere", "drawing of another time"),
    ]
    assert all(row["failed"] == 0 for row in rows.values())
    assert list(values(tmp_path / "summary.json")) == [*(label.split(": ")[1] for label in rows), "all"]
    lens = rows["clips/box: focal length + 5 %"]
    # What is measured is the depth through the lens that was given: off, but by shares of the room.
    assert 0.005 < lens["depth_error_median"] < 0.5


def plane(certain: float, offset: float = 0.3) -> list[Metric]:
    return [
        Metric("offset_error", offset, "m", False),
        Metric("offset_sigma", 0.01, "m", None),
        Metric("off", 1.0, "", False),
        Metric("wrong_and_certain", certain, "", False),
    ]


def outcome(scene: str, variant: str, iou: float, certain: float, **planes: list[Metric]) -> Outcome:
    whole = [
        Metric("failed", 0.0, "", False),
        Metric("iou", iou, "", True),
        Metric("accepted", float(iou >= 0.8), "", True),
        Metric("depth_error_trimmed", 1 - iou, "m", False),
        Metric("wrong_and_certain", certain, "", False),
    ]
    return Outcome(scene, variant, {WHOLE: whole, **{f"{name}|{name}_0|ok": of for name, of in planes.items()}})


OUTCOMES = [
    outcome("a", "roll: 2°", 0.9, 2, floor=plane(1.0), wall=plane(1.0, 0.5), door=plane(0.0)),
    outcome("b", "roll: 1°", 0.7, 0, floor=plane(0.0)),
    Outcome("c", "roll: 2°", {}, "no tracks"),
    outcome("a", "as it is", 1.0, 1, floor=plane(1.0)),
]


def test_sums_means_and_the_worst() -> None:
    found = {metric.key: metric.value for metric in variant_tables.summarised(OUTCOMES[:3])}
    assert found["variants"] == 3
    assert found["failed"] == 1
    assert found["iou"] == pytest.approx((0.9 + 0.7 + 0) / 3)
    assert found["iou_worst"] == 0
    assert found["accepted"] == pytest.approx(1 / 3)
    assert found["wrong_and_certain"] == 2
    assert found["depth_error_trimmed_worst"] == pytest.approx(0.3)


def test_what_is_wrong_and_certain_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Clip, degradation, plane and instance, with error and σ; rows and planes are counted apart."""
    variant_tables.write(tmp_path, OUTCOMES, lambda name: name.split(": ")[0])
    found = values(tmp_path / "wrong_and_certain.json")
    assert found == {
        "a: roll: 2°: floor = floor_0": {"offset_error": 0.3, "offset_sigma": 0.01},
        "a: roll: 2°: wall = wall_0": {"offset_error": 0.5, "offset_sigma": 0.01},
        "a: as it is: floor = floor_0": {"offset_error": 0.3, "offset_sigma": 0.01},
    }
    assert list(values(tmp_path / "summary.json")) == ["roll", "as it is", "all"]
    with (tmp_path / "planes.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 5
    assert values(tmp_path / "rows.json")["c: roll: 2°"] == {"failed": 1, "iou": 0, "accepted": 0}
    variant_tables.show(tmp_path, OUTCOMES)
    printed = capsys.readouterr().out
    assert "2 of 4 rows end wrong and certain (3 planes), 1 failed" in printed
    assert "| a: roll: 2°: wall = wall_0 | 0.50" in printed


def test_nothing_wrong_leaves_no_old_names(tmp_path: Path) -> None:
    variant_tables.write(tmp_path, OUTCOMES, str)
    variant_tables.write(tmp_path, OUTCOMES[1:2], str)
    assert values(tmp_path / "wrong_and_certain.json") == {}
    assert (tmp_path / "failed.csv").read_text() == "scene,variant,reason\n"


def test_file_names_of_rows_are_plain_and_differ() -> None:
    names = ["as it is", "cameras × 0.1", "element left out: wall e1 (s/w) in a/b.jpg", "focal length + 5 %"]
    found = [variant_tables.file_name("clip", name) for name in (*names, "focal length − 5 %")]
    assert found[0] == "clip--as-it-is"
    assert len(set(found)) == 5
    assert all(Path(name).name == name and " " not in name for name in found)


def test_rows_without_values_have_none() -> None:
    assert np.isnan(OUTCOMES[2].value("planes"))
    assert OUTCOMES[2].label == "c: roll: 2°"
