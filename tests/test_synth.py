"""Synthetic rooms: what is rendered, drawn and written agrees with the planes it was made from."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from shapely import Point, Polygon

from gtlayout.errors import GtlayoutError
from gtlayout.geometry.raster import fill, rings_of
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.truth import read_truth
from gtlayout.scene import Camera, FloatArray
from gtlayout.synth import SynthConfig, shoot, synthesize
from gtlayout.synth.render import cast, project_polygon, shade
from gtlayout.synth.room import Room, make_room
from gtlayout.synth.surfaces import make_surface
from gtlayout.synth.textures import plain

EXAMPLE = Path(__file__).parents[1] / "examples/room"
SMALL = SynthConfig(seed=3, frames=9, width=160, height=120)


@pytest.fixture(scope="module")
def furnished() -> Room:
    return make_room(SMALL.seed)


@pytest.fixture(scope="module")
def cameras(furnished: Room) -> tuple[Camera, ...]:
    return shoot(furnished, SynthConfig(seed=SMALL.seed, frames=60, width=320, height=240)).cameras


def _grid(camera: Camera) -> FloatArray:
    """All pixel centres, row by row."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.column_stack([x.ravel(), y.ravel()])


def test_a_wall_two_metres_ahead_is_two_metres_deep_and_ends_where_it_should() -> None:
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), np.eye(3), np.zeros(3), 100, 80)
    corners = np.array([[-0.5, 0.25, 2.0], [0.5, 0.25, 2], [0.5, -0.25, 2], [-0.5, -0.25, 2]])
    rng = np.random.default_rng(0)
    wall = make_surface(
        "wall", "wall", corners, lambda r, s: plain(r, s, (90, 90, 90), 5), lambda p, _: np.ones(len(p)), rng
    )
    np.testing.assert_allclose([*wall.normal, wall.d], [0, 0, -1, 2], atol=1e-12)
    hits = cast((wall,), camera)
    expected = np.zeros((80, 100), bool)
    expected[28:52, 25:75] = True  # ±25 and ±12.5 px about (50, 40); pixel centres at half pixels
    expected[27] = expected[28]  # 27.5 lies on the upper border, 52.5 on the lower: one of them counts
    np.testing.assert_array_equal(hits.surface == 0, expected)
    np.testing.assert_allclose(hits.depth[expected], 2, atol=1e-9)
    assert np.isinf(hits.depth[~expected]).all()


def test_the_nearest_surface_wins(furnished: Room, cameras: tuple[Camera, ...]) -> None:
    """Against rays intersected one by one with every polygon."""
    camera = cameras[10]
    hits = cast(furnished.surfaces, camera)
    pixels = np.random.default_rng(0).choice(camera.width * camera.height, 150, replace=False)
    rays = camera.rays_world(_grid(camera)[pixels])
    for pixel, ray in zip(pixels, rays, strict=True):
        nearest = np.inf
        for surface in furnished.surfaces:
            along = surface.normal @ ray
            if along >= 0:
                continue
            depth = -(surface.normal @ camera.center_world + surface.d) / along
            meets = surface.frame.to_plane((camera.center_world + depth * ray)[None])[0]
            if 0 < depth < nearest and Polygon(surface.corners_uv).contains(Point(meets)):
                nearest = depth
        assert hits.depth.ravel()[pixel] == pytest.approx(nearest, abs=1e-6)


def test_a_polygon_is_cut_at_the_near_plane() -> None:
    camera = Camera(np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]), np.eye(3), np.zeros(3), 100, 100)
    floor = np.array([[-1.0, 1, -5], [1, 1, -5], [1, 1, 5], [-1, 1, 5]])
    outline = project_polygon(camera, floor)
    assert len(outline) == 4
    assert outline[:, 1].min() == pytest.approx(70)
    assert outline[:, 1].max() == pytest.approx(50 + 100 / 0.05)
    assert len(project_polygon(camera, floor - np.array([0, 0, 6]))) == 0


def test_a_point_looks_the_same_from_two_frames(furnished: Room, cameras: tuple[Camera, ...]) -> None:
    """Texture sticks to the surfaces: warping one picture by the true depth gives the other."""
    first, second = cameras[20], cameras[24]
    empty = furnished.structure  # nothing that the other frame cannot see
    pictures = [shade(empty, camera, cast(empty, camera, 2)) for camera in (first, second)]
    depth = cast(empty, first).depth.ravel()
    points, _ = second.project(first.center_world + first.rays_world(_grid(first)) * depth[:, None])
    points = points.reshape(first.height, first.width, 2)
    # The high-pass filter below reaches 12 px.
    inside = ((points > 2) & (points < (first.width - 2, first.height - 2))).all(axis=2)
    inside = np.asarray(cv2.erode(np.where(inside, np.uint8(1), np.uint8(0)), np.ones((25, 25)))) > 0

    def correlation(off_px: tuple[float, float]) -> float:
        x, y = np.moveaxis((points - 0.5 + off_px).astype(np.float32), 2, 0)
        pair = pictures[0], cv2.remap(pictures[1], x, y, cv2.INTER_CUBIC)
        # Only the fine texture: patches of it have to match, not the walls' colours.
        fine = [image[..., 1] - cv2.GaussianBlur(image, (0, 0), 3)[..., 1] for image in pair]
        return float(np.corrcoef(fine[0][inside], fine[1][inside])[0, 1])

    best = correlation((0, 0))
    assert best > 0.97
    for off_px in ((0.25, 0), (-0.25, 0), (0, 0.25), (0, -0.25)):
        assert correlation(off_px) < best - 0.01


