"""The main job on the real clips, from the command line: error ceilings on what it writes."""

from __future__ import annotations

import io
import json
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import SHARED_DATA
from jsonschema import validate

from gtlayout.api import load_solved
from gtlayout.cli.app import main
from gtlayout.evaluation.evaluate import evaluate
from gtlayout.evaluation.instance_scores import match_instances, plane_error
from gtlayout.geometry.depth import median_depth
from gtlayout.io.truth import read_truth
from gtlayout.results.layout_format import layout_schema

CEILINGS = {
    # clip: least IoU, largest ε without the worst 1 % of pixels (m), elements drawn
    "office": (0.95, 0.025, 41),
    "redkitchen": (0.93, 0.043, 45),
    "corridor": (0.97, 0.046, 60),
}


@pytest.fixture(scope="module", params=sorted(CEILINGS))
def real_clip(request: pytest.FixtureRequest) -> Path:
    """Each clip with depth in turn; other tests make do with two of them."""
    clip = SHARED_DATA / str(request.param)
    if not clip.is_dir():
        pytest.skip(f"real clip {clip.name} is not beside the checkout")
    return clip


@pytest.fixture(scope="module")
def solved(real_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Folder of results and the figures of their evaluation."""
    out = tmp_path_factory.mktemp(real_clip.name)
    assert main(["solve", str(real_clip), "--out", str(out)]) == 0
    with redirect_stdout(io.StringIO()) as printed:
        assert main(["evaluate", str(real_clip), "--layout", str(out), "--json"]) == 0
    return out, json.loads(printed.getvalue())


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
    sigma = {instance["name"]: instance["plane"]["sigma_depth"] for instance in layout["instances"]}
    assert len(found["planes"]) >= 4
    assert sum(plane["offset"] > 3 * sigma[plane["instance"]] for plane in found["planes"]) <= 1


def test_a_real_flat_without_a_unit(tmp_path: Path) -> None:
    """COLMAP's cameras in no unit, a lens, 1280x720 px, blank walls, frames like photographs: what most people have."""
    flat = SHARED_DATA / "flat"
    if not flat.is_dir():
        pytest.skip("real clip flat is not beside the checkout")
    assert main(["solve", str(flat), "--out", str(tmp_path)]) == 0
    scene, layout = load_solved(flat, tmp_path)
    found = evaluate(scene, layout)
    assert not found.metric
    assert found.iou > 0.89
    # Nothing but their drawing places the walls of the entry.
    assert len(found.unobservable) == 2
    quality = json.loads((tmp_path / "quality.json").read_text())
    assert quality["headline"]["word"] == "check"
    truth = read_truth(scene)
    assert truth is not None
    match = match_instances(layout, truth)
    depth = median_depth(scene, layout.instances, layout.planes)
    known = {name: true for name, true in truth.planes.items() if np.isfinite(true.d)}
    assert len(known) == 9
    for name, true in known.items():
        off = plane_error(layout, match[name], name, true)
        # The truth's own normals face all cameras together, the layout's those that drew the plane.
        assert min(off.normal_deg, 180 - off.normal_deg) < 2.5, name
        assert off.offset < 0.01 * depth, name
