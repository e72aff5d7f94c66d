"""One room in every format of cameras with every format of annotations: the same cameras, the same planes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from camera_writers import write_colmap_binary, writer_of
from label_studio_writer import write_label_studio

from gtlayout.config import Config
from gtlayout.io.files import write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.io.units import SCENE_FILE
from gtlayout.io.writing.scene_writers import (
    ANNOTATION_WRITERS,
    CAMERA_WRITERS,
    METRIC_FORMATS,
    AnnotationWriter,
    CameraFormat,
    CameraWriter,
    write_scene,
    write_to,
)
from gtlayout.layout import Layout
from gtlayout.method import solve
from gtlayout.scene import OPENINGS, Scene
from gtlayout.solution import Solution

CAMERAS: dict[str, CameraWriter] = {
    **{str(name): write for name, write in CAMERA_WRITERS.items()},
    "colmap-binary": write_colmap_binary,
    **{name: writer_of(name) for name in ("seven_scenes", "arkitscenes", "polycam")},
}
METRIC = {*METRIC_FORMATS, "seven_scenes", "arkitscenes", "polycam"}
ANNOTATIONS: dict[str, AnnotationWriter] = {
    **{str(name): write for name, write in ANNOTATION_WRITERS.items()},
    "label-studio": write_to("label_studio.json", write_label_studio),
}
SAME = 1e-6
"""Of poses, intrinsics and normals; of d relative to 1 m."""
WITHOUT_OCCLUSION_EDGES = ("coco",)
ROUNDING: dict[str, tuple[float, float]] = {
    # annotations: degrees, metres
    "cvat": (0.01, 0.0005),
    "coco": (1e-6, 1e-6),
    "labelme": (1e-6, 1e-6),
    "label-studio": (0.02, 0.001),
    "cad-estate": (1.0, 0.02),
}
"""How far planes may be off those of the native annotations, three times what was measured or more: CVAT has hundredths
of a pixel, Label Studio per cent, of which the last bit may decide on a sampled point, CAD-Estate whole pixels."""


@pytest.fixture(scope="module")
def original(small_room: Path) -> Scene:
    return load_scene(small_room)


@pytest.fixture(scope="module")
def read(original: Scene, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Scene]:
    """The room in these formats, written and read."""

    @cache
    def read_once(cameras: str, annotations: str) -> Scene:
        return load_scene(_write(original, tmp_path_factory.mktemp("formats") / "room_0", cameras, annotations))

    return read_once


@pytest.fixture(scope="module")
def solved(read: Callable[[str, str], Scene]) -> Callable[[str, str], tuple[Scene, Layout]]:
    """… and solved; each once."""

    @cache
    def solve_once(cameras: str, annotations: str) -> tuple[Scene, Layout]:
        scene = read(cameras, annotations)
        return scene, solve(scene, Config()).layout

    return solve_once


@pytest.mark.parametrize(("cameras", "annotations"), list(product(CAMERAS, ANNOTATIONS)))
def test_every_format_says_the_same(
    original: Scene,
    read: Callable[[str, str], Scene],
    solved: Callable[[str, str], tuple[Scene, Layout]],
    cameras: str,
    annotations: str,
) -> None:
    """All of a scene is compared as it is read. Solved are all cameras with one format of annotations, and the other
    way round: what is the same has the same solution.
    """
    scene = read(cameras, annotations)
    assert scene.metric
    _assert_same_cameras(scene, original)
    _assert_same_drawings(scene, read("native", annotations))
    if "native" not in (cameras, annotations):
        return
    layout, reference = solved(cameras, annotations)[1], solved("native", annotations)[1]
    angle_deg, offset_m = _difference(layout, reference)
    assert len(layout.planes) == len(reference.planes)
    assert np.deg2rad(angle_deg) < SAME
    assert offset_m < SAME


@pytest.mark.parametrize("annotations", [name for name in ANNOTATIONS if name != "native"])
def test_annotations_differ_by_their_rounding(
    solved: Callable[[str, str], tuple[Scene, Layout]], annotations: str
) -> None:
    """COCO, which has no occlusion edges, from the native ones without any; masks have openings in their walls."""
    native, expected = solved("native", "native")
    if annotations in WITHOUT_OCCLUSION_EDGES:
        key_frames = tuple(replace(key_frame, occlusion_edges=()) for key_frame in native.key_frames)
        expected = solve(replace(native, key_frames=key_frames), Config()).layout
    _, layout = solved("native", annotations)
    merged = OPENINGS if annotations == "cad-estate" else frozenset()
    labels = [instance.label for instance in expected.instances if instance.label not in merged]
    assert sorted(instance.label for instance in layout.instances) == sorted(labels)
    angle_deg, offset_m = _difference(layout, expected)
    most_deg, most_m = ROUNDING[annotations]
    assert angle_deg < most_deg
    assert offset_m < most_m


@pytest.mark.parametrize("annotations", ANNOTATION_WRITERS)
def test_truth_goes_along(
    original: Scene, solved: Callable[[str, str], tuple[Scene, Layout]], annotations: str
) -> None:
    assert _drawn_of_each_plane(solved("native", annotations)[0]) == {
        plane: count
        for plane, count in _drawn_of_each_plane(original).items()
        if annotations != "cad-estate" or not plane.startswith(tuple(OPENINGS))
    }


@pytest.mark.parametrize("cameras", CAMERA_WRITERS)
def test_real_clips_in_every_format(real_clip: Path, tmp_path: Path, cameras: CameraFormat) -> None:
    """Cameras, images byte by byte, annotations and, where the format has it, depth."""
    scene = load_scene(real_clip)
    write_scene(scene, tmp_path / "clip_0", cameras, "native")
    read = load_scene(tmp_path / "clip_0")
    assert read.metric
    _assert_same_cameras(read, scene)
    has_depth = cameras in ("native", "colmap", "scannet")
    for before, after in zip(scene.frames, read.frames, strict=True):
        assert after.image_path.read_bytes() == before.image_path.read_bytes()
        assert (after.depth_path is not None) == (before.depth_path is not None and has_depth)
        if before.depth_path is not None and after.depth_path is not None:
            assert after.depth_path.read_bytes() == before.depth_path.read_bytes()
    for key, expected in zip(read.key_frames, scene.key_frames, strict=True):
        assert key.frame == expected.frame
        assert [element.id for element in key.elements] == [element.id for element in expected.elements]
        assert all(a.amodal.equals(b.amodal) for a, b in zip(key.elements, expected.elements, strict=True))


def test_a_real_clip_solves_to_the_same_figures(office_part: Scene, office_solution: Solution, tmp_path: Path) -> None:
    """From quaternions and cameras in another frame; what is read of all formats is compared above."""
    expected = office_solution
    write_scene(office_part, tmp_path / "office_0", "colmap", "native")
    solution = solve(load_scene(tmp_path / "office_0"), Config())
    angle_deg, offset_m = _difference(solution.layout, expected.layout)
    assert len(solution.layout.planes) == len(expected.layout.planes)
    assert np.deg2rad(angle_deg) < SAME
    assert offset_m < SAME
    assert solution.quality.iou == pytest.approx(expected.quality.iou, abs=SAME)


def _write(scene: Scene, out: Path, cameras: str, annotations: str) -> Path:
    if cameras in CAMERA_WRITERS and annotations in ANNOTATION_WRITERS:
        write_scene(scene, out, cameras, annotations)
    else:
        ANNOTATIONS[annotations](replace(scene, frames=CAMERAS[cameras](scene, out)), out)
        if cameras not in METRIC:
            write_json_atomic(out / SCENE_FILE, {"metric": True})
    return out


def _assert_same_cameras(scene: Scene, expected: Scene) -> None:
    for frame, other in zip(scene.frames, expected.frames, strict=True):
        for name in ("K", "R_cam_from_world", "t_cam_from_world"):
            found, wanted = getattr(frame.camera, name), getattr(other.camera, name)
            np.testing.assert_allclose(found, wanted, rtol=0, atol=SAME, err_msg=f"{frame.name}: {name}")


def _assert_same_drawings(scene: Scene, expected: Scene) -> None:
    for found, wanted in zip(scene.key_frames, expected.key_frames, strict=True):
        assert found.frame == wanted.frame
        for one, other in zip(found.elements, wanted.elements, strict=True):
            assert (one.id, one.label) == (other.id, other.label)
            for a, b in ((one.amodal, other.amodal), (one.visible, other.visible)):
                assert a.symmetric_difference(b).area < SAME * (1 + b.area)
        for line, same in zip(found.occlusion_edges, wanted.occlusion_edges, strict=True):
            np.testing.assert_allclose(line, same, rtol=0, atol=SAME)


def _difference(layout: Layout, expected: Layout) -> tuple[float, float]:
    """The largest angle (degrees) and distance (of d) between planes of ``layout`` and the nearest ones expected."""
    worst = np.zeros(2)
    for instance, plane in zip(layout.instances, layout.planes, strict=True):
        assert plane is not None
        differences = [
            (np.rad2deg(np.linalg.norm(plane.normal - other.normal)), abs(plane.d - other.d))
            for same, other in zip(expected.instances, expected.planes, strict=True)
            if other is not None and same.label == instance.label
        ]
        worst = np.maximum(worst, min(differences, key=sum))
    return float(worst[0]), float(worst[1])


def _drawn_of_each_plane(scene: Scene) -> Counter[str]:
    truth = read_truth(scene)
    assert truth is not None
    return Counter(truth.elements.values())
