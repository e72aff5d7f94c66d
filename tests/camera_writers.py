"""Camera formats that are read but not written by gtlayout, for a scene with images."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
from camera_formats import FORMATS

from gtlayout.io.cameras.colmap.reader import write_colmap
from gtlayout.io.files import write_atomic
from gtlayout.io.pixels.exports import write_jpeg
from gtlayout.io.pixels.images import read_gray
from gtlayout.io.writing.scene_writers import CAMERA_WRITERS, CameraWriter
from gtlayout.scene import Frame, Scene


def write_colmap_binary(scene: Scene, out: Path) -> tuple[Frame, ...]:
    """As the text format, but binary."""
    frames = CAMERA_WRITERS["colmap"](scene, out)
    shutil.rmtree(out / "sparse")
    write_colmap(out / "sparse/0", frames, binary=True)
    return frames


def writer_of(name: str) -> CameraWriter:
    """The format ``name`` of ``camera_formats``, with the scene's images instead of made-up ones.

    Where it has PNG, images are grey: what a JPEG decodes to when grey is asked for, which is what is tracked;
    converted from colour it would differ by rounding.
    """

    def write(scene: Scene, out: Path) -> tuple[Frame, ...]:
        FORMATS[name](out, [frame.camera for frame in scene.frames])
        (out / "annotations.json").unlink()
        written = []
        images = sorted(path for path in out.rglob("*") if path.suffix in (".jpg", ".png"))
        for image, frame in zip(images, scene.frames, strict=True):
            if image.suffix == ".png":
                write_atomic(image, cv2.imencode(".png", read_gray(frame))[1].tobytes())
            else:
                write_jpeg(image, frame)
            written.append(Frame(image.name, image, frame.camera))
        return tuple(written)

    return write
