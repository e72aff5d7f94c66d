"""From a scene folder and its results to the page: all reading and writing of the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json, write_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.quality.assess import assess
from gtlayout.quality.config import QualityConfig
from gtlayout.report.data import report_data
from gtlayout.report.frames import photo
from gtlayout.report.page import environment, page
from gtlayout.results.evidence import evidence_of
from gtlayout.results.evidence_file import read_evidence
from gtlayout.results.layout_files import package_versions
from gtlayout.results.layout_reader import read_solved
from gtlayout.results.names import TIMINGS_FILE
from gtlayout.results.review_file import read_review
from gtlayout.solution import Solution


@dataclass(frozen=True)
class Records:
    """What a solve wrote beside its layout; empty where a file is absent."""

    timings_s: dict[str, float] = field(default_factory=dict)
    """Seconds of each stage."""
    config: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    """What was skipped, repaired, joined or split."""


def write_report(
    scene_dir: Path,
    folder: Path,
    out: Path,
    progress: Callable[[int, int], None],
    *,
    cameras: Path | None = None,
    annotations: Path | None = None,
) -> None:
    """Write the page of the layout in ``folder`` to ``out``; ``cameras`` and ``annotations`` as for ``load_scene``.

    Raises:
        MissingExtraError: Jinja2 or plotly is not installed.
        GtlayoutError: the scene or its results cannot be read, or the disk does not take the page. A key frame's image
            that cannot be read only leaves its place in the page empty.
    """
    environment()  # What it needs is missed before the work, not after it.
    scene, layout = read_solved(load_scene(scene_dir, annotations, cameras=cameras), folder)
    records = read_records(folder)
    quality = assess(scene, layout.instances, layout.planes, layout.extents, QualityConfig())
    photos = []
    for number in range(len(scene.key_frames)):
        photos.append(photo(scene, number))
        progress(number + 1, len(scene.key_frames))
    data = report_data(
        scene,
        layout,
        quality,
        photos,
        timings_s=records.timings_s,
        config=records.config,
        versions=records.versions,
        warnings=records.warnings or scene.warnings,
        findings=read_review(folder, scene),
        evidence=read_evidence(folder, scene, layout),
    )
    write_atomic(out, page(data))


def solved_page(solution: Solution, plotly_src: str) -> str:
    """The page of what has just been solved, for folders of many: plotly.js is not in it, see ``page``.

    A key frame's image that cannot be read only leaves its place in the page empty.
    """
    scene = solution.scene
    data = report_data(
        scene,
        solution.layout,
        solution.quality,
        [photo(scene, number) for number in range(len(scene.key_frames))],
        timings_s=solution.timings_s,
        config=asdict(solution.config),
        versions=package_versions(),
        warnings=scene.warnings,
        evidence=evidence_of(solution),
    )
    return page(data, plotly_src)


def read_records(folder: Path) -> Records:
    """Read timings.json, config.json and quality.json. Raises GtlayoutError when one is there but damaged."""
    timings, config, quality = (_optional(folder / name) for name in (TIMINGS_FILE, "config.json", "quality.json"))
    try:
        return Records(
            {str(stage): float(seconds) for stage, seconds in timings.get("seconds", {}).items()},
            dict(config.get("config", {})),
            {str(package): str(version) for package, version in config.get("versions", {}).items()},
            tuple(str(warning) for warning in quality.get("warnings", ())),
        )
    except (AttributeError, TypeError, ValueError) as error:
        raise GtlayoutError(
            f"{folder}: {TIMINGS_FILE}, config.json or quality.json is damaged: {error}; solve the scene again"
        ) from error


def _optional(path: Path) -> dict[str, Any]:
    return read_json(path) if path.exists() else {}
