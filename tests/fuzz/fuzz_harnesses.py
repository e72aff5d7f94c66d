"""What is fuzzed: the readers, each with a correct scene around the one file that is damaged.

An input is a byte, which file of the harness it is for, and what that file then holds.
"""

from __future__ import annotations

import json
import os
import re
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rooms
from camera_formats import FORMATS as CAMERA_FORMATS
from camera_formats import cameras_in_general_position
from fuzz_mutations import Mutation, json_tree, members, png, words
from PIL import Image
from test_hostile_annotations_coco import FORMATS as JSON_ANNOTATIONS
from test_hostile_annotations_cvat import GOOD as CVAT
from test_hostile_annotations_label_studio import valid as label_studio_tasks
from videos import pictures, write_video

from gtlayout.accuracy import Accuracy
from gtlayout.annotate.store import Store
from gtlayout.batch.record import RECORD_FILE, RUN_FILE, Record, read_record, write_record
from gtlayout.batch.run_folder import FORMAT as RUN_FORMAT
from gtlayout.batch.run_folder import read_run
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.instances import Dimension, NextMeasurement, Quantity
from gtlayout.io.annotations.annotation_files import left_out
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.labels import FILE_NAME as LABELS
from gtlayout.io.annotations.labels import read_label_file
from gtlayout.io.annotations.masks import decode_mask, mask_polygons
from gtlayout.io.cad_estate.room_structure import RoomStructure, read_room_structure, write_room_structure
from gtlayout.io.cameras.frames import build_frames
from gtlayout.io.files import write_json_atomic
from gtlayout.io.measurements import FILE as MEASUREMENTS
from gtlayout.io.measurements import read_measurements
from gtlayout.io.pixels.images import decode, encoded, read_depth
from gtlayout.io.pixels.turn import read_header
from gtlayout.io.pixels.video import Video
from gtlayout.io.scene_folder import ANNOTATION_READERS, CAMERA_READERS
from gtlayout.io.truth import FILE as TRUTH
from gtlayout.io.truth import read_truth
from gtlayout.io.units import SCENE_FILE, read_unit
from gtlayout.io.video_record import FILE as VIDEO_RECORD
from gtlayout.io.video_record import with_origins
from gtlayout.layout import Layout
from gtlayout.measurement import Checked, Measurement, Scale
from gtlayout.mesh import build_mesh
from gtlayout.planes.trail import EvidenceAlone, PlaneTrail
from gtlayout.quality.assess import assess
from gtlayout.results.evidence import EdgeSeen, EvidenceSeen, TracksSeen
from gtlayout.results.evidence_file import read_evidence
from gtlayout.results.layout_files import write_results
from gtlayout.results.layout_reader import read_layout
from gtlayout.results.names import EVIDENCE_FILE, REVIEW_FILE
from gtlayout.results.refined_cameras import FILE as REFINED
from gtlayout.results.refined_cameras import with_refined_cameras
from gtlayout.results.review_file import read_review
from gtlayout.review.findings import Finding
from gtlayout.scene import Camera, Frame

SIZE = (64, 48)
CAMERA = Camera(np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]), np.eye(3), np.zeros(3), *SIZE)
FRAMES = tuple(Frame(name, Path(name), CAMERA) for name in ("001.png", "002.png", "1.png", "2.png"))
SQUARE = [[1, 2], [30, 2], [30, 40], [1, 40]]


@dataclass(frozen=True)
class Readable:
    """A file with a correct scene around it."""

    path: Path
    use: Callable[[], object]
    """Reads it, and uses what is read as far as it takes to refuse it."""
    mutation: Mutation | None = None
    """Damage that leaves its form whole; None = bytes only."""
    prints: bool = False
    """Whether its decoder has lines of its own on stderr, which nothing stops: libjpeg of a damaged JPEG."""


class Harness:
    """Readers that share a minute of fuzzing."""

    def __init__(self, files: list[Readable]) -> None:
        self.files = files
        self.seeds = [bytes([i]) + file.path.read_bytes() for i, file in enumerate(files)]
        self._silent = os.memfd_create("stderr")

    def file(self, data: bytes) -> Readable:
        """The file that an input is for."""
        return self.files[(data[0] if data else 0) % len(self.files)]

    def run(self, data: bytes) -> bool:
        """Whether the input is read; False where GtlayoutError refuses it. Anything else is raised, or AssertionError.

        Nothing may be printed, by compiled code either.
        """
        file = self.file(data)
        file.path.write_bytes(data[1:])
        with self._silence(file), warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                file.use()
            except GtlayoutError as error:
                assert str(error).isprintable(), "a message that is not printable"
                return False
        return True

    @contextmanager
    def _silence(self, file: Readable) -> Iterator[None]:
        """What is written to stderr within is an AssertionError, unless the file may."""
        own = os.dup(2)
        os.dup2(self._silent, 2)
        try:
            yield
        finally:
            os.dup2(own, 2)
            os.close(own)
            if said := os.fstat(self._silent).st_size:
                text = os.pread(self._silent, 500, 0).decode(errors="replace")
                os.ftruncate(self._silent, 0)
                os.lseek(self._silent, 0, os.SEEK_SET)
                assert file.prints, f"{said} bytes on stderr: {text}"


