"""Settings of closing a room."""

from __future__ import annotations

from dataclasses import dataclass

from gtlayout.scene import SAME_BORDER_PX


@dataclass(frozen=True)
class ClosingConfig:
    """How a room is closed. Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others.

    The numbers were chosen on ten synthetic rooms with two camera paths each. Others than those measure the result.
    """

    max_tilt_deg: float = 10.0
    """Walls that lean by more are not continued, nor do they end the room."""
    border_px: float = SAME_BORDER_PX
    """A key frame shows something else only further than this from where the instance is drawn: the hands' errors."""
    same_place: float = 0.005
    """Of the median depth: what is as near is the same place. A centimetre or two in a room."""
    gap: float = 0.05
    """Of the median depth: nothing is seen through a gap of that height between a wall and a floor or ceiling."""
    min_width: float = 0.002
    """Of the median depth: parts that are narrower are rounding, and are left out."""
    min_corner_deg: float = 15.0
    """Two walls that meet at less do not make a corner: its place is not known."""
    max_off_square_deg: float = 3.0
    """A wall that is square to another goes on to abreast of the cameras, …"""
    max_hidden_share: float = 0.25
    """… unless another may stand in its way: over more than this share of its distance from the camera nobody looked
    where the other would stand."""
    over_low: float = 0.1
    """Of the median depth: a wall that is lower than the cameras is low when over this height above it, …"""
    low_share: float = 0.5
    """… in more than this share, key frames show that there is no wall. It stands in a room like furniture: it is not
    continued, and the room goes on behind it."""
    least_seen: float = 0.05
    """A room has a floor or a ceiling whose seen part is at least this share of it, …"""
    least_contact: float = 0.8
    """… and of several parallel ones that beside which this share of an unseen part's border lies."""
