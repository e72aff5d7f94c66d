"""The main job on the real clips, from the command line: error ceilings on what it writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import validate

from gtlayout.cli import main
from gtlayout.io.layout_format import layout_schema

CEILINGS = {
    # clip: least IoU, largest ε without the worst 1 % of pixels (m), elements drawn
    "office": (0.95, 0.025, 41),
    "redkitchen": (0.93, 0.041, 45),
}


@pytest.fixture(scope="module")
def solved(real_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Folder of results and the figures of their evaluation."""
    out = tmp_path_factory.mktemp(real_clip.name)
    assert main(["solve", str(real_clip), "--out", str(out)]) == 0
    figures = out / "evaluation.json"
    assert main(["evaluate", str(real_clip), "--layout", str(out), "--json", str(figures)]) == 0
    return out, json.loads(figures.read_text())


def test_errors_stay_below_their_ceilings(real_clip: Path, solved: tuple[Path, dict[str, Any]]) -> None:
    least_iou, largest_error_m, elements = CEILINGS[real_clip.name]
    _, found = solved
    assert found["metric"] is True
    assert found["iou"] > least_iou
    assert found["depth"]["trimmed_mean"] < largest_error_m
    assert found["depth"]["missing"] < 0.01 * found["depth"]["pixels"]
    assert (found["elements_on_right_instance"], found["elements"]) == (elements, elements)
    assert found["unobservable"] == []
    assert found["missing_planes"] == []


def test_layout_fits_its_schema(solved: tuple[Path, dict[str, Any]]) -> None:
    validate(json.loads((solved[0] / "layout.json").read_text()), layout_schema())


def test_no_wrong_plane_looks_certain(solved: tuple[Path, dict[str, Any]]) -> None:
    """No more than one true plane lies outside 3 σ of the depth; the truth itself is good to 2-3 cm."""
    out, found = solved
    layout = json.loads((out / "layout.json").read_text())
    sigma = {element["name"]: element["plane"]["sigma_depth"] for element in layout["elements"]}
    assert len(found["planes"]) >= 4
    assert sum(plane["offset"] > 3 * sigma[plane["instance"]] for plane in found["planes"]) <= 1