def harness(name: str, folder: Path) -> Harness:
    """One of ``HARNESSES``, its scenes in an empty folder."""
    return Harness(HARNESSES[name](folder))


def known(name: str) -> dict[str, bytes]:
    """Inputs that once broke a reader, by what is wrong in them."""
    return {path.name: path.read_bytes() for path in sorted((Path(__file__).parent / "known" / name).glob("*"))}


def _camera_files(folder: Path, formats: tuple[str, ...], mutation: Mutation | None) -> list[Readable]:
    """The files of these formats; of several that hold the same of each image, the first."""
    found: list[Readable] = []
    for name in formats:
        written = CAMERA_FORMATS[name](_new(folder / name), cameras_in_general_position(4))
        relative = sorted((path.relative_to(folder / name) for path in written), reverse=True)
        for path in {re.sub(r"\d+", "", path.as_posix()): path for path in relative}.values():
            root = _new(folder / f"{name}-{len(found)}")
            CAMERA_FORMATS[name](root, cameras_in_general_position(4))
            found.append(Readable(root / path, partial(_use_cameras, root), mutation))
    return found


def _use_cameras(root: Path) -> None:
    for reader in CAMERA_READERS:
        for path in reader.detect(root):
            frames, _, _ = build_frames(root, reader.read(root, path).images)
            for frame in frames:
                assert frame.image_path.is_relative_to(root), "a path that leads out of the scene"
                assert np.isfinite(frame.camera.center_world).all(), "a camera that is nowhere"
                assert np.isfinite(frame.camera.rays_world(np.array([[0.0, 0.0], SIZE]))).all(), "a ray that is none"


def _annotation_files(folder: Path) -> list[Readable]:
    contents = {file_name: json.dumps(data) for _, file_name, data in JSON_ANNOTATIONS.values()}
    contents["label_studio.json"] = json.dumps(label_studio_tasks())
    found = [_drawn(_new(folder / name) / name, content, json_tree) for name, content in contents.items()]
    native = JSON_ANNOTATIONS["native"][2]
    edited = _new(folder / "edited") / "annotations.json"
    write_json_atomic(edited, {**native, "drafts": native["frames"]})
    return [*found, Readable(edited, partial(_use_edited, edited.parent), json_tree)]


def _use_edited(root: Path) -> None:
    """As the page for annotating does."""
    store = Store(root, FRAMES)
    store.drafts()
    store.key_frames()


def _cvat_files(folder: Path) -> list[Readable]:
    return [_drawn(folder / "annotations.xml", CVAT, words)]


def _drawn(path: Path, content: str, mutation: Mutation) -> Readable:
    path.write_text(content)
    return Readable(path, partial(_use_annotations, path.parent), mutation)


def _use_annotations(root: Path) -> None:
    left_out(root)
    for reader in ANNOTATION_READERS:
        for path in reader.detect(root):
            key_frames, _ = build_key_frames(reader.read(root, path), FRAMES, (), {})
            for element in (element for key_frame in key_frames for element in key_frame.elements):
                assert element.amodal.is_valid and not element.amodal.is_empty, "an outline that is none"
                assert element.visible.is_valid, "a visible part that is none"


