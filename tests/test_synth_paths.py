"""Camera paths of synthetic scenes: they stay in the room, look into it, and replayed ones are what was recorded."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
import shapely
from conftest import SHARED_DATA
from scipy.spatial.transform import Rotation

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.re10k import Re10kCamera, read_cameras
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import FloatArray
from gtlayout.synth import Shot, SynthConfig, shoot
from gtlayout.synth.motion import CameraPath, drift, looking
from gtlayout.synth.paths import HEADROOM_M, LOWEST_M, REPLAY_M, CameraKind, replay_path, upright
from gtlayout.synth.room import ROOM_KINDS, Room, RoomKind, make_room

EXAMPLE = Path(__file__).parents[1] / "examples/room"
CLIP_NAMES = (
    *("0bf152ef84195293", "0c11dbe781b1c11c", "0c9b371cc6225682", "0f47577ab3441480", "0f68374b76390082"),
    *("2c80f9eb0d3b2bb4", "2f25826f0d0ef09a", "3c35b868a8ec3433", "3f79dc32d575bcdc", "4a2d6753676df096"),
)
GOOD_LINE = "1000 .5 .9 .5 .5 0 0 1 0 0 .1 0 1 0 .2 0 0 1 .3"


@lru_cache
def _room(seed: int, kind: RoomKind) -> Room:
    return make_room(seed, kind)


@pytest.fixture(params=CLIP_NAMES)
def clip(request: pytest.FixtureRequest) -> Path:
    """Each recorded path in turn."""
    file = SHARED_DATA / f"re10k_cameras/{request.param}.txt"
    if not file.is_file():
        pytest.skip(f"RealEstate10k cameras {file.name} are not beside the checkout")
    return file


def _off_focus_deg(shot: Shot, room: Room) -> FloatArray:
    ahead = np.stack([camera.R_cam_from_world[2, :2] for camera in shot.cameras])
    to_focus = room.focus - shot.path.centers_world[:, :2]
    cosine = (ahead * to_focus).sum(axis=1) / np.linalg.norm(ahead, axis=1) / np.linalg.norm(to_focus, axis=1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))


def _check_is_in_the_room_and_looks_in(shot: Shot, room: Room) -> None:
    centers = shot.path.centers_world
    assert shapely.contains_xy(room.standing, centers[:, :2]).all()
    assert centers[:, 2].min() > LOWEST_M
    assert centers[:, 2].max() < room.height_m - HEADROOM_M + 1e-9
    half_fov_deg = np.rad2deg(np.arctan(shot.cameras[0].width / 2 / shot.cameras[0].K[0, 0]))
    assert (_off_focus_deg(shot, room) < half_fov_deg).mean() > 0.7
    # No wall in between: from where it stands the camera sees the focus over the floor.
    floors = [shapely.Polygon(s.corners_world[:, :2]) for s in room.structure if s.label == "floor"]
    floor = shapely.union_all(floors).buffer(0.01)
    assert all(floor.covers(shapely.LineString([center, room.focus])) for center in centers[::10, :2])


@pytest.mark.parametrize(("kind", "camera"), list(product(ROOM_KINDS, ("orbit", "dolly", "rotation"))))
def test_a_path_stays_in_the_room_and_looks_into_it(kind: RoomKind, camera: CameraKind) -> None:
    room = _room(1, kind)
    shot = shoot(room, SynthConfig(seed=1, room=kind, camera=camera))
    _check_is_in_the_room_and_looks_in(shot, room)
    R, centers = shot.path.R_cam_from_world, shot.path.centers_world
    steps_deg = [np.rad2deg(Rotation.from_matrix(b @ a.T).magnitude()) for a, b in pairwise(R)]
    baseline_m = np.ptp(centers, axis=0)[:2].max()
    if camera == "orbit":
        assert 0.5 < np.median(steps_deg) < 2.5
        assert baseline_m > 1.0
    elif camera == "dolly":
        assert np.median(steps_deg) < 1.0
        assert 0.4 < baseline_m < 1.5
    else:
        assert 0.5 < np.median(steps_deg) < 2.5
        assert np.ptp(centers, axis=0).max() == 0
        assert np.ptp([each.center_world for each in shot.cameras], axis=0).max() < 1e-12


def test_the_default_path_is_that_of_the_first_version() -> None:
    """The example was made with it; figures in the changelog were, too."""
    example = load_scene(EXAMPLE)
    shot = shoot(_room(1, "box"), SynthConfig(seed=1, frames=41))
    for frame, camera in zip(example.frames, shot.cameras, strict=True):
        np.testing.assert_allclose(camera.K, frame.camera.K, atol=1e-9)
        np.testing.assert_allclose(camera.R_cam_from_world, frame.camera.R_cam_from_world, atol=1e-9)
        np.testing.assert_allclose(camera.center_world, frame.camera.center_world, atol=1e-9)


def test_looking_ahead_is_upright() -> None:
    np.testing.assert_allclose(looking(0, 0, 0), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)
    R_cam_from_world = looking(0.3, -0.2, 0.1)
    np.testing.assert_allclose(R_cam_from_world @ R_cam_from_world.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(R_cam_from_world) == pytest.approx(1)
    assert R_cam_from_world[2, 2] == pytest.approx(np.sin(-0.2))


def _motion_in_cameras(R_cam_from_world: FloatArray, centers: FloatArray) -> FloatArray:
    """(N, N, 3) where each camera sees each other one: the same for a path and any similar one, up to its scale."""
    return np.einsum("iab,ijb->ija", R_cam_from_world, centers[None] - centers[:, None])


def _check_is_the_recorded(replayed: CameraPath, recorded: tuple[Re10kCamera, ...]) -> float:
    """Relative rotations and, up to one scale, relative positions. Returns the scale."""
    R_file = np.stack([camera.R_cam_from_world for camera in recorded])
    centers_file = np.stack([-camera.R_cam_from_world.T @ camera.t_cam_from_world for camera in recorded])
    relative = [np.einsum("iab,jcb->ijac", R, R) for R in (replayed.R_cam_from_world, R_file)]
    np.testing.assert_allclose(relative[0], relative[1], atol=1e-6)
    seen = _motion_in_cameras(replayed.R_cam_from_world, replayed.centers_world)
    seen_file = _motion_in_cameras(R_file, centers_file)
    scale = float((seen * seen_file).sum() / (seen_file**2).sum())
    np.testing.assert_allclose(seen, scale * seen_file, atol=1e-6)
    return scale


@pytest.mark.parametrize("kind", ROOM_KINDS)
def test_a_replayed_path_is_the_recorded_one_up_to_a_similarity(kind: RoomKind, clip: Path) -> None:
    room, recorded = _room(1, kind), read_cameras(clip)
    at_s = np.array([camera.timestamp_us - recorded[0].timestamp_us for camera in recorded]) / 1e6
    replayed = replay_path(room, recorded, at_s, np.random.default_rng(0))
    assert _check_is_the_recorded(replayed, recorded) > 0.1
    length_m = np.linalg.norm(np.diff(replayed.centers_world, axis=0), axis=1).sum()
    assert 0.5 * REPLAY_M < length_m < REPLAY_M + 1e-9
    config = SynthConfig(room=kind, camera="dolly", replay=clip, width=480, height=270)
    shot = shoot(room, config)
    _check_is_in_the_room_and_looks_in(shot, room)
    assert len(shot.cameras) == config.frames
    # More frames than recorded: in between, nothing jumps.
    steps_m = np.linalg.norm(np.diff(shot.path.centers_world, axis=0), axis=1)
    assert steps_m.max() < 5 * REPLAY_M / config.frames


def test_a_replay_takes_the_field_of_view_of_the_file_unless_told(clip: Path) -> None:
    room, recorded = _room(1, "box"), read_cameras(clip)
    K = shoot(room, SynthConfig(camera="dolly", replay=clip)).cameras[0].K
    focal_px = recorded[0].focal_shares[0] * 480
    np.testing.assert_allclose(K, np.array([[focal_px, 0, 240], [0, focal_px, 180], [0, 0, 1]]), atol=1e-6)
    K = shoot(room, SynthConfig(camera="dolly", replay=clip, hfov_deg=90)).cameras[0].K
    assert K[0, 0] == pytest.approx(240)


def _recording(tilt: Rotation, yaws_deg: FloatArray, pitch_deg: float) -> tuple[Re10kCamera, ...]:
    """Level cameras on a curve, in a world tilted by ``tilt`` and seven times as large."""
    cameras = []
    for number, yaw in enumerate(np.deg2rad(yaws_deg)):
        center = 7 * np.array([0.1 * number, 0.02 * number**2, 0.01 * np.sin(number)])
        R_cam_from_world = looking(yaw, np.deg2rad(pitch_deg), 0) @ tilt.as_matrix().T
        t_cam_from_world = -R_cam_from_world @ tilt.apply(center)
        cameras.append(
            Re10kCamera(10**9 + 270_000 * number, (0.5, 0.9), (0.5, 0.5), R_cam_from_world, t_cam_from_world)
        )
    return tuple(cameras)


@pytest.mark.parametrize(("turn_deg", "pitch_deg", "off_deg"), [(0, 0, 0.01), (60, 0, 0.01), (60, -8, 3), (0, -8, 8.1)])
def test_gravity_is_found_in_a_tilted_world(turn_deg: float, pitch_deg: float, off_deg: float) -> None:
    tilt = Rotation.from_euler("xyz", [70, -20, 130], degrees=True)
    recorded = _recording(tilt, np.linspace(0, turn_deg, 12), pitch_deg)
    R_up_from_file = upright(np.stack([camera.R_cam_from_world for camera in recorded]))
    np.testing.assert_allclose(R_up_from_file @ R_up_from_file.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R_up_from_file) > 0
    up = R_up_from_file @ tilt.apply([0, 0, 1])
    assert np.rad2deg(np.arccos(min(up[2], 1))) < off_deg
    room = _room(1, "box")
    replayed = replay_path(room, recorded, 0.27 * np.arange(12, dtype=np.float64), np.random.default_rng(0))
    _check_is_the_recorded(replayed, recorded)


def test_poses_in_between_are_on_the_way() -> None:
    times = np.linspace(0, 3, 13)
    angles = 0.4 * np.sin(times)
    path = CameraPath(
        Rotation.from_euler("y", angles[:, None]).as_matrix(),
        np.column_stack([np.cos(times), np.sin(times), times]),
    )
    wanted = np.linspace(0, 3, 37)
    found = path.at(times, wanted)
    np.testing.assert_allclose(found.centers_world[::3], path.centers_world, atol=1e-12)
    np.testing.assert_allclose(found.R_cam_from_world[::3], path.R_cam_from_world, atol=1e-9)
    exact = np.column_stack([np.cos(wanted), np.sin(wanted), wanted])
    np.testing.assert_allclose(found.centers_world, exact, atol=1e-3)
    exact_R = Rotation.from_euler("y", 0.4 * np.sin(wanted)[:, None]).as_matrix()
    np.testing.assert_allclose(found.R_cam_from_world, exact_R, atol=1e-3)


def test_drift_has_unit_variance_at_every_frame_and_is_smooth() -> None:
    rng = np.random.default_rng(0)
    many = np.stack([drift(20, 3, 8, rng) for _ in range(2000)])
    np.testing.assert_allclose(many.std(axis=(0, 2)), 1, atol=0.05)
    steps = np.diff(many, axis=1).std()
    assert 0.1 < steps < 0.4, "white noise has √2"


def _write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_cameras_are_read_as_the_format_says(tmp_path: Path) -> None:
    turned = "2000 .5 .9 .5 .4 0 0 0 -1 0 1 1 0 0 2 0 0 1 3"
    first, second = read_cameras(_write(tmp_path / "clip.txt", "https://a.video/x", GOOD_LINE, turned, ""))
    assert (first.timestamp_us, first.focal_shares, first.center_shares) == (1000, (0.5, 0.9), (0.5, 0.5))
    np.testing.assert_allclose(first.t_cam_from_world, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(second.R_cam_from_world, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(second.t_cam_from_world, [1, 2, 3])
    assert second.center_shares == (0.5, 0.4)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ((), "line 1 must be the address"),
        ((GOOD_LINE,), "line 1 must be the address"),
        (("https://v",), "holds no camera"),
        (("https://v", "1 2 3"), "line 2 has 3 columns, 19 are expected"),
        (("https://v", GOOD_LINE, GOOD_LINE), "line 3: the timestamp is not later"),
        (("https://v", GOOD_LINE.replace(".9", "nine")), "line 2: not a number: 'nine'"),
        (("https://v", GOOD_LINE.replace(".9", "nan")), "line 2: all columns must be finite"),
        (("https://v", GOOD_LINE.replace(".9", "-1")), "line 2: the focal lengths"),
        (
            ("https://v", GOOD_LINE.replace("1 0 0 .1", "2 0 0 .1")),
            "line 2: the pose in columns 8 to 19 is no rotation",
        ),
        (("https://v", GOOD_LINE.replace("1 0 0 .1", "-1 0 0 .1")), "line 2: the pose in columns 8 to 19 is mirrored"),
    ],
)
def test_a_damaged_camera_file_is_named_with_its_line(tmp_path: Path, lines: tuple[str, ...], message: str) -> None:
    with pytest.raises(GtlayoutError, match=message) as caught:
        read_cameras(_write(tmp_path / "clip.txt", *lines))
    assert "clip.txt" in str(caught.value)


@pytest.mark.parametrize("make", [Path.mkdir, lambda path: path.write_bytes(b"\xff\xfe\x00"), lambda _path: None])
def test_what_is_no_camera_file_is_refused(tmp_path: Path, make: Callable[[Path], object]) -> None:
    make(tmp_path / "clip.txt")
    with pytest.raises(GtlayoutError, match=r"clip\.txt"):
        read_cameras(tmp_path / "clip.txt")


def test_a_path_of_one_camera_cannot_be_replayed(tmp_path: Path) -> None:
    file = _write(tmp_path / "clip.txt", "https://v", GOOD_LINE)
    with pytest.raises(GtlayoutError, match="at least 2 cameras"):
        shoot(_room(1, "box"), SynthConfig(camera="dolly", replay=file))
