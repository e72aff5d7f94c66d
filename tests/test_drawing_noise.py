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


def window_drawn(right_px: float, cameras: int = 2) -> SolvedRoom:
    """A window alone; its drawings lie to the right of it by so many pixels."""
    scene = rooms.seen_from([CAMERA, NEARER][:cameras], [WINDOW])
    for k in range(cameras):
        drawn = shapely.MultiPolygon([translate(one, right_px) for one in scene.key_frames[k].elements[0].amodal.geoms])
        scene = rooms.redraw(scene, k, 0, drawn)
    return SolvedRoom(scene, rooms.instances_of([WINDOW], cameras), [WINDOW.plane], [WINDOW.extent])


def test_drawings_that_agree_are_believed_more_than_usual() -> None:
    """Two exact ones, against the four that the usual σ is worth."""
    assert window_drawn(0.0).drawn_sigma_px == pytest.approx(USUAL_SIGMA_PX * np.sqrt(4 / 6), rel=1e-3)


def test_drawings_that_differ_less() -> None:
    """Off by 6 px sideways: so far from two sides, less from the others, whose median is one of both kinds."""
    assert window_drawn(6.0).drawn_sigma_px > window_drawn(3.0).drawn_sigma_px > window_drawn(0.0).drawn_sigma_px
    assert window_drawn(40.0).drawn_sigma_px > USUAL_SIGMA_PX


def test_one_drawing_shows_nothing() -> None:
    """An outline is where its only drawing has it, however badly that was drawn."""
    assert window_drawn(6.0, cameras=1).drawn_sigma_px == USUAL_SIGMA_PX
