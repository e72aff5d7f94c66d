"""Settings of stage 1."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackingConfig:
    """Stage 1."""

    spacing_px: float = 30.0
    """Mean spacing of the Sobol points on visible parts (paper 3.2)."""
    max_cells: int = 150
    """Most Sobol points on an element. Images of 640x480 px need up to 121. Without this limit 6,000 corners would be
    tracked on a wall in full HD, of which a few hundred are used."""
    corners_per_cell: int = 8
    """Corners tracked in the cell around each Sobol point, the best first."""
    corner_distance_px: float = 8.0
    """Minimum distance of two corners."""
    corner_quality: float = 0.002
    """Weakest corner that is used, as a share of the element's best."""
    corner_block_px: int = 9
    """Window of the corner measure."""
    border_px: float = 3.0
    """Margin that points keep from the border of a visible part and of the image."""
    sigma_px: float = 1.0
    """Noise of a point with good texture: matching, camera and rolling-shutter errors together."""
    weak_texture: float = 1e-4
    """Smaller eigenvalue of the structure tensor (grey values in 0..1) at which image noise adds as much as a pixel."""
    max_frames: int = 20
    """Number of frames that a point is followed each way."""
    min_observations: int = 3
    """Shorter tracks are dropped."""
    window_px: int = 21
    """Lucas-Kanade window."""
    levels: int = 3
    """Pyramid levels above the full image."""
    max_forward_backward_px: float = 0.7
    """Largest distance from its start to which a point may come back."""
    max_patch_shift_px: float = 4.0
    """Largest correction of a position by the key frame's own patch."""
    patch_px: int = 15
    """Size of the patch that is compared with the key frame's."""
    min_correlation: float = 0.85
    """Least normalised cross-correlation of the two."""
    raft_weights: str | None = None
    """File with the weights of torchvision's raft_small. Where it is given, RAFT moves points from frame to frame in
    place of Lucas-Kanade."""


@dataclass(frozen=True)
class FeatureConfig:
    """SIFT features of some frames, in stage 1."""

    contrast: float = 0.01
    """Least contrast of a feature, in OpenCV's unit. Its default, 0.04, leaves hardly any on a plain wall."""
    max_side_px: int = 640
    """Larger images are shrunk to this side."""
    sigma_px: float = 0.3
    """σ of the place of a feature in the image that SIFT sees."""
    spread_frames: int = 20
    """Frames, evenly spread over the video, in which features are looked for. Key frames come on top."""


@dataclass(frozen=True)
class ImageMatchConfig:
    """Features matched without the cameras, by which cameras are judged."""

    max_features: int = 1200
    """Features of an image that take part, spread over it, the clearest."""
    max_frames: int = 24
    """Of all frames with features, the nearest so many are compared with a key frame."""
    max_ratio: float = 0.8
    """Largest distance of a match's descriptor, as a share of that of the second candidate (Lowe 2004)."""
    tolerance_sigmas: float = 3.0
    """Largest distance from the epipolar line that the matches themselves agree on, in σ of a feature."""
    iterations: int = 1000
    """Most samples of MAGSAC++ (Barath et al. 2020), which finds the matches that agree."""
    min_matches: int = 12
    """With fewer that agree, two images count as not matched."""
    min_share: float = 0.3
    """The same for their share of all matches."""
    max_tracks: int = 300
    """Most tracks from one key frame: the longest of each cell of a grid over the image."""
    followed_factor: float = 2.0
    """Factor on σ of followed points where they are to judge cameras: the errors of a track, all from one patch, are
    not independent. Without it what they have in common counts as large noise of the poses, and focal lengths come out
    2 to 6 % wrong."""
    enough_tracks: int = 200
    """From so many tracks on, cameras are judged by them alone; with fewer by the followed points as well."""


@dataclass(frozen=True)
class WideBaselineConfig:
    """Features that are found again in far frames, at the end of stage 1."""

    max_features: int = 400
    """Most features of an element in a key frame, one in each cell of a grid, the clearest."""
    max_frames: int = 30
    """Of all these frames, the nearest so many are compared with a key frame."""
    nearest_paths: float = 0.05
    """Least depth of a point, in lengths of the camera's path."""
    tolerance_sigmas: float = 3.0
    """Largest distance of a match from its epipolar line, and of a position from the track's point, in σ."""
    max_ratio: float = 0.85
    """Largest distance of a match's descriptor, as a share of that of the second candidate on the epipolar line."""
    min_agreement: float = 0.5
    """Least share of the matches of a feature that must agree on a depth."""
    min_tracks: int = 5
    """Least number of these tracks with which they take the place of the element's other tracks."""


@dataclass(frozen=True)
class TriangulationConfig:
    """Depths of the tracks, between stages 1 and 2."""

    cauchy: float = 2.0
    """Robust scale, in σ of an observation."""
    depth_range_paths: tuple[float, float] = (0.002, 1000.0)
    """Nearest and farthest depth that is tried, in lengths of the camera's path."""
    depth_range_medians: tuple[float, float] = (0.06, 12.0)
    """Nearest and farthest depth that a track keeps, in median depths of all tracks."""


