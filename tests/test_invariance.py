"""What says nothing about a room changes nothing: its world and unit, the order of drawings, ids, copies of frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.prepared.canonical import canonical
from gtlayout.scene import Camera, Element, FloatArray, KeyFrame, Scene
from gtlayout.solution import Solution

TURN = Rotation.from_euler("xyz", [31, -112, 64], degrees=True).as_matrix()
Members = frozenset[tuple[str, str]]
"""What an instance is, whatever it is called: image and id of each of its drawings."""


@pytest.fixture(scope="module")
def scene(small_room: Path) -> Scene:
    return load_scene(small_room)


@pytest.fixture(scope="module")
def solution(scene: Scene) -> Solution:
    return solve(scene)


def moved(scene: Scene, scale: float = 1.0, turn: FloatArray | None = None, shift: float = 0.0) -> Scene:
    """The scene in the world ``X' = scale turn X + shift (1, -1, 1)``, without a unit where that has changed."""
    rotation = np.eye(3) if turn is None else turn

    def camera(one: Camera) -> Camera:
        R = one.R_cam_from_world @ rotation.T
        center = scale * (rotation @ one.center_world) + shift * np.array([1.0, -1.0, 1.0])
        return replace(one, R_cam_from_world=R, t_cam_from_world=-R @ center)

    frames = tuple(replace(frame, camera=camera(frame.camera)) for frame in scene.frames)
    return replace(scene, frames=frames, metric=scene.metric and scale == 1.0)


def by_members(solution: Solution, ids: Callable[[str], str] = lambda name: name) -> dict[Members, int]:
    scene = solution.scene
    return {
        frozenset((scene.frame_of(k).name, ids(scene.key_frames[k].elements[e].id)) for k, e in instance.members): i
        for i, instance in enumerate(solution.instances)
    }


def differences(a: Solution, b: Solution, scale: float = 1.0, turn: FloatArray | None = None) -> FloatArray:
    """(S, 5) of normals, of offsets along them where the first camera's image centre looks (in units of ``a``), of σ of
    normals, of σ of depth (shares), and of the offset in σ.
    """
    rotation = np.eye(3) if turn is None else turn
    of_a, of_b = by_members(a), by_members(b)
    assert of_a.keys() == of_b.keys()
    rows = []
    for members, i in of_a.items():
        j = of_b[members]
        p, q = a.planes[i], b.planes[j]
        assert p.observable == q.observable
        if not p.observable:
            continue
        k = a.instances[i].members[0][0]
        camera_a, camera_b = a.scene.frame_of(k).camera, b.scene.frame_of(k).camera
        distance_a = p.normal @ camera_a.center_world + p.d
        distance_b = (q.normal @ camera_b.center_world + q.d) / scale
        judged_a, judged_b = a.quality.instances[i], b.quality.instances[j]
        foot = camera_a.center_world - distance_a * p.normal
        rows.append(
            [
                np.abs(rotation @ p.normal - q.normal).max(),
                abs(distance_a - distance_b),
                abs(q.sigma_normal_deg / p.sigma_normal_deg - 1),
                abs(judged_b.sigma_depth / scale / judged_a.sigma_depth - 1),
                abs(distance_a - distance_b) / float(p.sigma_offset(foot)),
            ]
        )
    return np.array(rows)


def redrawn(scene: Scene, change: Callable[[KeyFrame], KeyFrame]) -> Scene:
    return replace(scene, key_frames=tuple(change(key_frame) for key_frame in scene.key_frames))


def each_element(change: Callable[[Element], Element]) -> Callable[[KeyFrame], KeyFrame]:
    return lambda key_frame: replace(key_frame, elements=tuple(change(one) for one in key_frame.elements))


def reversed_rings(element: Element) -> Element:
    return replace(element, amodal=shapely.reverse(element.amodal), visible=shapely.reverse(element.visible))


def rolled(element: Element) -> Element:
    """Rings that begin two vertices later."""

    def roll(polygon: shapely.Polygon) -> shapely.Polygon:
        rings = [np.roll(shapely.get_coordinates(r)[:-1], -2, axis=0) for r in (polygon.exterior, *polygon.interiors)]
        return shapely.Polygon(rings[0], rings[1:])

    return replace(
        element,
        amodal=shapely.MultiPolygon([roll(part) for part in element.amodal.geoms]),
        visible=shapely.MultiPolygon([roll(part) for part in element.visible.geoms]),
    )


REWRITTEN: dict[str, Callable[[KeyFrame], KeyFrame]] = {
    "order": lambda key_frame: replace(key_frame, elements=key_frame.elements[::-1]),
    "winding": each_element(reversed_rings),
    "first vertex": each_element(rolled),
    "occlusion edges": lambda key_frame: replace(
        key_frame, occlusion_edges=tuple(edge[::-1] for edge in key_frame.occlusion_edges[::-1])
    ),
}


@pytest.mark.parametrize("change", REWRITTEN.values(), ids=REWRITTEN.keys())
def test_how_drawings_are_written_changes_no_plane(
    scene: Scene, solution: Solution, change: Callable[[KeyFrame], KeyFrame]
) -> None:
    found = differences(solution, solve(redrawn(scene, change)))
    assert found[:, :4].max() < 1e-9


