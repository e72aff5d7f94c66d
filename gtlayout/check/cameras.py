"""Do the cameras fit the images? If not: would other axes, inverted or shifted poses, or another focal length?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gtlayout.check.images import Matches
from gtlayout.check.two_views import MAX_ERROR_SHARE, triangulate_pair
from gtlayout.scene import Camera, FloatArray, Scene

FITS = 0.6
"""Cameras fit when so many matches do: in the real clips 0.97 and more, in made rooms with poor poses 0.82 and more,
and in both at most 0.33 with cameras read in a wrong way."""
MAX_SHIFT = 10
"""Frames by which poses may be ahead of the images or behind."""
FOCAL_FACTORS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.1, 1.25, 1.4, 1.7, 2.0)
"""Of the focal length that is given."""
GAIN = 2.0
"""Other frames' poses and other focal lengths must fit this many times better. With right cameras they fit worse."""
MIN_GAIN = 0.001
"""They must also fit better by this share of the focal length, because neighbours of a slow camera fit, too."""

_OTHER_HAND = np.diag([1.0, -1.0, -1.0])


def _axes_turned(camera: Camera) -> Camera:
    """As if y and z were up and back in the file where they were read as down and forward, or the other way round."""
    R, t = camera.R_cam_from_world, camera.t_cam_from_world
    return replace(camera, R_cam_from_world=_OTHER_HAND @ R, t_cam_from_world=_OTHER_HAND @ t)


def _inverted(camera: Camera) -> Camera:
    """As if the file had camera-to-world where world-to-camera was read, or the other way round."""
    return replace(camera, R_cam_from_world=camera.R_cam_from_world.T, t_cam_from_world=camera.center_world)


def _flipped(camera: Camera, x: bool, y: bool) -> Camera:
    """As if the images had been turned over left for right, upside down, or both."""
    flip = np.eye(3)
    if x:
        flip[0] = -1.0, 0.0, camera.width
    if y:
        flip[1] = 0.0, -1.0, camera.height
    return replace(camera, K=flip @ camera.K)


@dataclass(frozen=True)
class Reading:
    """Another way to read the cameras."""

    what: str
    """What the file would then have."""
    mend: str
    apply: Callable[[Camera], Camera]


AS_GIVEN = Reading("", "", lambda camera: camera)
OTHERWISE = (
    Reading(
        "camera axes of the other kind (OpenGL: x right, y up, z back; OpenCV: x right, y down, z forward)",
        "negate the camera's y and z axes",
        _axes_turned,
    ),
    # Which of these two it is depends on the axes that the file's format has: inverting its poses turns the axes of the
    # camera into the world's, which are anybody's choice.
    *(
        Reading(
            "poses the other way round (camera-to-world, world-to-camera)",
            "invert the poses, and check again whether the axes are right then",
            apply,
        )
        for apply in (_inverted, lambda camera: _axes_turned(_inverted(camera)))
    ),
    Reading(
        "images that are mirrored, left for right, or poses in the axes of a mirrored world (left-handed, as of games)",
        "mirror the images back, or negate one axis of the world and the same of the camera",
        lambda camera: _flipped(camera, x=True, y=False),
    ),
    Reading(
        "images that are upside down",
        "turn them by 180°, and what is drawn on them",
        lambda camera: _flipped(camera, x=True, y=True),
    ),
)


def camera_suspicions(scene: Scene, matches: list[Matches]) -> list[str]:
    """Whether poses and images belong together; at most one line. None without matches."""
    if not matches:
        return []
    given = share_explained(scene, matches)
    better = _better(scene, matches)
    if given >= FITS and better is None:
        return []
    best, share = max(((way, share_explained(scene, matches, way)) for way in OTHERWISE), key=lambda pair: pair[1])
    if given < FITS <= share:
        return [
            f"the cameras fit the images only with {best.what}: {share:.0%} of the points followed through the video, "
            f"as they are {given:.0%}; {best.mend}"
        ]
    if better is not None:
        return [better]
    return [
        f"the cameras do not fit the images: they explain {given:.0%} of the points followed through the video; wrong "
        "intrinsics, another video's poses, or names or timestamps mixed up"
    ]


def fits_images(scene: Scene, matches: list[Matches]) -> bool:
    """Whether the cameras explain most matches."""
    return share_explained(scene, matches) >= FITS


def share_explained(scene: Scene, matches: list[Matches], reading: Reading = AS_GIVEN) -> float:
    """Share of the matches near the image of a point in front of both cameras: the mean of all pairs of frames."""
    return float(np.mean([np.mean(_errors(scene, m, reading=reading) < MAX_ERROR_SHARE) for m in matches]))


def _errors(scene: Scene, matches: Matches, shift: int = 0, reading: Reading = AS_GIVEN) -> FloatArray:
    """(N,) errors as a share of the focal length that is given."""
    source, target = (reading.apply(scene.frames[i + shift].camera) for i in (matches.source, matches.target))
    errors_px, _ = triangulate_pair(matches, source, target)
    return errors_px / scene.frames[matches.target].camera.K[0, 0]


def _better(scene: Scene, matches: list[Matches]) -> str | None:
    """Which other frames' poses or what other focal length fit best; None when what is given fits as well."""
    tried = [(shift, 1.0) for shift in range(-MAX_SHIFT, MAX_SHIFT + 1) if shift]
    tried += [(0, factor) for factor in FOCAL_FACTORS]
    found: list[tuple[float, float, int, float]] = []
    for shift, factor in tried:
        both = [m for m in matches if m.source + shift >= 0 and m.target + shift < len(scene.frames)]
        if 2 * len(both) < len(matches):
            continue
        given = _median_error(scene, both, 0, 1.0)
        changed = _median_error(scene, both, shift, factor)
        if changed < MAX_ERROR_SHARE and given > GAIN * changed and given - changed > MIN_GAIN:
            found.append((changed, given, shift, factor))
    if not found:
        return None
    changed, given, shift, factor = min(found)
    focal_px = float(np.median([frame.camera.K[0, 0] for frame in scene.frames]))
    what, mend = f"a focal length about {factor:g} times as long", "were the images resized after they were calibrated?"
    if shift:
        what = f"the poses of {abs(shift)} frame(s) {'later' if shift > 0 else 'earlier'}"
        mend = "shift the poses' timestamps or names"
    return (
        f"the cameras fit the images better with {what}: points followed through the video are then "
        f"{changed * focal_px:.1f} px off (median), as they are {given * focal_px:.1f} px; {mend}"
    )


def _median_error(scene: Scene, matches: list[Matches], shift: int, factor: float) -> float:
    """Of the pairs' medians, as a share of the focal length that is given, with that focal length times ``factor``."""
    zoom = np.diag([factor, factor, 1.0])

    def zoomed(camera: Camera) -> Camera:
        K = camera.K @ zoom
        K[:2, 2] = camera.K[:2, 2]
        return replace(camera, K=K)

    return float(np.median([np.median(_errors(scene, m, shift, Reading("", "", zoomed))) for m in matches]))
