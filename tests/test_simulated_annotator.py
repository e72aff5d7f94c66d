"""What it takes to correct proposals, counted on boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from rooms import NOTHING, level_camera, pixels
from shapely import MultiPolygon, Polygon

from gtlayout.scene import Element, FloatArray, KeyFrame, Label
from simulated.simulated_annotator import Effort, corrected, drawn_by_hand

CAMERA = level_camera([0, 0, 0], width=400, height=300)
LEFT, RIGHT = pixels(0, 0, 200, 300), pixels(200, 0, 400, 300)


def drawing(*outlines: tuple[MultiPolygon, Label], lines: Sequence[npt.ArrayLike] = ()) -> KeyFrame:
    elements = [Element(f"e{i}", label, outline, NOTHING) for i, (outline, label) in enumerate(outlines)]
    return KeyFrame(3, tuple(elements), tuple(np.array(line, dtype=np.float64) for line in lines))


def quad(*corners: tuple[float, float]) -> MultiPolygon:
    return MultiPolygon([Polygon(corners)])


def corners(region: MultiPolygon) -> set[tuple[float, float]]:
    found: FloatArray = shapely.get_coordinates(region)
    return {(x, y) for x, y in found.tolist()}


WANTED = drawing((LEFT, "wall"), (RIGHT, "wall"))


def test_drawing_by_hand_takes_a_click_for_each_vertex() -> None:
    line = [[200, 0], [200, 300]]
    found = drawn_by_hand(drawing((LEFT, "wall"), (RIGHT, "wall"), lines=[line]), CAMERA)
    # One edge of each box is not on the border of the image.
    assert found == Effort(edges=2, placed=8, other=2 + 1 + 1)
    assert found.clicks == 12


def test_what_is_within_reach_stays_as_it_is_proposed() -> None:
    proposed = drawing((pixels(0, 0, 204, 300), "wall"), (pixels(204, 0, 400, 300), "wall"))
    made, effort = corrected(proposed, WANTED, CAMERA, 5.0)
    assert effort == Effort(edges=2, untouched=2, other=1)
    assert [corners(element.amodal) for element in made.elements] == [
        corners(element.amodal) for element in proposed.elements
    ]
    assert made.frame == 3


def test_what_is_farther_becomes_what_is_wanted() -> None:
    proposed = drawing((pixels(0, 0, 204, 300), "wall"), (pixels(204, 0, 400, 300), "wall"))
    made, effort = corrected(proposed, WANTED, CAMERA, 3.0)
    assert effort == Effort(edges=2, untouched=0, moved=4, other=1)
    assert [corners(element.amodal) for element in made.elements] == [corners(LEFT), corners(RIGHT)]


def test_one_wrong_corner_is_moved_and_the_others_stay() -> None:
    proposed = drawing((quad((0, 0), (204, 0), (230, 300), (0, 300)), "wall"), (RIGHT, "wall"))
    made, effort = corrected(proposed, WANTED, CAMERA, 5.0)
    assert effort == Effort(edges=2, untouched=1, moved=1, other=1)
    assert corners(made.elements[0].amodal) == {(0, 0), (204, 0), (200, 300), (0, 300)}


def test_missing_corners_are_placed_and_surplus_ones_removed() -> None:
    notched = quad((0, 0), (200, 0), (200, 100), (150, 150), (200, 200), (200, 300), (0, 300))
    _, effort = corrected(WANTED, drawing((notched, "wall"), (RIGHT, "wall")), CAMERA, 5.0)
    assert (effort.moved, effort.placed, effort.removed) == (0, 3, 0)
    made, effort = corrected(drawing((notched, "wall"), (RIGHT, "wall")), WANTED, CAMERA, 5.0)
    # The two corners on the line that is wanted do no harm.
    assert (effort.moved, effort.placed, effort.removed) == (0, 0, 1)
    assert made.elements[0].amodal.equals(LEFT)


def test_a_corner_on_a_straight_line_need_not_be_placed() -> None:
    with_middle = quad((0, 0), (200, 0), (201, 150), (200, 300), (0, 300))
    made, effort = corrected(WANTED, drawing((with_middle, "wall"), (RIGHT, "wall")), CAMERA, 5.0)
    assert effort == Effort(edges=3, untouched=3, other=1)
    assert made.elements[0].amodal.equals(LEFT)


def test_elements_that_are_missing_or_wrong_or_mislabelled() -> None:
    floor = pixels(0, 290, 400, 300)
    made, effort = corrected(drawing((LEFT, "floor"), (floor, "floor")), WANTED, CAMERA, 5.0)
    # One click for the label, one that begins the element on the right, one that confirms.
    assert effort == Effort(edges=2, untouched=1, placed=4, removed=1, other=3)
    assert [(one.id, one.label) for one in made.elements] == [("e0", "wall"), ("e1", "wall")]


def test_occlusion_edges_are_marked_and_unmarked() -> None:
    middle, elsewhere = [[200, 0], [200, 300]], [[100, 0], [100, 300]]
    wanted = drawing((LEFT, "wall"), (RIGHT, "wall"), lines=[middle])
    for lines, clicks in (([], 1), ([middle], 0), ([[[203, 0], [203, 300]]], 0), ([elsewhere], 2)):
        made, effort = corrected(drawing((LEFT, "wall"), (RIGHT, "wall"), lines=lines), wanted, CAMERA, 5.0)
        assert effort.other == 1 + clicks
        assert len(made.occlusion_edges) == 1


def test_an_outline_that_would_collapse_is_drawn_as_wanted() -> None:
    wanted = quad((0, 0), (40, 0), (20, 5))
    proposed = quad((0, 0), (20, 0), (40, 0), (40, 5), (0, 5))
    made, _ = corrected(drawing((proposed, "wall")), drawing((wanted, "wall")), CAMERA, 6.0)
    assert made.elements[0].amodal.equals(wanted)
