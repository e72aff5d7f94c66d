"""eval/proposals.py: a proposal against a drawing, in figures that can be said beforehand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rooms
from shapely import affinity
from solved_rooms import NARROW, SEEN, WIDE, solved

import proposals
from common.compared import compare
from common.metrics import read_rows
from gtlayout.geometry.polygons import polygons
from gtlayout.proposals.propose import propose
from gtlayout.scene import Scene

FAR = 4
FOCALS = (300.0, 280.0, 240.0, 200.0)


def zooming(folder: Path) -> Scene:
    """Four drawings of the box room from one place, each of a larger part, on grey images."""
    cameras = [rooms.level_camera((2.0, 0.6, 1.25), focal=focal, width=640, height=480) for focal in FOCALS]
    scene = rooms.seen_from(cameras, SEEN)
    cv2.imwrite(str(folder / "grey.png"), np.full((480, 640, 3), 128, np.uint8))
    return replace(scene, frames=tuple(replace(frame, image_path=folder / "grey.png") for frame in scene.frames))


def test_a_proposal_is_compared_with_the_drawing() -> None:
    exact = rooms.seen_from([NARROW, WIDE], SEEN)
    far = exact.key_frames[1].elements[FAR].amodal
    scene = rooms.redraw(exact, 1, FAR, polygons(affinity.translate(far, 8, 0)))
    whole = solved([], [], SEEN, scene=exact)
    proposal = propose(solved([NARROW], [WIDE]), 1)
    found = compare(proposal, scene, [0], 1, whole)
    assert found.drawings == 1
    assert found.false_elements == 0
    np.testing.assert_allclose(found.iou[:FAR], 1, atol=1e-3)
    width = far.bounds[2] - far.bounds[0]
    assert found.iou[FAR] == pytest.approx((width - 8) / (width + 8), abs=1e-3)
    # Eight lines between five surfaces, each from both sides; the far wall's own four are 8 px off at one end at least.
    assert len(found.edges) == 16
    off = sorted(edge.whole_px for edge in found.edges if edge.whole_px > 1)
    np.testing.assert_allclose(off, 8, atol=0.1)
    assert len(off) == 4
    assert sum(edge.line_px > 1 for edge in found.edges) == 2
    assert not any(edge.visible for edge in found.edges)
    assert (found.left == 0).sum() == 4
    assert len(found.left) == len(found.confidence) == 16
    # The narrow image shows two thirds of the wide one each way; of the far wall 8 px lie beside the drawn one.
    shown, height = 640 * 480 * 4 / 9, far.bounds[3] - far.bounds[1]
    assert found.visible_px2 == pytest.approx((shown - 8 * height, shown, 640 * 480), rel=1e-3)


def test_what_is_new_or_false_is_counted_so() -> None:
    scene = rooms.seen_from([NARROW, WIDE], SEEN)
    whole = solved([], [], SEEN, scene=scene)
    unseen = replace(whole.instances[FAR], members=((1, FAR),))
    layout = replace(whole.layout, instances=(*whole.instances[:FAR], unseen))
    proposal = propose(solved([NARROW], [WIDE], SEEN[:FAR]), 1)
    found = compare(proposal, scene, [0], 1, replace(whole, layout=layout))
    assert len(found.iou) == FAR
    assert sum(np.isinf(edge.whole_px) for edge in found.edges) == 4
    nobody = replace(scene, key_frames=(scene.key_frames[0], replace(scene.key_frames[1], elements=())))
    assert compare(proposal, nobody, [0], 1, whole).false_elements == FAR


def test_a_clip_is_replayed_and_written(tmp_path: Path) -> None:
    scene = zooming(tmp_path)
    assert list(proposals.drawing_order(scene, "video")) == [([0], 1), ([0, 1], 2), ([0, 1, 2], 3)]
    assert [drawn for drawn, _ in proposals.drawing_order(scene, "spread")][1] == [1, 3]
    rows = proposals.replay_rows(
        scene, "video", solved([], [], SEEN, scene=scene), lambda part: solved([], [], SEEN, scene=part)
    )
    figures = {metric.key: metric.value for metric in rows["video, snapped"]}
    assert figures["iou_after_two"] == pytest.approx(1, abs=1e-3)
    assert figures["edges_3px"] == 1
    # Each image shows more than those before it, and nothing else.
    shares = [(before / after) ** 2 for before, after in zip(sorted(FOCALS), sorted(FOCALS)[1:], strict=False)]
    assert figures["visible_iou"] == pytest.approx(np.mean(shares), abs=0.01)
    assert figures["visible_outside"] == pytest.approx(0, abs=0.01)
    assert figures["edges"] == 48
    # The first drawing is made by hand.
    assert figures["session_5px"] == pytest.approx(48 / 64)
    proposals.write(tmp_path / "out", {"a": rows, "b": rows})
    table = read_rows(tmp_path / "out" / "summary.json")
    assert list(table)[:3] == ["a: video, as predicted", "b: video, as predicted", "mean: video, as predicted"]
    pooled = [{m.key: m.value for m in row} for row in read_rows(tmp_path / "out" / "confidence.json").values()]
    assert sum(row["edges"] for row in pooled) == 2 * 48
    assert all(row["left_share"] == 1 for row in pooled if row["edges"])
