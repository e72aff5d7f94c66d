"""Stage 1 on rendered planes: noise textures seen by known cameras, so that every position is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
from scipy.stats import qmc
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.errors import GtlayoutError
from gtlayout.scene import BoolArray, Camera, Element, FloatArray, Frame, ImageArray, KeyFrame, Scene
from gtlayout.tracking.config import TrackingConfig
from gtlayout.tracking.follow import infinite_homography
from gtlayout.tracking.klt import PairTracker
from gtlayout.tracking.sampling import _corners, sample_points, texture_sigma_px
from gtlayout.tracking.sobol import sobol_points
from gtlayout.tracking.track import track
from gtlayout.tracking.tracks import Tracks
from simulated.simulated_room import as_multi

WIDTH, HEIGHT, FOCAL = 320, 240, 260.0
K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
CONFIG = TrackingConfig()
# The textured plane: a point at texture pixel (u, v) is ORIGIN + u AXES[0] + v AXES[1], slightly turned away.
TEXEL = 3.0 / FOCAL
AXES = TEXEL * np.array([[np.cos(0.2), 0, np.sin(0.2)], [0, 1.0, 0]])
TEXTURE_SIZE = (1600, 700)
ORIGIN = np.array([0, 0, 3.0]) - TEXTURE_SIZE[0] / 2 * AXES[0] - TEXTURE_SIZE[1] / 2 * AXES[1]
SEEN = shapely.box(30, 30, 290, 210)


@dataclass(frozen=True)
class Clip:
    scene: Scene

    def where(self, key_px: FloatArray, key_frame: int, frame: int) -> FloatArray:
        """(N, 2) true positions in a frame of what lies at ``key_px`` in another."""
        camera = self.scene.frames[key_frame].camera
        normal = np.cross(AXES[0], AXES[1])
        rays = camera.rays_world(key_px)
        depth = ((ORIGIN - camera.center_world) @ normal) / (rays @ normal)
        return self.scene.frames[frame].camera.project(camera.center_world + depth[:, None] * rays)[0]

    def errors_px(self, tracks: Tracks) -> FloatArray:
        """(M,) distance of every observation from the truth."""
        key = np.array([key_frame.frame for key_frame in self.scene.key_frames])[tracks.key_frame]
        errors = np.empty(len(tracks.track))
        for n in range(len(tracks)):
            mine = np.nonzero(tracks.track == n)[0]
            start = tracks.points_px[mine[tracks.frame[mine] == key[n]]]
            for m in mine:
                true_px = self.where(start, int(key[n]), int(tracks.frame[m]))[0]
                errors[m] = np.linalg.norm(tracks.points_px[m] - true_px)
        return errors


def texture(seed: int = 0) -> ImageArray:
    """Smooth noise of two scales."""
    rng = np.random.default_rng(seed)
    fine, coarse = (
        cv2.GaussianBlur(rng.normal(size=TEXTURE_SIZE[::-1]).astype(np.float32), (0, 0), sigma) * sigma
        for sigma in (2.0, 6.0)
    )
    return np.clip(128 + 90 * (fine + coarse), 0, 255).astype(np.uint8)


def camera_at(center: Sequence[float], turn_deg: float = 0.0, roll_deg: float = 0.0) -> Camera:
    yaw, _ = cv2.Rodrigues(np.array([0.0, np.deg2rad(turn_deg), 0.0]))
    roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, np.deg2rad(roll_deg)]))
    rotation = (roll @ yaw).astype(np.float64)
    return Camera(K, rotation, -rotation @ np.asarray(center, dtype=np.float64), WIDTH, HEIGHT)


def render(camera: Camera, image: ImageArray) -> ImageArray:
    """The textured plane as the camera sees it; both images have their first pixel's centre at (0.5, 0.5)."""
    world_from_texture = np.column_stack([AXES[0], AXES[1], ORIGIN])
    translation = np.outer(camera.t_cam_from_world, [0, 0, 1])
    homography = camera.K @ (camera.R_cam_from_world @ world_from_texture + translation)
    half = np.array([[1.0, 0, 0.5], [0, 1.0, 0.5], [0, 0, 1.0]])
    seen = cv2.warpPerspective(image, np.linalg.inv(half) @ homography @ half, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
    return np.asarray(seen, dtype=np.uint8)


def make_clip(folder: Path, cameras: Sequence[Camera], key_frames: Sequence[int], visible: BaseGeometry = SEEN) -> Clip:
    """Images of the textured plane with a pixel noise of 1, and one annotated wall per key frame."""
    rng = np.random.default_rng(7)
    surface = texture()
    frames = []
    for i, camera in enumerate(cameras):
        image = render(camera, surface) + rng.normal(size=(HEIGHT, WIDTH))
        path = folder / f"{i:03d}.png"
        write(path, np.clip(np.round(image), 0, 255).astype(np.uint8))
        frames.append(Frame(path.name, path, camera))
    wall = Element("e0", "wall", as_multi(shapely.box(0, 0, WIDTH, HEIGHT)), as_multi(visible))
    annotated = tuple(KeyFrame(k, (wall,)) for k in key_frames)
    return Clip(Scene(folder, tuple(frames), annotated, metric=True))


def write(path: Path, image: ImageArray) -> None:
    ok, png = cv2.imencode(".png", image)
    assert ok
    path.write_bytes(png.tobytes())


def sideways(count: int, step_m: float = 0.06) -> list[Camera]:
    return [camera_at([step_m * (i - count // 2), 0.01 * i, 0.0], 0.5 * i) for i in range(count)]


def dense_flow(
    source: ImageArray, target: ImageArray, points_px: FloatArray, guess_px: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """A dense tracker behind the same interface, as RAFT would be: it needs no guess."""
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(source, target, None)  # type: ignore[call-overload]
    column, row = np.clip(points_px.astype(int), 0, [WIDTH - 1, HEIGHT - 1]).T
    return points_px + flow[row, column].astype(np.float64), np.ones(len(points_px), dtype=bool)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    return make_clip(tmp_path_factory.mktemp("clip"), sideways(9), [4])


@pytest.fixture(scope="module")
def tracks(clip: Clip) -> Tracks:
    return track(clip.scene, CONFIG, seed=0)


def test_positions_are_good_to_a_third_of_a_pixel(clip: Clip, tracks: Tracks) -> None:
    errors_px = clip.errors_px(tracks)
    assert np.median(errors_px) < 0.1
    assert np.percentile(errors_px, 99) < 0.3
    # Good texture, slow motion: hardly any point is lost, and none in between.
    assert len(tracks) > 0.9 * tracks.tried[0].sum()
    assert np.median(np.bincount(tracks.track)) == 9


def test_arrays_fit_together(clip: Clip, tracks: Tracks) -> None:
    assert np.array_equal(np.lexsort((tracks.frame, tracks.track)), np.arange(len(tracks.track)))
    assert np.array_equal(np.unique(tracks.track), np.arange(len(tracks)))
    lengths = np.bincount(tracks.track)
    assert lengths.min() >= CONFIG.min_observations
    for n in range(len(tracks)):
        frames = tracks.frame[tracks.track == n]
        assert 4 in frames
        assert np.array_equal(frames, np.arange(frames[0], frames[-1] + 1)), "a track that ended does not come back"
    assert tracks.sigma_px.shape == (len(tracks),) and tracks.sigma_px.min() >= CONFIG.sigma_px
    assert tracks.unreadable == ()
    assert [len(counts) for counts in tracks.tried] == [1]


def test_error_does_not_add_up_along_a_track(clip: Clip, tracks: Tracks) -> None:
    errors_px = clip.errors_px(tracks)
    by_gap = [np.median(errors_px[np.abs(tracks.frame - 4) == gap]) for gap in (1, 4)]
    assert by_gap[1] < by_gap[0] + 0.1


@pytest.mark.parametrize("roll_deg", [0.0, 6.0])
def test_a_hundred_pixels_between_frames_are_followed(tmp_path: Path, roll_deg: float) -> None:
    # 21° a frame at this focal length are 100 px; the camera moves as well.
    cameras = [camera_at([0.1 * i, 0.0, 0.0], 21.0 * (i - 1), roll_deg * (i - 1)) for i in range(3)]
    clip = make_clip(tmp_path, cameras, [1], shapely.box(20, 20, 300, 220))
    moved_px = np.linalg.norm(clip.where(np.array([[160.0, 120.0]]), 1, 2) - [160, 120])
    assert moved_px > 90
    found = track(clip.scene, replace(CONFIG, min_observations=2), seed=0)
    assert np.percentile(clip.errors_px(found), 95) < 0.3
    # Of those sampled points that stay in view (half a patch inside) most are found.
    for frame in (0, 2):
        seen = found.frame == frame
        back = clip.where(np.array([[160.0, 120.0]]), 1, frame)[0] - [160, 120]
        share_in_view = 1 - abs(back[0]) / WIDTH
        assert seen.sum() > 0.5 * share_in_view * found.tried[0].sum()


def test_parallax_is_predicted_from_the_depth_seen_so_far(tmp_path: Path) -> None:
    # 0.35 m a frame at 3 m: 30 px that no rotation explains.
    clip = make_clip(tmp_path, [camera_at([0.35 * (i - 2), 0, 0]) for i in range(5)], [2])
    found = track(clip.scene, CONFIG, seed=0)
    assert len(found) > 0.5 * found.tried[0].sum()
    assert np.percentile(clip.errors_px(found), 95) < 0.3


def test_guesses_handed_to_the_tracker_close_in_on_the_truth(tmp_path: Path) -> None:
    guesses: list[FloatArray] = []
    moves: list[FloatArray] = []

    def spy(
        source: ImageArray, target: ImageArray, points_px: FloatArray, guess_px: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        moved, ok = dense_flow(source, target, points_px, guess_px)
        guesses.append(guess_px[ok])
        moves.append(moved[ok])
        return moved, ok

    moving = make_clip(tmp_path, [camera_at([0.1 * i, 0, 0]) for i in range(6)], [0])
    track(moving.scene, CONFIG, seed=0, tracker=spy)
    first, last = (np.median(np.linalg.norm(moves[i] - guesses[i], axis=1)) for i in (0, -1))
    assert first > 5, "nothing is known of depth at first"
    assert last < 0.5


def test_tracks_end_at_the_image_border(tmp_path: Path) -> None:
    clip = make_clip(tmp_path, [camera_at([0.0, 0.0, 0.0], 4.0 * i) for i in range(9)], [0])
    found = track(clip.scene, CONFIG, seed=0)
    margin = CONFIG.border_px
    assert found.points_px.min() > margin
    assert found.points_px[:, 0].max() < WIDTH - margin and found.points_px[:, 1].max() < HEIGHT - margin
    start = found.points_px[found.frame == 0]
    last = np.array([found.frame[found.track == n].max() for n in range(len(found))])
    ended = np.zeros(len(found), dtype=bool)
    for frame in range(1, 9):
        true_px = clip.where(start, 0, frame)
        outside = ((true_px < 0) | (true_px > [WIDTH, HEIGHT])).any(axis=1)
        assert np.all(last[outside] < frame)
        ended |= outside
    assert 0.1 < ended.mean() < 0.9, "the camera is meant to turn away from some points"
    assert np.mean(last[~ended] == 8) > 0.7


# A dense flow has no forward-backward check of its own: the key frame's patch alone must notice.
@pytest.mark.parametrize("tracker", [None, dense_flow])
def test_tracks_end_where_something_moves_in_front(tmp_path: Path, tracker: PairTracker | None) -> None:
    clip = make_clip(tmp_path, sideways(9), [2])
    cover = render(clip.scene.frames[0].camera, texture(seed=5))[60:180, 100:220]
    for i in range(6, 9):
        image = cv2.imread(str(clip.scene.frames[i].image_path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        image[60:180, 100:220] = cover
        write(clip.scene.frames[i].image_path, np.asarray(image, dtype=np.uint8))
    found = track(clip.scene, CONFIG, seed=0, tracker=tracker)
    start = found.points_px[found.frame == 2]
    last = np.array([found.frame[found.track == n].max() for n in range(len(found))])
    at_six = clip.where(start, 2, 6)
    covered = ((at_six > [108, 68]) & (at_six < [212, 172])).all(axis=1)
    free = ((at_six < [85, 45]) | (at_six > [235, 195])).any(axis=1)
    assert covered.sum() > 5
    assert np.mean(last[covered] == 5) > 0.9
    assert np.mean(last[covered] > 5) < 0.05
    assert np.mean(last[free] == 8) > 0.8


@pytest.mark.parametrize("damage", [b"", b"not an image", None])
def test_an_unreadable_image_is_stepped_over_and_named(tmp_path: Path, damage: bytes | None) -> None:
    clip = make_clip(tmp_path, sideways(7), [1])
    path = clip.scene.frames[3].image_path
    if damage is None:
        path.unlink()
    else:
        path.write_bytes(damage)
    found = track(clip.scene, CONFIG, seed=0)
    assert found.unreadable == ("003.png",)
    assert not (found.frame == 3).any()
    assert np.count_nonzero(found.frame == 4) > 0.8 * found.tried[0].sum()
    assert np.percentile(clip.errors_px(found), 95) < 0.3


def test_an_unreadable_key_frame_is_one_clear_line(tmp_path: Path) -> None:
    clip = make_clip(tmp_path, sideways(3), [1])
    clip.scene.frames[1].image_path.write_bytes(b"\x89PNG")
    with pytest.raises(GtlayoutError, match=r"^[^\n]*001\.png[^\n]*annotated[^\n]*$"):
        track(clip.scene, CONFIG, seed=0)


def test_a_wall_without_texture_gives_no_tracks_and_no_crash(tmp_path: Path) -> None:
    clip = make_clip(tmp_path, sideways(3), [1])
    for frame in clip.scene.frames:
        write(frame.image_path, np.full((HEIGHT, WIDTH), 200, dtype=np.uint8))
    found = track(clip.scene, CONFIG, seed=0)
    assert len(found) == 0
    assert found.points_px.shape == (0, 2)


@pytest.mark.parametrize("seed", [0, 7])
@pytest.mark.parametrize("count", [1, 3, 64, 1000])
def test_sobol_points_are_those_of_scipy(count: int, seed: int) -> None:
    of_scipy = qmc.Sobol(d=2, seed=seed).random(1 << (count - 1).bit_length())[:count]
    assert np.array_equal(sobol_points(count, seed), of_scipy)


def element(visible: BaseGeometry, amodal: BaseGeometry = shapely.box(0, 0, WIDTH, HEIGHT)) -> Element:  # noqa: B008
    return Element("e0", "wall", as_multi(amodal), as_multi(visible))


def test_points_spread_over_the_whole_region_and_stay_well_inside() -> None:
    image = render(camera_at([0, 0, 0]), texture())
    region = shapely.Polygon([(20, 20), (300, 20), (300, 90), (110, 90), (110, 220), (20, 220)])
    config = replace(CONFIG, corners_per_cell=1)
    points_px = sample_points(image, element(region), config, seed=0)
    # Points are pixel centres, the region is rasterised by pixel centres too.
    assert shapely.contains_xy(region.buffer(-config.border_px + 1e-6), points_px[:, 0], points_px[:, 1]).all()
    wanted = region.buffer(-config.border_px).area / config.spacing_px**2
    assert 0.5 * wanted < len(points_px) < 1.5 * wanted
    # No place in the region is farther from a point than a random cover of this density would leave it.
    x, y = np.meshgrid(np.arange(25, 300, 5.0), np.arange(25, 220, 5.0))
    inside = shapely.contains_xy(region, x, y)
    away = np.linalg.norm(np.column_stack([x[inside], y[inside]])[:, None] - points_px[None], axis=2).min(axis=1)
    assert away.max() < 2 * config.spacing_px
    more = sample_points(image, element(region), CONFIG, seed=0)
    assert 2 * len(points_px) < len(more) <= 8 * 1.5 * wanted
    apart = np.linalg.norm(more[:, None] - more[None], axis=2)[np.triu_indices(len(more), 1)]
    assert apart.min() >= CONFIG.corner_distance_px


def test_a_large_surface_gets_no_more_points_than_are_used() -> None:
    image = render(camera_at([0, 0, 0]), texture())
    region = shapely.box(10, 10, 310, 230)
    config = replace(CONFIG, corners_per_cell=1, max_cells=12)
    points_px = sample_points(image, element(region), config, seed=0)
    assert 6 <= len(points_px) <= 12 < region.area / CONFIG.spacing_px**2 / 4
    quadrants = {(x > 160, y > 120) for x, y in points_px}
    assert len(quadrants) == 4


def test_without_visible_parts_the_eroded_amodal_polygon_is_sampled() -> None:
    image = render(camera_at([0, 0, 0]), texture())
    amodal = shapely.box(40, 40, 200, 200)
    points_px = sample_points(image, element(MultiPolygon(), amodal), CONFIG, seed=0)
    assert len(points_px) > 10
    inner = amodal.buffer(-CONFIG.spacing_px / 2 + 1e-6)
    assert shapely.contains_xy(inner, points_px[:, 0], points_px[:, 1]).all()
    sliver = element(MultiPolygon(), shapely.box(40, 40, 60, 200))
    assert sample_points(image, sliver, CONFIG, seed=0).shape == (0, 2)


def test_weak_texture_is_matched_less_well() -> None:
    strong = render(camera_at([0, 0, 0]), texture())
    weak = (128 + (strong.astype(np.float64) - 128) / 20).astype(np.uint8)
    points_px = sample_points(strong, element(SEEN), CONFIG, seed=0)
    assert np.all(texture_sigma_px(strong, points_px, CONFIG) < 1.5 * CONFIG.sigma_px)
    assert np.all(texture_sigma_px(weak, points_px, CONFIG) > texture_sigma_px(strong, points_px, CONFIG))


def test_the_homography_of_a_turn_moves_points_at_infinity() -> None:
    a, b = camera_at([0, 0, 0], 3.0, 2.0), camera_at([5.0, -2.0, 1.0], 14.0, -5.0)
    directions = np.array([[0.1, 0.0, 1.0], [0.3, -0.2, 1.0]])
    far = [camera.project(1e9 * directions)[0] for camera in (a, b)]
    mapped = np.column_stack([far[0], np.ones(2)]) @ infinite_homography(a, b).T
    np.testing.assert_allclose(mapped[:, :2] / mapped[:, 2:], far[1], atol=1e-4)


def nothing_found(
    source: ImageArray, target: ImageArray, points_px: FloatArray, guess_px: FloatArray
) -> tuple[FloatArray, BoolArray]:
    return guess_px, np.zeros(len(points_px), dtype=bool)


def test_a_dense_flow_fits_the_interface(clip: Clip) -> None:
    dense: PairTracker = dense_flow
    found = track(clip.scene, CONFIG, seed=0, tracker=dense)
    assert len(found) > 0.8 * found.tried[0].sum()
    assert np.percentile(clip.errors_px(found), 95) < 0.3
    assert len(track(clip.scene, CONFIG, seed=0, tracker=nothing_found)) == 0


def test_the_same_seed_gives_the_same_bytes(clip: Clip, tracks: Tracks) -> None:
    again = track(clip.scene, CONFIG, seed=0)
    for name in ("key_frame", "element", "track", "frame", "points_px", "sigma_px"):
        assert getattr(again, name).tobytes() == getattr(tracks, name).tobytes(), name


def test_reach_and_progress(clip: Clip) -> None:
    steps: list[tuple[int, int]] = []
    found = track(clip.scene, replace(CONFIG, max_frames=2), seed=0, progress=lambda *step: steps.append(step))
    assert set(np.unique(found.frame)) == {2, 3, 4, 5, 6}
    assert steps == [(0, 1), (1, 1)]


@pytest.mark.parametrize(
    "box",
    [(0, 0, 40, 40), (150, 20, 213, 100), (40, 60, 170, 161), (0, 0, 213, 161), (90, 90, 91, 91), (64, 64, 128, 128)],
)
def test_corners_of_a_part_are_those_of_the_whole_image(box: tuple[int, int, int, int]) -> None:
    """Looked for around the part only; the image is no whole number of steps wide or high."""
    config = TrackingConfig()
    noise = np.random.default_rng(0).integers(0, 255, (161, 213), dtype=np.uint8)
    image: ImageArray = cv2.GaussianBlur(noise, (0, 0), 1.5).astype(np.uint8)
    mask = np.zeros(image.shape, dtype=bool)
    mask[box[1] : box[3], box[0] : box[2]] = True
    of_all = cv2.goodFeaturesToTrack(
        image,
        maxCorners=0,
        qualityLevel=config.corner_quality,
        minDistance=config.corner_distance_px,
        mask=mask.astype(np.uint8),
        blockSize=config.corner_block_px,
    )
    expected = np.empty((0, 2)) if of_all is None else of_all.reshape(-1, 2) + 0.5
    np.testing.assert_array_equal(_corners(image, mask, config), expected)
