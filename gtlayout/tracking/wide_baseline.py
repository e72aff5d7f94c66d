"""Stage 1, second part: features of the key frames found again in far frames, where nothing can be followed.

Points that are followed from frame to frame are lost where frames lie far apart, and those that are kept have seen
little parallax. A feature is found again over any distance, because the cameras are known: it is on its epipolar line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from shapely import contains_xy

from gtlayout.memory import Memory
from gtlayout.scene import BoolArray, Camera, Element, FloatArray, IntArray, Scene
from gtlayout.threads import in_threads
from gtlayout.tracking.config import TrackingConfig, WideBaselineConfig
from gtlayout.tracking.epipolar import EpipolarMatcher
from gtlayout.tracking.features import Features, VideoFeatures
from gtlayout.tracking.tracks import Tracks, joined
from gtlayout.tracking.triangulation import camera_path

_NO_MATCH = -1


def with_wide_baselines(
    scene: Scene,
    tracks: Tracks,
    features: VideoFeatures,
    tracking: TrackingConfig,
    config: WideBaselineConfig,
    memory: Memory | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Tracks:
    """The ``tracks`` with those of ``features`` found again in far frames, which replace the others of their element.

    An element with fewer than ``config.min_tracks`` of them keeps the tracks that it has. Nothing changes where the
    camera does not move. ``memory`` keeps what was found of each key frame, for one extractor of features. ``progress``
    is called with (key frames done, key frames in all).
    """
    path = camera_path(scene)
    if path == 0.0:
        return tracks
    wide = _found_again(scene, path, features, tracking, config, memory or Memory(), progress)
    replaced = [count >= config.min_tracks for count in wide.per_element()]
    tried = tuple(
        np.where(chosen, ours, theirs) for chosen, ours, theirs in zip(replaced, wide.tried, tracks.tried, strict=True)
    )
    first_of = np.cumsum([0, *map(len, tried)])
    flat = np.concatenate(replaced)
    of_wide, of_others = (flat[first_of[part.key_frame] + part.element] for part in (wide, tracks))
    return joined((tracks.only(~of_others), wide.only(of_wide)), tried)


@dataclass(frozen=True)
class _FoundAgain:
    """The n features of one key frame that were found again."""

    element: tuple[int, ...]
    sigma_px: float
    observed: tuple[_Seen, ...]
    tried: IntArray
    """(elements,)."""


def _found_again(
    scene: Scene,
    path: float,
    found: VideoFeatures,
    tracking: TrackingConfig,
    config: WideBaselineConfig,
    memory: Memory,
    progress: Callable[[int, int], None],
) -> Tracks:
    """Tracks of the features on all elements."""
    key_frame: list[int] = []
    element: list[int] = []
    sigma: list[float] = []
    observed: list[_Seen] = []
    tried = []

    def of_key_frame(k: int) -> _FoundAgain | None:
        key, elements = scene.key_frames[k].frame, scene.key_frames[k].elements
        if key not in found.of_frame:
            return None
        near = found.nearest(key, config.max_frames)
        seen = [(f, scene.frames[f].name, scene.frames[f].image_path, scene.frames[f].camera) for f in (key, *near)]
        return memory.of(
            "wide baselines of a key frame",
            (seen, path, [one.visible for one in elements], tracking, config),
            partial(_of_key_frame, scene, path, found, k, near, tracking, config),
        )

    for k, of_key in enumerate(in_threads(of_key_frame, range(len(scene.key_frames)))):
        progress(k + 1, len(scene.key_frames))
        if of_key is None:
            tried.append(np.zeros(len(scene.key_frames[k].elements), dtype=np.int64))
            continue
        tried.append(of_key.tried)
        key_frame += [k] * len(of_key.element)
        element += of_key.element
        sigma += [of_key.sigma_px] * len(of_key.element)
        observed += of_key.observed
    return _tracks(key_frame, element, sigma, observed, tuple(tried), found.unreadable)


def _of_key_frame(
    scene: Scene,
    path: float,
    found: VideoFeatures,
    k: int,
    near: Sequence[int],
    tracking: TrackingConfig,
    config: WideBaselineConfig,
) -> _FoundAgain:
    """The features on the elements of key frame ``k`` found again in the frames ``near``."""
    matcher = EpipolarMatcher(config.nearest_paths * path, config.tolerance_sigmas, config.max_ratio)
    key, elements, features = scene.key_frames[k].frame, scene.key_frames[k].elements, found.of_frame
    own, on_element = _on_elements(features[key], elements, config.max_features)
    sigma_px = float(np.hypot(tracking.sigma_px, features[key].sigma_px))
    key_px = features[key].points_px[own]
    found_px = _matches(scene, matcher, features, key, own, near, sigma_px)
    cameras = [scene.frames[f].camera for f in near]
    agree = _agreeing(scene.frames[key].camera, key_px, cameras, found_px, sigma_px, config)
    enough = np.nonzero(agree.sum(axis=1) + 1 >= tracking.min_observations)[0]
    frames = np.array(near, dtype=np.int64)
    return _FoundAgain(
        tuple(on_element[enough].tolist()),
        sigma_px,
        tuple(_Seen(frames[agree[i]], found_px[i, agree[i]]).with_key(key, key_px[i]) for i in enough),
        np.bincount(on_element, minlength=len(elements)),
    )


def _on_elements(features: Features, elements: Sequence[Element], most: int) -> tuple[IntArray, IntArray]:
    """(n,) features on the visible parts of ``elements``, the clearest of each cell of a grid, and (n,) their element.

    Where visible parts of two elements overlap, the later one has them.
    """
    on = np.full(len(features), -1)
    for e, element in enumerate(elements):
        on[contains_xy(element.visible, features.points_px[:, 0], features.points_px[:, 1])] = e
    chosen = [np.empty(0, dtype=np.int64)]
    for e, element in enumerate(elements):
        mine = np.nonzero(on == e)[0]
        if len(mine):
            corner = np.array(element.visible.bounds[:2])
            cell_px = np.sqrt(element.visible.area / most)
            cells = np.floor((features.points_px[mine] - corner) / cell_px).astype(np.int64)
            # Features come clearest first, and the first of each cell is taken.
            _, first = np.unique(cells, axis=0, return_index=True)
            chosen.append(mine[np.sort(first)])
    index = np.concatenate(chosen)
    return index, on[index]


@dataclass(frozen=True)
class _Seen:
    """Where one feature was found again: n frames, ascending."""

    frame: IntArray
    points_px: FloatArray

    def with_key(self, key: int, point_px: FloatArray) -> _Seen:
        """With the feature itself in its key frame."""
        at = int(np.searchsorted(self.frame, key))
        return _Seen(np.insert(self.frame, at, key), np.insert(self.points_px, at, point_px, axis=0))


def _matches(
    scene: Scene,
    matcher: EpipolarMatcher,
    features: Mapping[int, Features],
    key: int,
    own: IntArray,
    frames: Sequence[int],
    sigma_px: float,
) -> FloatArray:
    """(n, F, 2) where each feature ``own`` of frame ``key`` is found in each of ``frames``, px; NaN where it is not."""
    points_px = np.full((len(own), len(frames), 2), np.nan)
    row_of = np.full(len(features[key]), -1)
    row_of[own] = np.arange(len(own))
    for column, f in enumerate(frames):
        index, found = matcher(
            features[key], scene.frames[key].camera, own, features[f], scene.frames[f].camera, sigma_px
        )
        points_px[row_of[index], column] = features[f].points_px[found]
    return points_px


def _agreeing(
    key: Camera,
    key_px: FloatArray,
    cameras: Sequence[Camera],
    points_px: FloatArray,
    sigma_px: float,
    config: WideBaselineConfig,
) -> BoolArray:
    """(n, F) which matches of a feature agree on its depth; none of one of which these are too small a share.

    Every match proposes its depth, and the one that most others confirm is taken.

    Args:
        key: Camera of the features.
        key_px: (n, 2) the features.
        cameras: F others.
        points_px: (n, F, 2) where these see them; NaN = not found.
    """
    if not cameras:
        return np.zeros((len(key_px), 0), dtype=bool)
    far = np.stack([key.rays_world(key_px) @ (c.K @ c.R_cam_from_world).T for c in cameras], axis=1)
    slope = np.array([c.K @ (c.R_cam_from_world @ key.center_world + c.t_cam_from_world) for c in cameras])
    # A pixel u is met where the first two coordinates of far + ρ slope are u times the third.
    a = slope[:, :2] - points_px * slope[:, 2:]
    b = points_px * far[:, :, 2:] - far[:, :, :2]
    rho = np.maximum(np.sum(a * b, axis=2) / np.maximum(np.sum(a * a, axis=2), 1e-12), 0.0)
    image = far[:, None] + rho[:, :, None, None] * slope
    image_px = image[..., :2] / np.where(image[..., 2:] > 0, image[..., 2:], np.nan)
    off_px = np.linalg.norm(image_px - points_px[:, None], axis=3)
    near = off_px < config.tolerance_sigmas * sigma_px
    best = near.sum(axis=2).argmax(axis=1)
    kept: BoolArray = near[np.arange(len(near)), best]
    found = np.isfinite(points_px[:, :, 0]).sum(axis=1)
    return kept & (kept.sum(axis=1) >= config.min_agreement * found)[:, None]


def _tracks(
    key_frame: Sequence[int],
    element: Sequence[int],
    sigma_px: Sequence[float],
    observed: Sequence[_Seen],
    tried: tuple[IntArray, ...],
    unreadable: tuple[str, ...],
) -> Tracks:
    lengths = [len(seen.frame) for seen in observed]
    return Tracks(
        key_frame=np.array(key_frame, dtype=np.int64),
        element=np.array(element, dtype=np.int64),
        track=np.repeat(np.arange(len(lengths)), lengths),
        frame=np.concatenate([np.empty(0, dtype=np.int64), *(seen.frame for seen in observed)]),
        points_px=np.concatenate([np.empty((0, 2)), *(seen.points_px for seen in observed)]),
        sigma_px=np.array(sigma_px),
        tried=tried,
        unreadable=unreadable,
    )
