"""Graphs that are nearly singular: planes that are right within their σ, or a refusal; and numbers of every size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.positions import coarse_positions, without_far
from gtlayout.io.lens import Lens
from gtlayout.io.sources import PosedImage
from gtlayout.planes.estimate import Estimate
from gtlayout.quality.config import QualityConfig
from gtlayout.scene import Camera, FloatArray
from simulated.simulated_room import Room, box_faces, look_at, make_room, orbit, unproject
from simulated.simulation import chosen, errors, make_tracks, nees, solve, true_instance

KEY_FRAMES = [2, 6, 10, 14, 18]
SEEDS = range(4)
IN_999 = 16.3
"""χ² of three degrees of freedom is smaller in 99.9 %."""
FLOOR, CEILING, LEFT, RIGHT, NEAR, FAR = range(6)


def room_of(*faces: int, cameras: list[Camera] | None = None) -> Room:
    return make_room(cameras or orbit(), KEY_FRAMES, [box_faces()[i] for i in faces])


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def solves(room: Room) -> list[Estimate]:
    return [solve(room, make_tracks(room, rng(seed)), edges=()) for seed in SEEDS]


@pytest.mark.parametrize(
    "faces", [(FLOOR,), (FAR,), (FLOOR, CEILING), (RIGHT, FAR)], ids=["floor", "wall", "parallel", "two walls"]
)
def test_planes_that_share_nothing_are_right_within_their_sigma(faces: tuple[int, ...]) -> None:
    room = room_of(*faces)
    for solved in solves(room):
        assert all(plane.observable for plane in solved.planes)
        angles_deg, offsets = errors(room, solved.planes)
        assert nees(room, solved.planes).max() < IN_999
        assert angles_deg.max() < 1.0
        assert np.abs(offsets).max() < 0.02


def test_a_plane_whose_tracks_lie_on_a_line_may_turn_about_it() -> None:
    room = room_of(FLOOR)
    (plane,) = room.planes
    for seed in SEEDS:
        tracks = make_tracks(room, rng(seed), per_element=200)
        first = np.searchsorted(tracks.track, np.arange(len(tracks)))
        points = np.concatenate(
            [unproject(room.scene.frames[tracks.frame[n]].camera, tracks.points_px[n][None], plane) for n in first]
        )
        on_line = np.flatnonzero(np.abs(points[:, 1] - np.median(points[:, 1])) < 0.02)
        assert len(on_line) > 5
        few = chosen(tracks, on_line)
        solved = solve(room, few, edges=())
        whole = solve(room, tracks, edges=())
        assert solved.planes[0].sigma_normal_deg > 10 * whole.planes[0].sigma_normal_deg
        assert not solved.planes[0].observable or nees(room, solved.planes)[0] < IN_999


def aside(distance: float) -> list[Camera]:
    """Cameras that walk along the left wall, so far from it, and look along it."""
    return [look_at(np.array([distance, 0.8 + 0.07 * i, 1.4]), np.array([distance + 0.4, 4.6, 1.2])) for i in range(21)]


@pytest.mark.parametrize("distance", [2e-3, 0.01, 0.05])
def test_a_wall_that_the_camera_nearly_lies_on(distance: float) -> None:
    """A pixel of it covers metres. Nearer than a hand its error may be more than its σ says: it is never called ok."""
    room = room_of(LEFT, FAR, FLOOR, cameras=aside(distance))
    for seed in SEEDS:
        solved = solve(room, make_tracks(room, rng(seed)), edges=())
        known = [i for i, plane in enumerate(solved.planes) if plane.observable]
        assert all(np.isfinite(solved.planes[i].covariance).all() for i in known)
        off = nees(room, solved.planes)
        for i in known:
            plane, camera = solved.planes[i], room.scene.frames[10].camera
            depth_share = plane.sigma_offset(room.seen_center(i)) / abs(plane.normal @ camera.center_world + plane.d)
            assert off[i] < IN_999 or (distance < 0.05 and depth_share > QualityConfig().max_sigma_depth_share)


@pytest.mark.parametrize("noise_m", [0.0, 1e-9, 1e-4])
def test_cameras_in_one_place_are_refused(noise_m: float) -> None:
    center = np.array([1.2, 1.1, 1.4])
    still = [
        camera.placed(camera.R_cam_from_world, center + noise_m * rng(i).normal(size=3))
        for i, camera in enumerate(orbit())
    ]
    room = room_of(FLOOR, CEILING, RIGHT, FAR, cameras=still)
    tracks = make_tracks(room, rng(0))
    with pytest.raises(GtlayoutError, match=r"the camera (does not move|hardly moves).* gtlayout check"):
        solve(room, tracks, edges=())


@pytest.mark.parametrize(("scale", "shift"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e8)])
def test_planes_are_the_same_in_any_unit_and_far_from_the_origin(scale: float, shift: float) -> None:
    """Up to the digits that so large a number has."""
    room, origin = room_of(FLOOR, RIGHT, FAR), np.full(3, shift)
    tracks = make_tracks(room, rng(1))
    frames = [
        replace(f, camera=f.camera.placed(f.camera.R_cam_from_world, scale * f.camera.center_world + origin))
        for f in room.scene.frames
    ]
    other = replace(room, scene=replace(room.scene, frames=tuple(frames)))
    one, two = solve(room, tracks, edges=()), solve(other, tracks, edges=())
    assert true_instance(room, tracks).max() == 2
    for i, (p, q) in enumerate(zip(one.planes, two.planes, strict=True)):
        at = room.seen_center(i)
        digits = 1e-9 + np.finfo(np.float64).eps * shift * 100
        assert np.abs(p.normal - q.normal).max() < digits
        assert p.normal @ at + p.d == pytest.approx((q.normal @ (scale * at + origin) + q.d) / scale, abs=10 * digits)
        assert q.sigma_normal_deg == pytest.approx(p.sigma_normal_deg, rel=1e-4)


def images_at(centers: FloatArray) -> list[PosedImage]:
    lens = Lens("PINHOLE", 640, 480, (500.0, 500.0, 320.0, 240.0))
    path = make_room(orbit(), KEY_FRAMES).scene.root
    return [PosedImage(f"{i}.png", path / f"{i}.png", lens, np.eye(3), -at) for i, at in enumerate(centers)]


PATH = np.column_stack([np.linspace(0, 1.3, 20), np.sin(np.arange(20.0)) / 7, np.full(20, 1.4)])


@pytest.mark.parametrize(("far", "at"), [([7], 1e3), ([7, 12], -1e8), ([0], 1e6)])
def test_cameras_that_are_elsewhere_are_left_out(far: list[int], at: float) -> None:
    centers = PATH.copy()
    centers[far, 1] = at
    kept, (line,) = without_far(images_at(centers), 1e9)
    assert [image.name for image in kept] == [f"{i}.png" for i in range(20) if i not in far]
    assert line.startswith(f"{len(far)} of 20 cameras are elsewhere and were skipped, first ")
    assert f"{far[0]}.png" in line


@pytest.mark.parametrize(
    "centers",
    [
        PATH,
        PATH + 1e8,
        np.zeros((20, 3)),
        np.where(np.arange(20)[:, None] < 15, 0.0, PATH),  # it stands still, and then walks
        np.where(np.arange(20)[:, None] < 12, 1e-3 * PATH, 100 + PATH),  # two rooms
        PATH[:3] * [[1], [1], [1e6]],
    ],
    ids=["path", "far origin", "still", "still, then not", "two rooms", "three"],
)
def test_no_other_camera_is(centers: FloatArray) -> None:
    images = images_at(centers)
    assert without_far(images, 1e9) == (images, [])


@pytest.mark.parametrize(("shift", "step"), [(1e5, "0.0078"), (1e6, "0.062"), (1e8, "8")])
def test_positions_of_32_bits_far_from_the_origin(shift: float, step: str) -> None:
    def cameras(centers: FloatArray) -> list[Camera]:
        return [camera.placed(camera.R_cam_from_world, at) for camera, at in zip(orbit(20), centers, strict=True)]

    single = (shift + 3 * PATH).astype(np.float32).astype(np.float64)
    (line,) = coarse_positions(cameras(single))
    assert line.startswith(f"camera positions come in steps of {step}, ")
    assert coarse_positions(cameras(shift + 3 * PATH)) == []
    assert coarse_positions(cameras((3 * PATH).astype(np.float32).astype(np.float64))) == []
    assert coarse_positions(cameras(np.round(3 * PATH, 1))) == []
