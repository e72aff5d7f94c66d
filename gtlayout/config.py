"""Every tunable, with its unit and where it comes from. The resolved configuration is saved beside the results."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class TrackingConfig:
    """Stage 1."""

    spacing_px: float = 30.0
    """Mean spacing of the Sobol points on visible parts (paper 3.2)."""
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
    max_frames: int = 40
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
class CorrespondenceConfig:
    """Stage 2."""


@dataclass(frozen=True)
class EdgeConfig:
    """Stage 3."""

    max_gap_px: float = 4.0
    """Two boundaries closer than this run along each other."""
    step_px: float = 4.0
    """Distance of the samples on a contact edge."""
    min_length_px: float = 20.0
    """Shorter contacts say nothing about a line."""
    straightness_px: float = 6.0
    """A pair's points further than this from their common line are not contact."""
    occlusion_px: float = 6.0
    """Reach of an annotated occlusion edge."""
    border_px: float = 3.0
    """Boundaries this close to the image border are cut by the image, not by a neighbour."""


@dataclass(frozen=True)
class EstimationConfig:
    """Stage 4."""


@dataclass(frozen=True)
class ExtentConfig:
    """Stages 5 and 6."""

    max_growth: float = 0.10
    """Refinement extends an element to its neighbour's plane when its area grows by at most this share (paper 3.4)."""
    max_cut: float = 0.10
    """… and cuts a piece beyond the neighbour's plane when it is less than this share of the area (paper 3.4)."""
    min_angle_deg: float = 10.0
    """Planes that meet at less than this angle have no intersection line worth refining to."""
    max_depth_ratio: float = 10.0
    """A key frame's polygon is clipped where its plane is farther than this many times the scene's median depth."""
    min_horizon_px: float = 10.0
    """… and where it comes closer than this to the plane's horizon: one pixel there moves the point by a tenth of its depth."""
    min_piece: float = 0.005
    """Separate pieces and holes below this share of an element's area are gaps between drawn polygons: dropped."""


@dataclass(frozen=True)
class QualityConfig:
    """Stage 7."""

    accept_iou: float = 0.8
    """A scene is accepted from this mean reprojection IoU on (paper 3.5); an element below it is weak."""
    max_sigma_normal_deg: float = 3.0
    """An element whose normal is less certain is weak."""
    max_sigma_depth_share: float = 0.05
    """An element whose depth is less certain, as a share of that depth, is weak."""


@dataclass(frozen=True)
class Config:
    """All stages."""

    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    correspondence: CorrespondenceConfig = field(default_factory=CorrespondenceConfig)
    edges: EdgeConfig = field(default_factory=EdgeConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    extent: ExtentConfig = field(default_factory=ExtentConfig)
    quality: QualityConfig = field(default_factory=QualityConfig)
    seed: int = 0
