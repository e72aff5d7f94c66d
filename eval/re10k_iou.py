"""The RealEstate10K columns of the paper's Table 1: IoU with and without quality control, share accepted.

The published CAD-Estate layouts are scored beside ours: rendered into the same frames, against the same masks.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from common.command_line import Jobs, exit_status, new_app
from common.metrics import Metric
from common.runner import SceneRows
from common.table1 import OURS, annotated_scenes, measure_ours, score_scenes, summary_row, write_summary
from gtlayout.errors import GtlayoutError
from gtlayout.instances import Instance
from gtlayout.io.cad_estate.room_structure import FILE_NAME, RoomStructure, read_room_structure
from gtlayout.io.scene_folder import load_scene
from gtlayout.quality.config import QualityConfig
from gtlayout.quality.reprojection import element_ious, mean_by_frame
from gtlayout.scene import Scene

PUBLISHED = "published"

app = new_app("re10k_iou", __doc__)


@app.default
def run(root: Annotated[Path, Parameter(name="ROOT")], /, *, out: Path, jobs: Jobs = 1) -> None:
    """Solve every scene with default settings and compare the layouts with the annotations.

    Scenes may be clips of CAD-Estate (annotations/<clip>, with frames) or gtlayout's own folders. A run that was cut
    short goes on where it was. Written are scenes.* and summary.* (.md, .csv, .json).

    Parameters
    ----------
    root
        A scene folder, or a folder of scene folders: `annotations` of the release.
    out
        Where tables and the results of each scene go.
    jobs
        Scenes at a time.
    """
    scenes = annotated_scenes(root)
    with_layout = {name: path for name, path in scenes.items() if _is_published(path)}
    ours = score_scenes(scenes, out, OURS, measure_ours, jobs)
    theirs = score_scenes(with_layout, out, PUBLISHED, measure_published, jobs) if with_layout else {}
    methods = {OURS: summary_row(ours, len(scenes))}
    if with_layout and len(with_layout) < len(scenes):
        same = {name: row for name, row in ours.items() if name in with_layout}
        methods[f"{OURS}, scenes with a published layout"] = summary_row(same, len(with_layout))
    if with_layout:
        methods[PUBLISHED] = summary_row(theirs, len(with_layout))
    side_by_side = {
        name: [
            *row,
            *(Metric(f"{PUBLISHED}_{m.key}", m.value, m.unit, m.higher_is_better) for m in theirs.get(name, [])),
        ]
        for name, row in ours.items()
    }
    write_summary(out, side_by_side, methods)


def measure_published(folder: Path) -> SceneRows:
    """Score the layout that the release holds. Raises GtlayoutError when it or the scene cannot be read."""
    iou = published_iou(load_scene(folder), read_room_structure(folder / FILE_NAME))
    accepted = float(iou >= QualityConfig().accept_iou)
    return {PUBLISHED: [Metric("accepted", accepted, "", True), Metric("iou", iou, "", True)]}


def published_iou(scene: Scene, structure: RoomStructure) -> float:
    """IoU of a published layout with the masks it was made from, defined as for ours.

    Raises GtlayoutError when an annotated element is none of the layout's.
    """
    members: dict[int, list[tuple[int, int]]] = {number: [] for number in range(1, len(structure.labels))}
    for k, key_frame in enumerate(scene.key_frames):
        for e, element in enumerate(key_frame.elements):
            if not element.id.isdecimal() or int(element.id) not in members:
                raise GtlayoutError(f"{scene.root}: the annotations are not those of the published layout")
            members[int(element.id)].append((k, e))
    instances = [Instance(str(number), structure.labels[number] or "wall", tuple(of)) for number, of in members.items()]
    # Instances count from 0, -1 is nothing; the file's elements count from 1.
    elements = element_ious(scene, instances, lambda camera: structure.render(camera) - 1)
    return float(np.nanmean(mean_by_frame(scene, instances, elements)))


def _is_published(folder: Path) -> bool:
    """Whether there is a layout with triangles. A damaged file counts: that its scene cannot be read is said later."""
    if not (folder / FILE_NAME).exists():
        return False
    try:
        return len(read_room_structure(folder / FILE_NAME).triangles) > 0
    except GtlayoutError:
        return True


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
