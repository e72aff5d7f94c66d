"""Every tunable, with its unit and where it comes from. The resolved configuration is saved beside the results."""

from __future__ import annotations

from dataclasses import dataclass, field

from gtlayout.errors import GtlayoutError
from gtlayout.tracking.config import CameraRefinementConfig, TrackingConfig, TriangulationConfig


@dataclass(frozen=True)
class CorrespondenceConfig:
    """Stage 2."""

    min_votes: float = 3.0
    """Two elements become one instance from so many tracks on."""
    carried_weight: float = 8.0
    """What it counts, in tracks, that all of an element lands on another with the depth of the tracks around it."""
    carried_points: int = 40
    """Points spread over an element for that."""
    depth_neighbours: int = 8
    """Tracks whose median depth such a point takes."""
    max_relative_sigma: float = 0.15
    """Tracks whose depth is known less well than this share of it do not lend it."""


@dataclass(frozen=True)
class EdgeConfig:
    """Stage 3. Pixels are those of an image of 640x480; see ``Camera.annotation_scale`` for others."""

    max_gap_px: float = 4.0
    """Two boundaries closer than this run along each other."""
    step_px: float = 4.0
    """Distance of the samples on a contact edge."""
    min_length_px: float = 20.0
    """Shorter contacts say nothing about a line."""
    straightness_px: float = 6.0
    """A pair's points further than this from their common line are not contact."""
    occlusion_px: float = 6.0
    """Reach of an annotated occlusion edge."""
    border_px: float = 3.0
    """Boundaries this close to the image border are cut by the image, not by a neighbour."""


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
    unseen: float = 2.0
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
    sigma_surface: float = 0.01
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


@dataclass(frozen=True)
class RegroupingConfig:
    """After stage 4: instances that are one plane are joined, those that are two are split."""

    rounds: int = 3
    """How often the instances are looked at, and solved again when that changes them."""
    max_chi2: float = 11.34
    """Two planes agree up to this χ² of their difference: the 99 % quantile for its 3 degrees of freedom."""
    max_sigma_share: float = 0.05
    """… which only says something when the σ of their distance is no more than this share of the depth …"""
    max_gap_share: float = 0.03
    """… and, should σ be too wide, when they are no further apart than this share of it …"""
    max_angle_deg: float = 6.0
    """… nor at a larger angle."""
    max_reach_share: float = 0.05
    """Two parts of one plane overlap, or lie no further from each other than this share of the depth."""
    min_opening_overlap: float = 0.25
    """Two drawings of one door or window overlap by this share of the smaller."""
    max_contradicted: float = 0.4
    """Most that key frames may show of something else where the other part should be, as a share."""
    min_tracks: int = 10
    """A drawing with fewer tracks does not tell where its plane is."""
    relative_depth_sigma: float = 0.02
    """Camera and tracking errors that a drawing's tracks share, as a share of depth."""
    track_cauchy: float = 2.0
    """Robust scale of a track, in σ."""
    track_cutoff: float = 3.0
    """A track off by more σ does not lie on the plane."""
    max_lost: float = 0.6
    """Two planes explain an instance when each leaves no more than this share of any of its drawings unexplained …"""
    min_lost_on_other: float = 0.6
    """… and no less of the other plane's, on average …"""
    min_gain: float = 0.5
    """… and when so many drawings more than by the best single plane are explained."""
    max_shown_as_one: float = 0.4
    """Most that key frames may show of one part where the other should be, as a share."""


@dataclass(frozen=True)
class ExtentConfig:
    """Stages 5 and 6."""

    max_growth: float = 0.10
    """Refinement extends an element to its neighbour's plane when its area grows by at most this share (paper 3.4)."""
    max_cut: float = 0.10
    """… and cuts a piece beyond the neighbour's plane when it is less than this share of the area (paper 3.4)."""
    min_angle_deg: float = 10.0
    """Planes that meet at less than this angle have no intersection line worth refining to."""
    max_depth_ratio: float = 10.0
    """A key frame's polygon is clipped where its plane is farther than so many times the scene's median depth."""
    min_horizon_px: float = 10.0
    """… and where it comes this near to the plane's horizon: a pixel there moves the point by a tenth of its depth."""
    max_sigma_depth_share: float = 0.5
    """An element ends where the σ of its depth is more than this share of the depth: from there on two σ of the inverse
    depth reach zero, and the surface may be anywhere from the camera to infinity …"""
    max_sigma_growth: float = 2.0
    """… and more than so many times the least on it: what is known nowhere keeps the shape that was drawn."""
    occluder_margin: float = 0.05
    """What is drawn nearer than a plane by more than this share of its depth may hide it, all else contradicts it."""
    min_piece: float = 0.005
    """Separate pieces and holes below this share of an element's area are gaps between drawn polygons: dropped."""