def _result_files(folder: Path) -> list[Readable]:
    surfaces = rooms.BOX[:5]
    scene = rooms.seen_from([rooms.level_camera([2.0, y, 1.25]) for y in (1.0, 0.5)], surfaces)
    scene = replace(scene, frames=tuple(replace(one, image_path=scene.root / one.name) for one in scene.frames))
    instances, extents = rooms.instances_of(surfaces, 2), tuple(surface.extent for surface in surfaces)
    planes = tuple(surface.plane for surface in surfaces)
    loa = Accuracy(0.011, 30, "within", 20)
    heights = Dimension(0, 1, "height", 2.5, 0.01, np.array([[0.0, 0, 0], [0, 0, 2.5]]), loa)
    measured = Measurement("between", ("floor_0", "ceiling_1"), 2.5, 0.003)
    layout = Layout(
        instances,
        planes,
        extents,
        build_mesh(instances, extents),
        metric=True,
        dimensions=(heights,),
        accuracies=(loa,) * len(instances),
        quantities=(Quantity("floor area", (0,), 20.0, 0.1, True),),
        scale=Scale(1.01, 0.002),
        measurements=(Checked(measured, 2.51, 0.01, True),),
        next_measurement=NextMeasurement(0, 0, 1, 1),
        inferred=extents,
    )
    alone = EvidenceAlone("tracks", 30, 0.012, 0.02, 0.4, 0.6, 1.0, 3)
    px = np.array([[20.0, 30.0], [40.0, 30.0]])
    evidence = EvidenceSeen(
        tuple(PlaneTrail(extent.frame.origin, (alone,)) for extent in extents),
        (TracksSeen(0, 0, px, np.array([0.02, 0.98])),),
        (EdgeSeen(1, (0, 4), px, px + 1, 1.0, True),),
    )
    findings = (Finding(0, "0.png", "e1", 2, "edge", "it is elsewhere", 3.5, px, px + 1),)
    quality = assess(scene, instances, planes, extents, Config().quality)
    written = (layout, quality, Config(), True, None, findings, evidence)
    uses: dict[str, Callable[[Path], object]] = {
        "layout.json": lambda out: read_layout(out, scene),
        EVIDENCE_FILE: lambda out: read_evidence(out, scene, layout),
        REVIEW_FILE: lambda out: read_review(out, scene),
        REFINED: lambda out: with_refined_cameras(scene, out),
    }
    found = []
    for name, use in uses.items():
        write_results(folder / name, scene, *written)
        found.append(Readable(folder / name / name, partial(use, folder / name), json_tree))
    return found


def _small_files(folder: Path) -> list[Readable]:
    scene = replace(
        rooms.seen_from([rooms.level_camera([2.0, y, 1.25]) for y in (1.0, 0.5)], rooms.BOX[:3]), root=folder
    )
    mark = [{"0.png": [1, 2], "1.png": [3, 4]}, {"0.png": [9, 2], "1.png": [13, 4]}]
    lens = {"model": "OPENCV", "width": 160, "height": 100, "params": [80.0, 80, 80, 50, 0.01, 0, 0, 0]}
    frame = {"image": "0.png", "number": 4, "time_s": 0.5, "lenses": [0]}
    size = {"frame_count": 50, "image_size": [160, 100], "orientation": 1}
    plane = {"normal": [0, 0, 1.0], "d": 0.5, "extent": [[[[0, 0, 0], [1, 0, 0], [1, 1, 0]]]]}
    record = Record("a", "accepted", stages_s={"tracking": 1.5}, files={"layout.json": "00"})
    write_record(folder / RECORD_FILE, record)
    contents: dict[str, Any] = {
        MEASUREMENTS: [
            {
                "between": ["floor_0", "ceiling_0"],
                "metres": 2.513,
                "sigma_m": 0.003,
                "elements": [["0.png", "e0"], None],
            },
            {"width": "door_0", "metres": 0.885, "assumed": True},
            {"angle": ["wall_0", "wall_1"], "degrees": 90.4},
            {"points": mark, "metres": 3.2},
        ],
        SCENE_FILE: {"unit": "cm", "scale_sigma": 0.01},
        LABELS: {"Wand": "wall", "x": None},
        TRUTH: {"planes": {"floor": plane, "none": {"normal": None}}, "elements": {"0.png": {"e0": "floor"}}},
        VIDEO_RECORD: {"format": "gtlayout-video/1", "video": "a.mp4", **size, "lenses": [lens], "frames": [frame]},
        RUN_FILE: {"format": RUN_FORMAT, "scenes": ["a"], "config": {}, "configuration": "00"},
    }
    for name, content in contents.items():
        write_json_atomic(folder / name, content)
    uses: dict[str, Callable[[], object]] = {
        MEASUREMENTS: lambda: read_measurements(folder / MEASUREMENTS, scene.frames),
        SCENE_FILE: lambda: read_unit(folder / SCENE_FILE),
        LABELS: lambda: read_label_file(folder / LABELS),
        TRUTH: lambda: read_truth(scene),
        VIDEO_RECORD: lambda: with_origins(folder, scene.frames),
        RECORD_FILE: lambda: read_record(folder / RECORD_FILE),
        RUN_FILE: lambda: read_run(folder),
    }
    return [Readable(folder / name, use, json_tree) for name, use in uses.items()]


