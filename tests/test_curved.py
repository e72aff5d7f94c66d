"""Round walls: found among planes by their evidence, with a radius and σ that hold; flat walls stay planes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from curved_rooms import Measured, measured
from synth_views import the_room

from gtlayout.curved.config import CurvedConfig
from gtlayout.cylinder import Cylinder
from gtlayout.geometry.similarity import Similarity
from gtlayout.scene import FloatArray
from gtlayout.synth.arcs import Arc
from gtlayout.synth.room import CURVED_ROOM_KINDS, RoomKind
from gtlayout.tracking.triangulation import TriangulatedTracks

seen = cache(measured)


def true_wall(kind: RoomKind) -> tuple[str, Arc]:
    wall = next(surface for surface in the_room(kind).structure if surface.arc is not None)
    assert wall.arc is not None
    return wall.name, wall.arc


@pytest.mark.parametrize("kind", CURVED_ROOM_KINDS)
def test_a_round_wall_is_found_with_its_radius_and_axis(kind: RoomKind) -> None:
    room = seen(kind)
    name, arc = true_wall(kind)
    (wall,) = room.found()
    assert room.instances[wall.instance].name == name
    cylinder = wall.cylinder
    assert cylinder.radius == pytest.approx(arc.radius_m, rel=0.03)
    assert abs(cylinder.radius - arc.radius_m) < 3 * cylinder.sigma_radius
    assert cylinder.sigma_radius < 0.1 * arc.radius_m
    axis = cylinder.axis_point_world
    np.testing.assert_allclose(axis[:2], arc.center_xy, atol=0.05)
    assert np.rad2deg(np.arccos(cylinder.axis_world[2])) < 1
    assert wall.concave
    assert np.ptp(wall.arc_rad) == pytest.approx(arc.to_rad - arc.from_rad, abs=0.35)
    assert 1.8 < np.ptp(wall.height) < 2.85


@pytest.mark.parametrize("kind", ["box", "slanted", "polygon"])
def test_no_flat_wall_is_round(kind: RoomKind) -> None:
    assert seen(kind).found() == ()


def test_a_wall_with_little_evidence_is_round_only_where_it_is_drawn_so() -> None:
    """Its foot alone shows the bend: by BIC it is round, but not without anyone who says so."""
    room = seen("bay")
    index = room.index(true_wall("bay")[0])
    shallow = replace(room, rays=_flattened(room, index, 0.9))
    assert shallow.found() == ()
    assert [wall.instance for wall in shallow.found(drawn=(index,))] == [index]
    flat = tuple(i for i, one in enumerate(room.instances) if one.label == "wall" and i != index)
    assert len(flat) >= 2
    assert [wall.instance for wall in room.found(drawn=flat)] == [index], "evidence is against what is drawn"


def _flattened(room: Measured, index: int, sigma: float) -> TriangulatedTracks:
    """Tracks of a wall that know nothing of depth, so that only its foot shows the bend."""
    own = room.track_instance == index
    return replace(room.rays, sigma_rho=np.where(own, sigma * room.rays.rho, room.rays.sigma_rho))


def test_tracks_and_foot_must_both_bend() -> None:
    room = seen("bay")
    (wall,) = room.found()
    least = min(wall.gain_tracks, wall.gain_edges)
    assert room.found(CurvedConfig(min_gain_each=least + 0.1)) == ()
    assert room.found(CurvedConfig(min_gain=wall.gain_tracks + wall.gain_edges + 0.1)) == ()
    assert len(room.found(CurvedConfig(min_gain_each=least - 0.1))) == 1


def test_one_bent_foot_among_straight_ones_bends_no_wall() -> None:
    room = seen("bay")
    assert room.found(CurvedConfig(min_bent_feet=1.01)) == ()


def test_without_a_floor_or_ceiling_nothing_is_upright() -> None:
    room = seen("bay")
    unknown = tuple(
        replace(plane, observable=False) if instance.label in ("floor", "ceiling") else plane
        for instance, plane in zip(room.instances, room.planes, strict=True)
    )
    assert replace(room, planes=unknown).found() == ()


def test_a_short_arc_stays_a_plane() -> None:
    room = seen("round-corner")
    assert room.found(CurvedConfig(min_arc_deg=120.0)) == ()


def test_the_world_does_not_matter() -> None:
    """Turned, moved and in millimetres: the same wall."""
    room = seen("bay")
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    move = Similarity(turn * np.sign(np.linalg.det(turn)), np.array([5.0, -3.0, 2.0]), 1000.0)
    (here,), (there,) = room.found(), _moved(room, move).found()
    assert there.cylinder.radius == pytest.approx(1000 * here.cylinder.radius, rel=1e-5)
    assert there.cylinder.sigma_radius == pytest.approx(1000 * here.cylinder.sigma_radius, rel=1e-3)
    np.testing.assert_allclose(there.cylinder.axis_world, move.R @ here.cylinder.axis_world, atol=1e-5)
    off = there.cylinder.unrolled(move.points(here.cylinder.axis_point_world[None]))[2]
    assert off[0] == pytest.approx(-1000 * here.cylinder.radius, rel=1e-3)


def _moved(room: Measured, move: Similarity) -> Measured:
    coefficients, jacobian = np.array([[*p.normal, p.d] for p in room.planes]), np.eye(4)
    jacobian[:3, :3] = move.R
    jacobian[3] = np.append(move.scale * move.origin, move.scale)
    planes = [
        replace(plane, normal=at[:3], d=float(at[3]), covariance=jacobian @ plane.covariance @ jacobian.T)
        for plane, at in zip(room.planes, move.planes(coefficients), strict=True)
    ]
    scene = replace(
        room.scene, frames=tuple(replace(frame, camera=move.camera(frame.camera)) for frame in room.scene.frames)
    )
    rays = replace(
        room.rays,
        center=move.points(room.rays.center),
        ray=room.rays.ray @ move.R.T,
        rho=room.rays.rho / move.scale,
        sigma_rho=room.rays.sigma_rho / move.scale,
    )
    return replace(room, scene=scene, planes=tuple(planes), rays=rays)


def test_points_are_unrolled_from_a_cylinder() -> None:
    """A cylinder about (1, 2) along z, radius 3."""
    cylinder = Cylinder(np.array([0.0, 0, 1]), np.eye(3), np.array([1.0, 2, 3, 0, 0]), np.diag([1.0, 1, 4, 1, 1]))
    points: FloatArray = np.array([[4.0, 2, 1], [1, 5, 2], [1, 3, 0]])
    angles, heights, off = cylinder.unrolled(points)
    np.testing.assert_allclose(angles, [0, np.pi / 2, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(heights, [0, 1, -1])
    np.testing.assert_allclose(off, [0, 0, -2], atol=1e-12)
    assert cylinder.sigma_radius == 2
    leaning = replace(cylinder, values=np.array([1.0, 2, 3, 0.1, 0]))
    np.testing.assert_allclose(leaning.unrolled(np.array([[4.1, 2, 2]]))[2], [0], atol=1e-12)
    np.testing.assert_allclose(leaning.axis_world, np.array([0.1, 0, 1]) / np.hypot(0.1, 1))
