"""The scene that is annotated: one whose image files are what the cameras see, and whose drawings are ours."""

from __future__ import annotations

from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import NATIVE_FILE
from gtlayout.io.choosing import sources_in
from gtlayout.io.scene_folder import ANNOTATION_READERS, load_undrawn
from gtlayout.scene import Scene


def open_scene(root: Path, cameras: Path | None = None) -> Scene:
    """The scene in a folder, without key frames: those are read from ``annotations.json`` as they are drawn.

    Raises GtlayoutError when it cannot be read, its drawings are another tool's, or its images are not pinhole and
    upright, so that what is drawn on the file is not what the camera sees.
    """
    others = [source for source in sources_in(root, ANNOTATION_READERS) if source.path != root / NATIVE_FILE]
    if others:
        raise GtlayoutError(
            f"the drawings of {root} are in {', '.join(map(str, others))}; annotate works on {NATIVE_FILE}: `gtlayout "
            f"import {root} NEW` makes a scene folder with them in {NATIVE_FILE}, and leaves this one as it is"
        )
    scene = load_undrawn(root, cameras)
    if any(frame.undistort is not None for frame in scene.frames):
        raise GtlayoutError(
            f"the images of {root} have a lens to be undistorted, or an orientation tag: straight edges are not "
            f"straight there; make upright pinhole images with `gtlayout import {root} NEW`, and annotate those"
        )
    return scene
