"""gtlayout: posed video and 2D annotations → the room's structural planes with uncertainty."""

__version__ = "0.1.0"
