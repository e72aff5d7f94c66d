"""Plots: written whole, the same bytes for the same data, and no crash on data that has holes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib import rcParams

from common.plots import by_variant, per_scene, reliability, sigma_against_error
from gtlayout.errors import GtlayoutError
from gtlayout.scene import FloatArray

RNG = np.random.default_rng(0)
SCENES = [f"scene{i:04d}" for i in range(64)]
OURS = dict(zip(SCENES, RNG.lognormal(-4, 0.5, 64).tolist(), strict=True))
OTHER = {scene: 2 * value for scene, value in OURS.items()}
SIGMA = RNG.lognormal(-4, 0.5, 100)
ERROR = np.abs(RNG.normal(0, SIGMA))


def _is_picture(path: Path) -> bool:
    image = cv2.imread(str(path))
    return image is not None and image.shape[1] == 960 and float(image.std()) > 5


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "rows",
    [
        pytest.param({"ours": OURS, "other": OTHER}, id="two methods"),
        pytest.param({"ours": OURS, "a": OTHER, "b": OTHER, "c": OURS}, id="four"),
        pytest.param({f"method with a long name, number {k}": OURS for k in range(9)}, id="more than colours"),
        pytest.param({"ours": OURS}, id="one"),
        pytest.param({"ours": {"a": 0.5}, "other": {"a": 0.5}}, id="one scene"),
        pytest.param({"ours": {"a": 0.5}, "other": {"b": 0.1}}, id="no scene in common"),
        pytest.param({"ours": {"a": 0.0, "b": -1.0}, "other": {"a": np.nan, "b": 3.0}}, id="NaN, zero, negative"),
        pytest.param({"ours": {"a": np.nan}, "other": {"a": np.nan}}, id="NaN only"),
        pytest.param({"ours": {}, "other": {}}, id="no scene"),
        pytest.param({}, id="nothing"),
    ],
)
def test_per_scene_draws_whatever_there_is(tmp_path: Path, rows: dict[str, dict[str, float]]) -> None:
    path = tmp_path / "new folder" / "plot.png"
    per_scene(path, rows, "depth error ε, m", higher_is_better=False, log=len(rows) != 1)
    assert _is_picture(path)
    assert [file.name for file in path.parent.iterdir()] == ["plot.png"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("sigma", "error"),
    [
        pytest.param(SIGMA, ERROR, id="100 points"),
        pytest.param([0.1], [0.2], id="one"),
        pytest.param([0.1, 0.2, np.nan, np.inf, 0.0], [0.0, np.nan, 1.0, 1.0, 1.0], id="holes"),
        pytest.param([np.nan], [np.nan], id="NaN only"),
        pytest.param([], [], id="none"),
    ],
)
def test_sigma_against_error_draws_whatever_there_is(tmp_path: Path, sigma: list[float], error: list[float]) -> None:
    groups = ["floor", "wall"] * len(sigma)
    sigma_against_error(tmp_path / "s.png", np.array(sigma), np.array(error), groups[: len(sigma)], "offset", "m")
    assert _is_picture(tmp_path / "s.png")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "scenes",
    [
        pytest.param({"a": [("roll", 0.9), ("roll", 0.8), ("none", 1.0)], "b": [("none", 0.7)]}, id="two scenes"),
        pytest.param({f"scene {k}": [("roll", k / 12)] for k in range(12)}, id="more than colours"),
        pytest.param({"a": [("roll", np.nan)]}, id="NaN only"),
        pytest.param({}, id="nothing"),
    ],
)
def test_by_variant_draws_whatever_there_is(tmp_path: Path, scenes: dict[str, list[tuple[str, float]]]) -> None:
    by_variant(tmp_path / "v.png", {"IoU": scenes, "planes": scenes}, ["roll", "none"])
    image = cv2.imread(str(tmp_path / "v.png"))
    assert image is not None
    assert float(image.std()) > 5


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_data_same_bytes_and_no_date_in_them(tmp_path: Path, suffix: str) -> None:
    before = dict(rcParams)
    files = [tmp_path / f"{name}{suffix}" for name in ("a", "b")]
    for file in files:
        per_scene(file, {"ours": OURS, "other": OTHER}, "IoU", higher_is_better=True)
    first, second = (file.read_bytes() for file in files)
    assert first == second
    assert b"matplotlib.org" not in first
    assert b"<dc:date>" not in first
    assert dict(rcParams) == before, "settings of the process are as they were"


def test_legend_counts_scenes_medians_and_failures(tmp_path: Path) -> None:
    """Ours is better at a, worse at b, equal at c; the other fails at d and e, its median of .1 .2 .3 - - is .3."""
    ours = {"a": 0.05, "b": 0.25, "c": 0.3, "d": 0.1, "e": 0.1}
    other = {"a": 0.1, "b": 0.2, "c": 0.3, "d": np.nan}
    per_scene(tmp_path / "p.svg", {"ours": ours, "other": other}, "ε, m", higher_is_better=False, log=True)
    text = (tmp_path / "p.svg").read_text()
    for label in (
        "other: worse in 1 of 3",
        "ours: median 0.100",
        "other: median 0.300, 2 failed",
        "% of 5 scenes",
    ):
        assert label in text


def test_legend_says_what_share_lies_below_the_lines(tmp_path: Path) -> None:
    sigma, error = np.full(8, 0.01), np.array([0.0, 0.005, 0.01, 0.015, 0.016, 0.02, 0.03, np.nan])
    sigma_against_error(tmp_path / "s.svg", sigma, error, ["wall"] * 8, "offset", "m")
    text = (tmp_path / "s.svg").read_text()
    for label in ("error = σ: 43% below", "error = 2σ: 86% below", "wall (7)", "predicted σ of offset, m"):
        assert label in text


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "squared",
    [
        pytest.param({"orbit": RNG.chisquare(3, 100), "dolly": RNG.chisquare(3, 20)}, id="two groups"),
        pytest.param({"orbit": np.array([2.0, np.nan, 1e9])}, id="holes and a giant"),
        pytest.param({"orbit": np.empty(0)}, id="empty"),
        pytest.param({}, id="nothing"),
    ],
)
def test_reliability_draws_whatever_there_is(tmp_path: Path, squared: dict[str, FloatArray]) -> None:
    reliability(tmp_path / "r.png", squared, 3)
    assert _is_picture(tmp_path / "r.png")


def test_other_formats_are_refused(tmp_path: Path) -> None:
    with pytest.raises(GtlayoutError, match=r"plot\.jpg.*\.png or \.svg"):
        per_scene(tmp_path / "plot.jpg", {"ours": OURS}, "IoU", higher_is_better=True)
    assert not list(tmp_path.iterdir())
