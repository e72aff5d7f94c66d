"""Tunables of stage 1."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackingConfig:
    """Stage 1."""

    spacing_px: float = 30.0
    """Mean spacing of the Sobol points on visible parts (paper 3.2)."""
    max_cells: int = 150
    """Most Sobol points on an element. Images of 640x480 px need up to 121; in full HD 6,000 corners would be tracked
    on a wall, of which a few hundred are used."""
    corners_per_cell: int = 8
    """Corners tracked in the cell round each Sobol point, best first."""
    corner_distance_px: float = 8.0
    """Minimum distance of two corners."""
    corner_quality: float = 0.002
    """Weakest corner taken, as a share of the element's best."""
    corner_block_px: int = 9
    """Window of the corner measure."""
    border_px: float = 3.0
    """Margin kept from the rim of a visible part and of the image."""
    sigma_px: float = 1.0
    """Noise of a point with good texture: matching, camera and rolling-shutter errors together."""
    weak_texture: float = 1e-4
    """Smaller eigenvalue of the structure tensor (grey values in 0..1) at which image noise adds as much as a pixel."""
    max_frames: int = 20
    """How far a point is followed each way."""
    min_observations: int = 3
    """Shorter tracks are dropped."""
    window_px: int = 21
    """Lucas-Kanade window."""
    levels: int = 3
    """Pyramid levels above the full image."""
    max_forward_backward_px: float = 0.7
    """A point must come back to where it started."""
    max_anchor_shift_px: float = 4.0
    """Largest correction by the key frame's own patch."""
    patch_px: int = 15
    """Patch compared with the key frame's."""
    min_correlation: float = 0.85
    """Least normalised cross-correlation of the two."""


@dataclass(frozen=True)
class TriangulationConfig:
    """Depths of the tracks, between stages 1 and 2."""

    cauchy: float = 2.0
    """Robust scale, in σ of an observation."""
    depth_range_paths: tuple[float, float] = (0.002, 1000.0)
    """Nearest and farthest depth that is looked at, in lengths of the camera's path."""
    depth_range_medians: tuple[float, float] = (0.06, 12.0)
    """Nearest and farthest depth that a track keeps, in median depths of all tracks."""


@dataclass(frozen=True)
class CameraRefinementConfig:
    """Bundle adjustment between stages 1 and 2. The unit of length is 1/2.5 of the median depth, as in stage 4."""

    sigma_rotation_deg: float = 0.05
    """How far the given rotations are trusted, about each axis."""
    sigma_position: float = 0.005
    """How far the given camera centres are trusted, along each axis."""
    looser: tuple[float, ...] = (4.0,)
    """Factors on both, tried in turn where the tracks say that the given poses are worse than that."""
    sigma_factor: float = 3.0
    """An observation counts with so many of its σ: the errors of a track come from one patch and are no news each."""
    cauchy: float = 0.5
    """Robust scale of an observation, in σ made so large."""
    sigma_point_depths: float = 5.0
    """Prior on a landmark round its start, in depths of it."""
    min_moved_share: float = 0.2
    """Share of tracks that must show parallax; below it the camera hardly moves and there is nothing to go by."""
    max_tracks: int = 2000
    """Random tracks that take part, held-out ones included."""
    max_observations: int = 20
    """Observations of a track that enter the graph, spread evenly over it."""
    max_iterations: int = 30
    """Levenberg-Marquardt iterations."""
    relative_decrease: float = 2e-3
    """The solve ends when an iteration lowers the cost by less than this share."""
    held_out_share: float = 0.25
    """Share of the tracks that the first refinement does not see and is judged by."""
    min_held_out: int = 20
    """Fewer of them prove nothing."""
    min_gain: float = 0.1
    """Share by which their robust cost must fall; below it the given cameras stay."""
    min_gain_looser: float = 0.25
    """Share by which it must fall once more for given poses to be trusted less."""
