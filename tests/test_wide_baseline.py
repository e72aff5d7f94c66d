"""Features found again in far frames: on a textured plane seen by known cameras, so that every position is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from test_tracking import Clip, camera_at, make_clip, render, texture

from gtlayout.scene import Camera, FloatArray, ImageArray, Scene
from gtlayout.tracking.config import FeatureConfig, TrackingConfig, WideBaselineConfig
from gtlayout.tracking.epipolar import EpipolarMatcher, Segments
from gtlayout.tracking.features import Features, SiftExtractor, VideoFeatures
from gtlayout.tracking.track import track
from gtlayout.tracking.tracks import Tracks, joined
from gtlayout.tracking.wide_baseline import with_wide_baselines
from simulated.simulated_room import as_multi

TRACKING, CONFIG, FEATURES = TrackingConfig(), WideBaselineConfig(), FeatureConfig()
EXTRACTOR = SiftExtractor(FEATURES.contrast, FEATURES.max_side_px, FEATURES.sigma_px)
FAR_APART = [camera_at([0.9 * (i - 2), 0.05 * i, 0.1 * i], 12.0 * (i - 2)) for i in range(5)]
"""Steps of 16° as seen from the plane: photographs, not a video."""


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    return make_clip(tmp_path_factory.mktemp("far"), FAR_APART, [2])


@pytest.fixture(scope="module")
def followed(clip: Clip) -> Tracks:
    return track(clip.scene, TRACKING, seed=0)


def features(clip: Clip) -> VideoFeatures:
    return VideoFeatures.of(clip.scene, FEATURES)


@pytest.fixture(scope="module")
def found(clip: Clip, followed: Tracks) -> Tracks:
    return with_wide_baselines(clip.scene, followed, features(clip), TRACKING, CONFIG)


def test_features_are_found_where_points_are_lost(clip: Clip, followed: Tracks, found: Tracks) -> None:
    assert len(followed) < 0.3 * followed.tried[0].sum()
    assert len(found) > 0.6 * found.tried[0].sum() > 50
    errors_px = clip.errors_px(found)
    assert np.median(errors_px[errors_px > 0]) < 0.5
    assert np.percentile(errors_px, 99) < CONFIG.tolerance_sigmas * found.sigma_px.max()
    # From one end of the path to the other.
    assert np.bincount(found.track).max() == len(FAR_APART)


def test_positions_keep_the_promised_sigma(clip: Clip, found: Tracks) -> None:
    """σ is of each coordinate, and holds errors of cameras, too, which there are none of here."""
    errors_px = clip.errors_px(found)
    assert np.sqrt(np.mean(errors_px[errors_px > 0] ** 2) / 2) < found.sigma_px[0]
    assert found.sigma_px[0] == pytest.approx(np.hypot(TRACKING.sigma_px, FEATURES.sigma_px))


def test_arrays_fit_together(clip: Clip, found: Tracks) -> None:
    assert np.array_equal(np.lexsort((found.frame, found.track)), np.arange(len(found.track)))
    assert np.array_equal(np.unique(found.track), np.arange(len(found)))
    assert np.bincount(found.track).min() >= TRACKING.min_observations
    for n in range(len(found)):
        at_key = found.points_px[(found.track == n) & (found.frame == 2)]
        assert len(at_key) == 1
        assert shapely.contains_xy(clip.scene.key_frames[0].elements[0].visible, *at_key[0])
    assert [tried.tolist() for tried in found.per_element()] == [[len(found)]]


def test_few_features_leave_an_element_its_tracks(clip: Clip, followed: Tracks) -> None:
    kept = with_wide_baselines(clip.scene, followed, features(clip), TRACKING, replace(CONFIG, min_tracks=10**6))
    assert_same(kept, followed)


def test_a_camera_that_only_turns_keeps_its_tracks(tmp_path: Path) -> None:
    clip = make_clip(tmp_path, [camera_at([0.0, 0.0, 0.0], 2.0 * i) for i in range(4)], [1])
    followed = track(clip.scene, TRACKING, seed=0)
    assert with_wide_baselines(clip.scene, followed, features(clip), TRACKING, CONFIG) is followed


def test_an_unreadable_image_is_stepped_over_and_named(tmp_path: Path) -> None:
    clip = make_clip(tmp_path, FAR_APART, [2])
    followed = track(clip.scene, TRACKING, seed=0)
    clip.scene.frames[4].image_path.write_bytes(b"no image")
    found = with_wide_baselines(clip.scene, followed, features(clip), TRACKING, CONFIG)
    assert found.unreadable == ("004.png",)
    assert len(found) > 20
    assert 4 not in found.frame


def test_the_same_scene_gives_the_same_bytes(clip: Clip, followed: Tracks, found: Tracks) -> None:
    assert_same(with_wide_baselines(clip.scene, followed, features(clip), TRACKING, CONFIG), found)


def test_any_extractor_fits(clip: Clip, followed: Tracks) -> None:
    """One that knows the world: its descriptors are noise, the same wherever a point of the plane is seen."""
    found = with_wide_baselines(
        clip.scene, followed, VideoFeatures.of(clip.scene, FEATURES, AllSeeing(clip)), TRACKING, CONFIG
    )
    assert len(found) == found.tried[0].sum() > 50
    assert clip.errors_px(found).max() < 1e-6


@dataclass
class AllSeeing:
    clip: Clip
    calls: int = 0

    def __call__(self, image: ImageArray) -> Features:
        frame, self.calls = self.calls, self.calls + 1
        rng = np.random.default_rng(3)
        key_px = rng.uniform([30, 30], [290, 210], (80, 2))
        descriptors = rng.normal(size=(80, 16)).astype(np.float32)
        unit = descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True)
        return Features(self.clip.where(key_px, 2, frame), unit, 0.0)


def test_clearest_feature_of_each_cell_is_used(clip: Clip, followed: Tracks) -> None:
    few = with_wide_baselines(clip.scene, followed, features(clip), TRACKING, replace(CONFIG, max_features=20))
    # The grid is of squares, so those at the border come on top.
    assert 15 <= few.tried[0].sum() <= 36


# ---------------------------------------------------------------------------------------------------- epipolar lines


@pytest.mark.parametrize(
    "target",
    [
        camera_at([0.5, 0.1, 0.0], 5.0),
        camera_at([0.0, 0.0, 0.4]),  # forward: the near part of a ray lies behind it
        camera_at([0.0, 0.0, -0.4]),
        camera_at([0.3, 0.0, 0.3], 140.0),  # looks back: hardly anything is seen
    ],
)
def test_every_point_in_front_lies_on_its_segment(target: Camera) -> None:
    source, nearest = camera_at([0.0, 0.0, 0.0]), 0.2
    rng = np.random.default_rng(1)
    pixels = rng.uniform([0, 0], [320, 240], (200, 2))
    depths = 0.2 / rng.uniform(0.0, 1.0, 200)
    seen_px, depth = target.project(depths[:, None] * source.rays_world(pixels))
    lines = Segments.of(pixels, source, target, nearest)
    inside = (depth > 0.05) & (np.abs(seen_px) < 2000).all(axis=1)
    pairs = set(zip(*(index.tolist() for index in lines.near(seen_px, 0.1)), strict=True))
    assert all((i, i) in pairs for i in np.nonzero(inside)[0])
    behind = lines.length_px < 0
    assert not any(i in np.nonzero(behind)[0] for i, _ in pairs)
    assert not np.any(behind & inside)


def test_points_off_the_line_or_too_near_are_no_candidates() -> None:
    source, target = camera_at([0.0, 0.0, 0.0]), camera_at([0.5, 0.0, 0.0])
    pixel = np.array([[160.0, 120.0]])
    lines = Segments.of(pixel, source, target, 1.0)
    ray = source.rays_world(pixel)
    on_line, too_near = (target.project(depth * ray)[0] for depth in (2.0, 0.5))
    candidates = np.concatenate([on_line, np.add(on_line, [0.0, 2.9]), np.add(on_line, [0.0, 3.1]), too_near])
    assert lines.near(candidates, 3.0)[1].tolist() == [0, 1]


MATCHER = EpipolarMatcher(nearest=0.2, tolerance_sigmas=3.0, max_ratio=0.85)


def matched(descriptors: FloatArray, others: FloatArray, key_px: FloatArray, other_px: FloatArray) -> list[list[int]]:
    """Pairs between a camera and one half a unit to its right, whose epipolar lines are the rows of the image."""
    key, other = (
        Features(points_px, (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32), 0.0)
        for points_px, rows in ((key_px, descriptors), (other_px, others))
    )
    a, b = camera_at([0.0, 0.0, 0.0]), camera_at([0.5, 0.0, 0.0])
    return [index.tolist() for index in MATCHER(key, a, np.array([0]), other, b, 1.0)]


def test_the_ratio_counts_only_candidates_on_the_line() -> None:
    """A twin elsewhere in the image is no rival, one on the line is."""
    look = np.eye(4)
    key_px = np.array([[200.0, 100.0]])
    assert matched(look[:1], look[[0, 0]], key_px, np.array([[150.0, 100.5], [150.0, 140.0]])) == [[0], [0]]
    assert matched(look[:1], look[[0, 0]], key_px, np.array([[150.0, 100.5], [170.0, 99.5]])) == [[], []]


def test_a_match_must_be_mutual() -> None:
    """Another feature of the key frame is more alike, and could be the same by the geometry."""
    looks = np.array([[1.0, 0.1, 0.0], [1.0, 0.0, 0.0]])
    other_px = np.array([[150.0, 100.0]])
    assert matched(looks, looks[1:], np.array([[200.0, 100.0], [220.0, 100.0]]), other_px) == [[], []]
    assert matched(looks, looks[1:], np.array([[200.0, 100.0], [220.0, 160.0]]), other_px) == [[0], [0]]


def test_no_feature_no_match() -> None:
    assert matched(np.eye(3)[:1], np.empty((0, 3)), np.array([[200.0, 100.0]]), np.empty((0, 2))) == [[], []]


# ---------------------------------------------------------------------------------------------------------- features


def test_sift_finds_a_point_where_it_is_in_a_shrunk_image() -> None:
    """The same features, twice as far from the corner, in an image of twice the size."""
    image = render(camera_at([0.0, 0.0, 0.0]), texture())
    large = np.kron(image, np.ones((2, 2), dtype=np.uint8))
    small, shrunk = EXTRACTOR(image), replace(EXTRACTOR, max_side_px=320)(large)
    assert len(small) == len(shrunk) > 50
    np.testing.assert_allclose(shrunk.points_px, 2 * small.points_px)
    np.testing.assert_allclose(np.linalg.norm(small.descriptors, axis=1), 1.0, atol=1e-5)
    assert (small.sigma_px, shrunk.sigma_px) == (0.3, 0.6)


def test_a_blank_image_has_no_features() -> None:
    features = EXTRACTOR(np.full((60, 80), 128, dtype=np.uint8))
    assert len(features) == 0
    assert features.points_px.shape == (0, 2)


# ------------------------------------------------------------------------------------------------------------ tracks


def test_joined_tracks_keep_their_observations(clip: Clip, followed: Tracks, found: Tracks) -> None:
    both = joined((followed, found), found.tried)
    assert len(both) == len(followed) + len(found)
    assert np.array_equal(np.lexsort((both.frame, both.track)), np.arange(len(both.track)))
    assert_same(both.only(np.arange(len(both)) < len(followed)), replace(followed, tried=found.tried))
    assert_same(both.only(np.arange(len(both)) >= len(followed)), found)


def test_tracks_are_sorted_by_key_frame(clip: Clip, found: Tracks) -> None:
    later = replace(found, key_frame=found.key_frame + 1)
    both = joined((later, found), (found.tried[0], found.tried[0]))
    assert both.key_frame.tolist() == sorted(both.key_frame)
    assert_same(both.only(both.key_frame == 1), replace(later, tried=both.tried))


def assert_same(a: Tracks, b: Tracks) -> None:
    for name in ("key_frame", "element", "track", "frame", "points_px", "sigma_px"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_array_equal(np.concatenate(a.tried), np.concatenate(b.tried))


def test_visible_parts_decide(clip: Clip, followed: Tracks) -> None:
    """Nothing is found on furniture, which visible parts leave out."""
    half = as_multi(shapely.box(30, 30, 120, 210))
    key_frame = clip.scene.key_frames[0]
    element = replace(key_frame.elements[0], visible=half)
    scene: Scene = replace(clip.scene, key_frames=(replace(key_frame, elements=(element,)),))
    found = with_wide_baselines(scene, followed, VideoFeatures.of(scene, FEATURES), TRACKING, CONFIG)
    assert len(found) > 20
    assert shapely.contains_xy(half, *found.points_px[found.frame == 2].T).all()
