"""A contact edge against planes: distances from the line in which these meet, and points on them."""

from __future__ import annotations

import numpy as np
import pytest
import rooms

from gtlayout.planes.contact_offsets import shifts_and_tilts_px
from gtlayout.planes.edge_group import FARTHEST_PX, EdgeGroup
from gtlayout.scene import FloatArray

CAMERA = rooms.level_camera([2.0, 1.0, 1.25])
FLOOR, FAR = (np.append(surface.plane.normal, surface.plane.d) for surface in (rooms.FLOOR, rooms.FAR))
FOOT = np.column_stack([np.linspace(1, 3, 9), np.full(9, 5.0), np.zeros(9)])
"""On the line in which floor and far wall meet."""


def edge(shift_px: FloatArray | float = 0.0, scale: float = 1.0) -> EdgeGroup:
    """Drawn that far below the line; in a world that many times as large."""
    camera = CAMERA.placed(CAMERA.R_cam_from_world, scale * CAMERA.center_world)
    points_px, _ = camera.project(scale * FOOT)
    points_px[:, 1] += shift_px
    return EdgeGroup(camera, (0, 1), points_px, key_frame=0)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e4])
def test_distances_are_those_from_the_line_in_which_the_planes_meet(scale: float) -> None:
    planes = np.stack([FLOOR, FAR]) * [1, 1, 1, scale]
    np.testing.assert_allclose(np.abs(edge(0.0, scale).misfits_px(planes)), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.abs(edge(3.0, scale).misfits_px(planes)), 3.0, atol=1e-6)
    tilted = edge(np.linspace(-2, 2, 9), scale).misfits_px(planes)
    np.testing.assert_allclose(tilted, np.sign(tilted[-1]) * np.linspace(-2, 2, 9), atol=1e-6)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e4])
@pytest.mark.parametrize(("angle", "meets"), [(0.15, False), (0.3, True)])
def test_planes_that_nearly_coincide_make_no_edge_in_any_unit(scale: float, angle: float, meets: bool) -> None:
    """Turned about a line in the wall, by more or less than .2 radians."""
    normal = np.array([0.0, -np.cos(angle), np.sin(angle)])
    other = np.append(normal, -normal @ [2.0, 5.0, 1.25])
    planes = np.stack([other, FAR]) * [1, 1, 1, scale]
    assert np.isfinite(edge(0.0, scale).misfits_px(planes)).all() == meets


def test_its_ends_lie_on_a_plane_where_they_are_seen() -> None:
    ends = edge().ends_on(FLOOR)
    np.testing.assert_allclose(ends, FOOT[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(edge().ends_on(FAR), FOOT[[0, -1]], atol=1e-9)


def test_two_points_stand_for_it_one_deviation_off_its_middle() -> None:
    group = edge()
    first, last = group.ends.points_px
    np.testing.assert_allclose((first + last) / 2, group.points_px.mean(axis=0))
    spread = np.sqrt(np.mean(np.sum((group.points_px - group.points_px.mean(axis=0)) ** 2, axis=1)))
    np.testing.assert_allclose(np.linalg.norm(last - first) / 2, spread)


def test_misfits_count_as_of_a_small_image_and_up_to_a_limit() -> None:
    large = rooms.level_camera([2.0, 1.0, 1.25], focal=640.0, width=1280, height=960)
    assert large.annotation_scale == pytest.approx(2.0)
    group = EdgeGroup(large, (0, 1), np.zeros((2, 2)), key_frame=0)
    np.testing.assert_allclose(group.annotation_px(np.array([-8.0, 3.0, np.inf])), [-4.0, 1.5, FARTHEST_PX])


def test_it_knows_both_its_sides() -> None:
    group = EdgeGroup(CAMERA, (4, 7), np.zeros((2, 2)), key_frame=0)
    assert (group.other(4), group.other(7)) == (7, 4)


def test_the_farthest_point_is_a_corner_of_the_hull() -> None:
    rng = np.random.default_rng(0)
    group = edge(rng.normal(0, 2, 9))
    planes = np.tile(FLOOR, (20, 1)) + rng.normal(0, 0.05, (20, 4))
    of_all = np.abs(group.distances_px(planes, FAR)).max(axis=1)
    np.testing.assert_allclose(np.abs(group.hull.distances_px(planes, FAR)).max(axis=1), of_all, rtol=1e-12)
    assert len(group.hull.points_px) < len(group.points_px)


def test_shift_and_tilt_are_those_of_its_two_representatives_and_change_with_the_offset() -> None:
    large = rooms.level_camera([2.0, 1.0, 1.25], focal=640.0, width=1280, height=960)
    points_px, _ = large.project(FOOT)
    groups = [edge(np.linspace(1, 4, 9)), EdgeGroup(large, (0, 1), points_px + np.array([0, 6.0]), key_frame=0)]
    planes = np.stack([FLOOR, FAR])
    offsets = np.array([[0.0, 0.02, -0.01], [0.01, 0.0, 0.03]])
    px, by_offset = shifts_and_tilts_px(groups, planes, offsets)
    for group, offset, (shift, tilt), derivative in zip(groups, offsets, px, by_offset, strict=True):
        first, last = group.ends.misfits_px(planes, offset) / group.camera.annotation_scale
        np.testing.assert_allclose([shift, tilt], [(first + last) / 2, (first - last) / 2], atol=1e-9)
        assert abs(shift) > 1
        for axis in range(3):
            step = np.zeros((2, 3))
            step[:, axis] = 1e-6
            above, below = (shifts_and_tilts_px([group] * 2, planes, offset + sign * step)[0][0] for sign in (1, -1))
            np.testing.assert_allclose(derivative[:, axis], (above - below) / 2e-6, rtol=1e-5, atol=1e-5)


def test_planes_that_coincide_have_neither() -> None:
    px, by_offset = shifts_and_tilts_px([edge(2.0), edge(2.0)], np.stack([FLOOR, FLOOR]), np.zeros((2, 3)))
    assert not px.any()
    assert not by_offset.any()
