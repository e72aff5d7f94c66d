"""Solve scenes and write all that comes of each: what gtlayout writes, and what it was made of, to the last bit.

    python solve_here.py OUT SCENE [SCENE ...]

``machines.py`` runs it as on different processors. ``OUT/<number>`` holds the results, ``stages.npz`` (arrays by stage;
whole numbers are decisions) and ``decisions.json`` (what else is decided).
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

import cv2
import numpy as np
import shapely

import gtlayout
from gtlayout.evaluation.instance_scores import centroid_world
from gtlayout.io.files import json_text, write_all_atomic
from gtlayout.solution import Solution

STAGES_FILE, DECISIONS_FILE = "stages.npz", "decisions.json"


def stages(solution: Solution) -> dict[str, np.ndarray]:
    """Arrays in the order in which they are made."""
    tracks, layout = solution.tracks, solution.layout
    regions = [region for extent in layout.extents for region in (extent.unrefined, extent.region)]
    frames = [extent.frame for extent in layout.extents for _ in range(2)]
    corners = [frame.to_world(shapely.get_coordinates(region)) for frame, region in zip(frames, regions, strict=True)]
    planes = [[*plane.normal, plane.d] for plane in layout.planes]
    centroids = [centroid_world(extent) for extent in layout.extents]
    sigmas = [float(plane.sigma_offset(at)) for plane, at in zip(layout.planes, centroids, strict=True)]
    return {
        "tracks": np.column_stack([tracks.key_frame, tracks.element]),
        "observations": np.column_stack([tracks.track, tracks.frame]),
        "points_px": tracks.points_px,
        "sigma_px": tracks.sigma_px,
        "track_instance": solution.track_instance,
        "edge_points_px": np.concatenate([np.empty((0, 2)), *(edge.points_px for edge in solution.edges)]),
        "observable": np.array([plane.observable for plane in layout.planes], dtype=np.int64),
        "planes": np.array(planes, dtype=np.float64).reshape(-1, 4),
        "centroids": np.array(centroids).reshape(-1, 3),
        "sigma_offsets": np.array(sigmas),
        "corner_counts": shapely.get_num_coordinates(regions),
        "corners": np.concatenate([np.empty((0, 3)), *corners]),
        "faces": layout.triangles.faces,
        "vertices": layout.triangles.vertices,
        "ious": np.array([element.iou for element in solution.quality.elements]),
    }


def decisions(solution: Solution) -> dict[str, object]:
    """What else is decided, in the order in which it is."""
    quality = solution.quality
    return {
        "instances": [[one.name, one.label, one.host, one.members] for one in solution.instances],
        "edges": [[edge.key_frame, edge.instances, len(edge.points_px)] for edge in solution.edges],
        "dominant_evidence": [
            [plane.support.tracks, plane.support.dominant_evidence, plane.note] for plane in solution.planes
        ],
        "dimensions": [[one.kind, one.first, one.second] for one in solution.layout.dimensions],
        "headline": [quality.headline.word, quality.accepted, quality.predicted],
        "verdicts": [[one.verdict, one.reason] for one in quality.instances],
        "warnings": solution.scene.warnings,
    }


if __name__ == "__main__":
    cv2.setNumThreads(1)
    for number, scene in enumerate(sys.argv[2:]):
        out = Path(sys.argv[1], str(number))
        solution = gtlayout.solve(gtlayout.load(scene))
        gtlayout.save(solution, out)
        arrays = io.BytesIO()
        np.savez(arrays, **stages(solution))  # type: ignore[arg-type]
        write_all_atomic({out / STAGES_FILE: arrays.getvalue(), out / DECISIONS_FILE: json_text(decisions(solution))})