@dataclass(frozen=True)
class CameraRefinementConfig:
    """Bundle adjustment between stages 1 and 2. The unit of length is 1/2.5 of the median depth, as in stage 4."""

    sigma_rotation_deg: float = 0.05
    """How far the given rotations are trusted, about each axis."""
    sigma_position: float = 0.005
    """How far the given camera centres are trusted, along each axis."""
    looser_factors: tuple[float, ...] = (4.0,)
    """Factors on both, tried in turn where the tracks show that the given poses are worse."""
    sigma_factor: float = 3.0
    """Factor on the σ of an observation: the errors of a track come from one patch, so they are not independent."""
    cauchy: float = 0.5
    """Robust scale of an observation, in σ multiplied by ``sigma_factor``."""
    sigma_point_depths: float = 5.0
    """σ of a landmark's prior around its start, in depths of the landmark."""
    min_moved_share: float = 0.2
    """Least share of tracks with parallax. Below it the camera hardly moves, and the cameras are not refined."""
    max_tracks: int = 2000
    """Random tracks that take part, held-out ones included."""
    max_observations: int = 20
    """Observations of a track that enter the graph, spread evenly over it."""
    max_iterations: int = 30
    """Levenberg-Marquardt iterations."""
    relative_decrease: float = 2e-3
    """The solve ends when an iteration lowers the cost by less than this share."""
    held_out_share: float = 0.25
    """Share of the tracks that the first refinement does not use, and by which it is judged."""
    min_held_out: int = 20
    """Least number of such tracks. With fewer the given cameras are kept."""
    min_gain: float = 0.1
    """Share by which their robust cost must fall. Below it the given cameras are kept."""
    min_gain_looser: float = 0.25
    """Share by which it must fall further for the given poses to be trusted less."""


@dataclass(frozen=True)
class ErrorScale:
    """How large an error that all cameras share may be."""

    prior: float
    """σ before anything is seen."""
    floor: float
    """σ that remains however many tracks there are: rolling shutter, distortion, slow changes of the lens."""
    matters: float
    """Smaller errors change a room by less than what else is wrong, and stay."""


@dataclass(frozen=True)
class CameraErrorConfig:
    """Errors that all cameras share, between stages 1 and 2. The unit of length is 1/2.5 of the median depth."""

    focal_log: ErrorScale = ErrorScale(prior=0.1, floor=0.005, matters=0.02)
    """Logarithm of the focal length's factor."""
    principal_point_widths: ErrorScale = ErrorScale(prior=0.05, floor=0.005, matters=0.04)
    """Shift of the principal point along each axis, in widths of the image."""
    roll_deg: ErrorScale = ErrorScale(prior=3.0, floor=0.2, matters=1.0)
    """Turn of all cameras about their optical axes."""
    heading_deg: ErrorScale = ErrorScale(prior=5.0, floor=0.2, matters=0.7)
    """Turn of the heading over the video, about each axis."""
    scale_log: ErrorScale = ErrorScale(prior=0.5, floor=0.04, matters=0.15)
    """Logarithm of the factor between steps at the end and at the start of the video."""
    delay_frames: ErrorScale = ErrorScale(prior=3.0, floor=0.1, matters=0.7)
    """Frames that poses are late. Poses half a frame off have less noise of their own, which looks like a delay."""
    max_tracks: int = 1000
    """Random tracks that take part."""
    max_frames: int = 40
    """Frames that take part, spread evenly over the video; key frames come on top."""
    max_observations: int = 10
    """Positions of a track that take part, spread evenly over it."""
    min_tracks: int = 60
    """With fewer nothing is looked for."""
    min_moved_share: float = 0.2
    """Least share of tracks with parallax. Below it the camera hardly moves, and nothing is looked for."""
    least_smooth: tuple[float, float] = (0.02, 0.002)
    """Least σ of poses' errors that are smooth along the video: rotation, degrees, and position. More is learned."""
    least_white: tuple[float, float] = (0.008, 0.0008)
    """The same of errors that are independent from frame to frame."""
    first_noise: float = 5.0
    """Factor on both from which their size is learned."""
    correlated_frames: float = 8.0
    """Length of the smooth errors' correlation."""
    cauchy: float = 2.0
    """Robust scale, in σ of an observation."""
    sigma_factor: float = 1.5
    """Factor on the σ of an observation in the weights: errors of a frame are not independent."""
    iterations: int = 4
    """Gauss-Newton iterations of each fit."""
    noise_steps: int = 3
    """Steps of learning the size of poses' errors in each of them."""
    response_steps: int = 30
    """The same for what the tracks leave open of the cameras."""
    confidence_factor: float = 1.5
    """Factor on σ of what is found. Errors found in 60 synthetic rooms whose cameras have none had 2 σ (RMS)."""
    min_sigmas: float = 3.0
    """An error counts from so many σ on."""
    held_out_share: float = 0.5
    """Share of the tracks by which a correction is judged that was found with the others."""
    exact_noise_share: float = 0.1
    """Poses whose noise tracks show to be smaller than ``least_smooth`` and ``least_white`` may leave depths open by as
    little as this share of it: what the response is made of. Synthetic rooms with exact cameras come down to it."""
    floor_by_noise: float = 0.3
    """Share of ``floor`` that errors of all cameras have where the noise of poses is that of good cameras; it grows
    with the square of the noise."""
    floor_shares: tuple[float, float] = (0.25, 3.0)
    """Least and largest share."""
    wrong_share: float = 0.1
    """Share of videos whose cameras are badly wrong in one of these ways."""
    response_directions: int = 32
    """Independent ways in which cameras may be wrong that are propagated to the planes, strongest first."""
    min_gain_sigmas: float = 3.0
    """Their mean robust cost must fall by so many σ of the difference for a correction."""
    min_gain: float = 0.2
    """Their median error must also fall by this share. A heading that large smooth noise of poses looked like, in a
    synthetic room, made 14 % and the planes worse; errors of 5 %, 3° or a frame make 24 % and more on most clips."""
