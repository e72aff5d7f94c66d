"""A plot for each table: values per scene, ours against others, predicted σ against true error, courses of a run.

Figures are made without pyplot and without a display; the same data gives the same bytes.
"""

from __future__ import annotations

import io
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from scipy.stats import chi2

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import write_atomic
from gtlayout.scene import FloatArray

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's: colour-blind eyes tell them apart."""
MARKERS = "os^DvPX"
DASHES = ("solid", "dashed", "dashdot", "dotted")
WIDTH_IN = 4.8
"""Panels of this width, one above the other, can be read on a phone and in a column of a paper."""
STYLE: dict[str, Any] = {
    "font.size": 11,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e0e0e0",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "legend.borderaxespad": 0.2,
    "savefig.dpi": 200,
    "svg.hashsalt": "gtlayout",  # else SVG's ids are random
}
METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}
"""By suffix: neither dates nor versions."""


def per_scene(
    path: Path,
    rows_by_method: Mapping[str, Mapping[str, float]],
    ylabel: str,
    higher_is_better: bool,
    log: bool = False,
) -> None:
    """Compare methods over scenes: the first one's values against the others', and each one's distribution.

    Args:
        path: where the picture goes, .png or .svg.
        rows_by_method: method → scene → value. A scene that a method has no value for (absent or NaN) is one it failed
            at: the upper panel leaves it out, in the lower one the method's curve does not reach 100 %, and it counts
            as the worst in the median.
        ylabel: what is measured, with its unit.
        higher_is_better: its direction.
        log: logarithmic axes; what is not positive is drawn at the smallest positive value.

    Raises:
        GtlayoutError: another suffix, or the folder or disk does not take the file.
    """
    scenes = list(dict.fromkeys(scene for rows in rows_by_method.values() for scene in rows))
    table = {
        method: np.array([rows.get(scene, np.nan) for scene in scenes], dtype=np.float64)
        for method, rows in rows_by_method.items()
    }
    limits = _limits(np.concatenate([np.empty(0), *table.values()]), log)
    with matplotlib.style.context(["default", STYLE]):
        heights = [5.4, 4.4] if len(table) > 1 else [4.4]
        figure = Figure(figsize=(WIDTH_IN, sum(heights)), layout="constrained")
        *above, below = figure.subfigures(len(heights), height_ratios=heights, squeeze=False)[:, 0]
        for part in above:
            _draw_pairs(part, table, limits, ylabel, higher_is_better, log)
        _draw_shares(below, table, limits, ylabel, higher_is_better, log)
        _save(figure, path)


def sigma_against_error(
    path: Path, sigma: FloatArray, error: FloatArray, groups: Sequence[str], quantity: str, unit: str
) -> None:
    """Scatter of true error against predicted σ, with the lines error = σ and error = 2σ and the shares below them.

    Of calibrated errors along one axis 68 % lie below σ and 95 % below 2σ.

    Args:
        path: where the picture goes, .png or .svg.
        sigma: (N,) predicted, in ``unit``. What is not finite or not positive is left out, with its error.
        error: (N,) absolute errors, in ``unit``. NaN is left out; what is below a thousandth of the smallest
            σ is drawn at the lower border.
        groups: (N,) what each point is (floor, wall …): its colour and marker.
        quantity: what is predicted, such as ``offset``.
        unit: ``m``, ``°`` …

    Raises:
        GtlayoutError: another suffix, or the folder or disk does not take the file.
    """
    usable = np.isfinite(sigma) & (sigma > 0) & np.isfinite(error)
    x, y = sigma[usable], error[usable]
    names = np.array(groups, dtype=object)[usable]
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(WIDTH_IN, 5.2), layout="constrained")
        panel = figure.subplots()
        low, high = ends = _limits(x, log=True)
        bottom = max(low / 1000, float(y[y > 0].min(initial=low)) / 1.3)
        top = max(3 * high, 1.3 * float(y.max(initial=0.0)))
        for factor, name, dash in ((1, "σ", "solid"), (2, "2σ", "dashed")):
            share = f"{np.mean(y <= factor * x):.0%}" if len(x) else "–"
            line = factor * np.array(ends)
            panel.plot(ends, line, color="#333333", linestyle=dash, label=f"error = {name}: {share} below")
        # The rare ones on top.
        for k, (name, count) in enumerate(Counter(names.tolist()).most_common()):
            own = names == name
            panel.scatter(x[own], np.maximum(y[own], bottom), label=f"{name} ({count})", **_points(k, len(x)))
        panel.set_xlabel(f"predicted σ of {quantity}, {unit}")
        panel.set_ylabel(f"error of {quantity}, {unit}")
        _scale(panel, "x", ends, log=True)
        _scale(panel, "y", (bottom, top), log=True)
        _legend(figure, panel, columns=2)
        _save(figure, path)


