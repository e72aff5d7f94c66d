"""Results as tables: for the terminal and, as Markdown, for the rerun viewer."""

from __future__ import annotations

from rich.box import SIMPLE
from rich.table import Table

from gtlayout.camera_refinement import CameraReport
from gtlayout.evaluation import Evaluation
from gtlayout.layout import Layout
from gtlayout.quality import Quality
from gtlayout.scene import Scene

_COLUMNS = ("instance", "label", "area", "frames", "tracks", "σ normal", "σ depth", "IoU", "verdict")
_STYLES = {"ok": "green", "weak": "yellow", "unobservable": "red"}


def element_table(layout: Layout, quality: Quality) -> Table:
    """One row per instance; fits 80 columns."""
    table = Table(box=SIMPLE, padding=0, show_edge=False)
    for column in _COLUMNS:
        table.add_column(
            column, no_wrap=True, justify="left" if column in ("instance", "label", "verdict") else "right"
        )
    for row, judged in zip(_rows(layout, quality), quality.instances, strict=True):
        table.add_row(*row, style=_STYLES[judged.verdict] if judged.verdict != "ok" else None)
    return table


def reasons(layout: Layout, quality: Quality) -> list[str]:
    """Why each element that is not ok is not, and what makes it uncertain: one line an element."""
    return [
        f"{instance.name} is {judged.verdict}: {judged.reason}"
        + (f" ({', '.join(judged.causes)})" if judged.causes else "")
        for instance, judged in zip(layout.instances, quality.instances, strict=True)
        if judged.reason
    ]


def dimensions(layout: Layout) -> list[str]:
    """Heights and widths of the room with their σ: one line each, the most certain first."""
    unit = "m" if layout.metric else "units"
    names = [instance.name for instance in layout.instances]
    return [
        f"{one.kind} {names[one.first]} – {names[one.second]}: {one.length:.3f} ± {one.sigma:.3f} {unit}"
        for one in sorted(layout.dimensions, key=lambda one: (one.kind, one.sigma))
    ]


def camera_line(cameras: CameraReport, metric: bool) -> str:
    """One line: what refining the cameras came to."""
    if not cameras.refined:
        return f"cameras kept: refinement did not prove itself ({cameras.kept_because})"
    shift = f"{100 * cameras.shift:.1f} cm" if metric else f"{cameras.shift:.3g} units"
    return (
        f"cameras refined: median {cameras.rotation_deg:.2f}° / {shift} moved, "
        f"points left out {cameras.given_px:.2f} → {cameras.refined_px:.2f} px off"
    )


def verdict(scene: Scene, layout: Layout, quality: Quality) -> str:
    """One line: accepted or not by its IoU, what the marginals predict, and what to redraw first."""
    worst = quality.elements[quality.worst_element]
    openings = "" if quality.openings_iou is None else f" (doors and windows alone {quality.openings_iou:.3f})"
    return (
        f"{'Accepted' if quality.accepted else 'NOT accepted'}: IoU {quality.iou:.3f}{openings}. "
        f"{_prediction(quality).capitalize()}. "
        f"Worst frame {scene.frame_of(quality.worst_frame).name} ({quality.frames[quality.worst_frame]:.3f}), "
        f"worst element {worst_drawing(scene, layout, quality)} ({worst.iou:.3f})."
    )


def worst_drawing(scene: Scene, layout: Layout, quality: Quality) -> str:
    """What to redraw first: the instance, and the annotator's id of its drawing with the frame."""
    worst = quality.elements[quality.worst_element]
    element = scene.key_frames[worst.key_frame].elements[worst.element].id
    return f"{layout.instances[worst.instance].name} = {element} in {scene.frame_of(worst.key_frame).name}"


def markdown(layout: Layout, quality: Quality) -> str:
    """The table of elements as Markdown."""
    lines = [
        f"**{'Accepted' if quality.accepted else 'Not accepted'}**, IoU {quality.iou:.3f}; {_prediction(quality)}",
        "",
        "|" + "|".join(_COLUMNS) + "|",
        "|" + "---|" * len(_COLUMNS),
    ]
    lines += ["|" + "|".join(row) + "|" for row in _rows(layout, quality)]
    lines += ["", *(f"- {line}" for line in (*reasons(layout, quality), *dimensions(layout)))]
    return "\n".join(lines)


def evaluation_table(evaluation: Evaluation) -> Table:
    """All figures of an evaluation, with their units."""
    unit = "m" if evaluation.metric else "units"
    table = Table(box=SIMPLE)
    table.add_column("measure")
    table.add_column("value", justify="right")
    table.add_row("reprojection IoU", f"{evaluation.iou:.4f} ({'accepted' if evaluation.accepted else 'not accepted'})")
    table.add_row("predicted σ of depth", f"{100 * evaluation.sigma_depth_share:.1f} % ({evaluation.predicted})")
    if evaluation.openings_iou is not None:
        table.add_row("IoU of doors and windows alone", f"{evaluation.openings_iou:.4f}")
    if evaluation.unobservable:
        table.add_row("unobservable", ", ".join(evaluation.unobservable))
    if (depth := evaluation.depth) is not None:
        table.add_row("depth error ε, mean", f"{depth.mean:.4f} {unit}")
        table.add_row("… without the worst 1 % of pixels", f"{depth.trimmed_mean:.4f} {unit}")
        table.add_row("… median", f"{depth.median:.4f} {unit}")
        if depth.within_5cm is not None and depth.within_10cm is not None:
            within = f"{100 * depth.within_5cm:.1f} %, {100 * depth.within_10cm:.1f} %"
            table.add_row("pixels within 5 and 10 cm", within)
        table.add_row("… pixels (and without a surface)", f"{depth.pixels} ({depth.missing})")
        for name, mean, pixels in depth.by_instance:
            table.add_row(f"  {name}", f"{mean:.4f} {unit} on {pixels} px")
    for plane in evaluation.planes:
        table.add_row(
            f"{plane.truth} ({plane.instance})",
            f"{plane.normal_deg:.2f}° ± {plane.sigma_normal_deg:.2f}°, "
            f"{plane.offset:.4f} ± {plane.sigma_offset:.4f} {unit} off",
        )
    for name in evaluation.missing_planes:
        table.add_row(name, "no observable instance")
    if evaluation.elements:
        table.add_row(
            "elements on the right instance", f"{evaluation.elements_on_right_instance} of {evaluation.elements}"
        )
    table.add_row("precision and recall of elements", f"{evaluation.precision:.3f}, {evaluation.recall:.3f}")
    if evaluation.wrong:
        table.add_row("… instances that are not right", ", ".join(evaluation.wrong))
    return table


def _prediction(quality: Quality) -> str:
    return f"predicted {quality.predicted}: σ of depth {100 * quality.sigma_depth_share:.1f} %"


def _rows(layout: Layout, quality: Quality) -> list[tuple[str, ...]]:
    unit = "m" if layout.metric else "u"
    rows: list[tuple[str, ...]] = []
    parts = zip(layout.instances, layout.planes, layout.extents, quality.instances, strict=True)
    for instance, plane, extent, judged in parts:
        rows.append(
            (
                instance.name,
                instance.label,
                f"{extent.region.area:.2f} {unit}²",
                str(len(instance.members)),
                str(plane.support.tracks),
                f"{judged.sigma_normal_deg:.2f}°" if plane.observable else "–",
                f"{judged.sigma_depth:.3f} {unit}" if plane.observable else "–",
                f"{judged.iou:.3f}",
                judged.verdict,
            )
        )
    return rows
