"""Settings of stage 7."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class QualityConfig:
    """Stage 7."""

    accept_iou: float = 0.8
    """A scene is accepted from this mean reprojection IoU on (paper 3.5). An instance below it is weak."""
    max_sigma_normal_deg: float = 3.0
    """An instance with a larger σ of the normal is weak."""
    max_sigma_depth_share: float = 0.03
    """An instance with a larger σ of depth, as a share of the depth, is weak. In 90 synthetic rooms 5 of 6 planes whose
    depth is wrong by more than 5 % are weak, and of the planes that are not weak 1 in 50 is so wrong."""
    trusted_sigma_depth_share: float = 0.04
    """A scene is predicted trustworthy while the σ of depth, as a share of depth and in the mean over the drawn pixels,
    is at most this. Of 30 poor synthetic rooms 7 of the 9 whose mean error of depth is above 5 % are above it, and 8
    others. Where nothing is known the share is 1, so one pixel in 25 on unobservable instances is too much."""
    low_parallax_deg: float = 2.0
    """Less parallax is a cause of weakness: at 1 px noise and 500 px focal length a point is 6 % of its depth off."""
    few_tracks: float = 20.0
    """Fewer tracks are a cause of weakness. From this number on stage 4 trusts an instance fully."""
    low_survival: float = 0.1
    """A smaller share of surviving points is a cause of weakness. Good surfaces keep 0.4, glossy ones 0.02."""
    disagreeing_share: float = 0.5
    """Tracks and contact edges disagree, a cause of weakness, when more than this share of the tracks is outvoted."""
    disagreeing_edge_px: float = 5.0
    """Tracks and contact edges also disagree when the edges are further than this from where planes meet: 3 σ of a
    drawn edge."""
    min_frame_iou: float = 0.5
    """A scene with a key frame below this IoU is not trusted, whatever the mean: half of that frame is wrong."""
    known_sigma_depth_share: float = 0.1
    """Depth is known where its σ is at most this share of the depth."""
    min_known_share: float = 0.5
    """A scene in which depth is known for less than this share of the drawn pixels is to be redone."""
    min_ok_share: float = 0.5
    """A scene is not trusted when less than this share of its drawn pixels lies on instances that are ok."""
    min_room_depth_m: float = 0.3
    max_room_depth_m: float = 30.0
    """How far away the middle point of a room may be. Beyond these two the unit of a metric scene is not trusted."""
    max_camera_height_m: float = 10.0
    """Above the floor, likewise: no one films a room from higher up."""
    room_quantile: float = 0.95
    """The size of a room is this quantile of the distances of all drawn pixels whose depth is known."""
    max_reach: float = 1.6
    """An extent is out of all proportion when it reaches this multiple of that size from every camera that it was drawn
    in. In 30 synthetic rooms and 4 real clips extents that are right reach 1.3 times, those that wrong labels
    or elements threw across the room 1.7 to 5.7 times."""
