"""Where extents end whose drawn line lies beside that in which their planes meet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtlayout.edges import ContactEdge
from gtlayout.extent.shifts import shifts_on_planes
from gtlayout.instances import Plane, PlaneFrame
from gtlayout.scene import Camera, Frame, KeyFrame, Scene

FLOOR, WALL = (Plane(np.array(normal), 0.0, np.zeros((4, 4)), observable=True) for normal in ((0.0, 0, 1), (1.0, 0, 0)))
FRAMES = [PlaneFrame.across(plane.normal, np.zeros(3)) for plane in (FLOOR, WALL)]


def seen_from(*centers: tuple[float, float, float]) -> tuple[Scene, list[ContactEdge]]:
    """A contact of floor and wall in a key frame for each camera centre."""
    camera = Camera(np.eye(3), np.eye(3), np.zeros(3), 640, 480)
    frames = tuple(
        Frame(f"{i}.png", Path(f"{i}.png"), replace(camera, t_cam_from_world=-np.array(center)))
        for i, center in enumerate(centers)
    )
    scene = Scene(Path("/nowhere"), frames, tuple(KeyFrame(i, ()) for i in range(len(frames))), metric=True)
    return scene, [ContactEdge(i, (0, 1), np.zeros((2, 2))) for i in range(len(frames))]


def test_a_baseboards_foot_ends_the_floor_before_the_wall_and_the_wall_below_the_floor() -> None:
    """2 cm thick, seen from 2 m away and 1.5 m above: the wall goes on for .02 · 1.5 / (2 - .02) below the floor."""
    scene, edges = seen_from((2.0, 0.0, 1.5))
    shifts = shifts_on_planes(scene, (FLOOR, WALL), FRAMES, edges, {(0, 1): np.array([0.02, 0.0, 0.0])})
    assert shifts[0, 1] == pytest.approx(0.02)
    assert shifts[1, 0] == pytest.approx(-0.02 * 1.5 / 1.98)


def test_the_median_of_the_key_frames_counts_and_a_grazing_one_is_bounded() -> None:
    scene, edges = seen_from((2.0, 0.0, 1.5), (4.0, 0.0, 1.5), (0.0201, 0.0, 1.5))
    shifts = shifts_on_planes(scene, (FLOOR, WALL), FRAMES, edges, {(0, 1): np.array([0.02, 0.0, 0.0])})
    assert shifts[1, 0] == pytest.approx(-0.02 * 1.5 / 1.98)
    scene, edges = seen_from((0.0201, 0.0, 1.5))
    shifts = shifts_on_planes(scene, (FLOOR, WALL), FRAMES, edges, {(0, 1): np.array([0.02, 0.0, 0.0])})
    assert shifts[1, 0] == pytest.approx(-3 * 0.02)


def test_no_offset_moves_nothing() -> None:
    scene, edges = seen_from((2.0, 0.0, 1.5))
    assert shifts_on_planes(scene, (FLOOR, WALL), FRAMES, edges, {(0, 1): np.zeros(3)}) == {(0, 1): 0.0, (1, 0): 0.0}
    assert shifts_on_planes(scene, (FLOOR, WALL), FRAMES, edges, {}) == {}
