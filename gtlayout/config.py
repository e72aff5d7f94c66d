"""Every setting, with its unit and its source. The resolved configuration is saved beside the results."""

from __future__ import annotations

from dataclasses import dataclass, field

from gtlayout.accuracy import UPPER_ENDS_M
from gtlayout.closing_config import ClosingConfig
from gtlayout.correspondence.config import CorrespondenceConfig
from gtlayout.curved.config import CurvedConfig
from gtlayout.edges import EdgeConfig
from gtlayout.errors import GtlayoutError
from gtlayout.extent.config import ExtentConfig
from gtlayout.flatness.config import FlatnessConfig
from gtlayout.planes.config import EstimationConfig
from gtlayout.quality.config import QualityConfig
from gtlayout.regrouping.config import RegroupingConfig
from gtlayout.tracking.config import (
    CameraErrorConfig,
    CameraRefinementConfig,
    FeatureConfig,
    ImageMatchConfig,
    TrackingConfig,
    TriangulationConfig,
    WideBaselineConfig,
)


@dataclass(frozen=True)
class Config:
    """All stages."""

    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    features: FeatureConfig = field(default_factory=FeatureConfig)
    image_matches: ImageMatchConfig = field(default_factory=ImageMatchConfig)
    wide_baseline: WideBaselineConfig = field(default_factory=WideBaselineConfig)
    triangulation: TriangulationConfig = field(default_factory=TriangulationConfig)
    camera_errors: CameraErrorConfig = field(default_factory=CameraErrorConfig)
    camera_refinement: CameraRefinementConfig = field(default_factory=CameraRefinementConfig)
    correspondence: CorrespondenceConfig = field(default_factory=CorrespondenceConfig)
    edges: EdgeConfig = field(default_factory=EdgeConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    regrouping: RegroupingConfig = field(default_factory=RegroupingConfig)
    curved: CurvedConfig = field(default_factory=CurvedConfig)
    extent: ExtentConfig = field(default_factory=ExtentConfig)
    quality: QualityConfig = field(default_factory=QualityConfig)
    flatness: FlatnessConfig = field(default_factory=FlatnessConfig)
    closing: ClosingConfig = field(default_factory=ClosingConfig)
    seed: int = 0
    """Seed of all random numbers. The same seed gives the same bytes on one kind of processor."""
    refine_cameras: bool = True
    """Whether to refine the camera poses, where that proves itself, before stage 2."""
    restarts: int = 1
    """Number of solves, of which the one with the best reprojection IoU is kept (paper 3.5: 100)."""
    restart_share: float = 0.8
    """Random share of the tracks that each solve after the first uses."""

    loa: int = 20
    """The level of accuracy that surfaces and dimensions are held against: 10, 20, 30 or 40."""

    def __post_init__(self) -> None:
        if self.restarts < 1 or self.seed < 0:
            raise GtlayoutError(f"restarts must be at least 1 and seed at least 0, not {self.restarts} and {self.seed}")
        if self.loa not in UPPER_ENDS_M:
            raise GtlayoutError(f"a level of accuracy is 10, 20, 30 or 40, not {self.loa}")
