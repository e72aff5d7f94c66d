"""Variants of a scene: similarities are undone exactly, true planes carried exactly, drawings kept in step."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rooms
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from common.metrics import Metric
from gtlayout.errors import GtlayoutError
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.instances import Mesh, Plane
from gtlayout.io.files import write_json_atomic
from gtlayout.io.pixels.images import read_rgb
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import TruePlane, Truth, read_truth
from gtlayout.layout import Layout
from gtlayout.quality.measures import InstanceQuality, Verdict
from gtlayout.scene import Camera, FloatArray, Scene
from measure_variant import measured_apart
from variants.clip_forms import forms, sources_by_id, write_video
from variants.measures import (
    OFF_SHARE,
    WHOLE,
    carried,
    compared_planes,
    forget_peak,
    median_depth,
    peak_bytes,
    plane_rows,
    points_on,
)
from variants.variant import Similarity, all_drawn, variant, with_frames

CAMERAS = [rooms.level_camera([x, 0.5, 1.2]) for x in (1.5, 2.0, 2.5)]
MOVED = Similarity(7.3, Rotation.from_euler("xyz", [0.3, -1.1, 2.0]).as_matrix(), np.array([6000.0, -64.0, 4.8]))
POINTS = np.random.default_rng(1).uniform([0.5, 2, 0.2], [3.5, 4.5, 2.2], (20, 3))
COVARIANCE = 1e-4 * np.cov(np.random.default_rng(0).normal(size=(4, 9)))


def layout_of(surfaces: tuple[rooms.Surface, ...], covariance: FloatArray = COVARIANCE) -> Layout:
    """The surfaces as solved without error, from drawings in three key frames."""
    planes = tuple(replace(surface.plane, covariance=covariance) for surface in surfaces)
    extents = tuple(surface.extent for surface in surfaces)
    return Layout(rooms.instances_of(surfaces, len(CAMERAS)), planes, extents, Mesh.empty(), metric=True)


def in_the_world_of(moved: Similarity, layout: Layout) -> Layout:
    """The inverse of ``undone``, by the inverse similarity."""
    back = Similarity(1 / moved.scale, moved.R.T, -moved.R.T @ moved.t / moved.scale)
    return back.undone(layout, metric=False)


def room_with_truth(root: Path) -> Scene:
    """The box room in three key frames, each element named like its surface."""
    scene = replace(rooms.seen_from(CAMERAS, rooms.BOX[:5]), root=root)
    planes = {
        f"s{i}": {"normal": surface.plane.normal, "d": surface.plane.d} for i, surface in enumerate(rooms.BOX[:5])
    }
    elements = {frame.name: {f"e{i}": f"s{i}" for i in range(5)} for frame in scene.frames}
    write_json_atomic(root / "gt_planes.json", {"planes": planes, "elements": elements})
    return scene


def judged(*verdicts: Verdict) -> tuple[InstanceQuality, ...]:
    return tuple(InstanceQuality(1.0, 0.1, 0.1, 3.0, verdict, "") for verdict in verdicts)


ALL_OK = judged("ok", "ok", "ok", "ok", "ok")


def figures(metrics: list[Metric]) -> dict[str, float]:
    return {metric.key: metric.value for metric in metrics}


def test_a_moved_camera_sees_the_moved_world_as_before() -> None:
    moved_points = MOVED.scale * POINTS @ MOVED.R.T + MOVED.t
    for camera in CAMERAS:
        pixels, depth = camera.project(POINTS)
        found, found_depth = MOVED.camera(camera).project(moved_points)
        assert_allclose(found, pixels, atol=1e-8)
        assert_allclose(found_depth, MOVED.scale * depth, rtol=1e-10)


def test_a_similarity_is_undone_exactly() -> None:
    """Planes, what they say of their σ, and extents, there and back; and there they are where the points went."""
    layout = layout_of(rooms.BOX)
    there = in_the_world_of(MOVED, layout)
    back = MOVED.undone(there, metric=True)
    assert back.metric
    for plane, moved, surface in zip(back.planes, there.planes, rooms.BOX, strict=True):
        corners = MOVED.scale * surface.corners @ MOVED.R.T + MOVED.t
        assert_allclose(corners @ moved.normal + moved.d, 0, atol=1e-9)
        assert_allclose(moved.normal, MOVED.R @ surface.plane.normal, atol=1e-12)
        assert_allclose(plane.normal, surface.plane.normal, atol=1e-12)
        assert plane.d == pytest.approx(surface.plane.d, abs=1e-9)
        assert_allclose(plane.sigma_offset(POINTS), np.asarray(layout.planes[0].sigma_offset(POINTS)), rtol=1e-6)
        moved_points = MOVED.scale * POINTS @ MOVED.R.T + MOVED.t
        assert_allclose(moved.sigma_offset(moved_points), MOVED.scale * plane.sigma_offset(POINTS), rtol=1e-6)
    for extent, moved_extent, surface in zip(back.extents, there.extents, rooms.BOX, strict=True):
        ((ring,),) = extent.frame.rings_to_world(extent.region)
        ((moved_ring,),) = moved_extent.frame.rings_to_world(moved_extent.region)
        assert_allclose(moved_ring, MOVED.scale * ring @ MOVED.R.T + MOVED.t, atol=1e-8)
        assert {tuple(np.round(corner, 9) + 0.0) for corner in ring} == {
            tuple(np.round(corner, 9) + 0.0) for corner in surface.corners
        }


def test_the_true_plane_keeps_its_depth_at_every_pixel() -> None:
    """Whatever is wrong with the camera: pose, lens, both."""
    wall = rooms.FAR.plane
    true = TruePlane(wall.normal, wall.d, scored=True)
    turn = Rotation.from_euler("xyz", [0.02, -0.05, 0.03]).as_matrix()
    given = replace(
        CAMERAS[0],
        K=CAMERAS[0].K * np.array([[1.05, 1, 1.02], [1, 0.95, 1], [1, 1, 1]]),
        R_cam_from_world=turn @ CAMERAS[0].R_cam_from_world,
        t_cam_from_world=CAMERAS[0].t_cam_from_world + np.array([0.1, -0.2, 0.3]),
    )
    pixels = np.array([[10.0, 20.0], [80.5, 50.5], [150.0, 90.0], [3.0, 99.0]])
    seen = carried(true, CAMERAS[0], given)
    assert_allclose(_depths(seen, given, pixels), _depths(wall, CAMERAS[0], pixels), rtol=1e-12)
    points, depth = points_on(seen, given, pixels), _depths(wall, CAMERAS[0], pixels)
    found_px, found_depth = given.project(points)
    assert_allclose(found_px, pixels, atol=1e-9)
    assert_allclose(found_depth, depth, rtol=1e-12)
    same = carried(true, given, given)
    assert_allclose(same.normal, wall.normal, atol=1e-12)
    assert same.d == pytest.approx(wall.d)


def _depths(plane: Plane, camera: Camera, pixels: FloatArray) -> FloatArray:
    return np.asarray(1 / (np.column_stack([pixels, np.ones(len(pixels))]) @ inverse_depth(plane, camera)))


@pytest.mark.parametrize("name", ["as it is", "without a unit", "cameras × 0.1", "cameras × 1000", "world moved"])
def test_a_perfect_layout_is_perfect_in_every_form(tmp_path: Path, name: str) -> None:
    """As each form would have it, in its own unit and world."""
    scene = room_with_truth(tmp_path)
    made = forms(scene)[name](tmp_path)
    assert made.given.metric is (name in ("as it is", "world moved"))
    layout = made.moved.undone(in_the_world_of(made.moved, layout_of(rooms.BOX[:5])), metric=True)
    truth = read_truth(made.judge)
    assert truth is not None
    rows = plane_rows(made, truth, layout, ALL_OK)
    assert list(rows) == ["s0|floor_0|ok", "s1|ceiling_1|ok", "s2|wall_2|ok", "s3|wall_3|ok", "s4|wall_4|ok"]
    for metrics in rows.values():
        found = figures(metrics)
        assert found["offset_error"] < 1e-8
        assert found["normal_error"] < 1e-5
        assert (found["off"], found["wrong_and_certain"]) == (0, 0)
        assert found["offset_sigma"] > 0


def test_the_given_camera_of_a_scaled_form_is_scaled(tmp_path: Path) -> None:
    scene = room_with_truth(tmp_path)
    given = forms(scene)["cameras × 7.3"](tmp_path).given
    for frame, own in zip(given.frames, scene.frames, strict=True):
        assert_allclose(frame.camera.center_world, 7.3 * own.camera.center_world)
        assert_allclose(frame.camera.R_cam_from_world, own.camera.R_cam_from_world)


def off_by(offset_m: float, sigma_m: float, turn_deg: float = 0.0, sigma_deg: float = 1e-3) -> Plane:
    """The far wall, moved, turned about an upright line in its middle, and what it says of both."""
    wall = rooms.FAR.plane
    middle = rooms.FAR.corners.mean(axis=0) - offset_m * wall.normal
    normal = Rotation.from_euler("z", turn_deg, degrees=True).apply(wall.normal)
    # Errors of the normal about the middle; d follows from them and its own.
    across = np.array([[1.0, 0, 0], [0, 0, 1.0]])
    from_tilts = np.column_stack([across, -across @ middle])
    covariance = np.deg2rad(sigma_deg) ** 2 * from_tilts.T @ from_tilts
    covariance[3, 3] += sigma_m**2
    return Plane(normal, -float(normal @ middle), covariance, observable=True)


@pytest.mark.parametrize(
    ("plane", "verdict", "off", "certain"),
    [
        (off_by(0.3, 0.01), "ok", 1, 1),
        (off_by(0.3, 0.11), "ok", 1, 0),
        (off_by(0.3, 0.01), "weak", 1, 0),
        (off_by(0.09, 0.001), "ok", 0, 0),
        (off_by(0.0, 0.01, 6.0, 1.0), "ok", 1, 1),
        (off_by(0.0, 0.001, 6.0, 2.1), "ok", 1, 0),
        (off_by(0.3, 0.2, 4.0, 0.1), "ok", 1, 0),
        (off_by(0.3, 0.2, 6.0, 0.1), "ok", 1, 1),
    ],
)
def test_wrong_and_certain(tmp_path: Path, plane: Plane, verdict: Verdict, off: int, certain: int) -> None:
    """More than 10 cm or 5° off, called ok, and the σ of just that below a third of the error."""
    made = variant(scene := room_with_truth(tmp_path), scene, all_drawn(scene))
    perfect = layout_of(rooms.BOX[:5])
    layout = replace(perfect, planes=(*perfect.planes[:4], plane))
    truth = read_truth(made.judge)
    assert truth is not None
    found = figures(plane_rows(made, truth, layout, judged("ok", "ok", "ok", "ok", verdict))[f"s4|wall_4|{verdict}"])
    assert (found["off"], found["wrong_and_certain"]) == (off, certain)


def test_offset_and_sigma_are_those_at_the_drawn_pixels(tmp_path: Path) -> None:
    made = variant(scene := room_with_truth(tmp_path), scene, all_drawn(scene))
    perfect = layout_of(rooms.BOX[:5])
    layout = replace(perfect, planes=(*perfect.planes[:4], off_by(0.3, 0.02)))
    truth = read_truth(made.judge)
    assert truth is not None
    found = figures(plane_rows(made, truth, layout, ALL_OK)["s4|wall_4|ok"])
    assert found["offset_error"] == pytest.approx(0.3)
    assert found["offset_sigma"] == pytest.approx(0.02, abs=1e-4)
    assert found["normal_error"] == pytest.approx(0, abs=1e-5)


def test_without_a_unit_lengths_are_shares_of_the_depth(tmp_path: Path) -> None:
    scene = replace(room_with_truth(tmp_path), metric=False)
    made = variant(scene, scene, all_drawn(scene))
    truth = read_truth(made.judge)
    assert truth is not None
    depth = median_depth(made, truth)
    assert 1.5 < depth < 4.5
    limit = OFF_SHARE * depth
    for offset, off in ((0.98 * limit, 0), (1.02 * limit, 1)):
        perfect = layout_of(rooms.BOX[:5])
        layout = replace(perfect, planes=(*perfect.planes[:4], off_by(offset, 0.01)))
        metrics = plane_rows(made, truth, layout, ALL_OK)["s4|wall_4|ok"]
        assert metrics[0].unit == "of depth"
        assert figures(metrics)["offset_error"] == pytest.approx(offset / depth)
        assert figures(metrics)["off"] == off


def test_planes_without_an_instance_are_missing(tmp_path: Path) -> None:
    made = variant(scene := room_with_truth(tmp_path), scene, all_drawn(scene))
    perfect = layout_of(rooms.BOX[:5])
    unknown = replace(perfect.planes[4], observable=False)
    layout = replace(perfect, planes=(*perfect.planes[:4], unknown))
    truth = read_truth(made.judge)
    assert truth is not None
    rows = plane_rows(made, truth, layout, ALL_OK)
    assert [key for key, metrics in rows.items() if not metrics] == ["s4||unobservable"]


def test_a_weak_truth_counts_only_where_there_is_no_other() -> None:
    def truth(*scored: bool) -> Truth:
        planes = {f"p{i}": TruePlane(np.array([0, 0, 1.0]), 1.0, each) for i, each in enumerate(scored)}
        planes["unknown"] = TruePlane(np.full(3, np.nan), np.nan, False)
        planes["not drawn"] = TruePlane(np.array([0, 0, 1.0]), 1.0, True)
        return Truth(planes, {(0, i): name for i, name in enumerate(planes) if name != "not drawn"})

    assert compared_planes(truth(True, False)) == ["p0"]
    assert compared_planes(truth(False, False)) == ["p0", "p1"]


def test_key_frames_stay_when_frames_go(room: Path, tmp_path: Path) -> None:
    """24 frames, every eighth a key frame."""
    scene = load_scene(room)
    made = forms(scene)["every 3rd frame"](tmp_path)
    names = [frame.name for frame in made.given.frames]
    assert names == [f"{i:06d}.jpg" for i in sorted({*range(0, 24, 3), 0, 8, 16})]
    assert [made.given.frame_of(k).name for k in range(3)] == [scene.frame_of(k).name for k in range(3)]
    halved = forms(scene)["half of the key frames"](tmp_path)
    assert [halved.given.frame_of(k).name for k in range(2)] == ["000000.jpg", "000016.jpg"]
    assert halved.judge.key_frames == (scene.key_frames[0], scene.key_frames[2])
    assert halved.true_cameras == (scene.frame_of(0).camera, scene.frame_of(2).camera)
    with pytest.raises(KeyError):
        with_frames(scene, [0, 1])


def test_nobody_is_given_the_depth(room: Path, tmp_path: Path) -> None:
    made = forms(load_scene(room))["as it is"](tmp_path)
    assert all(frame.depth_path is None for frame in made.given.frames)
    assert any(frame.depth_path is not None for frame in made.judge.frames)


def test_a_video_shows_what_the_images_show(room: Path, tmp_path: Path) -> None:
    """As far as re-encoding allows: no frame is out of step."""
    scene = load_scene(room)
    given = forms(scene)["mp4"](tmp_path).given
    assert all(frame.video is not None for frame in given.frames)
    images = [read_rgb(frame).astype(float) for frame in scene.frames]
    for i in (0, 7, 23):
        off = [float(np.abs(read_rgb(given.frames[i]).astype(float) - image).mean()) for image in images]
        assert int(np.argmin(off)) == i
        assert off[i] < 6


def test_a_video_is_the_same_every_time(room: Path, tmp_path: Path) -> None:
    files = [tmp_path / "a.mp4", tmp_path / "b.mp4"]
    for file in files:
        write_video(file, load_scene(room))
    assert files[0].read_bytes() == files[1].read_bytes()


def test_half_the_size_is_the_same_view(room: Path, tmp_path: Path) -> None:
    scene = load_scene(room)
    made = forms(scene)["images × ½"](tmp_path)
    for k, key_frame in enumerate(made.given.key_frames):
        camera, own = made.given.frame_of(k).camera, scene.frame_of(k).camera
        assert (camera.width, camera.height) == (160, 120)
        points = own.center_world + own.rays_world(np.array([[10.0, 20.0], [300.0, 100.0]])) * 2.5
        assert_allclose(camera.project(points)[0], own.project(points)[0] / 2, atol=1e-6)
        for element, original in zip(key_frame.elements, made.judge.key_frames[k].elements, strict=True):
            assert (element.id, element.label) == (original.id, original.label)
            assert element.amodal.area == pytest.approx(original.amodal.area / 4, rel=1e-6)
            assert element.visible.area == pytest.approx(original.visible.area / 4, rel=1e-3, abs=2)


def test_elements_that_a_file_lost_or_moved_are_found_by_their_ids(room: Path) -> None:
    scene = load_scene(room)
    key_frames = [replace(key_frame, elements=key_frame.elements[::-1][:-1]) for key_frame in scene.key_frames]
    written = replace(scene, key_frames=tuple(key_frames))
    count = len(scene.key_frames[0].elements)
    assert sources_by_id(scene, written)[0] == (0, list(range(count - 1, 0, -1)))


def test_a_solve_apart_says_what_it_took(room: Path, tmp_path: Path) -> None:
    """In its own process: figures of the scene, and of each plane."""
    rows = measured_apart("forms", room, "cameras × 1000")
    whole = figures(rows[WHOLE])
    assert whole["iou"] > 0.5
    assert 60 < whole["peak_memory"] < 2000
    assert whole["time"] > 0
    assert whole["within_5cm"] <= whole["within_10cm"] <= 1
    assert whole["depth_error_median"] < 1.0, "metres, not millimetres"
    assert whole["planes"] + whole["missing"] == len(rows) - 1
    assert sum(figures(of)["off"] for key, of in rows.items() if key != WHOLE and of) == whole["off"]


def test_a_solve_apart_that_fails_says_why(room: Path, tmp_path: Path) -> None:
    shutil.copytree(room, tmp_path / "grey")
    for image in (tmp_path / "grey/images").iterdir():
        image.write_bytes(b"no image")
    with pytest.raises(GtlayoutError, match=r"image") as caught:
        measured_apart("forms", tmp_path / "grey", "as it is")
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(),
    reason="needs /proc/self/clear_refs: only Linux can reset the peak memory of a running process",
)
def test_peak_memory_is_that_since_it_was_forgotten() -> None:
    large = np.ones(100 << 17)
    with_it = peak_bytes()
    del large
    assert peak_bytes() == pytest.approx(with_it, abs=20 << 20), "a peak stays"
    forget_peak()
    assert 60 << 20 < peak_bytes() < with_it - (60 << 20)


def test_only_a_variant_knows_its_true_cameras(tmp_path: Path) -> None:
    scene = room_with_truth(tmp_path)
    spoiled = [replace(camera, K=2 * camera.K) for camera in CAMERAS]
    made = variant(scene, scene, all_drawn(scene), spoiled)
    assert [frame.camera for frame in made.judge.frames] == spoiled
    assert list(made.true_cameras) == CAMERAS
