"""Settings of flatness."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FlatnessConfig:
    """After stage 4. Lengths are shares of the depth. The numbers were chosen on 38 synthetic rooms of even surfaces,
    none of which is called uneven with them.
    """

    min_tracks: int = 40
    """Nothing is said of a surface with fewer tracks, …"""
    min_key_frames: int = 3
    """… or with tracks of fewer key frames: what they have in common looks like a bend."""
    max_sigma: float = 0.05
    """Tracks whose depth is known worse are not used, …"""
    max_off: float = 0.05
    """… nor those that lie further off their plane: they are on something that stands before it."""
    min_facing: float = 0.1
    """Nor those that see it at less than this sine."""
    cell: float = 0.08
    """Tracks of one key frame that are as near to each other count as one, …"""
    sigma_cell: float = 0.005
    """… with this error in common: they drift alike, and are on the same relief."""
    sigma_place: float = 0.003
    """… and this one in common with those of other key frames there: they are on the same texture."""
    sigma_shared: float = 0.01
    """σ of what the place and the tilt of all tracks of a key frame are off by, …"""
    sigma_shared_bend: float = 0.004
    """… and of how far they are bent."""
    freedom: float = 3.0
    """Degrees of freedom of the Student t distribution of all errors."""
    rounds: int = 10
    """Re-weightings of the fit."""
    min_places: int = 6
    """A bend is measured where there are tracks in so many places in each third of the measuring distance."""
