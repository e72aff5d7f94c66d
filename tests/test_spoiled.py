"""Spoiling cameras and drawings: each does what its name says, by how much it says, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rooms
import shapely
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from shapely import MultiPolygon, box

from gtlayout.errors import GtlayoutError
from gtlayout.io.files import write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.scene import Camera, Element, FloatArray, KeyFrame, Label, Scene
from variants import spoiled_cameras, spoiled_elements
from variants.degradations import degradations, kind_of
from variants.spoiled_cameras import path_length

WALK = [rooms.level_camera([0.1 * i, 0.2 * np.sin(i), 1.2 + 0.01 * i]) for i in range(11)]
VIEW = rooms.facing_camera()
"""100x80 px."""


def angle_deg(first: Camera, second: Camera) -> float:
    """Between two orientations."""
    turn = first.R_cam_from_world @ second.R_cam_from_world.T
    return float(np.rad2deg(Rotation.from_matrix(turn).magnitude()))


def steps(cameras: tuple[Camera, ...]) -> FloatArray:
    return np.linalg.norm(np.diff([camera.center_world for camera in cameras], axis=0), axis=1)


def test_focal_length() -> None:
    (found,) = spoiled_cameras.other_focal(WALK[:1], 1.05)
    assert_allclose(found.K, [[84, 0, 80], [0, 84, 50], [0, 0, 1]])
    assert_allclose(found.t_cam_from_world, WALK[0].t_cam_from_world)


def test_roll_turns_the_image_about_its_middle() -> None:
    for found, given in zip(spoiled_cameras.rolled(WALK, 2.0), WALK, strict=True):
        assert_allclose(found.center_world, given.center_world, atol=1e-12)
        assert angle_deg(found, given) == pytest.approx(2.0)
        ahead = given.center_world + given.R_cam_from_world[2]
        assert_allclose(found.project(ahead[None])[0], [[80, 50]], atol=1e-9)


def test_yaw_drifts_evenly_and_bends_the_path() -> None:
    found = spoiled_cameras.yaw_drift(WALK, 3.0)
    assert [angle_deg(a, b) for a, b in zip(found, WALK, strict=True)] == pytest.approx(np.linspace(0, 3, 11), abs=1e-6)
    assert_allclose(steps(found), steps(tuple(WALK)))
    # The relative motion of neighbours is off by a step of the drift only: that is what makes it a drift.
    for i in range(10):
        own = WALK[i].R_cam_from_world @ (WALK[i + 1].center_world - WALK[i].center_world)
        assert_allclose(
            found[i].R_cam_from_world @ (found[i + 1].center_world - found[i].center_world), own, atol=1e-12
        )
    # Upright stays upright.
    assert_allclose([camera.R_cam_from_world[1] for camera in found], [[0, 0, -1]] * 11, atol=1e-12)


def test_scale_drifts_about_one() -> None:
    found = spoiled_cameras.scale_drift(WALK, 0.3)
    assert_allclose(steps(found) / steps(tuple(WALK)), np.linspace(0.85, 1.15, 10))
    assert all(angle_deg(a, b) == pytest.approx(0, abs=1e-5) for a, b in zip(found, WALK, strict=True))


def test_late_poses() -> None:
    found = spoiled_cameras.late(WALK, 2)
    centers = [camera.center_world for camera in WALK]
    assert_allclose([camera.center_world for camera in found], [centers[max(i - 2, 0)] for i in range(11)])


def test_jitter_is_as_large_as_it_says_and_the_same_every_time() -> None:
    many = [WALK[0]] * 2000
    found = spoiled_cameras.jittered(many, 0.2, 0.01)
    off = np.array([camera.center_world - WALK[0].center_world for camera in found])
    assert_allclose(off.std(axis=0), 0.01, rtol=0.06)
    turned = [angle_deg(camera, WALK[0]) for camera in found]
    assert np.sqrt(np.mean(np.square(turned))) == pytest.approx(0.2 * np.sqrt(3), rel=0.05)
    again = spoiled_cameras.jittered(many, 0.2, 0.01)
    assert_allclose([c.center_world for c in again], [c.center_world for c in found], atol=0)


def test_a_centimetre_without_a_unit_is_a_share_of_the_path() -> None:
    scene = replace(rooms.seen_from(WALK, [rooms.FAR]), metric=False)
    (jitter,) = (name for name in spoiled_cameras.spoiled_cameras(scene) if "jitter" in name)
    found = spoiled_cameras.spoiled_cameras(scene)[jitter]()
    expected = spoiled_cameras.jittered(WALK, 0.2, 0.002 * path_length(WALK))
    assert_allclose([c.center_world for c in found], [c.center_world for c in expected])


def element(name: str, label: Label, region: shapely.Polygon, visible: shapely.Polygon | None = None) -> Element:
    return Element(name, label, MultiPolygon([region]), MultiPolygon([visible or region]))


LEFT = element("l", "wall", box(0, 0, 40, 60))
RIGHT = element("r", "door", box(40, 0, 100, 60))
BELOW = element("b", "floor", box(0, 60, 100, 80))
DRAWN = list(enumerate([LEFT, RIGHT, BELOW]))


def areas(drawn: list[tuple[int, Element]]) -> list[float]:
    return [element.amodal.area for _, element in drawn]


def test_an_edge_moves_in_all_elements_that_share_it() -> None:
    edge = np.array([[40.0, 60.0], [40.0, 0.0]])
    found = spoiled_elements.shifted_edge(DRAWN, edge, 15.0, VIEW)
    moved = abs(areas(found)[0] - LEFT.amodal.area)
    assert moved == pytest.approx(15 * 60)
    assert areas(found)[0] + areas(found)[1] == pytest.approx(100 * 60)
    assert areas(found)[2] == pytest.approx(100 * 20)
    assert all(element.amodal.buffer(1e-6).covers(element.visible) for _, element in found)


def test_the_longest_edge_is_none_of_the_image_border() -> None:
    edge = spoiled_elements.longest_edge(RIGHT, VIEW)
    assert edge is not None
    # 60 px along the floor and 60 px along the wall; the other two run along the image.
    assert np.linalg.norm(edge[1] - edge[0]) == 60
    assert spoiled_elements.longest_edge(element("a", "wall", box(0, 0, 100, 80)), VIEW) is None


def test_an_element_moves_within_the_image() -> None:
    found = spoiled_elements.shifted_element(DRAWN, 1, np.array([15.0, 0.0]), VIEW)
    assert found[1][1].amodal.bounds == (55, 0, 100, 60)
    assert found[1][1].visible.bounds == (55, 0, 100, 60)
    assert (found[0], found[2]) == (DRAWN[0], DRAWN[2])
    gone = spoiled_elements.shifted_element(DRAWN, 1, np.array([150.0, 0.0]), VIEW)
    assert [number for number, _ in gone] == [0, 2]


def test_jitter_moves_every_vertex_within_the_image() -> None:
    inner = list(enumerate([element("i", "wall", box(30, 30, 70, 60))]))
    corners = [
        shapely.get_coordinates(spoiled_elements.jittered(inner, 2.0, VIEW, np.random.default_rng(i))[0][1].amodal)
        for i in range(50)
    ]
    off = np.concatenate([shapely.get_coordinates(inner[0][1].amodal)[:4, None] - of[None, :4] for of in corners])
    nearest = np.abs(off).sum(axis=2).min(axis=1)
    assert 1 < nearest.mean() < 4
    found = spoiled_elements.jittered(DRAWN, 8.0, VIEW, np.random.default_rng(0))
    assert all(shapely.box(0, 0, 100, 80).covers(of.amodal) and of.amodal.is_valid for _, of in found)


def test_labels_and_visible_parts() -> None:
    swapped = spoiled_elements.swapped_labels(DRAWN, 0, 2)
    assert [of.label for _, of in swapped] == ["floor", "door", "wall"]
    assert [of.amodal for _, of in swapped] == [of.amodal for _, of in DRAWN]
    half_hidden = element("h", "wall", box(0, 0, 40, 60), box(0, 0, 40, 20))
    (hidden, open_) = spoiled_elements.visible_on_furniture([(0, half_hidden), (1, RIGHT)])
    assert hidden[1].visible.bounds == (0, 20, 40, 60)
    assert open_[1] == RIGHT


def test_which_element_is_spoiled() -> None:
    assert spoiled_elements.largest(DRAWN) == 1
    assert spoiled_elements.largest(DRAWN, ("wall",)) == 0
    assert spoiled_elements.largest_of_another_label(DRAWN, 1) == 0
    assert spoiled_elements.largest_of_another_label(DRAWN[:1], 0) is None


@pytest.fixture(scope="module")
def scene(room: Path) -> Scene:
    """24 frames, key frames 0, 8 and 16; rooms of one box have no occlusion edges of their own."""
    made = load_scene(room)
    first = replace(made.key_frames[0], occlusion_edges=(np.array([[10.0, 10.0], [10.0, 90.0]]),))
    return replace(made, key_frames=(first, *made.key_frames[1:]))


def test_names_say_what_was_chosen(scene: Scene) -> None:
    """The middle key frame is spoiled."""
    names = list(degradations(scene))
    kinds = list(dict.fromkeys(map(kind_of, names)))
    assert kinds == [
        "unspoiled",
        *("focal length + 5 %", "focal length − 5 %", "yaw drifting by 3°", "roll 2°", "scale drifting by 0.3"),
        *("poses 1 frame late", "poses 2 frames late", "pose jitter 0.2°, 1 cm"),
        *("key frame dropped", "only the first two key frames", "only the first and the last key frame"),
        *("labels swapped", "edge shifted 15 px", "element shifted 15 px", "edge shifted 30 px"),
        *("element shifted 30 px", "vertices jittered 8 px", "element left out", "element left out everywhere"),
        *("visible parts on furniture", "no occlusion edges", "drawing of another time"),
    ]
    assert [name for name in names if kind_of(name) == "key frame dropped"] == [
        f"key frame dropped: 0000{i}.jpg" for i in ("00", "08", "16")
    ]
    assert names[-1] == "drawing of another time: 000008.jpg on 000018.jpg"
    assert all("000008.jpg" in name for name in names if kind_of(name) in ("labels swapped", "element left out"))


def test_drawings_and_truth_stay_in_step(scene: Scene, tmp_path: Path) -> None:
    """Every variant: as many elements given as judged, with the same ids, and the judge's drawn as in the original."""
    truth = read_truth(scene)
    assert truth is not None
    for name, make in degradations(scene).items():
        made = make(tmp_path)
        assert len(made.true_cameras) == len(made.given.key_frames) == len(made.judge.key_frames) > 0, name
        numbers = [key_frame.frame for key_frame in made.given.key_frames]
        assert numbers == sorted(set(numbers)), name
        for given, judge in zip(made.given.key_frames, made.judge.key_frames, strict=True):
            assert [of.id for of in given.elements] == [of.id for of in judge.elements], name
            (original,) = (of for of in scene.key_frames if of.frame == judge.frame)
            assert set(judge.elements) <= set(original.elements), name
        judged = read_truth(made.judge)
        assert judged is not None
        assert set(judged.elements.values()) <= set(truth.elements.values())


