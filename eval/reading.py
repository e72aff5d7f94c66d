"""What reading costs: large annotation files of every tool, and a scene that is one long video in full HD."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import av
import cv2
import numpy as np
import shapely
from av.video.stream import VideoStream
from cyclopts import Parameter
from cyclopts.validators import Number
from shapely import MultiPolygon, Polygon

from common.command_line import exit_status, new_app
from common.metrics import Metric, write_tables
from gtlayout.io.annotations import labelme, native
from gtlayout.io.annotations.coco import reader as coco
from gtlayout.io.annotations.coco.reader import write_coco
from gtlayout.io.annotations.cvat import reader as cvat
from gtlayout.io.annotations.cvat.writer import write_cvat
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.labelme import write_labelme
from gtlayout.io.annotations.native import write_annotations
from gtlayout.io.cameras.re10k import write_re10k
from gtlayout.io.pixels.images import read_rgb
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.sources import RawAnnotations, Reader
from gtlayout.scene import LABELS, Camera, Element, Frame, ImageArray, KeyFrame
from gtlayout.synth import SynthConfig, synthesize
from speed import MIB, run_solve

SHAPES_PER_IMAGE = 10
CORNERS = 8
FULL_HD = (1920, 1080)
RATE_HZ = 30
ROOM = SynthConfig(frames=48, key_every=12, width=480, height=270, camera="dolly", camera_format="re10k")
KEY_FRAMES = 10
"""Annotated frames of the video, spread over all of it."""
FORMATS: dict[str, tuple[str, Callable[[Path, Sequence[Frame], Sequence[KeyFrame]], None], Reader[RawAnnotations]]] = {
    "native": ("annotations.json", write_annotations, native.READER),
    "CVAT": ("annotations.xml", write_cvat, cvat.READER),
    "COCO": ("coco.json", write_coco, coco.READER),
    "LabelMe": ("", write_labelme, labelme.READER),
}
"""Format → name of the file, how it is written, how it is read."""

app = new_app("reading", __doc__)


@app.default
def measure(
    *,
    out: Path,
    images: Annotated[int, Parameter(validator=Number(gte=1))] = 1000,
    video_frames: Annotated[int, Parameter(validator=Number(gte=20))] = 2000,
    shrink: Annotated[int, Parameter(validator=Number(gte=1))] = 1,
) -> None:
    """Read annotation files of so many images with 10 polygons each, and solve a scene whose images are a video.

    Parameters
    ----------
    out
        Where the tables go.
    images
        Annotated images.
    video_frames
        Length of the video.
    shrink
        By how much its frames are smaller than full HD.
    """
    frames, key_frames = annotated_frames(images)
    rows = {}
    for name, (file, write, reader) in FORMATS.items():
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder) / file, frames, key_frames)
            rows[name] = time_reading(Path(folder), reader, frames)
    with tempfile.TemporaryDirectory() as folder:
        film(Path(folder), video_frames, (FULL_HD[0] // shrink, FULL_HD[1] // shrink))
        video = {f"{video_frames} frames": time_video(Path(folder))}
    for name, table, title in (("annotations", rows, "format"), ("video", video, "video")):
        write_tables(out, name, table, title)
        print((out / f"{name}.md").read_text(encoding="utf-8"))
    print(f"Results: {out}")


def annotated_frames(count: int) -> tuple[list[Frame], list[KeyFrame]]:
    """``count`` images in full HD with polygons of 8 corners each; a sixth of them have a visible part."""
    rng = np.random.default_rng(0)
    camera = Camera(np.eye(3), np.eye(3), np.zeros(3), *FULL_HD)
    frames = [Frame(f"{i:04d}.jpg", Path(f"{i:04d}.jpg"), camera) for i in range(count)]
    angles = np.sort(rng.uniform(0, 2 * np.pi, (count, SHAPES_PER_IMAGE, CORNERS)), axis=2)
    middles = rng.uniform([450, 350], [1470, 730], (count, SHAPES_PER_IMAGE, 1, 2))
    radii = rng.uniform(100, 350, (count, SHAPES_PER_IMAGE, 1, 1))
    outlines = (middles + radii * np.stack([np.cos(angles), np.sin(angles)], axis=-1)).round(2)
    nothing = MultiPolygon()
    key_frames = []
    for i, shapes in enumerate(outlines):
        elements = []
        for e, outline in enumerate(shapes):
            region = MultiPolygon([Polygon(outline)])
            label = LABELS[e % len(LABELS)]
            seen = MultiPolygon([region.geoms[0].convex_hull]) if e == 0 else nothing
            elements.append(Element(f"e{e}", label, region, seen))
        key_frames.append(KeyFrame(i, tuple(elements)))
    return frames, key_frames


def time_reading(folder: Path, reader: Reader[RawAnnotations], frames: Sequence[Frame]) -> list[Metric]:
    """Seconds of the processor: to find the file, to read it, to make key frames of it. The second run counts."""
    for _ in range(2):
        begin = time.process_time()
        (path,) = reader.detect(folder)
        found = time.process_time()
        raw = reader.read(folder, path)
        read = time.process_time()
        key_frames, _warnings = build_key_frames(raw, frames, (), {})
        built = time.process_time()
    files = sorted(folder.iterdir())
    shapes = sum(len(key_frame.elements) for key_frame in key_frames)
    return [
        Metric("images", len(key_frames), "", None),
        Metric("elements", shapes, "", None),
        Metric("size", sum(file.stat().st_size for file in files) / MIB, "MiB", None),
        Metric("find", found - begin, "s", False),
        Metric("read", read - found, "s", False),
        Metric("key_frames", built - read, "s", False),
        Metric("all", built - begin, "s", False),
    ]


def film(folder: Path, count: int, size: tuple[int, int]) -> None:
    """A scene: a synthetic room filmed there and back until there are ``count`` frames, as H.264, and its cameras."""
    with tempfile.TemporaryDirectory() as made:
        synthesize(Path(made) / "room", ROOM)
        room = load_scene(Path(made) / "room")
        there_and_back = [*range(ROOM.frames), *range(ROOM.frames - 2, 0, -1)]
        shown = [there_and_back[i % len(there_and_back)] for i in range(count)]
        pictures = [cv2.resize(read_rgb(frame), size, interpolation=cv2.INTER_CUBIC) for frame in room.frames]
        encode(folder / "video.mp4", (np.asarray(pictures[i], dtype=np.uint8) for i in shown), size)
    scale = size[0] / ROOM.width
    cameras = [
        replace(frame.camera, K=np.diag([scale, scale, 1]) @ frame.camera.K, width=size[0], height=size[1])
        for frame in room.frames
    ]
    times_us = [round(1e6 * i / RATE_HZ) for i in range(count)]
    frames = [Frame(f"{us}.jpg", Path(), cameras[i]) for us, i in zip(times_us, shown, strict=True)]
    write_re10k(folder / "cameras.txt", frames, times_us, "file://")
    drawn = {key_frame.frame: key_frame for key_frame in room.key_frames}
    candidates = [i for i, base in enumerate(shown) if base in drawn]
    chosen = np.unique(np.linspace(0, len(candidates) - 1, KEY_FRAMES).round().astype(int))
    key_frames = [_scaled(drawn[shown[candidates[c]]], candidates[c], scale) for c in chosen]
    write_annotations(folder / "annotations.json", frames, key_frames)


def encode(path: Path, pictures: Iterable[ImageArray], size: tuple[int, int]) -> None:
    """Write (H, W, 3) uint8 RGB pictures as H.264."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE_HZ, options={"preset": "veryfast", "crf": "20"})
        assert isinstance(stream, VideoStream)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.time_base = Fraction(1, RATE_HZ)
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def time_video(folder: Path) -> list[Metric]:
    """Seconds to load the scene, and ``gtlayout solve`` as it is called. Raises GtlayoutError when that fails."""
    begin = time.perf_counter()
    scene = load_scene(folder)
    loaded = time.perf_counter() - begin
    seconds, peak_bytes = run_solve(folder)
    return [
        Metric("width", scene.frames[0].camera.width, "px", None),
        Metric("height", scene.frames[0].camera.height, "px", None),
        Metric("key_frames", len(scene.key_frames), "", None),
        Metric("load", loaded, "s", False),
        Metric("command", seconds, "s", False),
        Metric("peak_memory", peak_bytes / MIB, "MiB", False),
    ]


def _scaled(key_frame: KeyFrame, frame: int, scale: float) -> KeyFrame:
    def larger(region: MultiPolygon) -> MultiPolygon:
        return shapely.transform(region, lambda points_px: points_px * scale)

    elements = tuple(
        replace(element, amodal=larger(element.amodal), visible=larger(element.visible))
        for element in key_frame.elements
    )
    return KeyFrame(frame, elements, tuple(edge * scale for edge in key_frame.occlusion_edges))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
