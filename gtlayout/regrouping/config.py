"""Settings of joining and splitting."""

from __future__ import annotations

from dataclasses import dataclass, field

from gtlayout.prediction.config import PredictionConfig


@dataclass(frozen=True)
class RegroupingConfig:
    """After stage 4: instances that are one plane are joined, those that are two are split."""

    rounds: int = 3
    """Most rounds of joining and splitting. After each that changes instances the planes are solved again."""
    max_chi2: float = 11.34
    """Two planes agree up to this χ² of their difference: the 99 % quantile for its 3 degrees of freedom."""
    max_sigma_share: float = 0.05
    """They agree only if the σ of their distance is at most this share of the depth: a large σ agrees with anything."""
    max_gap_share: float = 0.03
    """They agree only if they are no further apart than this share of the depth, in case σ is too large."""
    max_angle_deg: float = 6.0
    """They agree only if the angle between them is at most this."""
    max_reach_share: float = 0.05
    """Two parts of one plane overlap, or lie no further from each other than this share of the depth."""
    min_opening_overlap: float = 0.25
    """Two elements of one door or window overlap by at least this share of the smaller."""
    max_contradicted: float = 0.4
    """Largest share of the votes by which key frames may show something else where the other part should be."""
    min_tracks: int = 10
    """An element with fewer tracks is not used to find two planes."""
    relative_depth_sigma: float = 0.02
    """Camera and tracking errors that the tracks of an element have in common, as a share of depth."""
    track_cauchy: float = 2.0
    """Robust scale of a track, in σ."""
    track_cutoff: float = 3.0
    """A track that is off by more σ does not lie on the plane."""
    max_truncated_loss: float = 0.6
    """Two planes explain an instance only if each leaves at most this share of any of its elements unexplained."""
    min_loss_on_other: float = 0.6
    """They explain it only if each leaves at least this share of the other plane's elements unexplained, on average."""
    min_gain: float = 0.5
    """They explain it only if they explain this many elements more than the best single plane."""
    max_shown_as_one: float = 0.4
    """Largest share of the votes by which key frames may show one part where the other should be."""
    prediction: PredictionConfig = field(default_factory=PredictionConfig)
    """How the elements of a key frame are matched to what all other key frames predict in it."""
    min_known_share: float = 0.25
    """An element is compared with an instance only where the others predict something on at least this share of it, and
    something is drawn on at least this share of what they predict of the instance."""
    min_swapped_iou: float = 0.8
    """Two elements have each other's label when each matches an instance of the other label with at least this IoU."""
    max_contradicted_iou: float = 0.3
    """An element contradicts the others when its IoU with what they predict of its instance is below this. On real
    clips right drawings have .74 and more."""
    max_alone_iou: float = 0.1
    """One that does so alone in its key frame is left out only below this: a small element need not be far off."""
    min_others: int = 2
    """It does so only if at least this many others agree on its instance: of two nobody knows which is wrong."""
    min_rejoin_iou: float = 0.5
    """An element rejoins the instance that it looks like with at least this IoU: one that nothing places, or that looks
    less like its own."""
    max_contradicted_share: float = 0.5
    """A key frame is left out as a whole when elements with more than this share of its drawn area contradict."""
    max_others_beyond: float = 0.05
    """A wall ends at a floor or ceiling when at most this share of what other key frames draw of it lies beyond."""
    min_beyond_share: float = 0.1
    """An element reaches through that floor or ceiling when at least this share of it lies beyond …"""
    min_beyond_px: float = 30.0
    """… as far as this from the line where the wall ends, px of an image of 640x480."""
