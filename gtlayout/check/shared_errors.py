"""Do all cameras share an error that tracks show over their whole length: of the focal length, a drift, a delay?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtlayout.camera_errors.find import find_camera_errors
from gtlayout.camera_errors.wording import camera_error_lines
from gtlayout.check.images import Matches
from gtlayout.scene import KeyFrame, Scene
from gtlayout.tracking.config import (
    CameraErrorConfig,
    FeatureConfig,
    ImageMatchConfig,
    TrackingConfig,
    TriangulationConfig,
)
from gtlayout.tracking.features import VideoFeatures
from gtlayout.tracking.image_matches import camera_evidence
from gtlayout.tracking.tracks import Tracks


def shared_error_suspicions(scene: Scene, matches: list[Matches]) -> list[str]:
    """A line for each error that is larger than its σ; a solve looks again, with its own tracks, and may correct it."""
    sources = sorted({m.source for m in matches})
    sampled = replace(scene, key_frames=tuple(KeyFrame(frame, ()) for frame in sources))
    tracks = _tracks(matches, sources)
    features = VideoFeatures.of(sampled, FeatureConfig())
    evidence = camera_evidence(sampled, features, tracks, TrackingConfig().sigma_px, ImageMatchConfig())
    doubt = find_camera_errors(sampled, evidence.judges, CameraErrorConfig(), TriangulationConfig(), seed=0)
    return [line.split(";")[0] for line in camera_error_lines(scene, doubt)]


def _tracks(matches: list[Matches], sources: list[int]) -> Tracks:
    """The points as tracks, each sampled in the frame it was followed from."""
    key_frame, frame, points, track = [], [], [], []
    count = 0
    for m in matches:
        steps = ((m.source, m.source_px), *m.between, (m.target, m.target_px))
        numbers = count + np.arange(len(m.source_px))
        count += len(numbers)
        key_frame.append(np.full(len(numbers), sources.index(m.source)))
        track.append(np.tile(numbers, len(steps)))
        frame.append(np.repeat([of for of, _ in steps], len(numbers)))
        points.append(np.concatenate([points_px for _, points_px in steps]))
    order = np.lexsort((np.concatenate(frame), np.concatenate(track)))
    return Tracks(
        key_frame=np.concatenate(key_frame),
        element=np.zeros(count, dtype=np.int64),
        track=np.concatenate(track)[order],
        frame=np.concatenate(frame)[order],
        points_px=np.concatenate(points)[order],
        sigma_px=np.full(count, TrackingConfig().sigma_px),
        tried=(),
    )
