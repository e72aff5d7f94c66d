"""Settings of stage 4."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class InitializationConfig:
    """Stage 4, starting planes: costs by which hypotheses are chosen (residuals of tracks are in σ).

    Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others.
    """

    draws: int = 100
    """Hypotheses from random tracks."""
    draws_per_edge: int = 10
    """Hypotheses from each contact edge with a random track."""
    sweeps: int = 3
    """How often the plane of every instance is chosen again, given all others."""
    max_tracks: int = 100
    """Most tracks of an instance that are used."""
    unknown_depth_share: float = 0.25
    """σ as a share of the depth from which on a track counts nothing in the order in which instances are placed. A
    track whose depth is known exactly counts fully."""
    placed_contact_tracks: float = 3.0
    """Weight, in tracks, of a contact edge with an instance that is already placed, in the same order."""
    parallel_points: int = 20
    """Tracks of an instance through which planes parallel to others are tried."""
    track_cutoff: float = 3.0
    """A track that is off by more σ is an outlier."""
    max_track_weight: float = 60.0
    """More tracks than this do not weigh more, because their errors are not independent."""
    edge_weight: float = 5.0
    """Weight of a contact edge, in tracks."""
    edge_cutoff_px: float = 18.0
    """A contact edge that is off by more is an outlier."""
    perpendicularity_weight: float = 10.0
    """Weight of a right angle, in tracks."""
    perpendicularity_cutoff: float = 0.15
    """sin of the deviation from which on an angle is not taken for a right angle."""
    manhattan_weight: float = 2.0
    """Weight, in tracks, of a wall at right angles or parallel to the others."""
    usual_depth_weight: float = 0.5
    """Cost, in tracks, of a depth that is e times or 1/e of the points' median depth."""
    absurd_weight: float = 5.0
    """Cost, in tracks, of an instance that is drawn where its plane cannot be seen."""


@dataclass(frozen=True)
class UncertaintyConfig:
    """Stage 4, covariances: the errors that are expected. The residuals show how many times as large they are."""

    relative_depth: float = 0.006
    """Relative error of depth that all points of an instance in one key frame share."""
    share_of_track_sigma: float = 0.3
    """Share of the σ of the tracks there that is added to it: at small parallax errors of cameras have more effect."""
    shared_bias_ratio: float = 1.4
    """Error that all key frames of an instance share, as a multiple of that of one key frame."""
    min_trust: float = 0.01
    """Lower limit of the trust in an instance, which is the share of its points that could be followed."""
    student_freedom: float = 8.0
    """Degrees of freedom of the Student t distribution of all errors."""
    prior_measurements: float = 6.0
    """Number of residuals of the expected size that are added to each family of errors."""
    rounds: int = 15
    """Iterations of expectation maximisation."""