def reliability(path: Path, squared: Mapping[str, FloatArray], dof: int) -> None:
    """Share of true values that lie in ellipsoids which should hold so many: calibrated ones follow the diagonal.

    Args:
        path: where the picture goes, .png or .svg.
        squared: group → (N,) squared errors in units of their own covariance (NEES). NaN is left out.
        dof: degrees of freedom of an error.

    Raises:
        GtlayoutError: another suffix, or the folder or disk does not take the file.
    """
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(WIDTH_IN, 5.2), layout="constrained")
        panel = figure.subplots()
        panel.plot([0, 100], [0, 100], color="#333333", linewidth=0.8, label="calibrated")
        for k, (name, values) in enumerate(squared.items()):
            nominal = 100 * np.sort(chi2.cdf(values[np.isfinite(values)], dof))
            count = len(nominal)
            panel.step(
                [0, *nominal, 100],
                [*(100 * np.arange(count + 1) / max(1, count)), 100 * min(1, count)],
                where="post",
                color=COLORS[k % len(COLORS)],
                linestyle=DASHES[k % len(DASHES)],
                linewidth=1.8,
                label=f"{name} ({count})",
            )
        panel.set_xlabel("should lie in the ellipsoid, %")
        panel.set_ylabel("lie in it, %")
        panel.set_box_aspect(1)
        _scale(panel, "xy", (0.0, 100.0), log=False)
        _legend(figure, panel, columns=2)
        _save(figure, path)


def courses(path: Path, x: FloatArray, series: Mapping[str, FloatArray], xlabel: str, ylabel: str) -> None:
    """Several quantities over one: a line each, from 0 up.

    Args:
        path: where the picture goes, .png or .svg.
        x: (N,) ascending.
        series: name → (N,) values in one unit.
        xlabel: what ``x`` is, with its unit.
        ylabel: what the values are, with their unit.

    Raises:
        GtlayoutError: another suffix, or the folder or disk does not take the file.
    """
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(WIDTH_IN, 4.4), layout="constrained")
        panel = figure.subplots()
        for k, (name, values) in enumerate(series.items()):
            panel.plot(x, values, label=name, color=COLORS[k % len(COLORS)], linestyle=DASHES[k % len(DASHES)])
        panel.set_xlabel(xlabel)
        panel.set_ylabel(ylabel)
        panel.set_ylim(bottom=0)
        _legend(figure, panel, columns=2)
        _save(figure, path)


def by_variant(
    path: Path, panels: Mapping[str, Mapping[str, Sequence[tuple[str, float]]]], variants: Sequence[str]
) -> None:
    """A line per variant, a mark per scene on it; a panel per quantity, one beside the other, each from 0 to 1 or more.

    Args:
        path: where the picture goes, .png or .svg.
        panels: what is measured, shares or counts → scene → (variant, value) pairs; NaN is left out.
        variants: from top to bottom.

    Raises:
        GtlayoutError: another suffix, or the folder or disk does not take the file.
    """
    row = {variant: i for i, variant in enumerate(variants)}
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(WIDTH_IN * (0.5 + 0.5 * len(panels)), 1.6 + 0.3 * len(row)), layout="constrained")
        drawn = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for panel, (title, scenes) in zip(drawn, panels.items(), strict=True):
            for k, (scene, values) in enumerate(scenes.items()):
                # Marks of scenes that agree stand one above the other.
                shift = 0.5 * (k + 0.5) / len(scenes) - 0.25
                y = np.array([row[variant] + shift for variant, _ in values])
                panel.scatter([value for _, value in values], y, label=scene, **_points(k, 0))
            known = [value for values in scenes.values() for _, value in values if np.isfinite(value)]
            top = max([1.0, *known])
            _scale(panel, "x", (-0.04 * top, 1.04 * top), log=False)
            panel.set_xlabel(title)
        drawn[0].set_yticks(range(len(row)), list(row))
        drawn[0].set_ylim(len(row) - 0.5, -0.5)
        _legend(figure, drawn[0], columns=2)
        _save(figure, path)


