"""Figures as text, and that no printer ever says ``nan``: a layout of which σ is unknown goes through every one."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import rooms
from rich.console import Console

from gtlayout.config import Config
from gtlayout.evaluation.evaluate import DepthError, Evaluation, evaluate
from gtlayout.evaluation.instance_scores import PlaneError
from gtlayout.export import export_layout
from gtlayout.export.facts import facts, scene_facts
from gtlayout.figures import figure, is_known, percent, short, sigma_figure, with_sigma
from gtlayout.instances import Dimension, Instance, Mesh, Plane, Quantity
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.quality.assess import Quality, assess
from gtlayout.report import page, report_data
from gtlayout.results.tables import (
    camera_line,
    dimensions,
    evaluation_table,
    headline_text,
    instance_table,
    markdown,
    measures,
    quantity_of,
    reasons,
)
from gtlayout.scene import Label, Scene
from gtlayout.tracking.bundle_adjustment import CameraReport

NOT_SAID = re.compile(r"\b(nan|inf|infinity)\b", re.IGNORECASE)


def test_what_an_area_is_of() -> None:
    labels: list[Label] = ["floor", "floor", "floor", "wall", "wall", "wall", "wall"]
    instances = tuple(Instance(f"{label}_{i}", label, ()) for i, label in enumerate(labels))
    layout = Layout(instances, (), (), Mesh.empty(), True)
    said = [quantity_of(layout, Quantity("floor area", of, 1.0, 0.1, True)) for of in ((0,), (0, 1), (0, 1, 2))]
    assert said == ["floor_0", "floor_0 – floor_1", "of all floors"]
    assert quantity_of(layout, Quantity("net wall area", (3, 4, 6), 1.0, 0.1, False)) == "of 3 of 4 walls"


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (figure(0.0444, 3, " m"), "0.044 m"),
        (figure(0.5, 1, signed=True), "+0.5"),
        (figure(None, 3, " m"), "–"),
        (figure(np.nan, 3, " m"), "–"),
        (figure(-np.inf, 3, " m"), "–"),
        (short(418.4), "418"),
        (short(1.5583e4), "15583"),
        (short(0.012345), "0.0123"),
        (short(np.nan), "–"),
        (short(np.inf), "–"),
        (percent(0.314), "31 %"),
        (percent(0.0337, 1), "3.4 %"),
        (percent(np.nan), "–"),
        (sigma_figure(0.5, 2.0, 3, " m"), "0.500 m"),
        (sigma_figure(2.0, 2.0, 3, " m"), "unknown"),
        (sigma_figure(2048.5, 2.0, 3, " u"), "unknown"),
        (sigma_figure(0.5, np.nan, 3, " m"), "unknown"),
        (sigma_figure(np.nan, 2.0, 3, " m"), "unknown"),
        (sigma_figure(None, 2.0, 3, " m"), "unknown"),
        (with_sigma(2.682, 0.159, 3, " m"), "2.682 ± 0.159 m"),
        (with_sigma(2.682, 2.7, 3, " m"), "2.682 m ± unknown"),
        (with_sigma(2.682, np.nan, 3, " m"), "2.682 m ± unknown"),
        (with_sigma(np.nan, 0.1, 3, " m"), "–"),
        (with_sigma(np.inf, 0.1, 3, " m"), "–"),
    ],
)
def test_figures(said: str, expected: str) -> None:
    assert said == expected


def test_sigma_says_something_below_what_it_is_of() -> None:
    assert is_known(1.9, 2.0)
    assert not any(is_known(*pair) for pair in ((2.0, 2.0), (np.nan, 2.0), (np.inf, np.inf), (0.1, None), (None, 1.0)))


@pytest.fixture
def unknown() -> tuple[Scene, Layout, Quality]:
    """The box room: nothing is known of the floor's σ, the ceiling is unobservable, the left wall may be anywhere, the
    right one is drawn where it is not seen; one frame shows no element that counts.
    """
    surfaces = rooms.BOX[:5]
    cameras = [rooms.level_camera([2.0, y, 1.25]) for y in (1.0, 0.5)]
    scene = rooms.redraw(rooms.seen_from(cameras, surfaces), 0, 3, rooms.pixels(10, 20, 30, 40))
    planes = [surface.plane for surface in surfaces]
    planes[0] = replace(planes[0], covariance=np.full((4, 4), np.nan))
    planes[1] = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False, note="no track places it")
    planes[2] = replace(planes[2], covariance=np.diag([0, 0, 0, 2048.0**2]))
    extents = [surface.extent for surface in surfaces]
    extents[1] = replace(extents[1], region=rooms.NOTHING, unrefined=rooms.NOTHING)
    instances = rooms.instances_of(surfaces, 2)
    quality = assess(scene, instances, planes, extents, Config().quality)
    ends = np.array([[2.0, 5.0, 1.25], [2.0, 0.0, 1.25]])
    measured = tuple(
        Dimension(2, 3, kind, length, sigma, ends)
        for kind in ("height", "width")
        for length, sigma in ((4.0, np.nan), (4.0, np.inf), (4.0, 2048.0), (np.nan, np.nan), (4.0, 0.1))
    )
    layout = Layout(instances, tuple(planes), tuple(extents), build_mesh(instances, extents), True, measured)
    return scene, layout, replace(quality, frames=(quality.frames[0], np.nan))


def _printed(*what: object) -> str:
    console = Console(width=100)
    with console.capture() as capture:
        for one in what:
            console.print(one)
    return capture.get()


def _assert_never_said(texts: Iterable[str]) -> None:
    for text in texts:
        assert not NOT_SAID.search(text), text


def test_tables_and_lines_say_what_is_not_known_in_words(unknown: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, quality = unknown
    table = _printed(instance_table(layout, quality))
    refined = CameraReport("", np.nan, np.inf, np.nan, np.nan)
    _assert_never_said(
        [
            table,
            *reasons(layout, quality),
            *dimensions(layout),
            measures(scene, layout, quality),
            headline_text(quality.headline).plain,
            markdown(layout, quality),
            camera_line(refined, metric=True),
            camera_line(refined, metric=False),
        ]
    )
    rows = {line.split()[0]: line for line in table.splitlines() if line.strip()}
    assert re.search(r"–\s+unknown\s", rows["floor_0"])
    assert re.search(r"0\.00°\s+unknown\s", rows["wall_2"]), "2 km are no σ"
    assert re.search(r"–\s+–\s+0\.000", rows["ceiling_1"])
    said = dimensions(layout)
    assert said[0] == "height wall_2 – wall_3: 4.000 ± 0.100 m", "the most certain first"
    assert sorted(said[1:5]) == ["height wall_2 – wall_3: 4.000 m ± unknown"] * 3 + ["height wall_2 – wall_3: –"]


def test_evaluation_table_says_what_is_not_known_in_words(unknown: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, _ = unknown
    nothing = replace(
        evaluate(scene, layout),
        openings_iou=np.nan,
        depth=DepthError(np.nan, np.nan, np.nan, np.nan, np.nan, 0, 0, (("wall_0", np.nan, 0),)),
        planes=(PlaneError("a", "wall_0", np.nan, np.nan, np.nan, np.inf),),
        precision=np.nan,
        recall=np.nan,
    )
    assert isinstance(nothing, Evaluation)
    text = _printed(evaluation_table(nothing))
    _assert_never_said([text])
    assert "– ± –, – ± – off" in text
    assert "–, –" in text


def test_report_says_what_is_not_known_in_words(unknown: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, quality = unknown
    data = report_data(scene, layout, quality, [None, None], timings_s={}, config={}, versions={})
    json.dumps(data, allow_nan=False)
    html = page(data, plotly_src="plotly.min.js")
    text = re.sub(r"<(script|style)\b.*?</\1>|<[^>]*>", " ", html, flags=re.DOTALL)
    _assert_never_said([text])
    assert "unknown" in text
    # What the 3D view is drawn from.
    assert data["room"]["instances"][0]["sigma"][0] is None


@pytest.mark.parametrize("to", ["svg", "dxf"])
def test_floor_plans_say_what_is_not_known_in_words(
    to: Literal["svg", "dxf"], unknown: tuple[Scene, Layout, Quality], tmp_path: Path
) -> None:
    scene, layout, _ = unknown
    export_layout(tmp_path / "plan", scene, layout, to)
    text = (tmp_path / "plan").read_text(encoding="utf-8")
    _assert_never_said([text])
    assert "4.000 m ± unknown" in text


def test_facts_of_exports_leave_out_what_is_not_known(unknown: tuple[Scene, Layout, Quality]) -> None:
    scene, layout, _ = unknown
    told = scene_facts(scene, layout)
    _assert_never_said(str(value) for value in told.values())
    assert "sigma_depth" not in facts(scene, layout, 0)
