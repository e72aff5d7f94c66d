"""The parameters of a synthetic scene, with their units and flags on the command line."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter
from cyclopts.validators import Number

from gtlayout.errors import GtlayoutError
from gtlayout.io.writing.scene_writers import AnnotationFormat, CameraFormat
from gtlayout.synth.errors import AnnotatorErrors, CameraErrors, NotNegative, Share
from gtlayout.synth.paths import CameraKind
from gtlayout.synth.room import RoomKind
from gtlayout.synth.trim import NO_TRIM, Trim

HFOV_DEG = 65.0
"""The default: that of a phone's video."""

WORLD = Group.create_ordered("World")
TRIM = Group.create_ordered("Trim")
CAMERA = Group.create_ordered("Camera")
IMAGES = Group.create_ordered("Images")
ANNOTATOR = Group.create_ordered("Errors of the annotator")
REPORTED = Group.create_ordered("Errors of the written cameras")

Positive = Number(gte=1)


@dataclass(frozen=True)
class SynthConfig:
    """One synthetic scene."""

    seed: Annotated[int, Parameter(validator=NotNegative)] = 0
    """Seed of all random numbers. The same seed gives the same bytes on one kind of processor."""
    camera_format: CameraFormat = "native"
    """How images and cameras are written; native = nerfstudio's transforms.json."""
    annotation_format: AnnotationFormat = "native"
    """How annotations are written, with cameras of any format."""
    room: Annotated[RoomKind, Parameter(group=WORLD)] = "box"
    """Kind of floor plan or ceiling."""
    texture: Annotated[float, Parameter(group=WORLD, validator=Share)] = 1.0
    """Strength of the texture on walls, floor and ceiling; 0 = bare."""
    trim: Annotated[Trim, Parameter(name="*", group=TRIM)] = NO_TRIM
    """Baseboards, reveals and kitchens."""
    camera: Annotated[CameraKind, Parameter(group=CAMERA)] = "orbit"
    """Hand-held arc, real-estate dolly, or a camera that only turns (which shows no depth)."""
    replay: Annotated[Path | None, Parameter(group=CAMERA)] = None
    """RealEstate10k camera file that the dolly follows."""
    frames: Annotated[int, Parameter(group=CAMERA, validator=Positive)] = 60
    """Length of the video."""
    key_every: Annotated[int, Parameter(group=CAMERA, validator=Positive)] = 8
    """Frames from one annotated frame to the next."""
    hfov_deg: Annotated[float | None, Parameter(group=CAMERA)] = None
    """Horizontal field of view; 65 when not given, or that of the replayed file."""
    width: Annotated[int, Parameter(group=IMAGES, validator=Positive)] = 480
    """Image width, px."""
    height: Annotated[int, Parameter(group=IMAGES, validator=Positive)] = 360
    """Image height, px."""
    noise_sigma: Annotated[float, Parameter(name="--noise", group=IMAGES, validator=NotNegative)] = 2.0
    """σ of the image noise, grey levels."""
    shutter_share: Annotated[float, Parameter(name="--blur", group=IMAGES, validator=Share)] = 0.0
    """Motion blur: the share of the time from frame to frame in which the shutter is open."""
    exposure_sigma_ev: Annotated[float, Parameter(name="--exposure", group=IMAGES, validator=NotNegative)] = 0.0
    """σ of a smooth change of exposure over the video, stops."""
    oversample: Annotated[int, Parameter(group=IMAGES, validator=Positive)] = 2
    """Rays per pixel and axis."""
    jpeg_quality: Annotated[int, Parameter(group=IMAGES, validator=Number(gte=1, lte=100))] = 92
    """1 to 100."""
    annotator: Annotated[AnnotatorErrors, Parameter(name="*", group=ANNOTATOR)] = field(default_factory=AnnotatorErrors)
    """The errors of the annotator."""
    camera_errors: Annotated[CameraErrors, Parameter(name="*", group=REPORTED)] = field(default_factory=CameraErrors)
    """The errors of the written cameras."""

    def __post_init__(self) -> None:
        """Refuse what cannot be rendered."""
        small, large = min(self.width, self.height), max(self.width, self.height)
        checks = {
            "seed must not be negative": self.seed >= 0,
            "frames must be at least 2": self.frames >= 2,
            "width and height must be 64 to 4096 px": 64 <= small <= large <= 4096,
            "hfov_deg must lie between 20 and 120": self.hfov_deg is None or 20 <= self.hfov_deg <= 120,
            "key_every and oversample must be at least 1": min(self.key_every, self.oversample) >= 1,
            "noise_sigma and exposure_sigma_ev must not be negative": 0 <= self.noise_sigma < float("inf")
            and 0 <= self.exposure_sigma_ev < float("inf"),
            "texture and shutter_share must lie between 0 and 1": 0 <= self.texture <= 1
            and 0 <= self.shutter_share <= 1,
            "jpeg_quality must be 1 to 100": 1 <= self.jpeg_quality <= 100,
            "only a dolly replays a file: add --camera dolly": self.replay is None or self.camera == "dolly",
        }
        for problem, fine in checks.items():
            if not fine:
                raise GtlayoutError(f"synthetic scene: {problem}")
