"""Results as tables: for the terminal and, as Markdown, for the rerun viewer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import get_args

from rich.box import SIMPLE
from rich.table import Table
from rich.text import Text

from gtlayout.accuracy import Accuracy, Flatness
from gtlayout.evaluation.evaluate import Evaluation
from gtlayout.figures import NOTHING, figure, percent, short, sigma_figure, with_sigma
from gtlayout.instances import Dimension, DimensionKind, Quantity
from gtlayout.layout import Layout
from gtlayout.measurement import GROSS_M, NAMED, TAPE_SIGMA_M, Checked
from gtlayout.quality.assess import Quality
from gtlayout.quality.headline import Headline, element_name
from gtlayout.scene import Scene
from gtlayout.tracking.bundle_adjustment import CameraReport

_COLUMNS = ("instance", "area", "frames", "tracks", "σ normal", "σ depth", "LOA", "IoU", "verdict")
_LEAST_NEEDED_FIRST = ("frames", "tracks", "area", "LOA", "σ normal", "IoU")
"""Columns that a narrow terminal does without."""
_STYLES = {"ok": "green", "weak": "yellow", "unobservable": "red"}
_HEADLINE_STYLES = {"trust": "bold green", "check": "bold yellow", "redo": "bold red"}


def instance_table(layout: Layout, quality: Quality, width: int | None = None) -> Table:
    """One row per instance; in ``width`` columns, where it is given, by leaving out what is needed least."""
    rows = _rows(layout, quality)
    widths = {cells[0]: max(map(len, cells)) for cells in zip(_COLUMNS, *rows, strict=True)}
    shown = list(_COLUMNS)
    for column in _LEAST_NEEDED_FIRST:
        if width is not None and sum(widths[name] + 1 for name in shown) - 1 > width:
            shown.remove(column)
    table = Table(box=SIMPLE, padding=0, show_edge=False, width=sum(widths[name] + 1 for name in shown) - 1)
    for column in shown:
        table.add_column(column, no_wrap=True, justify="left" if column in ("instance", "verdict") else "right")
    for row, judged in zip(rows, quality.instances, strict=True):
        cells = [cell for name, cell in zip(_COLUMNS, row, strict=True) if name in shown]
        table.add_row(*cells, style=_STYLES[judged.verdict] if judged.verdict != "ok" else None)
    return table


def reasons(layout: Layout, quality: Quality) -> list[str]:
    """Why each instance that is not ok is not, and what makes it uncertain: one line per instance."""
    return [
        f"{instance.name} is {judged.verdict}: {judged.reason}"
        + (f" ({', '.join(judged.causes)})" if judged.causes else "")
        for instance, judged in zip(layout.instances, quality.instances, strict=True)
        if judged.reason
    ]


def dimensions(layout: Layout) -> list[str]:
    """Heights, widths, radii, areas and volumes of the room with σ, what doors and windows measure, which surfaces are
    not flat: one line each.

    Of each kind the most certain first; of walls only all together. Lengths in metres have their level of accuracy.
    """
    unit = " m" if layout.metric else " units"
    lines = [
        f"{one.kind} {dimension_of(layout, one)}: {with_sigma(one.length, one.sigma, 3, unit)}{_level(one.accuracy)}"
        for one in most_certain_first(layout.dimensions)
    ]
    for i, cylinder in layout.curved.items():
        radius = with_sigma(cylinder.radius, cylinder.sigma_radius, 3, unit)
        lines.append(f"radius of the curved wall {layout.instances[i].name}: {radius}")
    for amount in shown_quantities(layout):
        power = "³" if amount.kind == "volume" else "²"
        least = "" if amount.closed else " at least: not all of its outline was seen"
        lines.append(
            f"{amount.kind} {quantity_of(layout, amount)}: "
            f"{with_sigma(amount.amount, amount.sigma, 2, unit + power)}{least}"
        )
    return [*lines, *flatness_lines(layout)]


def flatness_lines(layout: Layout) -> list[str]:
    """The surfaces that are not flat, one line each."""
    flatness = layout.flatness or (None,) * len(layout.instances)
    return [
        f"flatness {instance.name}: {flatness_text(flat)}"
        for instance, flat in zip(layout.instances, flatness, strict=True)
        if flat is not None and flat.status == "out"
    ]


def flatness_text(flat: Flatness) -> str:
    """How far a surface bends, over which distance, and what is permitted; metres."""
    way = "bulges into the room" if flat.deviation > 0 else "bulges out of the room"
    return (
        f"{way} by {figure(1000 * abs(flat.deviation), 0)} ± {figure(1000 * flat.sigma, 0)} mm over "
        f"{figure(flat.distance, 1)} m ({flat.status}: DIN 18202, table 3, line {flat.line} permits "
        f"{figure(1000 * flat.limit_m, 0)} mm)"
    )


def shown_quantities(layout: Layout) -> list[Quantity]:
    """Areas and volumes, of walls only all together."""
    totals = {amount.kind: len(amount.instances) for amount in layout.quantities}
    return [
        amount
        for amount in layout.quantities
        if amount.kind != "net wall area" or len(amount.instances) == totals[amount.kind]
    ]


def quantity_of(layout: Layout, amount: Quantity) -> str:
    """What an area or a volume is of: ``floor_0``, or ``of all walls``, or of how many."""
    names = [layout.instances[i].name for i in amount.instances]
    if len(names) < 3:
        return " – ".join(names)
    label = layout.instances[amount.instances[0]].label
    there = sum(instance.label == label for instance in layout.instances)
    return f"of all {label}s" if len(names) == there else f"of {len(names)} of {there} {label}s"


def measurement_lines(layout: Layout) -> list[str]:
    """What was measured by hand, beside what everything else says, and what to measure next: one line each."""
    lines = []
    for one in layout.measurements:
        hand = one.measurement
        digits = 1 if hand.kind == "angle" else 3
        says = with_sigma(one.predicted, one.predicted_sigma, digits, f" {hand.unit}")
        of_others = f"everything else says {says}" if math.isfinite(one.predicted) else "gives the scene its unit"
        lines.append(f"measured {hand.name}: {figure(hand.value, digits, f' {hand.unit}')}, {of_others}{_verdict(one)}")
    if layout.scale is not None and layout.scale.gave_unit:
        sigma = percent(layout.scale.sigma_share, 1)
        lines.append(f"scale by what was measured: 1 unit of the cameras = {short(layout.scale.factor)} m ± {sigma}")
    return [*lines, *next_line(layout)]


def _verdict(one: Checked) -> str:
    """What everything else makes of a measurement, and what slip of its reading that could not show."""
    if not one.used:
        return ": NOT USED, it contradicts that; measure it again"
    if not math.isfinite(one.predicted):
        return ": nothing else checks it; measure a second length"
    slip = _slip(one.hidden_slip, one.measurement.unit)
    if one.held_back:
        digits, unit = (1, "°") if one.measurement.kind == "angle" else (3, " m")
        counted = figure(one.counted_sigma, digits, unit)
        return f": held back, it counts as ± {counted} and could hide a slip of up to {slip}; measure it a second time"
    return f"; it could hide a slip of up to {slip}"


def _slip(amount: float, unit: str) -> str:
    return figure(amount, 1, unit) if unit == "°" else figure(100 * amount, 1, " cm")


def next_line(layout: Layout) -> list[str]:
    """What to measure next, in a line; none where nothing would help."""
    one = layout.next_measurement
    if one is None:
        return []
    dimension = layout.dimensions[one.dimension]
    what = f"{dimension.kind} {dimension_of(layout, dimension)}"
    if not layout.metric:
        return [f"measure {what}: it would give the scene its unit"]
    wanted = next((each.accuracy.wanted for each in layout.dimensions if each.accuracy), 0)
    hidden_m = NAMED * math.hypot(dimension.sigma, TAPE_SIGMA_M)
    brings = f"it would bring {one.reached} of {one.of} dimensions to LOA{wanted} ({one.within} now)"
    if hidden_m <= GROSS_M:
        return [f"measure {what}: {brings}"]
    return [f"measure {what}, twice: {brings}; read once it could hide a slip of up to {_slip(hidden_m, ' m')}"]


def dimension_of(layout: Layout, one: Dimension) -> str:
    """What a dimension is of: ``floor_0 – ceiling_0``, or ``door_0``."""
    first, second = (layout.instances[i].name for i in (one.first, one.second))
    return first if one.first == one.second else f"{first} – {second}"


def _level(accuracy: Accuracy | None) -> str:
    """The level that a length reaches, in words; nothing where the scene has no unit."""
    if accuracy is None or not math.isfinite(accuracy.error_95_m):
        return ""
    return f" (LOA{accuracy.level}, {accuracy.status})" if accuracy.level else f" ({accuracy.status}: below LOA10)"


def most_certain_first(dimensions: Sequence[Dimension]) -> list[Dimension]:
    """Heights and widths of the room before those of doors and windows; those of unknown σ last."""
    order = get_args(DimensionKind)
    return sorted(
        dimensions, key=lambda one: (order.index(one.kind), one.sigma if math.isfinite(one.sigma) else math.inf)
    )


def camera_line(cameras: CameraReport, metric: bool) -> str:
    """One line: the result of refining the cameras."""
    if not cameras.refined:
        return f"cameras kept: refinement did not prove itself ({cameras.kept_because})"
    shift = figure(100 * cameras.shift, 1, " cm") if metric else f"{short(cameras.shift)} units"
    return (
        f"cameras refined: median {figure(cameras.rotation_deg, 2, '°')} / {shift} moved, "
        f"points left out {figure(cameras.given_px, 2)} → {figure(cameras.refined_px, 2)} px off"
    )


def headline_text(headline: Headline) -> Text:
    """``CHECK: the first reason``, and a line for each of the others, in the word's colour."""
    first, *others = headline.reasons
    lines = [f"{headline.word.upper()}: {first}", *(f"  and {reason}" for reason in others)]
    return Text("\n".join(lines), style=_HEADLINE_STYLES[headline.word])