def _draw_pairs(
    figure: SubFigure,
    table: Mapping[str, FloatArray],
    limits: tuple[float, float],
    label: str,
    higher_is_better: bool,
    log: bool,
) -> None:
    """A point per scene and other method: the other's value to the right, the first method's up."""
    panel = figure.subplots()
    (ours, first), *others = table.items()
    side = "above" if higher_is_better else "below"
    panel.plot(limits, limits, color="#333333", linewidth=1, label=f"equal; {side} the line {ours} is better")
    for k, (method, values) in enumerate(others, start=1):
        both = np.isfinite(values) & np.isfinite(first)
        x, y = (np.maximum(of[both], limits[0]) for of in (values, first))
        worse = np.count_nonzero(values[both] < first[both] if higher_is_better else values[both] > first[both])
        panel.scatter(x, y, label=f"{method}: worse in {worse} of {len(x)}", **_points(k, len(first)))
    panel.set_xlabel(f"{label}\n{others[0][0] if len(others) == 1 else 'others'}")
    panel.set_ylabel(f"{ours}\n{label}")
    panel.set_box_aspect(1)
    _scale(panel, "xy", limits, log)
    _legend(figure, panel, columns=1)


def _draw_shares(
    figure: SubFigure,
    table: Mapping[str, FloatArray],
    limits: tuple[float, float],
    label: str,
    higher_is_better: bool,
    log: bool,
) -> None:
    """Per method the share of scenes that are at least as good as the value to the right."""
    panel = figure.subplots()
    for k, (method, values) in enumerate(table.items()):
        ordered = np.sort(values[np.isfinite(values)])
        counts = np.arange(len(ordered) + 1)
        shares = 100 * (counts[::-1] if higher_is_better else counts) / max(1, len(values))
        failed = len(values) - len(ordered)
        panel.step(
            [limits[0], *np.maximum(ordered, limits[0]), limits[1]],
            [*shares, shares[-1]],
            where="post",
            color=COLORS[k % len(COLORS)],
            linestyle=DASHES[k % len(DASHES)],
            linewidth=1.8,
            label=f"{method}: median {_median(values, higher_is_better)}" + (f", {failed} failed" if failed else ""),
        )
    panel.set_ylim(0, 102)
    panel.set_xlabel(label)
    panel.set_ylabel(f"at least as good, % of {len(next(iter(table.values()), []))} scenes")
    _scale(panel, "x", limits, log)
    _legend(figure, panel, columns=1)


def _median(values: FloatArray, higher_is_better: bool) -> str:
    """Three digits; a dash when half of the scenes or more have no value."""
    if len(values) == 0:
        return "–"
    median = np.median(np.where(np.isfinite(values), values, -np.inf if higher_is_better else np.inf))
    return f"{median:#.3g}".rstrip(".") if np.isfinite(median) else "–"


def _points(k: int, count: int) -> dict[str, Any]:
    """How the k-th of several kinds of points looks, smaller when there are many."""
    size = 28 if count < 300 else 14
    look = {"color": COLORS[k % len(COLORS)], "marker": MARKERS[(k + k // len(COLORS)) % len(MARKERS)]}
    return {**look, "s": size, "alpha": 0.75, "linewidths": 0, "clip_on": False}


def _limits(values: FloatArray, log: bool) -> tuple[float, float]:
    """Ends of an axis with all values in it, or all positive ones when it is logarithmic: then at least a decade."""
    used = values[np.isfinite(values) & ((values > 0) | (not log))]
    if len(used) == 0:
        return 0.1, 1.0
    low, high = float(used.min()), float(used.max())
    if log:
        margin = max(1.2, np.sqrt(10 * low / high))
        return low / margin, high * margin
    margin = 0.04 * (high - low) or 0.04 * abs(high) or 0.04
    return low - margin, high + margin


def _scale(panel: Axes, axes: str, limits: tuple[float, float], log: bool) -> None:
    """Set limits and scale of the axes named; the more decades, the fewer labels in each."""
    for name in axes:
        axis = panel.xaxis if name == "x" else panel.yaxis
        if log:
            panel.set(**{f"{name}scale": "log"})
            decades = np.log10(limits[1] / limits[0])
            axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 1.5 else (1, 3) if decades < 3 else (1,)))
            axis.set_minor_locator(NullLocator())
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        else:
            axis.set_major_locator(MaxNLocator(5))
        panel.set(**{f"{name}lim": limits})


def _legend(figure: FigureBase, panel: Axes, columns: int) -> None:
    """Above the panel, where it hides nothing, over the figure's whole width."""
    handles, _ = panel.get_legend_handles_labels()
    legend = figure.legend(handles=handles, loc="outside upper left", ncols=columns, columnspacing=1.2)
    for text in legend.get_texts():
        text.set_text(textwrap.fill(text.get_text(), 56 // columns))


def _save(figure: Figure, path: Path) -> None:
    kind = path.suffix[1:].lower()
    if kind not in METADATA:
        raise GtlayoutError(f"cannot write {path}: plots are .png or .svg")
    content = io.BytesIO()
    figure.savefig(content, format=kind, metadata=METADATA[kind])
    write_atomic(path, content.getvalue())
