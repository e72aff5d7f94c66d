"""Tunables of joining and splitting."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RegroupingConfig:
    """After stage 4: instances that are one plane are joined, those that are two are split."""

    rounds: int = 3
    """How often the instances are looked at, and solved again when that changes them."""
    max_chi2: float = 11.34
    """Two planes agree up to this χ² of their difference: the 99 % quantile for its 3 degrees of freedom."""
    max_sigma_share: float = 0.05
    """… which only says something when the σ of their distance is no more than this share of the depth …"""
    max_gap_share: float = 0.03
    """… and, should σ be too wide, when they are no further apart than this share of it …"""
    max_angle_deg: float = 6.0
    """… nor at a larger angle."""
    max_reach_share: float = 0.05
    """Two parts of one plane overlap, or lie no further from each other than this share of the depth."""
    min_opening_overlap: float = 0.25
    """Two drawings of one door or window overlap by this share of the smaller."""
    max_contradicted: float = 0.4
    """Most that key frames may show of something else where the other part should be, as a share."""
    min_tracks: int = 10
    """A drawing with fewer tracks does not tell where its plane is."""
    relative_depth_sigma: float = 0.02
    """Camera and tracking errors that a drawing's tracks share, as a share of depth."""
    track_cauchy: float = 2.0
    """Robust scale of a track, in σ."""
    track_cutoff: float = 3.0
    """A track off by more σ does not lie on the plane."""
    max_truncated_loss: float = 0.6
    """Two planes explain an instance when each leaves no more than this share of any of its drawings unexplained …"""
    min_loss_on_other: float = 0.6
    """… and no less of the other plane's, on average …"""
    min_gain: float = 0.5
    """… and when so many drawings more than by the best single plane are explained."""
    max_shown_as_one: float = 0.4
    """Most that key frames may show of one part where the other should be, as a share."""
