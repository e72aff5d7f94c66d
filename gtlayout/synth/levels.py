"""The quality of film and annotation of a room: three levels, and anything between them."""

from __future__ import annotations

from dataclasses import replace

from gtlayout.synth.config import SynthConfig
from gtlayout.synth.errors import AnnotatorErrors, CameraErrors
from gtlayout.synth.trim import HOME_TRIM

CLEAN = SynthConfig()
TYPICAL = replace(
    CLEAN,
    texture=0.5,
    trim=HOME_TRIM,
    shutter_share=0.3,
    exposure_sigma_ev=0.2,
    annotator=AnnotatorErrors(corner_sigma_px=2.0, edge_sigma_px=2.0, missing_occlusion_share=0.1),
    camera_errors=CameraErrors(rotation_sigma_deg=0.05, position_sigma_m=0.003),
)
POOR = replace(
    CLEAN,
    texture=0.2,
    trim=HOME_TRIM,
    noise_sigma=4.0,
    shutter_share=0.5,
    exposure_sigma_ev=0.4,
    annotator=AnnotatorErrors(
        corner_sigma_px=2.5,
        edge_sigma_px=4.0,
        missing_share=0.05,
        swapped_share=0.05,
        missing_occlusion_share=0.3,
        no_visible_share=0.1,
    ),
    camera_errors=CameraErrors(rotation_sigma_deg=0.15, position_sigma_m=0.01),
)
LEVELS = {"clean": CLEAN, "typical": TYPICAL, "poor": POOR}
"""A careful annotator and exact cameras; ordinary input; bad input that also occurs."""
