"""A cylinder unrolled: places on it and in the world, facets within a tolerance, rays that meet it, other worlds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, box

from gtlayout.cylinder import CurvedWall, Cylinder
from gtlayout.geometry.strip import (
    StripFrame,
    bordered,
    flat_parts,
    pieces,
    sigma_along_normal,
    sigma_depth_on,
    strip_of,
    unproject_onto,
)
from gtlayout.instances import Extent, Plane
from gtlayout.scene import Camera, FloatArray

COVARIANCE = np.diag([0.01, 0.01, 0.02, 1e-3, 1e-3]) ** 2
LEANING = Cylinder(np.array([1.0, 2.0, 0.5]), np.eye(3), np.array([0.3, -0.2, 1.5, 0.02, -0.01]), COVARIANCE)
UV = np.array([[0.0, 0.0], [0.7, 1.0], [-1.2, -0.4], [2.0, 0.3]])
REGION = MultiPolygon([box(-1.0, -1.0, 1.2, 1.0) - box(0.1, -0.5, 0.6, 0.5)])
PLANE = Plane(np.array([1.0, 0, 0]), 0.0, np.zeros((4, 4)), observable=True)


def strip(*, concave: bool = True, tolerance: float = 0.002, cylinder: Cylinder = LEANING) -> StripFrame:
    wall = CurvedWall(0, cylinder, (0.4, 1.8), (-1.0, 1.0), concave, 9.0, 9.0)
    return StripFrame.on(wall, tolerance)


def looking(center: FloatArray, at: FloatArray) -> Camera:
    forward = (at - center) / np.linalg.norm(at - center)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    return Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), R, -R @ center, 100, 80)


@pytest.mark.parametrize("concave", [True, False])
def test_there_and_back(concave: bool) -> None:
    frame = strip(concave=concave)
    points = frame.to_world(UV)
    np.testing.assert_allclose(frame.to_plane(points), UV, atol=1e-12)
    np.testing.assert_allclose(LEANING.unrolled(points)[2], 0, atol=1e-12)
    np.testing.assert_allclose(frame.to_world(np.zeros((1, 2)))[0], frame.origin, atol=1e-12)


@pytest.mark.parametrize("concave", [True, False])
def test_the_normal_is_towards_the_cameras(concave: bool) -> None:
    frame = strip(concave=concave)
    to_axis = LEANING.axis_point_world - frame.origin
    assert (np.cross(*frame.axes) @ to_axis > 0) == concave
    for point in UV:
        step = 1e-6
        by_u, by_v = (
            (frame.to_world((point + d)[None]) - frame.to_world((point - d)[None]))[0] / (2 * step)
            for d in step * np.eye(2)
        )
        np.testing.assert_allclose(frame.by_uv(point[None])[0], [by_u, by_v], atol=1e-8)
        assert np.linalg.norm(by_u) == pytest.approx(1)
        normal = np.cross(by_u, by_v)
        np.testing.assert_allclose(frame.normal_at(point), normal / np.linalg.norm(normal), atol=1e-7)


@pytest.mark.parametrize("tolerance", [0.0005, 0.002, 0.02])
def test_facets_keep_the_tolerance(tolerance: float) -> None:
    """A chord of step s on radius R is R − √(R² − s²/4) off."""
    frame = strip(tolerance=tolerance)
    angle = frame.step / LEANING.radius
    assert LEANING.radius * (1 - np.cos(angle / 2)) == pytest.approx(tolerance)
    parts = flat_parts(PLANE, Extent(frame, REGION, REGION))
    assert len(parts) == len(frame.borders(-1.0, 1.2)) + 1
    for plane, extent in parts:
        assert strip_of(extent) is None
        corners = extent.frame.to_world(shapely.get_coordinates(extent.region))
        np.testing.assert_allclose(corners @ plane.normal + plane.d, 0, atol=1.01 * tolerance)
        np.testing.assert_allclose(np.cross(*extent.frame.axes), plane.normal, atol=1e-12)
        middle = extent.frame.to_world(shapely.get_coordinates(extent.region.envelope.centroid))
        assert abs(LEANING.unrolled(middle)[2][0]) <= 1.01 * tolerance
        assert plane.normal @ (LEANING.axis_point_world - corners[0]) > 0
    area = sum(extent.region.area for _, extent in parts)
    assert area == pytest.approx(REGION.area, rel=0.01)


def test_pieces_share_their_corners_at_the_borders() -> None:
    frame = strip()
    cut = pieces(REGION, frame)
    assert sum(piece.area for piece in cut) == pytest.approx(REGION.area, abs=1e-9)
    borders = frame.borders(-1.0, 1.2)
    for border, before, after in zip(borders, cut[:-1], cut[1:], strict=True):
        on = [{tuple(p) for p in shapely.get_coordinates(one).tolist() if p[0] == border} for one in (before, after)]
        assert on[0] == on[1]
        assert len(on[0]) >= 2
    marked = bordered(REGION, frame)
    assert marked.area == pytest.approx(REGION.area)
    assert shapely.get_num_coordinates(marked) > shapely.get_num_coordinates(REGION)
    flat = Extent(Extent(frame, REGION, REGION).frame, REGION, REGION)
    assert len(pieces(REGION, replace(frame, step=100.0))) == 2  # a border lies at u = 0
    assert strip_of(flat) is frame


@pytest.mark.parametrize("concave", [True, False])
def test_a_camera_sees_what_projects_there(concave: bool) -> None:
    frame = strip(concave=concave)
    center = LEANING.axis_point_world if concave else frame.to_world(np.zeros((1, 2)))[0] * 3 - 2 * frame.origin
    center = (
        LEANING.axis_point_world - 0.2 * np.cross(*frame.axes) if concave else frame.origin + 3 * np.cross(*frame.axes)
    )
    camera = looking(center, frame.origin)
    near = np.array([[0.0, 0.0], [0.3, 0.2], [-0.4, -0.3]])
    points_px, depth = camera.project(frame.to_world(near))
    np.testing.assert_allclose(unproject_onto(points_px, frame, camera), near, atol=1e-9)
    sigma, found = sigma_depth_on(frame, camera, points_px)
    np.testing.assert_allclose(found, depth, rtol=1e-9)
    on = frame.to_world(near)
    facing = [abs(camera.rays_world(px[None])[0] @ frame.normal_at(uv)) for px, uv in zip(points_px, near, strict=True)]
    np.testing.assert_allclose(sigma, LEANING.sigma_offset(on) / facing, rtol=1e-9)
    assert np.isnan(unproject_onto(points_px, frame, camera, max_depth=depth.min() / 2)).all()


def test_beside_the_cylinder_the_ray_passes_nearest() -> None:
    column = strip(concave=False, cylinder=replace(LEANING, values=np.array([0.3, -0.2, 0.5, 0, 0])))
    camera = looking(column.origin + 4 * np.cross(*column.axes), column.origin)
    uv = unproject_onto(np.array([[99.0, 40.0]]), column, camera)
    ray = camera.rays_world(np.array([[99.0, 40.0]]))[0]
    assert column.normal_at(uv[0]) @ ray == pytest.approx(0.0, abs=0.2)


def test_what_is_behind_a_camera_is_not_seen() -> None:
    frame = strip(concave=False)
    away = frame.origin + 3 * np.cross(*frame.axes)
    camera = looking(away, away + np.cross(*frame.axes))
    assert np.isnan(unproject_onto(np.array([[50.0, 40.0]]), frame, camera)).all()


def test_where_it_meets_a_plane() -> None:
    frame = strip()
    floor = Plane(np.array([0.0, 0, 1]), 0.6, np.zeros((4, 4)), observable=True)
    at = frame.onto(floor, np.array([0.5, 0.0]))
    assert frame.to_world(at[None])[0, 2] == pytest.approx(-0.6)
    assert at[0] == pytest.approx(0.5)
    wall = Plane(np.array([1.0, 0, 0]), -1.2, np.zeros((4, 4)), observable=True)
    assert frame.to_world(frame.onto(wall, np.array([0.2, 0.0]))[None])[0, 0] == pytest.approx(1.2)


def test_another_world() -> None:
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    shift = np.array([5.0, -3, 2])
    frame = strip()
    moved = frame.moved(1000.0, turn, shift)
    np.testing.assert_allclose(moved.to_world(1000 * UV), 1000 * frame.to_world(UV) @ turn.T + shift, rtol=1e-12)
    assert moved.step == pytest.approx(1000 * frame.step)
    assert moved.cylinder.sigma_radius == pytest.approx(1000 * LEANING.sigma_radius)
    assert moved.cylinder.sigma_normal_deg == pytest.approx(LEANING.sigma_normal_deg)
    np.testing.assert_allclose(moved.cylinder.axis_world, turn @ LEANING.axis_world)
    np.testing.assert_allclose(frame.moved().axes, frame.axes)


def test_angles_of_a_region() -> None:
    for concave in (True, False):
        frame = strip(concave=concave)
        first, last = frame.arc_rad(REGION)
        assert last - first == pytest.approx(2.2 / 1.5)
        mean = 1.1 + (-0.1 if concave else 0.1) / 1.5
        assert (first + last) / 2 == pytest.approx(mean)
    assert np.isnan(frame.arc_rad(MultiPolygon())).all()


def test_sigma_along_the_normal_by_hand() -> None:
    """On the first axis' side, at the origin's level: what moves the axis there, and the radius."""
    frame = strip()
    point = LEANING.points(np.zeros(1), np.zeros(1))
    sigma = np.hypot(0.01, 0.02)
    np.testing.assert_allclose(sigma_along_normal(PLANE, Extent(frame, REGION, REGION), point), sigma)
    high = LEANING.points(np.zeros(1), np.full(1, 10.0))
    np.testing.assert_allclose(LEANING.sigma_offset(high), np.sqrt(sigma**2 + 0.01**2))
    assert LEANING.sigma_normal_deg == pytest.approx(np.rad2deg(0.01 / 1.5))
