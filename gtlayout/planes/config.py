"""Tunables of stage 4."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class InitializationConfig:
    """Stage 4, starting planes: costs by which hypotheses are chosen (σ of tracks is whitened already).

    Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others.
    """

    draws: int = 100
    """Hypotheses from random tracks."""
    draws_per_edge: int = 10
    """Hypotheses from each contact edge with a random track."""
    sweeps: int = 3
    """How often every element is chosen again in the light of the others."""
    max_tracks: int = 100
    """Tracks of an element that take part."""
    unknown_depth_share: float = 0.25
    """In the order in which elements are placed a track whose σ is this share of its depth counts nothing, one whose
    depth is known exactly counts fully."""
    placed_contact_tracks: float = 3.0
    """In the same order, worth of a contact edge with something placed already, in tracks."""
    anchors: int = 20
    """Tracks of an element through which planes parallel to others are tried."""
    track_cutoff: float = 3.0
    """A track off by more σ than this is an outlier."""
    max_track_weight: float = 60.0
    """More tracks than this do not count more: their errors are not independent."""
    edge_weight: float = 5.0
    """Worth of a contact edge, in tracks."""
    edge_cutoff_px: float = 18.0
    """A contact edge off by more than this is wrong."""
    perpendicularity_weight: float = 10.0
    """Worth of a right angle, in tracks."""
    perpendicularity_cutoff: float = 0.15
    """sin of the deviation from which on an angle is not right at all."""
    manhattan_weight: float = 2.0
    """Worth, in tracks, of a wall at right angles or parallel to the others."""
    usual_depth_weight: float = 0.5
    """Price, in tracks, of a depth e times or 1/e of the points' median depth."""
    absurd_weight: float = 5.0
    """Price of an element drawn where its plane cannot be seen."""


@dataclass(frozen=True)
class UncertaintyConfig:
    """Stage 4, covariances: errors that are expected; the residuals then say how many times as large they are."""

    relative_depth: float = 0.006
    """Error of depth that all points of a surface in one key frame share."""
    of_track: float = 0.3
    """… and what adds to it in σ of a track there: at small parallax errors of cameras weigh more."""
    shared_share: float = 1.4
    """Error that all key frames of a surface share, in errors of one key frame."""
    least_trust: float = 0.01
    """Surfaces are trusted by the share of their points that could be followed; none less than this."""
    student_freedom: float = 8.0
    """Degrees of freedom of the Student t by which all errors are distributed."""
    prior_measurements: float = 6.0
    """How many residuals of the expected size are taken as seen already, per family of errors."""
    rounds: int = 15
    """Iterations of expectation maximisation."""
    sigma_inflation: float = 2.0
    """σ is so many times what the residuals show: part of the errors show in none. Measured on synthetic rooms."""


@dataclass(frozen=True)
class EstimationConfig:
    """Stage 4: noise model. The unit of length is 1/2.5 of the median depth: about a metre in a room.

    Pixels of drawings (not of tracks) are those of an image of 640x480; see ``Camera.annotation_scale`` for others.
    """

    initialization: InitializationConfig = field(default_factory=InitializationConfig)
    uncertainty: UncertaintyConfig = field(default_factory=UncertaintyConfig)
    starts: int = 4
    """Searches for starting planes of which the cheapest is kept."""
    depth_range: tuple[float, float] = (0.15, 30.0)
    """Depths at which an element may be seen: as far from the median as tracks may be."""
    relative_depth_sigma: float = 0.02
    """Camera and tracking errors that all points of an element share, as a share of depth."""
    observation_cauchy: float = 1.0
    """Robust scale of an observation, in σ."""
    sigma_relief: float = 0.01
    """Relief of a surface round its plane."""
    max_observations: int = 6
    """Observations of a track that enter the graph, spread evenly over it."""
    independent_observations: float = 3.0
    """A track counts as so many independent observations at most."""
    track_cauchy: float = 1.0
    """Robust scale of a whole track, in σ, or in the standard deviation of its surface's residuals if that is less."""
    least_spread: float = 0.3
    """… but in no less than this share of σ."""
    full_acceptance: float = 0.4
    """Share of sampled points that survive tracking from which on a surface is trusted fully; glossy ones keep 0.02."""
    full_tracks: float = 20.0
    """Tracks from which on a surface is trusted fully."""
    max_tracks: int = 400
    """Tracks of an element that enter the graph: more only cost time, for their weights have a limit together."""
    max_track_weight: float = 4.0
    """Sum of the weights of an element's tracks from one key frame."""
    min_edge_px: float = 40.0
    """Shorter contact edges place no plane: on the real clips they are 12 px off (median), longer ones 1 to 5."""
    sigma_edge_shift_px: float = 1.6
    """Shift of an annotated edge as a whole."""
    sigma_edge_tilt_px: float = 0.6
    """Tilt of an annotated edge: half the difference of its two representative points."""
    edge_cauchy: float = 3.0
    """Robust scale of an edge, in σ."""
    max_contact_px: float = 10.0
    """Two surfaces whose contact edge is further than this from where their planes meet do not touch."""
    readmitted_share: float = 0.6
    """A pair of instances taken apart comes together again once its edge fits better than this share of the limit."""
    contact_searches: int = 4
    """Searches for starting planes at most: without the wrong contacts others may turn out to be right."""
    sigma_perpendicularity: float = 0.02
    """Deviation from a right angle, radians."""
    right_angle_cauchy: float = 1.5
    """Robust scale of right angles between walls, in σ: unlike that of walls and floors it is no rule."""
    right_angle_reach: float = 0.25
    """sin of the deviation up to which two walls are taken to be meant at a right angle."""
    sigma_start_depths: float = 0.5
    """How far the solve may move d from its start where little else determines it, in depths of the element."""
    sigma_prior_depths: float = 10.0
    """Prior on d in the marginals, in depths: keeps an undetermined plane solvable; its σ then says so."""
    sigma_prior_normal: float = 1.0
    """Prior on the normal, radians."""
    sigma_prior_point: float = 10.0
    """Prior on a landmark round its start."""
    sigma_coplanarity_angle: float = 0.01
    """Angle between a door or window and its wall, radians."""
    sigma_recess: float = 0.03
    """How far a door or window sits back in its wall."""
    coplanarity_cauchy: float = 2.0
    """Robust scale of both, in σ."""
    annealing: tuple[float, ...] = (4.0, 2.0)
    """Robust scales start so many times as wide, one re-weighting each: graduated non-convexity."""
    rounds: int = 4
    """Re-weightings of whole tracks at the scales themselves."""
    max_iterations: int = 15
    """Levenberg-Marquardt iterations a round."""
    relative_decrease: float = 2e-3
    """A round ends when an iteration lowers the cost by less than this share."""
    settled: float = 1e-4
    """Re-weighting ends when no coefficient of a plane moves by more."""
    max_cost_growth: float = 0.25
    """A solve failed whose planes cost more than the start's by this share (and by ``max_plane_growth``). On real clips
    and synthetic rooms it is .05 at most."""
    max_moved_share: float = 0.3
    """… or that moved a plane by this share of its depth …"""
    max_plane_growth: float = 10.0
    """… though what is known of it then costs so much more, as a negative log-likelihood. Usual are 5 at most."""
    min_moved_share: float = 0.2
    """Share of tracks that must show parallax; below it the camera does not move."""
    unobservable_depth: float = 5.0
    """A plane whose σ of depth is more than this share of the depth is called unobservable."""