@dataclass(frozen=True)
class EstimationConfig:
    """Stage 4: noise model. The unit of length is 1/2.5 of the median depth: about a metre in a room.

    Pixels of annotations (not of tracks) are those of an image of 640x480; see ``Camera.annotation_scale`` for others.
    """

    initialization: InitializationConfig = field(default_factory=InitializationConfig)
    uncertainty: UncertaintyConfig = field(default_factory=UncertaintyConfig)
    starts: int = 4
    """Number of searches for starting planes, of which the cheapest is kept."""
    depth_range: tuple[float, float] = (0.15, 30.0)
    """Depths at which an instance may be seen: as far from the median as tracks may be."""
    relative_depth_sigma: float = 0.02
    """Camera and tracking errors that all points of an instance have in common, as a share of depth."""
    observation_cauchy: float = 1.0
    """Robust scale of an observation, in σ."""
    sigma_relief: float = 0.01
    """σ of the relief of a surface around its plane."""
    max_observations: int = 6
    """Observations of a track that enter the graph, spread evenly over it."""
    independent_observations: float = 3.0
    """A track counts as at most this many independent observations."""
    track_cauchy: float = 1.0
    """Robust scale of a whole track, in σ, or in the standard deviation of its instance's residuals if that is less."""
    reflected_share: float = 0.1
    """Share of an instance's tracks that is expected to be mirror images."""
    reflected_prior_tracks: float = 10.0
    """The number of tracks that this expectation is worth."""
    min_spread: float = 0.3
    """Least standard deviation of an instance's residuals that counts in ``track_cauchy``, in σ."""
    full_survival: float = 0.4
    """An instance is trusted fully from this share of surviving points on. Glossy ones keep 0.02."""
    full_tracks: float = 20.0
    """Number of tracks from which on an instance is trusted fully."""
    max_tracks: int = 400
    """Most tracks of an instance in the graph. More only cost time, because the sum of their weights is limited."""
    max_track_weight: float = 4.0
    """Largest sum of the weights of an instance's tracks from one key frame."""
    min_edge_px: float = 40.0
    """Shorter contact edges are not used: on the real clips they are 12 px off (median), longer ones 1 to 5."""
    sigma_edge_shift_px: float = 1.6
    """σ of the shift of an annotated edge as a whole."""
    sigma_edge_tilt_px: float = 0.6
    """σ of the tilt of an annotated edge: half the difference of its two representative points."""
    sigma_contact_offset: float = 0.025
    """σ, in each direction, of how far the line that is drawn between two instances lies from where their planes meet,
    in all key frames alike: the foot of a baseboard, the edge of a worktop, the frame of a door."""
    edge_cauchy: float = 3.0
    """Robust scale of an edge, in σ."""
    max_contact_px: float = 10.0
    """Two instances do not touch when their contact edge is further than this from where their planes meet."""
    readmitted_share: float = 0.6
    """Two instances touch again once their contact edge fits better than this share of ``max_contact_px``."""
    contact_searches: int = 4
    """Most rounds of removing wrong contacts, with ``starts`` searches each. Without the wrong ones others may prove
    right."""
    min_agreeing_share: float = 0.8
    """An instance is called well tracked when this share of its tracks lies on one plane. Of mirror images it is about
    half; where wrong contacts outvoted tracks, .87 and .97."""
    agreeing_track: float = 2.0
    """A track lies on a plane that it is not further from than this, in σ."""
    wrong_contact_price: float = 8.0
    """What it costs to call the contact of two instances wrong, as a negative log-likelihood: an occlusion edge is
    forgotten in one of ten places, and the line may then be anywhere."""
    usual_edge_cost: float = 2.5
    """What each key frame adds to that: the cost of an edge with the usual errors."""
    doubted_share: float = 0.5
    """A contact that costs more than this share of its price is tried without."""
    min_gain_without: float = 3.0
    """By how much the cost must fall, or the drawing is believed. Right contacts of the real clips reach 1, wrong ones
    6 and more."""
    judged_track_weight: float = 20.0
    """As ``max_track_weight``, where a well tracked plane is weighed against contacts that do not fit it."""
    sigma_perpendicularity: float = 0.02
    """σ of the deviation from a right angle, radians. How many times as large it is in a scene, its planes show."""
    right_angle_cauchy: float = 1.5
    """Robust scale of right angles between walls, in σ. Unlike between walls and floors, they are not a rule."""
    upright_cauchy: float = 2.0
    """Robust scale of right angles between walls and floors or ceilings, in σ: each may fail on its own."""
    right_angle_reach: float = 0.25
    """sin of the deviation up to which two walls get a factor for a right angle."""
    sigma_start_depths: float = 0.5
    """σ of the prior on d around its start in the solve, in depths of the instance."""
    sigma_prior_depths: float = 10.0
    """σ of the prior on d in the marginals, in depths. It keeps an undetermined plane solvable, with a large σ."""
    sigma_prior_normal: float = 1.0
    """σ of the prior on the normal, radians."""
    sigma_prior_point: float = 10.0
    """σ of the prior on a landmark around its start."""
    sigma_coplanarity_angle: float = 0.01
    """σ of the angle between a door or window and its wall, radians."""
    sigma_recess: float = 0.06
    """σ of the distance of a door or window from its wall's plane."""
    coplanarity_cauchy: float = 2.0
    """Robust scale of an opening's angle and distance to its host, in σ."""
    annealing: tuple[float, ...] = (4.0, 2.0)
    """Factors on the robust scales of tracks and edges, one re-weighting each: graduated non-convexity."""
    rounds: int = 4
    """Most re-weightings of whole tracks at the scales themselves."""
    max_iterations: int = 15
    """Most Levenberg-Marquardt iterations per round."""
    relative_decrease: float = 2e-3
    """A round ends when an iteration lowers the cost by less than this share."""
    converged_below: float = 1e-4
    """Re-weighting ends when no coefficient of a plane moves by more."""
    max_cost_growth: float = 0.25
    """A solve has failed when its planes cost more than the start's by this share and ``max_plane_cost_growth``
    together. On real clips and synthetic rooms the growth is .05 at most."""
    max_moved_share: float = 0.3
    """A solve has also failed when it moves a plane by this share of its depth and exceeds
    ``max_plane_cost_growth``."""
    max_plane_cost_growth: float = 10.0
    """Growth of the cost of one plane, a negative log-likelihood. The usual growth is 5 at most."""
    min_moved_share: float = 0.2
    """Least share of tracks with parallax. Below it the camera does not move enough to solve."""
    unobservable_sigma_ratio: float = 5.0
    """A plane whose σ of depth is more than this share of the depth is called unobservable."""