def test_all_of_that_together_changes_nothing_of_a_real_clip(office_part: Scene, office_solution: Solution) -> None:
    rewritten = office_part
    for change in REWRITTEN.values():
        rewritten = redrawn(rewritten, change)
    found = differences(office_solution, solve(rewritten))
    assert found[:, :4].max() < 1e-9


@pytest.mark.parametrize(("scale", "turn", "shift"), [(7.3, TURN, 1e4), (1e-3, None, 0.0)])
def test_world_and_unit_change_nothing_of_a_real_clip(
    office_part: Scene, office_solution: Solution, scale: float, turn: FloatArray | None, shift: float
) -> None:
    other = solve(moved(office_part, scale, turn, shift))
    assert differences(office_solution, other, scale, turn)[:, :4].max() < 1e-6


def test_ids_change_no_plane(scene: Scene, solution: Solution) -> None:
    def backwards(name: str) -> str:
        return name[::-1]

    other = solve(redrawn(scene, each_element(lambda element: replace(element, id=backwards(element.id)))))
    of_a, of_b = by_members(solution), by_members(other, backwards)
    assert of_a.keys() == of_b.keys()
    for members, i in of_a.items():
        np.testing.assert_array_equal(solution.planes[i].covariance, other.planes[of_b[members]].covariance)


@pytest.mark.parametrize("scale", [1e-6, 7.3, 1e6])
def test_the_unit_changes_nothing(scene: Scene, solution: Solution, scale: float) -> None:
    other = solve(moved(scene, scale))
    assert not other.layout.metric
    assert differences(solution, other, scale)[:, :4].max() < 1e-6
    # Extents agree, but a pixel centre on a border may fall to the other side. In a small element it counts for 1e-4.
    assert other.quality.iou == pytest.approx(solution.quality.iou, abs=3e-4)


@pytest.mark.parametrize(("turn", "shift"), [(TURN, 0.0), (None, 1e8), (TURN, 1e4)])
def test_the_world_changes_nothing(scene: Scene, solution: Solution, turn: FloatArray | None, shift: float) -> None:
    other = solve(moved(scene, 1.0, turn, shift))
    digits = 1e-6 + 1e-13 * shift  # positions are rounded to 1e-16 of themselves
    assert differences(solution, other, 1.0, turn)[:, :4].max() < digits
    # … nor do the covariances, wherever the world's origin lies.
    of_a, of_b = by_members(solution), by_members(other)
    for members, i in of_a.items():
        k = solution.instances[i].members[0][0]
        at = [one.scene.frame_of(k).camera.center_world for one in (solution, other)]
        planes = solution.planes[i], other.planes[of_b[members]]
        sigma = [float(plane.sigma_offset(point)) for plane, point in zip(planes, at, strict=True)]
        assert sigma[1] == pytest.approx(sigma[0], rel=digits)


def test_a_unit_that_is_known_changes_nothing(scene: Scene, solution: Solution) -> None:
    other = solve(replace(scene, metric=False))
    assert differences(solution, other)[:, :4].max() < 1e-12
    assert np.isnan([plane.sigma_depth_m for plane in other.planes]).all()


def test_frames_that_are_there_twice_change_nothing(scene: Scene, solution: Solution) -> None:
    frames = tuple(copy for frame in scene.frames for copy in (frame, replace(frame, name=f"again-{frame.name}")))
    key_frames = tuple(replace(key_frame, frame=2 * key_frame.frame) for key_frame in scene.key_frames)
    other = solve(replace(scene, frames=frames, key_frames=key_frames))
    assert differences(solution, other)[:, 4].max() < 1e-6
    assert other.scene.warnings == solution.scene.warnings
    assert set(np.unique(other.tracks.frame)) <= set(range(0, len(frames), 2))


def test_png_for_jpeg_changes_nothing(office_part: Scene, office_solution: Solution, tmp_path: Path) -> None:
    frames = []
    for frame in office_part.frames:
        png = tmp_path / f"{Path(frame.name).stem}.png"
        pixels = cv2.imread(str(frame.image_path))
        assert pixels is not None
        cv2.imwrite(str(png), pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        frames.append(replace(frame, image_path=png))
    other = solve(replace(office_part, frames=tuple(frames)))
    assert differences(office_solution, other)[:, 4].max() < 1e-9


def test_numbers_are_those_of_the_scene_that_was_given(scene: Scene, solution: Solution) -> None:
    """However the stages number elements and frames: each track lies on what it was sampled on, in its key frame."""
    tracks = solution.tracks
    for k, key_frame in enumerate(scene.key_frames):
        at_key = (tracks.frame == key_frame.frame) & (tracks.key_frame[tracks.track] == k)
        for e, element in enumerate(key_frame.elements):
            own = at_key & (tracks.element[tracks.track] == e)
            inside = shapely.contains_xy(element.amodal.buffer(1.0), tracks.points_px[own])
            assert inside.all()
            assert np.count_nonzero(own) <= tracks.tried[k][e]
    members = sorted(member for instance in solution.instances for member in instance.members)
    assert members == [(k, e) for k, key_frame in enumerate(scene.key_frames) for e in range(len(key_frame.elements))]


def test_a_canonical_scene_is_canonical(scene: Scene) -> None:
    once = canonical(scene).scene
    again = canonical(once)
    np.testing.assert_allclose(again.similarity.R, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(again.similarity.origin, 0, atol=1e-12)
    assert again.similarity.scale == pytest.approx(1.0)
    assert [list(order) for order in again.elements] == [list(range(len(order))) for order in again.elements]