@dataclass(frozen=True)
class QualityConfig:
    """Stage 7."""

    accept_iou: float = 0.8
    """A scene is accepted from this mean reprojection IoU on (paper 3.5); an element below it is weak."""
    max_sigma_normal_deg: float = 3.0
    """An element whose normal is less certain is weak."""
    max_sigma_depth_share: float = 0.03
    """An element whose depth is less certain, as a share of that depth, is weak: so are 5 of 6 planes whose depth is
    wrong by more than 5 %, in 90 synthetic rooms, and of the others 1 in 50 is so wrong."""
    trusted_sigma_depth_share: float = 0.04
    """A scene is predicted trustworthy while the σ of depth, as a share of depth and in the mean over the drawn pixels,
    is at most this. Of 30 poor synthetic rooms 7 of the 9 whose mean error of depth is above 5 % are above it, and 8
    others. Where nothing is known the share is 1: one pixel in 25 on unobservable surfaces is too much."""
    low_parallax_deg: float = 2.0
    """Named as a cause of weakness: at 1 px noise and 500 px focal length a point is then off by 6 % of its depth."""
    few_tracks: float = 20.0
    """Named as a cause: fewer than these, from which on stage 4 trusts a surface fully."""
    low_survival: float = 0.1
    """Named as a cause: good surfaces keep 0.4 of the points sampled on them, glossy ones 0.02."""
    disagreeing_share: float = 0.5
    """Named as a cause: tracks and contact edges disagree when so many of the tracks were given up …"""
    disagreeing_edge_px: float = 5.0
    """… or when the contact edges are so far from the line in which the planes meet: 3 σ of one drawn by hand."""
    min_frame_iou: float = 0.5
    """A scene with a key frame below this IoU is not trusted, whatever the mean: half of that frame is wrong."""
    known_sigma_depth_share: float = 0.1
    """Depth is known where its σ is at most this share of it …"""
    min_known_share: float = 0.5
    """… and a scene in which it is known for less than this share of the drawn pixels is of no use."""
    min_ok_share: float = 0.5
    """A scene is not trusted when less than this share of its drawn pixels lies on elements that are ok."""
    room_quantile: float = 0.95
    """A room is as large as this quantile of the distances of all drawn pixels whose depth is known …"""
    max_reach: float = 1.6
    """… and an element that reaches so many times as far from every camera that it was drawn in is out of all
    proportion. In 30 synthetic rooms and 4 real clips extents that are right reach 1.3 times, those that wrong labels
    or drawings threw across the room 1.7 to 5.7 times."""


@dataclass(frozen=True)
class Config:
    """All stages."""

    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    triangulation: TriangulationConfig = field(default_factory=TriangulationConfig)
    camera_refinement: CameraRefinementConfig = field(default_factory=CameraRefinementConfig)
    correspondence: CorrespondenceConfig = field(default_factory=CorrespondenceConfig)
    edges: EdgeConfig = field(default_factory=EdgeConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    regrouping: RegroupingConfig = field(default_factory=RegroupingConfig)
    extent: ExtentConfig = field(default_factory=ExtentConfig)
    quality: QualityConfig = field(default_factory=QualityConfig)
    seed: int = 0
    """Of everything random: the same seed gives the same bytes on one kind of processor."""
    refine_cameras: bool = False
    """Whether to refine the camera poses with the tracks before anything is built on them."""
    restarts: int = 1
    """Solves of which the one with the best reprojection IoU is kept (paper 3.5, which makes 100)."""
    restart_share: float = 0.8
    """Random share of the tracks that each solve after the first works with."""

    def __post_init__(self) -> None:
        if self.restarts < 1 or self.seed < 0:
            raise GtlayoutError(f"restarts must be at least 1 and seed at least 0, not {self.restarts} and {self.seed}")
