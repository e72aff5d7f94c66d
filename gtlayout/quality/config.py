"""Tunables of stage 7."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class QualityConfig:
    """Stage 7."""

    accept_iou: float = 0.8
    """A scene is accepted from this mean reprojection IoU on (paper 3.5); an element below it is weak."""
    max_sigma_normal_deg: float = 3.0
    """An element whose normal is less certain is weak."""
    max_sigma_depth_share: float = 0.03
    """An element whose depth is less certain, as a share of that depth, is weak: so are 5 of 6 planes whose depth is
    wrong by more than 5 %, in 90 synthetic rooms, and of the others 1 in 50 is so wrong."""
    trusted_sigma_depth_share: float = 0.04
    """A scene is predicted trustworthy while the σ of depth, as a share of depth and in the mean over the drawn pixels,
    is at most this. Of 30 poor synthetic rooms 7 of the 9 whose mean error of depth is above 5 % are above it, and 8
    others. Where nothing is known the share is 1: one pixel in 25 on unobservable surfaces is too much."""
    low_parallax_deg: float = 2.0
    """Named as a cause of weakness: at 1 px noise and 500 px focal length a point is then off by 6 % of its depth."""
    few_tracks: float = 20.0
    """Named as a cause: fewer than these, from which on stage 4 trusts a surface fully."""
    low_survival: float = 0.1
    """Named as a cause: good surfaces keep 0.4 of the points sampled on them, glossy ones 0.02."""
    disagreeing_share: float = 0.5
    """Named as a cause: tracks and contact edges disagree when so many of the tracks were given up …"""
    disagreeing_edge_px: float = 5.0
    """… or when the contact edges are so far from the line in which the planes meet: 3 σ of one drawn by hand."""
    min_frame_iou: float = 0.5
    """A scene with a key frame below this IoU is not trusted, whatever the mean: half of that frame is wrong."""
    known_sigma_depth_share: float = 0.1
    """Depth is known where its σ is at most this share of it …"""
    min_known_share: float = 0.5
    """… and a scene in which it is known for less than this share of the drawn pixels is of no use."""
    min_ok_share: float = 0.5
    """A scene is not trusted when less than this share of its drawn pixels lies on elements that are ok."""
    room_quantile: float = 0.95
    """A room is as large as this quantile of the distances of all drawn pixels whose depth is known …"""
    max_reach: float = 1.6
    """… and an element that reaches so many times as far from every camera that it was drawn in is out of all
    proportion. In 30 synthetic rooms and 4 real clips extents that are right reach 1.3 times, those that wrong labels
    or drawings threw across the room 1.7 to 5.7 times."""