def measures(scene: Scene, layout: Layout, quality: Quality) -> str:
    """One line with the measures behind the headline: IoU, σ of depth, and the worst frame and element."""
    worst = quality.elements[quality.worst_element]
    return (
        f"{_accepted(quality)}; {_prediction(quality)}. "
        f"Worst frame {scene.frame_of(quality.worst_frame).name} ({figure(quality.frames[quality.worst_frame], 3)}), "
        f"worst element {worst_element_name(scene, layout, quality)} ({figure(worst.iou, 3)})."
    )


def worst_element_name(scene: Scene, layout: Layout, quality: Quality) -> str:
    """The instance, the annotator's id of the element and its frame."""
    return element_name(scene, layout.instances, quality.elements[quality.worst_element])


def markdown(layout: Layout, quality: Quality) -> str:
    """Headline and table of instances as Markdown."""
    first, *others = quality.headline.reasons
    lines = [
        f"**{quality.headline.word}**: {first}",
        *(f"- {reason}" for reason in others),
        "",
        f"{_accepted(quality)}; {_prediction(quality)}",
        "",
        "|" + "|".join(_COLUMNS) + "|",
        "|" + "---|" * len(_COLUMNS),
    ]
    lines += ["|" + "|".join(row) + "|" for row in _rows(layout, quality)]
    lines += ["", *(f"- {line}" for line in (*reasons(layout, quality), *dimensions(layout)))]
    return "\n".join(lines)


