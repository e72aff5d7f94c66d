"""Settings of curved walls."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CurvedConfig:
    """After stage 4. Lengths are in units of 1/2.5 of the median depth: about a metre in a room.

    Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others. Gains are differences of
    negative log-likelihoods, of the best upright plane less the best upright cylinder.
    """

    max_tracks: int = 1000
    """Most tracks of a wall that are used, evenly over its key frames."""
    judged_tracks: int = 200
    """Most of them where a cylinder is weighed against a plane."""
    min_tracks: int = 20
    """With fewer, a wall stays a plane."""
    edge_points: int = 12
    """Samples of its foot (or head) in each key frame."""
    min_edge_px: float = 40.0
    """Shorter ones are not used."""
    sigma_edge_px: float = 1.6
    """σ of an annotated foot."""
    edge_weight: float = 3.0
    """Independent measurements that it is worth: its shift, its tilt and its bend, however many samples it has."""
    sigma_relief: float = 0.01
    """σ of the relief of a surface."""
    shared_depth_sigma: float = 0.02
    """Relative error of depth, where a cylinder is weighed against a plane: the errors that tracks have in common."""
    own_depth_sigma: float = 0.006
    """The same, where it is fitted: what all points have in common moves a wall, and hardly bends it."""
    judged_track_weight: float = 4.0
    """Largest sum of the weights of a wall's tracks from one key frame, where it is weighed against a plane …"""
    fitted_track_weight: float = 20.0
    """… and where it is fitted."""
    freedom: float = 3.0
    """Degrees of freedom of the Student t distribution of all errors."""
    min_gain: float = 8.0
    """A wall that nobody drew as curved is a cylinder when all its evidence together gains so much, …"""
    min_gain_each: float = 2.0
    """… and its tracks and its foot each gain so much. On the real clips no wall gains more than 4.9 in all, 2.4 with
    each; the round walls of synthetic rooms gain 9 to 200 in all."""
    min_bent_feet: float = 0.7
    """… and this share of its feet is likelier on the arc, each alone: a line drawn where two surfaces only seem to
    touch lies anywhere, and would bend a wall by itself."""
    straight_foot: float = 0.3
    """A foot that is nowhere off a line of its own by more than this (RMS, in its σ) is straight, and on no arc. Drawn
    lines have .15, feet of round walls in small images .44 and more."""
    min_arc_deg: float = 25.0
    """A cylinder of which less is seen is no better known than a plane."""
    sigma_lean: float = 0.01
    """σ of the lean of a wall against the floor's normal, radians."""
    facet_tolerance_mm: float = 2.0
    """Facets of a curved wall are nowhere farther from it, in scenes without a unit by thousandths of the length above.
    A circle of radius 1 m is 50 of them."""
    rounds: int = 8
    """Re-weightings of the fit."""
