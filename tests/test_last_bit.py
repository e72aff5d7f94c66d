"""No decision hangs on the last bit: input moved by less than another processor's rounding gives the same result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import rooms
import shapely
from shapely import MultiPolygon

from gtlayout.config import EdgeConfig, ExtentConfig
from gtlayout.edges import contact_edges
from gtlayout.extent import compute_extents, polygons
from gtlayout.layout import Extent, Instance, Mesh, Plane
from gtlayout.mesh import build_mesh
from gtlayout.scene import Scene

JITTERS = 6
ROUNDING = 1e-15
"""As much as the planes of one scene differ between two kinds of processor, relative."""
HAND_PX = 1.5
PLANE_M = 0.02
SURFACES = (
    rooms.FLOOR,
    rooms.CEILING,
    rooms.LEFT,
    rooms.RIGHT,
    rooms.FAR,
    rooms.Surface("door", rooms.rectangle([1.5, rooms.DEPTH_M, 0], [1.0, 0, 0], [0, 0, 2.0]), host=4),
)


def _by_hand(region: MultiPolygon, rng: np.random.Generator) -> MultiPolygon:
    """Each corner drawn a little off, with one more on every side."""
    corners = shapely.get_coordinates(shapely.segmentize(region, 30.0))[:-1]
    return polygons(shapely.polygons(corners + rng.uniform(-HAND_PX, HAND_PX, corners.shape)))


def _drawn_room(seed: int) -> tuple[Scene, list[Plane]]:
    """Four key frames of the box room as a hand draws them, and planes that are a little off, as solved ones are."""
    rng = np.random.default_rng(seed)
    cameras = [rooms.level_camera((x, 0.8, 1.25)) for x in (1.6, 1.9, 2.1, 2.4)]
    drawings = [[(s.label, _by_hand(rooms.draw(s.corners, camera), rng)) for s in SURFACES] for camera in cameras]
    planes = []
    for surface in SURFACES:
        exact = surface.plane
        normal = exact.normal + rng.normal(0, 0.01, 3)
        planes.append(
            replace(exact, normal=normal / np.linalg.norm(normal), d=exact.d + float(rng.normal(0, PLANE_M)))
        )
    return rooms.make_scene(cameras, drawings), planes


def _moved(planes: list[Plane], rng: np.random.Generator) -> list[Plane]:
    moved = []
    for plane in planes:
        normal = plane.normal + ROUNDING * rng.standard_normal(3)
        d = plane.d * (1 + ROUNDING * float(rng.standard_normal()))
        moved.append(replace(plane, normal=normal / np.linalg.norm(normal), d=d))
    return moved


def _surfaces(scene: Scene, instances: tuple[Instance, ...], planes: list[Plane]) -> tuple[tuple[Extent, ...], Mesh]:
    edges = contact_edges(scene, instances, EdgeConfig())
    extents = compute_extents(scene, instances, planes, edges, ExtentConfig())
    return extents, build_mesh(instances, extents)


@pytest.mark.parametrize("seed", range(4))
def test_extents_and_mesh_are_the_same_when_planes_differ_by_rounding(seed: int) -> None:
    scene, planes = _drawn_room(seed)
    instances = rooms.instances_of(SURFACES, len(scene.key_frames))
    extents, mesh = _surfaces(scene, instances, planes)
    for jitter in range(JITTERS):
        moved, moved_mesh = _surfaces(scene, instances, _moved(planes, np.random.default_rng(jitter)))
        for one, other in zip(extents, moved, strict=True):
            for before, after in ((one.unrefined, other.unrefined), (one.region, other.region)):
                corners, others = shapely.get_coordinates(before), shapely.get_coordinates(after)
                assert len(corners) == len(others)
                np.testing.assert_allclose(corners, others, atol=1e-7)
        np.testing.assert_array_equal(mesh.faces, moved_mesh.faces)
        np.testing.assert_allclose(mesh.vertices, moved_mesh.vertices, atol=1e-7)
