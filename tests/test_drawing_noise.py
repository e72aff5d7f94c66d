"""How well lines are drawn in a scene: closed forms with a window that two cameras see."""

from __future__ import annotations

import numpy as np
import pytest
import rooms
import shapely
from shapely.affinity import translate
from test_solved_room import CAMERA, WINDOW

from gtlayout.dimensions.drawing_noise import USUAL_SIGMA_PX
from gtlayout.dimensions.solved_room import SolvedRoom

NEARER = CAMERA.placed(CAMERA.R_cam_from_world, np.array([2.1, 1.5, 1.25]))


def window_drawn(off_px: float, cameras: int = 2) -> SolvedRoom:
    """A window alone; its drawings lie to the right of it and below it by so many pixels."""
    scene = rooms.seen_from([CAMERA, NEARER][:cameras], [WINDOW])
    for k in range(cameras):
        exact = scene.key_frames[k].elements[0].amodal
        drawn = shapely.MultiPolygon([translate(one, off_px, off_px) for one in exact.geoms])
        scene = rooms.redraw(scene, k, 0, drawn)
    return SolvedRoom(scene, rooms.instances_of([WINDOW], cameras), [WINDOW.plane], [WINDOW.extent])


def test_drawings_that_agree_are_believed_more_than_usual() -> None:
    """Two exact ones, against the four that the usual σ is worth."""
    assert window_drawn(0.0).drawn_sigma_px == pytest.approx(USUAL_SIGMA_PX * np.sqrt(4 / 6), rel=1e-3)


def test_drawings_that_differ_are_believed_less() -> None:
    """Off by 4.2 px, three times as far as usual, twice."""
    assert window_drawn(4.2).drawn_sigma_px == pytest.approx(USUAL_SIGMA_PX * np.sqrt((2 * 9 + 4) / 6), rel=0.01)


def test_one_drawing_shows_nothing() -> None:
    """An outline is where its only drawing has it, however badly that was drawn."""
    assert window_drawn(6.0, cameras=1).drawn_sigma_px == USUAL_SIGMA_PX