def _archives(folder: Path) -> list[Readable]:
    structure = RoomStructure(
        "video_0",
        np.ones((2, 3, 3)),
        np.array([1, 2]),
        np.zeros(2, np.int64),
        (None, "wall", "floor"),
        np.array([33333]),
    )
    npz, zipped = folder / "room_structure.npz", _new(folder / "zip") / "drawn.zip"
    write_room_structure(npz, structure)
    with zipfile.ZipFile(zipped, "w") as archive:
        archive.writestr("annotations.xml", CVAT)
        archive.writestr("labelme/001.json", json.dumps(JSON_ANNOTATIONS["labelme"][2]))
    return [
        Readable(npz, lambda: read_room_structure(npz).render(CAMERA), members),
        Readable(zipped, partial(_use_annotations, zipped.parent), members),
    ]


def _pixels(folder: Path) -> list[Readable]:
    rng = np.random.default_rng(0)
    grey, depth = np.zeros((24, 32), np.uint8), rng.integers(900, 1100, (24, 32), dtype=np.uint16)
    grey[4:20, 6:20] = 1
    bgr = cv2.cvtColor(grey * 200, cv2.COLOR_GRAY2BGR)
    bgr[::3] += 9
    contents = {"mask.png": encoded(".png", grey), "depth.png": encoded(".png", depth)}
    contents |= {f"image{suffix}": encoded(suffix, bgr) for suffix in (".png", ".jpg", ".webp", ".bmp", ".ppm")}
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    exif = Image.Exif()
    exif[0x0112] = 6
    for name in ("tagged.tif", "tagged.jpg"):
        Image.fromarray(bgr).save(folder / name, exif=exif)
    camera = replace(CAMERA, width=32, height=24)
    frame = Frame("a", folder / "a", camera, depth_path=folder / "depth.png")
    uses: dict[str, Callable[[], object]] = {
        "mask.png": partial(_use_mask, folder / "mask.png"),
        "depth.png": lambda: read_depth(frame),
    }
    for name in [name for name in sorted(path.name for path in folder.iterdir()) if name not in uses]:
        uses[name] = partial(_use_image, folder / name)
    return [
        Readable(folder / name, use, png if name.endswith(".png") else None, prints=name.endswith(".jpg"))
        for name, use in uses.items()
    ]


def _use_mask(path: Path) -> None:
    try:
        assert mask_polygons(decode_mask(path.read_bytes()) == 1).is_valid, "an outline that is none"
    except ValueError as error:
        raise GtlayoutError(f"{path} {error}") from error


def _use_image(path: Path) -> None:
    read_header(path)
    assert decode(path, cv2.IMREAD_COLOR).shape[2:] == (3,), "an image that is none"


def _videos(folder: Path) -> list[Readable]:
    small = [picture[:24, :32] for picture in pictures(5)]
    made = {"a.mp4": "libx264", "a.mkv": "libx264", "a.avi": "mpeg4", "a.webm": "libvpx", "a.mov": "mjpeg"}
    found = []
    for name, codec in made.items():
        try:
            write_video(folder / name, small, codec=codec, options={"threads": "1"})
        except Exception:  # this PyAV cannot encode it; the others can be read all the same
            continue
        found.append(Readable(folder / name, partial(_use_video, folder / name)))
    return found


def _use_video(path: Path) -> None:
    video = Video(path)
    if len(video) and video.width * video.height:
        assert np.isfinite(video.interval_s), "times that are none"
        for index in (len(video) - 1, 0):
            assert video.frame(index).shape == (video.height, video.width, 3), "a frame of another size"


def _new(folder: Path) -> Path:
    folder.mkdir()
    return folder


TEXT_FORMATS = ("colmap_text", "scannet", "seven_scenes", "arkitscenes", "re10k")
HARNESSES: dict[str, Callable[[Path], list[Readable]]] = {
    "camera-texts": partial(_camera_files, formats=TEXT_FORMATS, mutation=words),
    "camera-json": partial(_camera_files, formats=("nerfstudio", "cad_estate", "polycam"), mutation=json_tree),
    "colmap-binary": partial(_camera_files, formats=("colmap_binary",), mutation=None),
    "annotations-json": _annotation_files,
    "annotations-xml": _cvat_files,
    "results": _result_files,
    "small-json": _small_files,
    "archives": _archives,
    "pixels": _pixels,
    "videos": _videos,
}
