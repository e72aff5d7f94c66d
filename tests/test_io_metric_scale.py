"""Metric scale, from depth and from a known distance, against a synthetic room whose unit is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest

from gtlayout.errors import GtlayoutError
from gtlayout.importing.known_distance import scale_from_distance
from gtlayout.importing.metric_scale import SparseDepths, scale_from_depth, sparse_depths
from gtlayout.io.cameras.undistort import Undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.pixels.images import read_depth
from gtlayout.io.pixels.turn import TURNS
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import FloatArray, Frame, Scene, scaled

METRES_PER_UNIT = 2.7
POINTS = 200


@pytest.fixture(scope="module")
def room_scene(room: Path) -> Scene:
    """The synthetic room as structure from motion would leave it: in another unit."""
    return replace(scaled(load_scene(room), 1 / METRES_PER_UNIT), metric=False)


@pytest.fixture(scope="module")
def observations(room_scene: Scene) -> tuple[SparseDepths, ...]:
    """What the key frames see: 1 % of noise, every tenth point grossly wrong."""
    rng = np.random.default_rng(0)
    return tuple(seen_by(frame, rng) for frame in room_scene.frames if frame.depth_path is not None)


def seen_by(frame: Frame, rng: np.random.Generator) -> SparseDepths:
    depth_m = read_depth(frame)
    height, width = depth_m.shape
    x, y = rng.integers(0, width, POINTS), rng.integers(0, height, POINTS)
    depths = depth_m[y, x] / METRES_PER_UNIT * np.exp(rng.normal(0, 0.01, POINTS))
    depths[::10] *= 3
    measured = np.isfinite(depths)
    points_px = np.column_stack([x, y])[measured] + 0.5
    return SparseDepths(frame.name, width, height, points_px, depths[measured].astype(np.float64))


def write_depth(path: Path, depth_mm: FloatArray) -> Path:
    assert cv2.imwrite(str(path), depth_mm.astype(np.uint16))
    return path


def test_scale_from_a_folder_of_depth_maps(room: Path, observations: tuple[SparseDepths, ...]) -> None:
    scale = scale_from_depth(observations, room / "depth")
    assert scale.factor == pytest.approx(METRES_PER_UNIT, rel=0.003)
    assert 0 < scale.sigma_share < 0.003
    assert f"in {len(observations)} depth maps" in scale.how


def test_scale_from_one_depth_map(room: Path, observations: tuple[SparseDepths, ...]) -> None:
    path = (room / "depth" / observations[1].name).with_suffix(".png")
    assert scale_from_depth(observations, path).factor == pytest.approx(METRES_PER_UNIT, rel=0.01)


def test_a_smaller_depth_map_has_the_same_field_of_view(
    room: Path, observations: tuple[SparseDepths, ...], tmp_path: Path
) -> None:
    name = Path(observations[0].name).with_suffix(".png").name
    depth = cv2.imread(str(room / "depth" / name), cv2.IMREAD_UNCHANGED)
    assert depth is not None
    write_depth(tmp_path / name, depth[1::3, 1::3].astype(np.float64))
    assert scale_from_depth(observations, tmp_path / name).factor == pytest.approx(METRES_PER_UNIT, rel=0.01)


def flat(tmp_path: Path, depth_mm: float = 2000.0, size: tuple[int, int] = (30, 40)) -> Path:
    return write_depth(tmp_path / "a.png", np.full(size, depth_mm))


def before_a_wall(depths: FloatArray) -> list[SparseDepths]:
    points_px = np.random.default_rng(2).uniform(5, 25, (len(depths), 2))
    return [SparseDepths("images/a.jpg", 40, 30, points_px, depths)]


def test_the_sigma_is_that_of_the_error(tmp_path: Path) -> None:
    path, rng = flat(tmp_path), np.random.default_rng(1)
    pulls = []
    for _ in range(200):
        scale = scale_from_depth(before_a_wall(np.exp(rng.normal(0, 0.05, 60))), path)
        pulls.append(np.log(scale.factor / 2.0) / scale.sigma_share)
    assert 0.8 < np.std(pulls) < 1.3


def test_maps_that_differ_widen_the_sigma(tmp_path: Path) -> None:
    for name, depth_mm in (("a", 2000.0), ("b", 2200.0)):
        write_depth(tmp_path / f"{name}.png", np.full((30, 40), depth_mm))
    (seen,) = before_a_wall(np.ones(50))
    scale = scale_from_depth([replace(seen, name="a.jpg"), replace(seen, name="b.jpg")], tmp_path)
    assert scale.sigma_share == pytest.approx(np.log(1.1) / 2, rel=0.2)


def test_points_at_depth_edges_are_left_out(tmp_path: Path) -> None:
    depth_mm = np.full((30, 40), 2000.0)
    depth_mm[:, 20:] = 8000.0
    points_px = np.column_stack([np.full(40, 19.5), np.linspace(2, 28, 40)])
    with pytest.raises(GtlayoutError, match="only 0 points"):
        scale_from_depth(
            [SparseDepths("a.jpg", 40, 30, points_px, np.ones(40))], write_depth(tmp_path / "a.png", depth_mm)
        )


def test_depth_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    good = before_a_wall(np.ones(60))
    with pytest.raises(GtlayoutError, match="known distance"):
        scale_from_depth([], flat(tmp_path))
    with pytest.raises(GtlayoutError, match="only 20 points"):
        scale_from_depth(before_a_wall(np.ones(20)), flat(tmp_path))
    with pytest.raises(GtlayoutError, match="whatever the scale"):
        scale_from_depth(before_a_wall(np.geomspace(0.1, 10, 60)), flat(tmp_path))
    with pytest.raises(GtlayoutError, match="another shape"):
        scale_from_depth(good, flat(tmp_path, size=(40, 30)))
    with pytest.raises(GtlayoutError, match="only 0 points"):
        scale_from_depth(good, flat(tmp_path, depth_mm=65535.0))
    with pytest.raises(GtlayoutError, match=r"no depth map .*none"):
        scale_from_depth(good, tmp_path / "none.png")
    with pytest.raises(GtlayoutError, match="no frame with points"):
        scale_from_depth(good, write_depth(tmp_path / "b.png", np.full((30, 40), 2000.0)))
    (tmp_path / "empty").mkdir()
    with pytest.raises(GtlayoutError, match=r"holds no depth map for any frame; looked for .*a\.png"):
        scale_from_depth(good, tmp_path / "empty")
    with pytest.raises(GtlayoutError, match="16-bit grey"):
        assert cv2.imwrite(str(tmp_path / "a.png"), np.zeros((30, 40), np.uint8))
        scale_from_depth(good, tmp_path / "a.png")
    (tmp_path / "a.png").write_bytes(b"\x89PNG cut off")
    with pytest.raises(GtlayoutError, match="cannot read image"):
        scale_from_depth(good, tmp_path / "a.png")


@pytest.mark.parametrize("name", ["../a.jpg", "/etc/a.jpg", "x/../../a.jpg"])
def test_names_in_a_model_lead_nowhere_else(name: str, tmp_path: Path) -> None:
    flat(tmp_path)
    (tmp_path / "depth").mkdir()
    (seen,) = before_a_wall(np.ones(60))
    with pytest.raises(GtlayoutError, match="scene folder"):
        scale_from_depth([replace(seen, name=name)], tmp_path / "depth")


def test_depths_of_a_models_points_are_along_the_cameras_axis() -> None:
    model = pycolmap.Reconstruction()
    lens = pycolmap.Camera(camera_id=1, model="PINHOLE", width=40, height=30, params=[20, 20, 20, 15])
    model.add_camera_with_trivial_rig(lens)
    image = pycolmap.Image(name="a.jpg", camera_id=1, image_id=1, points2D=[pycolmap.Point2D([30, 15])] * 2)
    model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(), [0, 0, 1]))
    model.add_point3D([1.5, 0, 2], pycolmap.Track([pycolmap.TrackElement(1, 1)]))
    (seen,) = sparse_depths(model)
    assert (seen.name, seen.width, seen.height) == ("a.jpg", 40, 30)
    np.testing.assert_array_equal(seen.points_px, [[30, 15]])
    np.testing.assert_allclose(seen.depths, [3.0])


def test_scaled_moves_cameras_and_nothing_else(room_scene: Scene) -> None:
    metric = scaled(room_scene, METRES_PER_UNIT)
    assert metric.metric
    point = np.array([[0.3, 0.2, 1.0]])
    for before, after in zip(room_scene.frames, metric.frames, strict=True):
        np.testing.assert_allclose(after.camera.center_world, METRES_PER_UNIT * before.camera.center_world)
        np.testing.assert_allclose(
            after.camera.project(METRES_PER_UNIT * point)[0], before.camera.project(point)[0], atol=1e-9
        )
    assert replace(metric, frames=room_scene.frames, metric=False) == room_scene


def marked(
    scene: Scene, points_world: FloatArray, noise_px: float = 0.0, seed: int = 0
) -> list[dict[str, list[float]]]:
    """Marks of each point in every frame that sees it, three at the most, from all along the video."""
    rng = np.random.default_rng(seed)
    marks = []
    for point in points_world:
        seen = {}
        for frame in scene.frames:
            px, depth = frame.camera.project(point[None])
            if depth[0] > 0 and np.all(px[0] > 5) and np.all(px[0] < (frame.camera.width - 5, frame.camera.height - 5)):
                seen[frame.name] = (px[0] + rng.normal(0, noise_px, 2)).tolist()
        names = list(seen)
        marks.append({name: seen[name] for name in (names[0], names[len(names) // 2], names[-1])})
    return marks


def in_the_middle(scene: Scene, depth_m: float, aside_px: float) -> FloatArray:
    camera = scene.frames[len(scene.frames) // 2].camera
    ray = camera.rays_world(np.array([[camera.width / 2 + aside_px, camera.height / 2]]))[0]
    return np.asarray(camera.center_world + depth_m / METRES_PER_UNIT * ray)


@pytest.fixture(scope="module")
def two_points(room_scene: Scene) -> FloatArray:
    return np.array([in_the_middle(room_scene, 2.0, -40), in_the_middle(room_scene, 2.5, 40)])


@pytest.fixture
def known(room_scene: Scene, two_points: FloatArray) -> dict[str, Any]:
    metres = METRES_PER_UNIT * float(np.linalg.norm(two_points[1] - two_points[0]))
    return {"metres": metres, "points": marked(room_scene, two_points)}


def distance_file(folder: Path, content: Any) -> Path:
    path = folder / "distance.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_scale_from_a_known_distance(room_scene: Scene, known: dict[str, Any], tmp_path: Path) -> None:
    scale = scale_from_distance(room_scene, distance_file(tmp_path, known))
    assert scale.factor == pytest.approx(METRES_PER_UNIT, rel=1e-9)
    assert 0 < scale.sigma_share < 0.1


def test_its_sigma_is_that_of_marks_good_to_a_pixel(
    room_scene: Scene, known: dict[str, Any], two_points: FloatArray, tmp_path: Path
) -> None:
    pulls = []
    for seed in range(200):
        noisy = {**known, "points": marked(room_scene, two_points, 1.0, seed)}
        scale = scale_from_distance(room_scene, distance_file(tmp_path, noisy))
        pulls.append((scale.factor / METRES_PER_UNIT - 1) / scale.sigma_share)
    assert 0.8 < np.std(pulls) < 1.2


def test_marks_are_pixels_of_the_distorted_image(room_scene: Scene, known: dict[str, Any], tmp_path: Path) -> None:
    lens = Undistortion("SIMPLE_RADIAL", 320, 240, (250.0, 160.0, 120.0, -0.1))
    K = lens.target.K
    frames = tuple(
        replace(
            each, undistort=lens, camera=replace(each.camera, K=K, width=lens.target.width, height=lens.target.height)
        )
        for each in room_scene.frames
    )
    distorted = replace(room_scene, frames=frames)
    points = np.array([in_the_middle(distorted, 2.0, -40), in_the_middle(distorted, 2.5, 40)])
    known["points"] = marked(distorted, points)
    known["metres"] = METRES_PER_UNIT * float(np.linalg.norm(points[1] - points[0]))
    for point in known["points"]:
        for name, px in point.items():
            ray = np.linalg.solve(K, [*px, 1.0])
            point[name] = np.asarray(lens.source.colmap.img_from_cam(ray[None]))[0].tolist()
    assert scale_from_distance(distorted, distance_file(tmp_path, known)).factor == pytest.approx(
        METRES_PER_UNIT, rel=1e-6
    )


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_marks_are_pixels_of_the_image_as_shown(
    room_scene: Scene, known: dict[str, Any], tmp_path: Path, orientation: int
) -> None:
    """Frames that stand upright as an image with a tag is shown: what is marked is a pixel of the frame."""
    turn = TURNS[orientation - 1]
    frames = []
    for each in room_scene.frames:
        stored = turn.inverse.camera(each.camera)
        way = Upright(turn, stored.width, stored.height, (), TURNS[0], turn)
        frames.append(replace(each, undistort=way))
    scale = scale_from_distance(replace(room_scene, frames=tuple(frames)), distance_file(tmp_path, known))
    assert scale.factor == pytest.approx(METRES_PER_UNIT, rel=1e-9)


def test_marks_that_disagree_name_point_and_frame(room_scene: Scene, known: dict[str, Any], tmp_path: Path) -> None:
    name = list(known["points"][1])[1]
    known["points"][1][name][1] += 40
    with pytest.raises(GtlayoutError, match=rf"point 2: its marks are not of one point, worst in frame {name}"):
        scale_from_distance(room_scene, distance_file(tmp_path, known))


def test_marks_from_one_place_are_refused(room_scene: Scene, known: dict[str, Any], tmp_path: Path) -> None:
    frames = (room_scene.frames[0], replace(room_scene.frames[0], name="again.jpg"))
    known["points"] = [{frames[0].name: [x, 100], "again.jpg": [x, 100]} for x in (100, 200)]
    with pytest.raises(GtlayoutError, match=r"point 1: its frames see it from directions only 0\.0° apart"):
        scale_from_distance(replace(room_scene, frames=frames), distance_file(tmp_path, known))


def test_one_point_twice_is_no_distance(room_scene: Scene, known: dict[str, Any], tmp_path: Path) -> None:
    known["points"][1] = known["points"][0]
    with pytest.raises(GtlayoutError, match="further apart"):
        scale_from_distance(room_scene, distance_file(tmp_path, known))


WRONG_METRES: tuple[Any, ...] = (None, "2", True, 0, -1, 1e99, [2])
WRONG_POINTS: tuple[Any, ...] = (None, 3, "ab", {}, [], [{}], [{}] * 3, [1, 2])
WRONG_MARKS: tuple[Any, ...] = (
    None,
    [],
    {"000000.jpg": [1, 2]},
    {"000000.jpg": [1, 2], "nowhere.jpg": [1, 2]},
    {"000000.jpg": [1, 2], "../000001.jpg": [1, 2]},
    {"000000.jpg": [1, 2], "000001.jpg": None},
    {"000000.jpg": [1, 2], "000001.jpg": [1]},
    {"000000.jpg": [1, 2], "000001.jpg": ["1", 2]},
    {"000000.jpg": [1, 2], "000001.jpg": [True, 2]},
    {"000000.jpg": [1, 2], "000001.jpg": [1e400, 2]},
    {"000000.jpg": [1, 2], "000001.jpg": [10**400, 2]},
    {"000000.jpg": [1, 2], "000001.jpg": [-1, 2]},
    {"000000.jpg": [1, 2], "000001.jpg": [1, 10_000]},
)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{",
        '{"metres": NaN, "points": []}',
        *(json.dumps({"metres": metres, "points": [{}, {}]}) for metres in WRONG_METRES),
        *(json.dumps({"metres": 2, "points": points}) for points in WRONG_POINTS),
        *(json.dumps({"metres": 2, "points": [marks, marks]}) for marks in WRONG_MARKS),
    ],
)
def test_a_distance_file_that_is_none_is_one_clear_error(content: str, room_scene: Scene, tmp_path: Path) -> None:
    path = distance_file(tmp_path, content)
    with pytest.raises(GtlayoutError, match=r"distance\.json") as caught:
        scale_from_distance(room_scene, path)
    assert "\n" not in str(caught.value)