def test_the_camera_sees_the_room_on_all_sides_and_nothing_too_close(
    furnished: Room, cameras: tuple[Camera, ...]
) -> None:
    for camera in cameras[::10]:
        hits = cast(furnished.surfaces, camera)
        assert (hits.surface >= 0).all()
        assert hits.depth.min() > 0.5


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_room(tmp_path: Path) -> None:
    files: dict[str, dict[str, bytes]] = defaultdict(dict)
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        synthesize(tmp_path / name, SynthConfig(seed=seed, frames=3, width=96, height=72))
        for path in sorted((tmp_path / name).rglob("*.*")):
            files[name][path.relative_to(tmp_path / name).as_posix()] = path.read_bytes()
    assert list(files["a"]) == [
        *("annotations.json", "depth/000000.png", "gt_planes.json"),
        *(f"images/{number:06d}.jpg" for number in range(3)),
        *("scene.json", "transforms.json"),
    ]
    assert files["a"] == files["b"]
    assert files["a"]["images/000000.jpg"] != files["c"]["images/000000.jpg"]


def test_what_is_written_reads_back_and_depth_lies_on_the_true_planes(tmp_path: Path) -> None:
    told = []
    synthesize(tmp_path / "made/room", SMALL, lambda done, total: told.append((done, total)))
    assert told == [(done, 9) for done in range(10)]
    scene = load_scene(tmp_path / "made/room")
    assert scene.metric
    assert not scene.warnings
    assert [key_frame.frame for key_frame in scene.key_frames] == [0, 8]
    truth = read_truth(scene)
    assert truth is not None
    for k, key_frame in enumerate(scene.key_frames):
        frame = scene.frame_of(k)
        depth_mm = cv2.imread(str(frame.depth_path), cv2.IMREAD_UNCHANGED)
        assert depth_mm is not None
        depth_m = depth_mm.ravel() / 1000
        points = frame.camera.center_world + frame.camera.rays_world(_grid(frame.camera)) * depth_m[:, None]
        for e, element in enumerate(key_frame.elements):
            plane = truth.planes[truth.elements[k, e]]
            assert plane.normal @ frame.camera.center_world + plane.d > 0.1
            mask = fill(rings_of(element.visible), frame.camera.height, frame.camera.width).ravel()
            assert np.abs(points[mask] @ plane.normal + plane.d).max(initial=0) < 0.0006  # half a millimetre in z


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(GtlayoutError, match="not an empty folder"):
        synthesize(tmp_path, SMALL)
    with pytest.raises(GtlayoutError, match="not an empty folder"):
        synthesize(tmp_path / "mine.txt", SMALL)
    with pytest.raises(GtlayoutError, match="cannot write"):
        synthesize(tmp_path / "mine.txt/room", SMALL)
    assert [path.name for path in tmp_path.rglob("*")] == ["mine.txt"]


def test_nothing_is_left_of_a_scene_that_was_not_finished(tmp_path: Path) -> None:
    def interrupt(done: int, _total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        synthesize(tmp_path / "room", SMALL, interrupt)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"frames": 1}, "frames must be at least 2"),
        ({"width": 20}, "width and height"),
        ({"hfov_deg": 180.0}, "hfov_deg"),
        ({"noise_sigma": -1.0}, "must not be negative"),
    ],
)
def test_a_scene_that_cannot_be_rendered_is_refused(config: dict[str, Any], message: str) -> None:
    with pytest.raises(GtlayoutError, match=message):
        SynthConfig(**config)


def test_the_example_is_complete_and_small() -> None:
    scene = load_scene(EXAMPLE)
    assert not scene.warnings
    assert len(scene.key_frames) >= 5
    assert all(frame.image_path.is_file() for frame in scene.frames)
    assert all(scene.frame_of(k).depth_path is not None for k in range(len(scene.key_frames)))
    truth = json.loads((EXAMPLE / "gt_planes.json").read_text())
    assert {plane["label"] for plane in truth["planes"].values()} == {"wall", "floor", "ceiling", "door", "window"}
    results = EXAMPLE / "gtlayout"
    files = [path for path in EXAMPLE.rglob("*") if path.is_file() and not path.is_relative_to(results)]
    assert sum(path.stat().st_size for path in files) < 3_000_000
