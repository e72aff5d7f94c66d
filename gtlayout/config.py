"""Every tunable, with its unit and where it comes from. The resolved configuration is saved beside the results."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class TrackingConfig:
    """Stage 1."""


@dataclass(frozen=True)
class CorrespondenceConfig:
    """Stage 2."""


@dataclass(frozen=True)
class EdgeConfig:
    """Stage 3."""


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


@dataclass(frozen=True)
class QualityConfig:
    """Stage 7."""

    accept_iou: float = 0.8
    """A scene is accepted from this mean reprojection IoU on (paper 3.5)."""


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