def made_of(scene: Scene, kind: str, folder: Path) -> tuple[Scene, Scene]:
    """What is given, and what judges, in the one degradation of this kind."""
    (name,) = (name for name in degradations(scene) if kind_of(name) == kind)
    made = degradations(scene)[name](folder)
    return made.given, made.judge


def test_spoiled_scenes(scene: Scene, tmp_path: Path) -> None:
    def counts(of: Scene) -> list[int]:
        return [len(key_frame.elements) for key_frame in of.key_frames]

    whole = counts(scene)
    given, _ = made_of(scene, "element left out", tmp_path)
    assert np.subtract(whole, counts(given)).tolist() == [0, 1, 0]
    (everywhere,) = (name for name in degradations(scene) if kind_of(name) == "element left out everywhere")
    truth = read_truth(scene)
    assert truth is not None
    given, judge = made_of(scene, "element left out everywhere", tmp_path)
    drawn = [k for (k, _), name in truth.elements.items() if name == everywhere.split(": ")[1]]
    assert np.subtract(whole, counts(given)).tolist() == [drawn.count(k) for k in range(3)]
    left = read_truth(judge)
    assert left is not None
    assert everywhere.split(": ")[1] not in left.elements.values()

    given, _ = made_of(scene, "no occlusion edges", tmp_path)
    assert not any(key_frame.occlusion_edges for key_frame in given.key_frames)
    given, judge = made_of(scene, "drawing of another time", tmp_path)
    assert [given.frame_of(k).name for k in range(3)] == ["000000.jpg", "000016.jpg", "000018.jpg"]
    assert [judge.frame_of(k).name for k in range(3)] == ["000000.jpg", "000016.jpg", "000008.jpg"]
    assert given.key_frames[2].elements == scene.key_frames[1].elements

    given, judge = made_of(scene, "focal length + 5 %", tmp_path)
    assert given.frames[3].camera.K[0, 0] == pytest.approx(1.05 * scene.frames[3].camera.K[0, 0])
    assert judge.frames[3].camera == given.frames[3].camera
    given, _ = made_of(scene, "only the first and the last key frame", tmp_path)
    assert [given.frame_of(k).name for k in range(2)] == ["000000.jpg", "000016.jpg"]
    given, _ = made_of(scene, "labels swapped", tmp_path)
    changed = [
        (a.label, b.label)
        for a, b in zip(given.key_frames[1].elements, scene.key_frames[1].elements, strict=True)
        if a.label != b.label
    ]
    assert len(changed) == 2
    assert changed[0] == changed[1][::-1]


