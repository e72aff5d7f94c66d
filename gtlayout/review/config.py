"""Settings of the review of drawings."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReviewConfig:
    """What counts as wrong. Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others.

    Chosen on five real clips and 22 synthetic rooms with planted errors; nothing was held out.
    """

    opening_px: float = 3.0
    """Gaps and overlaps are eroded and dilated by this: two hands' lines differ by a pixel or two."""
    min_area_px2: float = 300.0
    """Smaller gaps and overlaps do not count."""
    same_iou: float = 0.9
    """Two elements with this IoU are taken for one that was drawn twice."""
    min_distance_px: float = 6.0
    """A contact edge is wrong from this distance on …"""
    max_alone_sigma_px: float = 5.0
    """σ of a line up to which its edge is judged where one of the two instances is drawn only there: its plane rests on
    the tracks of this drawing, and those may lie on furniture. By judgement, from one false alarm (10 px)."""
    min_z: float = 3.0
    """… if that is also more than so many σ of the line and of drawing together."""
    sigma_drawn_px: float = 2.5
    """σ of drawing an edge."""
    max_occlusion_px: float = 10.0
    """A contact edge is an occlusion edge where one is predicted within this distance …"""
    min_occlusion_share: float = 0.5
    """… along at least this share of it."""
    min_known_share: float = 0.25
    """An element is compared with the others only where these know at least this share of it."""
    min_label_iou: float = 0.6
    """An element has the label of the instance that it looks like with at least this IoU."""
    max_placed_iou: float = 0.3
    """An element with less IoU with what the others see of its instance is drawn in another place."""
    min_whole_share: float = 0.5
    """A whole drawing is of another place when more than this share of its area is."""
    shape_opening_px: float = 5.0
    """Shapes differ only where they do so over twice this width: outlines on planes that are a little off do, too."""
    min_shape_share: float = 0.2
    """An element has another shape from this share of it on that is not where it is in all other key frames."""
    min_others: int = 2
    """… if at least this many others show it: of two nobody knows which is wrong."""
    min_missing_share: float = 0.01
    """An instance is missing where the others show it on at least this share of the image."""
