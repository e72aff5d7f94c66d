"""Heights and widths: exact lengths, σ in closed form with what the planes' errors share, and what is no dimension."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
from room_dimensions import room_dimensions
from scipy.linalg import block_diag

from gtlayout.instances import Dimension, Plane
from gtlayout.scene import FloatArray


def _dimensions(
    surfaces: Sequence[rooms.Surface], covariance: FloatArray | None = None, planes: Sequence[Plane] | None = None
) -> tuple[Dimension, ...]:
    return room_dimensions(
        rooms.instances_of(surfaces, 1),
        planes or [surface.plane for surface in surfaces],
        [surface.extent for surface in surfaces],
        np.zeros((4 * len(surfaces), 4 * len(surfaces))) if covariance is None else covariance,
    )


def _opposite(angle_deg: float = 0.0) -> tuple[rooms.Surface, rooms.Surface]:
    """The left wall at x = 0, 2 m wide, and another 4 m from its middle, turned about the vertical."""
    left = rooms.Surface("wall", rooms.rectangle([0, -1, 0], [0, 2, 0], rooms.Z))
    along = np.array([np.sin(np.deg2rad(angle_deg)), np.cos(np.deg2rad(angle_deg)), 0.0])
    right = rooms.Surface("wall", rooms.rectangle([4, 0, 0] - along, rooms.Z, 2 * along))
    return left, right


def test_box_room_has_its_three_dimensions() -> None:
    surfaces = (rooms.CEILING, *rooms.BOX[2:], rooms.FLOOR)
    found = {(one.kind, one.first, one.second): one for one in _dimensions(surfaces)}
    assert list(found) == [("height", 5, 0), ("width", 1, 2), ("width", 3, 4)], "a height goes up from the floor"
    assert [one.length for one in found.values()] == pytest.approx([rooms.HEIGHT_M, rooms.WIDTH_M, rooms.DEPTH_M])
    assert [one.sigma for one in found.values()] == [0.0, 0.0, 0.0]
    height = found["height", 5, 0]
    np.testing.assert_allclose(height.ends_world, [[2.0, 2.5, 0.0], [2.0, 2.5, 2.5]], atol=1e-12)


@pytest.mark.parametrize(("correlation", "factor"), [(1.0, 2.0), (0.0, np.sqrt(2.0)), (-1.0, 0.0)])
def test_what_two_offsets_share_adds_or_cancels(correlation: float, factor: float) -> None:
    """The distance of planes that face each other is d + d': both grow when the camera path is taken too long."""
    covariance = np.zeros((8, 8))
    covariance[3, 3] = covariance[7, 7] = 0.02**2
    covariance[3, 7] = covariance[7, 3] = correlation * 0.02**2
    (width,) = _dimensions(_opposite(), covariance)
    assert width.length == pytest.approx(4.0)
    assert width.sigma == pytest.approx(0.02 * factor, abs=1e-12)


def test_a_tilt_counts_where_the_distance_is_measured() -> None:
    """The left wall turns about the z axis by σ 1° and faces the other for y from 1 to 5: 3 m · 1° at y = 3."""
    right = rooms.Surface("wall", rooms.rectangle([4, 1, 0], rooms.Z, [0, 9, 0]))
    turn = np.diag([0.0, np.deg2rad(1.0) ** 2, 0.0, 0.0])
    (width,) = _dimensions((rooms.LEFT, right), block_diag(turn, np.zeros((4, 4))))
    np.testing.assert_allclose(width.ends_world, [[0, 3, 1.25], [4, 3, 1.25]], atol=1e-12)
    assert width.sigma == pytest.approx(3.0 * np.deg2rad(1.0))


def test_walls_at_an_angle_by_hand() -> None:
    """A wedge of 8°: measured across its bisector, at 4° from both normals."""
    surfaces = _opposite(8.0)
    (width,) = _dimensions(surfaces)
    normals = np.stack([surface.plane.normal for surface in surfaces])
    across = (width.ends_world[1] - width.ends_world[0]) / width.length
    assert normals @ across == pytest.approx([np.cos(np.deg2rad(4.0)), -np.cos(np.deg2rad(4.0))])
    for surface, end in zip(surfaces, width.ends_world, strict=True):
        assert surface.plane.normal @ end + surface.plane.d == pytest.approx(0.0, abs=1e-12)
    foot = [abs(s.plane.normal @ e + s.plane.d) for s, e in zip(surfaces, width.ends_world[::-1], strict=True)]
    assert width.length == pytest.approx(np.mean(foot) / np.cos(np.deg2rad(4.0)))
    assert width.length == pytest.approx(4.0, abs=0.02)


def test_sigma_is_that_of_the_bisected_length_through_its_middle() -> None:
    """Against central differences in which the direction turns with the planes: it does not matter to first order."""
    surfaces = _opposite(8.0)
    rng = np.random.default_rng(0)
    root = rng.normal(size=(8, 8)) * 0.01
    covariance = root @ root.T
    (width,) = _dimensions(surfaces, covariance)
    middle = width.ends_world.mean(axis=0)
    at = np.concatenate([np.append(surface.plane.normal, surface.plane.d) for surface in surfaces])

    def length(coefficients: FloatArray) -> float:
        planes = coefficients.reshape(2, 4)
        units = planes[:, :3] / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        across = (units[0] - units[1]) / np.linalg.norm(units[0] - units[1])
        t = -(planes[:, :3] @ middle + planes[:, 3]) / (planes[:, :3] @ across)
        return float(t[1] - t[0])

    assert length(at) == pytest.approx(width.length)
    step = 1e-6
    gradient = np.array([(length(at + step * e) - length(at - step * e)) / (2 * step) for e in np.eye(8)])
    assert width.sigma == pytest.approx(np.sqrt(gradient @ covariance @ gradient), rel=1e-6)


def _moved(surface: rooms.Surface, x: float, y: float) -> rooms.Surface:
    return replace(surface, corners=surface.corners + np.array([x, y, 0.0]))


def test_what_does_not_face_each_other_has_no_distance() -> None:
    left, right = _opposite()
    assert _dimensions((left, _moved(right, 0, 1.75))), "an eighth lies opposite"
    assert not _dimensions((left, _moved(right, 0, 1.85))), "7.5 % of the walls lie opposite each other"
    assert not _dimensions((left, _moved(left, 1, 0))), "both look the same way"
    assert not _dimensions((left, _moved(right, -8, 0))), "back to back"
    assert not _dimensions(_opposite(11.0))
    assert not _dimensions((rooms.LEFT, rooms.FAR)), "at right angles"
    assert not _dimensions((left, replace(right, label="door")))
    assert not _dimensions((left, replace(right, label="ceiling")))
    assert not _dimensions((left, right), planes=[left.plane, replace(right.plane, observable=False)])


def test_a_plane_that_nothing_places_does_no_harm() -> None:
    surfaces = (*_opposite(), rooms.FLOOR)
    covariance = np.zeros((12, 12))
    covariance[3, 3] = 0.01**2
    covariance[8:], covariance[:, 8:] = np.nan, np.nan
    lost = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False)
    (width,) = _dimensions(surfaces, covariance, [*(s.plane for s in surfaces[:2]), lost])
    assert width.sigma == pytest.approx(0.01)
