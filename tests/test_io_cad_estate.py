"""The CAD-Estate release's layout: cameras, masks and room_structure.npz, written by the exporter and read back."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rooms
from scene_checks import assert_one_camera_skipped
from shapely import MultiPolygon, Polygon

from gtlayout.errors import GtlayoutError
from gtlayout.export.cad_estate import write_cad_estate
from gtlayout.geometry.raster import fill, rings_of
from gtlayout.io.annotations.masks import mask_polygons
from gtlayout.io.cad_estate.reader import read_frames
from gtlayout.io.cad_estate.room_structure import RoomStructure, read_room_structure, write_room_structure
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.io.writing.scene_writers import write_scene
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.scene import BoolArray, Element, FloatArray, Scene

Edit = Callable[[Path, Callable[[Any], object]], None]
CLIP = "vi-d_eo_1200"
SURFACES = (rooms.FLOOR, rooms.LEFT, rooms.FAR, rooms.facing(0, 0, 1, 1))
DOOR = rooms.Surface("door", rooms.rectangle([1, 5, 0], [1, 0, 0], [0, 0, 2]), host=2)


@pytest.fixture
def box_scene(tmp_path: Path) -> Scene:
    """Three views of the box room, its floor, two walls and a door in the far one; with images."""
    cameras = [rooms.level_camera([x, 2.0, 1.2]) for x in (1.5, 2.0, 2.5)]
    scene = rooms.seen_from(cameras, (*SURFACES[:3], DOOR))
    rng = np.random.default_rng(0)
    frames = []
    for frame in scene.frames:
        path = tmp_path / "source" / frame.name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(cv2.imencode(".png", rng.integers(0, 255, (100, 160, 3), dtype=np.uint8))[1].tobytes())
        frames.append(replace(frame, image_path=path))
    return replace(scene, root=tmp_path / "source", frames=tuple(frames), metric=False)


def layout_of(scene: Scene) -> Layout:
    """The box room itself."""
    surfaces = (*SURFACES[:3], DOOR)
    instances = rooms.instances_of(surfaces, len(scene.key_frames))
    extents = tuple(surface.extent for surface in surfaces)
    planes = tuple(surface.plane for surface in surfaces)
    return Layout(instances, planes, extents, build_mesh(instances, extents), scene.metric)


def test_cameras_come_back(tiny: Path, tmp_path: Path) -> None:
    scene = _turned(load_scene(tiny))
    write_scene(scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    read = load_scene(tmp_path / CLIP)
    assert [frame.name for frame in read.frames] == [f"vi-d_eo_{33_333 * i}.jpg" for i in range(5)]
    assert not read.metric
    for a, b in zip(scene.frames, read.frames, strict=True):
        assert (a.camera.width, a.camera.height) == (b.camera.width, b.camera.height)
        np.testing.assert_allclose(b.camera.K, a.camera.K, atol=1e-9)
        np.testing.assert_allclose(b.camera.R_cam_from_world, a.camera.R_cam_from_world, atol=1e-9)
        np.testing.assert_allclose(b.camera.t_cam_from_world, a.camera.t_cam_from_world, atol=1e-9)
    assert [key.frame for key in read.key_frames] == [key.frame for key in scene.key_frames]


def test_masks_come_back(room: Path, tmp_path: Path) -> None:
    """Masks → polygons → masks, on every element of a room with furniture."""
    scene = load_scene(room)
    write_scene(scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    read = load_scene(tmp_path / CLIP)
    assert len(read.warnings) == 1
    assert "occlusion edges" in read.warnings[0]
    assert read.metric
    for k, key_frame in enumerate(read.key_frames):
        stem = Path(read.frame_of(k).name).stem
        for kind in ("structure", "visible"):
            mask = _mask(tmp_path / CLIP, f"processed_{kind}_{stem}")
            for element in key_frame.elements:
                region = element.amodal if kind == "structure" else element.visible
                own = mask == int(element.id)
                assert own.any() or region.is_empty
                assert not own.any() or _overlap(fill(rings_of(region), *mask.shape), own) >= 0.99


def test_truth_goes_along(room: Path, tmp_path: Path) -> None:
    scene = load_scene(room)
    write_scene(scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    read = load_scene(tmp_path / CLIP)
    before, after = read_truth(scene), read_truth(read)
    assert before is not None
    assert after is not None
    for k, key_frame in enumerate(scene.key_frames):
        names = {
            before.elements[k, e] for e, one in enumerate(key_frame.elements) if one.label not in ("door", "window")
        }
        assert {after.elements[k, e] for e in range(len(read.key_frames[k].elements))} == names
    assert set(after.planes) == set(after.elements.values())


def test_doors_are_part_of_their_wall(box_scene: Scene, tmp_path: Path) -> None:
    """Also where the annotator cut the wall out around the door, and with hosts found in the images."""
    cut = [
        replace(
            key, elements=tuple(_without(one, key.elements[3]) if i == 2 else one for i, one in enumerate(key.elements))
        )
        for key in box_scene.key_frames
    ]
    scene = replace(box_scene, key_frames=tuple(cut))
    clip, plain = tmp_path / CLIP, tmp_path / "without-layout_1"
    write_cad_estate(scene, clip, layout_of(scene))
    write_scene(scene, plain, "cad-estate", "cad-estate")
    for written in (clip, plain):
        read = load_scene(written)
        for k, key_frame in enumerate(read.key_frames):
            assert [element.label for element in key_frame.elements] == ["floor", "wall", "wall"]
            whole = fill(rings_of(box_scene.key_frames[k].elements[2].amodal), 100, 160)
            assert _overlap(fill(rings_of(key_frame.elements[2].amodal), 100, 160), whole) >= 0.99
        structure = read_room_structure(written / "room_structure.npz")
        assert structure.labels == (None, "floor", "wall", "wall")
    structure = read_room_structure(clip / "room_structure.npz")
    door = structure.triangles[structure.triangle_flags == 2]
    assert set(structure.triangle_element[structure.triangle_flags == 2]) == {3}
    np.testing.assert_allclose(sorted(set(door[..., 0].ravel())), [1, 2])
    a, b = structure.triangles[:, 1] - structure.triangles[:, 0], structure.triangles[:, 2] - structure.triangles[:, 0]
    areas = np.linalg.norm(np.cross(a, b), axis=1) / 2
    assert areas[structure.triangle_element == 3].sum() == pytest.approx(rooms.WIDTH_M * rooms.HEIGHT_M)


def test_raw_masks_are_numbered_frame_by_frame(box_scene: Scene, tmp_path: Path) -> None:
    turned = replace(box_scene.key_frames[1], elements=box_scene.key_frames[1].elements[::-1])
    scene = replace(box_scene, key_frames=(box_scene.key_frames[0], turned, box_scene.key_frames[2]))
    write_scene(scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    raw, processed = (_mask(tmp_path / CLIP, f"{kind}_structure_vi-d_eo_33333") for kind in ("raw", "processed"))
    # The walls were drawn the other way round; the door, drawn first, stands for the far one.
    assert [int(raw[processed == number].max()) for number in (1, 2, 3)] == [3, 1, 2]


def test_holes_and_corners_in_masks() -> None:
    mask = np.zeros((40, 60), dtype=bool)
    mask[5:30, 10:50] = True
    mask[10:20, 20:30] = False
    mask[30, 50] = True
    region = mask_polygons(mask)
    assert region.is_valid
    assert np.array_equal(fill(rings_of(region), 40, 60), mask)
    assert [len(polygon.interiors) for polygon in region.geoms] == [1, 0]
    assert region.geoms[0].area == pytest.approx(25 * 40 - 100, rel=0.01)
    assert mask_polygons(np.zeros((4, 4), dtype=bool)).is_empty


def test_slanted_lines_are_unbiased() -> None:
    slanted = MultiPolygon([Polygon([(3, 3), (190, 17), (170, 95), (20, 80)])])
    region = mask_polygons(fill(rings_of(slanted), 100, 200))
    assert region.area == pytest.approx(slanted.area, rel=2e-3)
    assert (region ^ slanted).area < 0.3 * slanted.length


@pytest.mark.parametrize("place", ["images", "../../frames/vi-d_eo"])
def test_frames_may_lie_elsewhere(box_scene: Scene, tmp_path: Path, place: str) -> None:
    clip = tmp_path / "annotations" / CLIP
    write_scene(box_scene, clip, "cad-estate", "cad-estate")
    (clip / place).parent.mkdir(exist_ok=True)
    (clip / "vi-d_eo").rename((clip / place).resolve())
    assert len(load_scene(clip).frames) == 3


@pytest.mark.parametrize("said", [True, False])
def test_images_of_another_size(box_scene: Scene, tmp_path: Path, edit_json: Edit, said: bool) -> None:
    """Cameras and masks speak of 160x100 px; the video came in 320x200."""
    write_scene(box_scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    before = load_scene(tmp_path / CLIP)
    for image in (tmp_path / CLIP / "vi-d_eo").iterdir():
        image.write_bytes(cv2.imencode(".jpg", np.zeros((200, 320, 3), dtype=np.uint8))[1].tobytes())
    if not said:
        edit_json(tmp_path / CLIP / "frames.json", lambda data: data.update(image_size=None))
    after = load_scene(tmp_path / CLIP)
    factor = 2 if said else 1
    np.testing.assert_allclose(after.frames[0].camera.K[:2], factor * before.frames[0].camera.K[:2])
    assert (after.frames[0].camera.width, after.frames[0].camera.height) == (320, 200)
    areas = [scene.key_frames[0].elements[0].amodal.area for scene in (before, after)]
    assert areas[1] == pytest.approx(4 * areas[0])


def test_visible_masks_that_only_say_that(box_scene: Scene, tmp_path: Path) -> None:
    write_scene(box_scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    before = load_scene(tmp_path / CLIP)
    visible = next((tmp_path / CLIP / "structure_annotations").glob("processed_visible_*_0.png"))
    mask = _mask(tmp_path / CLIP, visible.stem)
    visible.write_bytes(cv2.imencode(".png", np.where(mask > 0, 255, 0).astype(np.uint8))[1].tobytes())
    after = load_scene(tmp_path / CLIP)
    for a, b in zip(before.key_frames[0].elements, after.key_frames[0].elements, strict=True):
        assert a.visible.equals(b.visible)
    visible.unlink()
    read = load_scene(tmp_path / CLIP)
    assert read.key_frames[0].elements[0].visible.is_empty
    assert "1 of 3 key frames have no mask of visible parts" in read.warnings[1]


def test_structure_comes_back(tmp_path: Path) -> None:
    structure = _structure()
    write_room_structure(tmp_path / "room_structure.npz", structure)
    read = read_room_structure(tmp_path / "room_structure.npz")
    assert (read.clip_name, read.labels) == (structure.clip_name, structure.labels)
    for part in ("triangles", "triangle_element", "triangle_flags", "annotated_timestamps"):
        np.testing.assert_array_equal(getattr(read, part), getattr(structure, part))
    data = dict(np.load(tmp_path / "room_structure.npz"))
    flags = np.zeros((4, 3), dtype=np.int64)
    flags[3, 1] = 2
    np.savez(tmp_path / "room_structure.npz", **{**data, "layout_triangle_flags": flags})
    assert read_room_structure(tmp_path / "room_structure.npz").triangle_flags.tolist() == [0, 0, 0, 2]


def test_structure_is_rendered_as_drawn() -> None:
    """Element 1 fills a box of pixels, element 2 lies half as far and covers a triangle of it, at pixel precision."""
    structure = _structure()
    expected = np.zeros((80, 100), dtype=np.int32)
    expected[10:70, 20:90] = 1
    rows, columns = np.mgrid[:80, :100] + 0.5
    expected[(columns > 30) & (rows < 60) & (columns - 30 < rows - 20)] = 2
    np.testing.assert_array_equal(structure.render(rooms.facing_camera()), expected)


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"layout_labels": None}, "no part .*layout_labels"),
        ({"layout_num_tri": np.array([0, 2, 3])}, "add up to the triangles"),
        ({"layout_num_tri": np.array([2, 2])}, "one per element"),
        ({"layout_num_tri": np.array([2, 0, 2])}, "element 0 must be the background"),
        ({"layout_labels": np.array([0, 1, 5])}, "0 to 4"),
        ({"layout_labels": np.array([0.0, 1.5, 2.0])}, "whole numbers"),
        ({"layout_triangles": np.zeros((4, 3))}, r"must be \(T, 3, 3\)"),
        ({"layout_triangles": np.full((4, 3, 3), np.nan)}, "finite"),
        ({"layout_triangle_flags": np.zeros(3, dtype=np.int64)}, "as many layout_triangle_flags"),
        ({"layout_triangles": np.array([{}, None], dtype=object)}, "damaged"),
    ],
)
def test_bad_structure(tmp_path: Path, parts: dict[str, Any], says: str) -> None:
    path = tmp_path / "room_structure.npz"
    write_room_structure(path, _structure())
    data = {**dict(np.load(path)), **parts}
    np.savez(path, **{name: part for name, part in data.items() if part is not None})
    with pytest.raises(GtlayoutError, match=says):
        read_room_structure(path)


@pytest.mark.parametrize("content", [None, b"", b"no zip", b"PK\x03\x04 cut off"])
def test_no_structure_file(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "room_structure.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(GtlayoutError, match=r"room_structure\.npz"):
        read_room_structure(path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d["frames"][1].pop("extrinsics"), "frame 33333 has no extrinsics"),
        (lambda d: d["frames"][1]["extrinsics"].update(rotation=[1, 1, 0, 0]), "frame 33333: rotation is no unit"),
        (lambda d: d["frames"][1]["extrinsics"].update(translation=[0, 0]), "frame 33333: translation must be 3"),
        (lambda d: d["frames"][1].update(intrinsics=[0, 1, 2, 3]), "frame 33333: focal lengths"),
    ],
)
def test_a_bad_frame_costs_only_itself(
    box_scene: Scene, tmp_path: Path, edit_json: Edit, change: Callable[[Any], object], says: str
) -> None:
    write_scene(box_scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    edit_json(tmp_path / CLIP / "frames.json", change)
    read = read_frames(tmp_path / CLIP, tmp_path / CLIP / "frames.json")
    assert len(read.images) == len(box_scene.frames) - 1
    assert_one_camera_skipped(read.warnings, says)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(clip_name="../../etc_0"), "clip_name must be <video>_<start>"),
        (lambda d: d.update(frames=[]), "has no frames"),
        (lambda d: d["frames"][1].pop("timestamp"), "frame number 1 has no timestamp"),
        (lambda d: d.update(image_size=[100]), "image_size must be 2 finite numbers"),
        (lambda d: d.update(image_size=[160, 100]), "image_size is 100x160 .* are 160x100"),
    ],
)
def test_bad_frames(
    box_scene: Scene, tmp_path: Path, edit_json: Edit, change: Callable[[Any], object], says: str
) -> None:
    write_scene(box_scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    edit_json(tmp_path / CLIP / "frames.json", change)
    _fails(tmp_path / CLIP, says)


@pytest.mark.parametrize(
    ("mask", "says"),
    [
        (
            np.full((100, 160), 9, dtype=np.uint8),
            "element skipped: it has no label in room_structure.npz, which has {labels} "
            "(1, first in processed_structure_vi-d_eo_0.png, element 9)",
        ),
        (np.ones((100, 160, 3), dtype=np.uint8), "1 of 3 masks cannot be used and were skipped, first: "),
        (np.full((100, 160), 300, dtype=np.uint16), "is no mask: 8-bit grey is expected"),
    ],
)
def test_a_bad_mask_costs_only_itself(box_scene: Scene, tmp_path: Path, mask: np.ndarray, says: str) -> None:
    clip = tmp_path / CLIP
    write_scene(box_scene, clip, "cad-estate", "cad-estate")
    file = next((clip / "structure_annotations").glob("processed_structure_*_0.png"))
    file.write_bytes(cv2.imencode(".png", mask)[1].tobytes())
    scene = load_scene(clip)
    assert [key.frame for key in scene.key_frames] == [1, 2]
    labels = len(read_room_structure(clip / "room_structure.npz").labels)
    assert sum(says.format(labels=labels) in line for line in scene.warnings) == 1, scene.warnings


@pytest.mark.parametrize(
    ("mask", "says"),
    [
        (np.ones((50, 160), dtype=np.uint8), "mask of visible parts skipped: it has another size (1, first in"),
        (np.ones((100, 160, 3), dtype=np.uint8), "mask of visible parts skipped: is no mask: 8-bit grey is expected"),
    ],
)
def test_a_bad_mask_of_visible_parts_costs_these(box_scene: Scene, tmp_path: Path, mask: np.ndarray, says: str) -> None:
    clip = tmp_path / CLIP
    write_scene(box_scene, clip, "cad-estate", "cad-estate")
    before = load_scene(clip)
    file = next((clip / "structure_annotations").glob("processed_visible_*_0.png"))
    file.write_bytes(cv2.imencode(".png", mask)[1].tobytes())
    scene = load_scene(clip)
    assert [[e.amodal.area for e in k.elements] for k in scene.key_frames] == [
        [e.amodal.area for e in k.elements] for k in before.key_frames
    ]
    assert [all(e.visible.is_empty for e in k.elements) for k in scene.key_frames] == [True, False, False]
    assert sum(says in line for line in scene.warnings) == 1, scene.warnings


def test_the_folder_of_masks_can_be_named(box_scene: Scene, tmp_path: Path) -> None:
    write_scene(box_scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    masks = tmp_path / CLIP / "structure_annotations"
    assert len(load_scene(tmp_path / CLIP, masks).key_frames) == 3
    masks.rename(tmp_path / "structure_annotations")
    with pytest.raises(GtlayoutError, match=r"room_structure\.npz"):
        load_scene(tmp_path / CLIP, tmp_path / "structure_annotations")


def test_without_any_good_mask(box_scene: Scene, tmp_path: Path) -> None:
    write_scene(box_scene, tmp_path / CLIP, "cad-estate", "cad-estate")
    for file in (tmp_path / CLIP / "structure_annotations").glob("processed_structure_*.png"):
        file.write_bytes(b"no image")
    _fails(tmp_path / CLIP, r"_0\.png is no PNG image")


def test_incomplete_clip(box_scene: Scene, tmp_path: Path) -> None:
    clip = tmp_path / CLIP
    write_scene(box_scene, clip, "cad-estate", "cad-estate")
    (clip / "room_structure.npz").rename(tmp_path / "npz")
    _fails(clip, r"cannot read .*room_structure\.npz")
    (tmp_path / "npz").rename(clip / "room_structure.npz")
    for mask in (clip / "structure_annotations").glob("processed_structure_*"):
        mask.unlink()
    _fails(clip, "holds no mask; looked for processed_structure_")
    (clip / "vi-d_eo").rename(tmp_path / "elsewhere")
    _fails(clip, "no image that can be read for any of 3 frames; looked for .*vi-d_eo_0.jpg")
    assert json.loads((clip / "frames.json").read_text())["image_size"] == [100, 160]


def _turned(scene: Scene) -> Scene:
    """Poses and intrinsics in general position."""
    rng = np.random.default_rng(1)
    frames = []
    for frame in scene.frames:
        rotation = cv2.Rodrigues(rng.normal(size=3))[0].astype(np.float64)
        K = np.array([[61 + rng.random(), 0, 30.5], [0, 62.75, 25.125], [0, 0, 1]])
        camera = replace(frame.camera, K=K, R_cam_from_world=rotation, t_cam_from_world=rng.normal(size=3))
        frames.append(replace(frame, camera=camera))
    return replace(scene, frames=tuple(frames))


def _structure() -> RoomStructure:
    """A wall ten metres off in two triangles, and a window pane's triangle five metres off."""
    wall, near = (rooms.facing(20, 10, 90, 70).corners, rooms.facing(30, 20, 70, 60).corners / 2)
    left_bottom, right_bottom, left_top = near[0], near[1], near[3]
    triangles: FloatArray = np.stack(
        [wall[[0, 1, 2]], wall[[0, 2, 3]], near[[0, 0, 0]], np.stack([left_bottom, right_bottom, left_top])]
    )
    return RoomStructure(
        "video_0",
        triangles.astype(np.float32).astype(np.float64),
        np.array([1, 1, 2, 2]),
        np.array([0, 0, 0, 1]),
        (None, "wall", "slanted"),
        np.array([0, 100]),
    )


def _without(element: Element, other: Element) -> Element:
    rest = element.amodal - other.amodal
    assert isinstance(rest, MultiPolygon | Polygon)
    region = rest if isinstance(rest, MultiPolygon) else MultiPolygon([rest])
    return replace(element, amodal=region, visible=region)


def _mask(clip: Path, stem: str) -> np.ndarray:
    mask = cv2.imread(str(clip / "structure_annotations" / f"{stem}.png"), cv2.IMREAD_UNCHANGED)
    assert mask is not None
    return mask


def _overlap(a: BoolArray, b: BoolArray) -> float:
    return float((a & b).sum() / (a | b).sum())


def _fails(root: Path, says: str) -> None:
    with pytest.raises(GtlayoutError, match=says) as caught:
        load_scene(root)
    assert "\n" not in str(caught.value)
