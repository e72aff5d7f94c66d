"""What looks wrong in a scene before it is solved. Nothing is written."""

from __future__ import annotations

from collections.abc import Callable

from gtlayout.check.annotations import annotation_suspicions, gaps
from gtlayout.check.cameras import camera_suspicions, fits_images
from gtlayout.check.images import look_through
from gtlayout.check.motion import motion_suspicions
from gtlayout.check.scale import scale_suspicions
from gtlayout.check.shared_errors import shared_error_suspicions
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.scene import Frame, Scene


def contents(scene: Scene) -> str:
    """The content of the scene, in numbers."""
    elements = sum(len(key_frame.elements) for key_frame in scene.key_frames)
    unit = "metric" if scene.metric else "without a unit"
    lenses = sorted({lens.model for frame in scene.frames for lens in _lenses(frame)})
    undistorted = f", undistorted from {' and '.join(lenses)}" if lenses else ""
    return f"{len(scene.frames)} frames, {len(scene.key_frames)} key frames, {elements} elements, {unit}{undistorted}"


def suspicions(scene: Scene, progress: Callable[[int, int], None] = lambda _done, _total: None) -> list[str]:
    """All that is suspicious about ``scene``, a line each: what, in which file, frame or element, and what to do.

    First the readers' warnings, then images, annotations, cameras, scale and motion, at last gaps. Every image is
    decoded once, and some twenty once more for their features; ``progress`` is called with (frames done, frames in
    all). Checks that depend on the cameras' poses are left out when these do not fit the images.
    """
    seen = look_through(scene, progress)
    otherwise = camera_suspicions(scene, seen.matches)
    lines = [*scene.warnings, *seen.lines, *annotation_suspicions(scene), *otherwise]
    if seen.matches and fits_images(scene, seen.matches):
        lines += [*scale_suspicions(scene, seen.matches), *motion_suspicions(scene, seen.matches)]
        # The same again, in smaller figures, where cameras fit better when they are read in another way.
        lines += [] if otherwise else shared_error_suspicions(scene, seen.matches)
    return [*lines, *gaps(scene)]


def _lenses(frame: Frame) -> tuple[Undistortion, ...]:
    """The lenses that its pixels were taken out of, one after another."""
    if isinstance(frame.undistort, Upright):
        return frame.undistort.lenses
    return (frame.undistort,) if isinstance(frame.undistort, Undistortion) else ()
