"""Features matched over whole images, without the cameras: on a textured plane, so that every position is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_tracking import Clip, camera_at, make_clip

from gtlayout.scene import IntArray
from gtlayout.tracking.config import FeatureConfig, ImageMatchConfig, TrackingConfig
from gtlayout.tracking.features import Features, VideoFeatures
from gtlayout.tracking.image_matches import _Image, _matched, _most_alike, _spread, camera_evidence, match_images
from gtlayout.tracking.track import track
from gtlayout.tracking.tracks import Tracks

CONFIG, FEATURES = ImageMatchConfig(), FeatureConfig()
SIGMA_PX = TrackingConfig().sigma_px
ARC = [camera_at([0.25 * (i - 3), 0.1 * (i % 3), 0.15 * (i % 2)], 4.0 * (i - 3)) for i in range(7)]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    return make_clip(tmp_path_factory.mktemp("arc"), ARC, [1, 5])


@pytest.fixture(scope="module")
def features(clip: Clip) -> VideoFeatures:
    return VideoFeatures.of(clip.scene, FEATURES)


@pytest.fixture(scope="module")
def matched(clip: Clip, features: VideoFeatures) -> Tracks:
    return match_images(clip.scene, features, SIGMA_PX, CONFIG)


def test_features_are_found_again_where_they_are(clip: Clip, matched: Tracks) -> None:
    assert len(matched) > 100
    errors_px = clip.errors_px(matched)
    assert np.median(errors_px[errors_px > 0]) < 0.5
    assert np.percentile(errors_px, 95) < 2.0
    assert np.bincount(matched.track).min() >= 3, "the key frame and two others"
    assert np.bincount(matched.track).max() == len(ARC)
    assert set(matched.key_frame) == {0, 1}
    assert np.all(matched.element == -1)
    assert np.array_equal(np.lexsort((matched.frame, matched.track)), np.arange(len(matched.track)))


def test_wrong_cameras_change_nothing(clip: Clip, features: VideoFeatures, matched: Tracks) -> None:
    """That is what they are for. Features that are looked for along epipolar lines are other ones then."""
    nowhere = camera_at([5.0, -3.0, 1.0], 100.0, 20.0)
    wrong = replace(clip.scene, frames=tuple(replace(frame, camera=nowhere) for frame in clip.scene.frames))
    again = match_images(wrong, features, SIGMA_PX, CONFIG)
    assert np.array_equal(again.points_px, matched.points_px)
    assert np.array_equal(again.frame, matched.frame)


def test_furniture_is_evidence_as_well(clip: Clip, features: VideoFeatures, matched: Tracks) -> None:
    """Nothing needs to be drawn, let alone marked as visible."""
    blank = replace(clip.scene, key_frames=tuple(replace(k, elements=()) for k in clip.scene.key_frames))
    again = match_images(blank, features, SIGMA_PX, CONFIG)
    assert np.array_equal(again.points_px, matched.points_px)


def test_at_most_so_many_tracks_the_longest_of_each_cell(clip: Clip, features: VideoFeatures, matched: Tracks) -> None:
    few = match_images(clip.scene, features, SIGMA_PX, replace(CONFIG, max_tracks=20))
    assert 2 * 10 < len(few) < 2 * 36 < len(matched)
    assert np.bincount(few.track).mean() > np.bincount(matched.track).mean()


def test_images_that_do_not_agree_on_a_geometry_are_not_matched() -> None:
    rng = np.random.default_rng(0)
    descriptors = rng.normal(size=(60, 32)).astype(np.float32)
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    a, b = (Features(rng.uniform(0, 300, (60, 2)), descriptors, 0.3) for _ in range(2))
    assert len(_most_alike(_Image.of(a), _Image.of(b), CONFIG.max_ratio)[0]) == 60, "alike they are"
    assert len(_matched(_Image.of(a), _Image.of(b), CONFIG)[0]) == 0
    moved = replace(b, points_px=a.points_px + np.array([3.0, 1.0]))
    assert len(_matched(_Image.of(a), _Image.of(moved), CONFIG)[0]) == 60
    few = np.arange(CONFIG.min_matches - 1)
    assert len(_matched(_Image.of(a.only(few)), _Image.of(a.only(few)), CONFIG)[0]) == 0


def test_a_pair_that_opencv_fails_on_costs_only_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCV 5.0's MAGSAC raises on some sets of points, for no fault of theirs; which ones differs by its version."""

    def fails(*_arguments: object) -> None:
        raise cv2.error("(-215:Assertion failed) !model.empty() in function 'setModelParameters'")

    rng = np.random.default_rng(0)
    a = _Image.of(Features(rng.uniform(0, 300, (60, 2)), np.eye(60, dtype=np.float32), 0.3))
    assert len(_matched(a, a, CONFIG)[0]) == 60
    monkeypatch.setattr(cv2, "findFundamentalMat", fails)
    assert len(_matched(a, a, CONFIG)[0]) == 0


def test_what_has_a_second_match_or_a_better_one_is_left_out() -> None:
    eye = np.eye(4, dtype=np.float32)
    mix = np.array([[0.8, 0.6, 0.0, 0.0]], dtype=np.float32)
    a = Features(np.zeros((3, 2)), np.concatenate([eye[:2], mix]), 0.3)
    b = Features(np.zeros((3, 2)), eye[[1, 0, 0]], 0.3)
    mine, theirs = _most_alike(_Image.of(a), _Image.of(b), 0.8)
    # Feature 0 is twice in b; the mixture is most like it, too, but like feature 1 alone nothing else is.
    assert (mine.tolist(), theirs.tolist()) == ([1], [0])


def test_features_are_spread_over_the_image() -> None:
    """One of each cell before the second of any, and the clearest of those."""
    crowd = np.column_stack([np.linspace(1, 9, 30), np.full(30, 5.0)])
    alone = np.array([[95.0, 95.0], [55.0, 5.0]])
    points_px = np.concatenate([crowd, alone])
    features = Features(points_px, np.ones((32, 4), dtype=np.float32), 0.3)
    kept: IntArray = _spread(features, (100, 100), 4)
    assert kept.tolist() == [0, 1, 30, 31]


def test_few_features_are_no_evidence_by_themselves(clip: Clip, features: VideoFeatures, matched: Tracks) -> None:
    followed = track(clip.scene, TrackingConfig(), seed=0)
    alone = camera_evidence(clip.scene, features, followed, SIGMA_PX, replace(CONFIG, enough_tracks=len(matched)))
    both = camera_evidence(clip.scene, features, followed, SIGMA_PX, replace(CONFIG, enough_tracks=len(matched) + 1))
    assert len(alone.judges) == len(matched)
    assert len(both.judges) == len(both.every) == len(alone.every) == len(matched) + len(followed)


def test_without_features_nothing_is_matched(tmp_path: Path) -> None:
    clip = make_clip(tmp_path, ARC[:3], [1])
    for frame in clip.scene.frames:
        frame.image_path.write_bytes(b"no image")
    found = VideoFeatures.of(clip.scene, FEATURES)
    assert found.unreadable == ("000.png", "001.png", "002.png")
    assert len(match_images(clip.scene, found, SIGMA_PX, CONFIG)) == 0