def test_without_truth_nothing_can_be_judged(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(GtlayoutError, match=r"no gt_planes\.json"):
        degradations(replace(scene, root=tmp_path))


def test_an_element_that_the_truth_does_not_name_is_left_out_in_its_frame_only(scene: Scene, tmp_path: Path) -> None:
    write_json_atomic(tmp_path / "gt_planes.json", {"planes": {}, "elements": {}})
    kinds = set(map(kind_of, degradations(replace(scene, root=tmp_path))))
    assert "element left out" in kinds
    assert "element left out everywhere" not in kinds


def test_a_key_frame_that_loses_all_is_none(scene: Scene, tmp_path: Path) -> None:
    """Its only element is the one that is left out."""
    truth = read_truth(scene)
    assert truth is not None
    wall = next(
        e for (k, e), name in truth.elements.items() if k == 1 and scene.key_frames[1].elements[e].label == "wall"
    )
    alone = replace(scene.key_frames[1], elements=(scene.key_frames[1].elements[wall],))
    poor = replace(scene, key_frames=(scene.key_frames[0], alone, scene.key_frames[2]))
    given, judge = made_of(poor, "element left out", tmp_path)
    assert [of.frame for of in given.key_frames] == [0, 16]
    assert isinstance(judge.key_frames[0], KeyFrame)
    assert len(judge.key_frames) == 2