def evaluation_table(evaluation: Evaluation) -> Table:
    """All figures of an evaluation, with their units."""
    unit = " m" if evaluation.metric else " units"
    table = Table(box=SIMPLE)
    table.add_column("measure")
    table.add_column("value", justify="right")
    table.add_row(
        "reprojection IoU", f"{figure(evaluation.iou, 4)} ({'accepted' if evaluation.accepted else 'not accepted'})"
    )
    table.add_row("predicted σ of depth", f"{percent(evaluation.sigma_depth_share, 1)} ({evaluation.predicted})")
    if evaluation.openings_iou is not None:
        table.add_row("IoU of doors and windows alone", figure(evaluation.openings_iou, 4))
    if evaluation.unobservable:
        table.add_row("unobservable", ", ".join(evaluation.unobservable))
    if (depth := evaluation.depth) is not None:
        table.add_row("depth error ε, mean", figure(depth.mean, 4, unit))
        table.add_row("… without the worst 1 % of pixels", figure(depth.trimmed_mean, 4, unit))
        table.add_row("… median", figure(depth.median, 4, unit))
        if depth.within_5cm is not None and depth.within_10cm is not None:
            within = f"{percent(depth.within_5cm, 1)}, {percent(depth.within_10cm, 1)}"
            table.add_row("pixels within 5 and 10 cm", within)
        table.add_row("… pixels (and without an instance)", f"{depth.pixels} ({depth.missing})")
        for name, mean, pixels in depth.by_instance:
            table.add_row(f"  {name}", f"{figure(mean, 4, unit)} on {pixels} px")
    for plane in evaluation.planes:
        table.add_row(
            f"{plane.truth} ({plane.instance})",
            f"{figure(plane.normal_deg, 2, '°')} ± {figure(plane.sigma_normal_deg, 2, '°')}, "
            f"{figure(plane.offset, 4)} ± {figure(plane.sigma_offset, 4, unit)} off",
        )
    for name in evaluation.missing_planes:
        table.add_row(name, "no observable instance")
    if evaluation.elements:
        table.add_row(
            "elements on the right instance", f"{evaluation.elements_on_right_instance} of {evaluation.elements}"
        )
    table.add_row(
        "precision and recall of instances", f"{figure(evaluation.precision, 3)}, {figure(evaluation.recall, 3)}"
    )
    if evaluation.wrong:
        table.add_row("… instances that are not right", ", ".join(evaluation.wrong))
    return table


def _accepted(quality: Quality) -> str:
    alone = "" if quality.openings_iou is None else f", of doors and windows alone {figure(quality.openings_iou, 3)}"
    return f"IoU {figure(quality.iou, 3)} ({'accepted' if quality.accepted else 'not accepted'}{alone})"


def _prediction(quality: Quality) -> str:
    return f"σ of depth {percent(quality.sigma_depth_share, 1)} (predicted {quality.predicted})"


def _rows(layout: Layout, quality: Quality) -> list[tuple[str, ...]]:
    unit = " m" if layout.metric else " u"
    rows: list[tuple[str, ...]] = []
    accuracies = layout.accuracies or (None,) * len(layout.instances)
    parts = zip(layout.instances, layout.planes, layout.extents, quality.instances, accuracies, strict=True)
    for instance, plane, extent, judged, accuracy in parts:
        rows.append(
            (
                instance.name,
                figure(extent.region.area, 2, f"{unit}²"),
                str(len(instance.members)),
                str(plane.support.tracks),
                figure(judged.sigma_normal_deg, 2, "°"),
                sigma_figure(judged.sigma_depth, judged.depth, 3, unit) if plane.observable else NOTHING,
                str(accuracy.level) if accuracy and accuracy.level else NOTHING,
                figure(judged.iou, 3),
                judged.verdict,
            )
        )
    return rows
