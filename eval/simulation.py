"""Rooms without images: cameras on a path, exact polygons per key frame, tracks with chosen errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

import consistency
from gtlayout.config import EstimationConfig, TriangulationConfig
from gtlayout.edges import ContactEdge
from gtlayout.estimation import Estimate, estimate
from gtlayout.layout import Instance, Plane
from gtlayout.scene import Camera, Element, FloatArray, Frame, IntArray, KeyFrame, Label, Scene
from gtlayout.tracking import Tracks
from gtlayout.triangulation import triangulate

K = np.array([[400.0, 0, 322], [0, 405, 238], [0, 0, 1]])
SIZE = (640, 480)
EDGE_STEP_PX, MIN_EDGE_PX = 4.0, 20.0
"""Distance of the points on an edge, and the shortest one that is drawn."""


@dataclass(frozen=True)
class Face:
    """A flat polygon in the world."""

    label: Label
    corners: FloatArray
    """(C, 3), clockwise seen from inside the room."""

    @property
    def plane(self) -> FloatArray:
        """(4,) normal into the room, and d."""
        a, b, c = self.corners[:3]
        normal = np.cross(c - a, b - a)
        normal /= np.linalg.norm(normal)
        return np.append(normal, -normal @ a)


@dataclass(frozen=True)
class Room:
    """A simulated scene and the truth about it."""

    scene: Scene
    faces: tuple[Face, ...]
    instances: tuple[Instance, ...]
    """The true ones, one per face that is seen."""
    planes: FloatArray
    """(S, 4) of the instances."""

    @cached_property
    def instance_of(self) -> list[IntArray]:
        """Per key frame, (elements,) the true instance of each."""
        found = [np.full(len(key_frame.elements), -1) for key_frame in self.scene.key_frames]
        for i, instance in enumerate(self.instances):
            for k, element in instance.members:
                found[k][element] = i
        return found

    def seen_center(self, i: int) -> FloatArray:
        """(3,) a point of instance ``i`` amid what the key frames show of it."""
        points = []
        for k, element in self.instances[i].members:
            drawn = self.scene.key_frames[k].elements[element]
            points.append(_unproject(self.scene.frame_of(k).camera, _xy(drawn.amodal.centroid), self.planes[i]))
        return np.mean(np.concatenate(points), axis=0)

    def index(self, label: Label, k: int = 0) -> int:
        """The instance with this label that covers most of key frame ``k``."""
        elements = self.scene.key_frames[k].elements
        best = max(
            (e for e in range(len(elements)) if elements[e].label == label), key=lambda e: elements[e].amodal.area
        )
        return int(self.instance_of[k][best])


def box_faces(width: float = 4.0, length: float = 5.0, height: float = 2.5) -> tuple[Face, ...]:
    """Floor, ceiling and four walls of a box with a corner at the origin, z up."""
    x, y, z = width, length, height
    quads: list[tuple[Label, list[list[float]]]] = [
        ("floor", [[0, 0, 0], [0, y, 0], [x, y, 0], [x, 0, 0]]),
        ("ceiling", [[0, 0, z], [x, 0, z], [x, y, z], [0, y, z]]),
        ("wall", [[0, 0, 0], [0, 0, z], [0, y, z], [0, y, 0]]),
        ("wall", [[x, 0, 0], [x, y, 0], [x, y, z], [x, 0, z]]),
        ("wall", [[0, 0, 0], [x, 0, 0], [x, 0, z], [0, 0, z]]),
        ("wall", [[0, y, 0], [0, y, z], [x, y, z], [x, y, 0]]),
    ]
    return tuple(Face(label, np.array(corners, dtype=np.float64)) for label, corners in quads)


def prism_faces(walls: int, radius: float = 3.0, height: float = 2.5) -> tuple[Face, ...]:
    """Floor, ceiling and so many equal walls round the origin, corners at ``radius``, z up."""
    angle = 2 * np.pi * np.arange(walls) / walls
    floor = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(walls)])
    ceiling = floor + np.array([0.0, 0.0, height])
    sides = [np.array([floor[i], ceiling[i], ceiling[i - 1], floor[i - 1]]) for i in range(walls)]
    return (Face("floor", floor[::-1]), Face("ceiling", ceiling), *(Face("wall", side) for side in sides))


def look_at(center: FloatArray, target: FloatArray, intrinsics: FloatArray = K, size: tuple[int, int] = SIZE) -> Camera:
    """A camera at ``center`` that looks at ``target``, z up in the world."""
    forward = (target - center) / np.linalg.norm(target - center)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    return Camera(intrinsics, rotation, -rotation @ center, *size)


def orbit(frames: int = 21, sweep_m: float = 1.4) -> list[Camera]:
    """A hand-held arc in front of the far corner of the box."""
    target = np.array([3.0, 4.2, 1.15])
    cameras = []
    for share in np.linspace(-0.5, 0.5, frames):
        center = np.array([1.2, 1.1, 1.4]) + share * sweep_m * np.array([0.8, -0.6, 0.0])
        center[2] += 0.07 * sweep_m * np.sin(5 * share)
        cameras.append(look_at(center, target))
    return cameras


def dolly(frames: int = 31, length_m: float = 0.6) -> list[Camera]:
    """A slow move half forwards, half sideways towards the far corner of the box, hardly turning."""
    along = np.linspace(-0.5, 0.5, frames)
    centers = np.array([1.6, 0.9, 1.4]) + length_m * along[:, None] * np.array([0.7, 0.7, 0.1])
    targets = np.array([2.6, 4.6, 1.15]) + along[:, None] * np.array([0.5, 0.0, 0.0])
    return [look_at(center, target) for center, target in zip(centers, targets, strict=True)]


def ring(frames: int, radius: float = 0.6) -> list[Camera]:
    """A full turn round the origin, looking across it."""
    angle = 2 * np.pi * np.arange(frames) / frames
    outwards = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(frames)])
    return [
        look_at(radius * out + np.array([0.0, 0.0, 1.4]), -3.0 * out + np.array([0.0, 0.0, 1.2])) for out in outwards
    ]


def make_room(
    cameras: Sequence[Camera],
    key_frames: Sequence[int],
    faces: Sequence[Face] | None = None,
    scale: float = 1.0,
    shift: FloatArray | None = None,
    metric: bool = True,
    seed: int = 0,
    min_area_px: float = 1500.0,
) -> Room:
    """Annotate the key frames exactly, elements in an order (and with ids) that changes from frame to frame.

    ``scale`` and ``shift`` move the whole world: pixels stay the same.
    """
    rng = np.random.default_rng(seed)
    origin = np.zeros(3) if shift is None else shift
    moved = [replace(c, t_cam_from_world=scale * c.t_cam_from_world - c.R_cam_from_world @ origin) for c in cameras]
    faces = tuple(replace(f, corners=scale * f.corners + origin) for f in faces or box_faces())
    frames = tuple(Frame(f"{i:03d}.png", Path("/nowhere") / f"{i:03d}.png", c) for i, c in enumerate(moved))
    annotated: list[KeyFrame] = []
    members: dict[int, list[tuple[int, int]]] = {}
    for k, f in enumerate(key_frames):
        drawn = [(i, draw(moved[f], face, 0.05 * scale)) for i, face in enumerate(faces)]
        drawn = [(i, region) for i, region in drawn if region.area > min_area_px]
        elements = []
        for e, n in enumerate(rng.permutation(len(drawn))):
            i, region = drawn[n]
            elements.append(Element(f"e{e}", faces[i].label, region, as_multi(region.buffer(-5.0))))
            members.setdefault(i, []).append((k, e))
        annotated.append(KeyFrame(f, tuple(elements)))
    scene = Scene(Path("/nowhere"), frames, tuple(annotated), metric)
    instances = tuple(Instance(f"{faces[i].label}_{i}", faces[i].label, tuple(members[i])) for i in members)
    return Room(scene, faces, instances, np.array([faces[i].plane for i in members]))


def draw(camera: Camera, face: Face, near: float) -> MultiPolygon:
    """A face's image, cut at the near plane and the image border."""
    corners = face.corners @ camera.R_cam_from_world.T + camera.t_cam_from_world
    kept: list[FloatArray] = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= near:
            kept.append(a)
        if (a[2] >= near) != (b[2] >= near):
            kept.append(a + (near - a[2]) / (b[2] - a[2]) * (b - a))
    if len(kept) < 3:
        return MultiPolygon()
    homogeneous = np.array(kept) @ camera.K.T
    image = shapely.box(0, 0, camera.width, camera.height)
    return as_multi(Polygon(homogeneous[:, :2] / homogeneous[:, 2:]).intersection(image))


def as_multi(region: Polygon | MultiPolygon) -> MultiPolygon:
    """Polygon or MultiPolygon as the latter."""
    if region.is_empty:
        return MultiPolygon()
    return MultiPolygon([region]) if region.geom_type == "Polygon" else region


def make_tracks(
    room: Room,
    rng: np.random.Generator,
    per_element: int = 12,
    sigma_px: float = 0.5,
    relief: float = 0.0,
    drifting: float = 0.0,
    without: Sequence[int] = (),
    reach: int = 40,
    furnished: float = 0.0,
) -> Tracks:
    """Points on every element but those of the instances ``without``, followed until they leave the image.

    Args:
        sigma_px: noise of each position outside the key frame, per axis.
        relief: σ of the surface round its plane, world unit.
        drifting: share of tracks that slide away, by 0.2 to 1 px a frame in one direction.
        furnished: share of points on furniture that stands before each surface, its front parallel at 0.1 to 0.6 m.
    """
    scene = room.scene
    key_frames, elements, tracks, frames, points = [], [], [], [], []
    tried = []
    fronts = rng.uniform(0.1, 0.6, len(room.instances)) if furnished > 0 else np.empty(0)
    count = 0
    for k, key_frame in enumerate(scene.key_frames):
        tried.append(np.zeros(len(key_frame.elements), dtype=np.int64))
        camera = scene.frames[key_frame.frame].camera
        for e, element in enumerate(key_frame.elements):
            instance = int(room.instance_of[k][e])
            if instance in without:
                continue
            start_px = _random_points(element.visible, per_element, rng)
            tried[k][e] = len(start_px)
            plane = room.planes[instance].copy()
            on_plane = _unproject(camera, start_px, plane)
            on_plane -= camera.center_world
            facing = np.abs(on_plane @ plane[:3])
            on_plane *= 1 + (relief * rng.normal(size=len(on_plane)) / facing)[:, None]
            if furnished > 0:
                before = np.where(rng.random(len(on_plane)) < furnished, fronts[instance], 0.0)
                on_plane *= 1 - (np.minimum(before, 0.8 * facing) / facing)[:, None]
            world = camera.center_world + on_plane
            angle = rng.uniform(0, 2 * np.pi, len(world))
            rate = np.where(rng.random(len(world)) < drifting, rng.uniform(0.2, 1.0, len(world)), 0.0)
            slide = rate[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
            index = np.arange(len(world))
            seen = [(index, np.full(len(index), key_frame.frame), start_px)]
            for direction in (-1, 1):
                alive = index
                for step in range(1, reach + 1):
                    f = key_frame.frame + direction * step
                    if not 0 <= f < len(scene.frames):
                        break
                    target = scene.frames[f].camera
                    position, depth = target.project(world[alive])
                    position = position + sigma_px * rng.normal(size=position.shape) + step * slide[alive]
                    inside = ((position > 3) & (position < np.array([target.width, target.height]) - 3)).all(axis=1)
                    alive, position = alive[inside & (depth > 0)], position[inside & (depth > 0)]
                    seen.append((alive, np.full(len(alive), f), position))
            which, when, where = (np.concatenate(part) for part in zip(*seen, strict=True))
            long_enough = np.bincount(which, minlength=len(world)) >= 3
            renumber = np.cumsum(long_enough) - 1 + count
            use = long_enough[which]
            tracks.append(renumber[which[use]])
            frames.append(when[use])
            points.append(where[use])
            kept = int(long_enough.sum())
            count += kept
            key_frames.append(np.full(kept, k))
            elements.append(np.full(kept, e))
    track, frame = np.concatenate(tracks), np.concatenate(frames)
    order = np.lexsort((frame, track))
    return Tracks(
        np.concatenate(key_frames),
        np.concatenate(elements),
        track[order],
        frame[order],
        np.concatenate(points)[order],
        np.full(count, max(sigma_px, 0.5)),
        tuple(tried),
    )


def chosen(tracks: Tracks, index: IntArray) -> Tracks:
    """Only the tracks ``index`` (ascending)."""
    number = np.full(len(tracks), -1)
    number[index] = np.arange(len(index))
    seen = number[tracks.track] >= 0
    return replace(
        tracks,
        key_frame=tracks.key_frame[index],
        element=tracks.element[index],
        track=number[tracks.track[seen]],
        frame=tracks.frame[seen],
        points_px=tracks.points_px[seen],
        sigma_px=tracks.sigma_px[index],
    )


def no_tracks(scene: Scene) -> Tracks:
    """What tracking returns when nothing could be tracked."""
    none = np.empty(0, dtype=np.int64)
    tried = tuple(np.zeros(len(key_frame.elements), dtype=np.int64) for key_frame in scene.key_frames)
    return Tracks(none, none, none, none, np.empty((0, 2)), np.empty(0), tried)


def true_instance(room: Room, tracks: Tracks) -> IntArray:
    """(N,) the instance each track was sampled on."""
    pairs = zip(tracks.key_frame, tracks.element, strict=True)
    return np.array([room.instance_of[k][e] for k, e in pairs], dtype=np.int64)


def true_edges(room: Room) -> tuple[ContactEdge, ...]:
    """The images of the segments that two faces share, as stage 3 should find them; not derived from the polygons."""
    edges: list[ContactEdge] = []
    face_of = [next(f for f in room.faces if np.array_equal(f.plane, plane)) for plane in room.planes]
    for k in range(len(room.scene.key_frames)):
        for a, b in combinations(sorted(set(room.instance_of[k].tolist())), 2):
            shared = [p for p in face_of[a].corners if (np.abs(face_of[b].corners - p).max(axis=1) < 1e-12).any()]
            if len(shared) != 2:
                continue
            edges += _drawn_edge(room, k, (a, b), shared[0], shared[1])
    return tuple(edges)


def edges_along(room: Room, pair: tuple[int, int], start: FloatArray, end: FloatArray) -> tuple[ContactEdge, ...]:
    """A segment in the world as contact edge of two instances, in each key frame that shows both."""
    edges: list[ContactEdge] = []
    for k, seen in enumerate(room.instance_of):
        if np.isin(pair, seen).all():
            edges += _drawn_edge(room, k, pair, start, end)
    return tuple(edges)


def _drawn_edge(room: Room, k: int, pair: tuple[int, int], start: FloatArray, end: FloatArray) -> list[ContactEdge]:
    """What key frame ``k`` shows of a segment in the world; none when that is too short."""
    camera = room.scene.frame_of(k).camera
    # Densely sampled in 3D, so that the part behind the camera can simply be dropped.
    pixels, depth = camera.project(start + np.linspace(0, 1, 2000)[:, None] * (end - start))
    if np.count_nonzero(depth > 0.05) < 2:
        return []
    inner = shapely.box(3, 3, camera.width - 3, camera.height - 3)
    line = shapely.LineString(pixels[depth > 0.05][[0, -1]]).intersection(inner)
    if line.length < MIN_EDGE_PX:
        return []
    at = np.arange(EDGE_STEP_PX / 2, line.length, EDGE_STEP_PX)
    return [ContactEdge(k, pair, shapely.get_coordinates(shapely.line_interpolate_point(line, at)))]


def jitter(
    edges: Sequence[ContactEdge], rng: np.random.Generator, shift_px: float, tilt_px: float
) -> list[ContactEdge]:
    """Edges as a hand draws them: each moved across its line as a whole, and tilted."""
    drawn = []
    for edge in edges:
        along = edge.points_px[-1] - edge.points_px[0]
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        position = (edge.points_px - edge.points_px.mean(axis=0)) @ along
        error = shift_px * rng.normal() + tilt_px * rng.normal() * position / position.std()
        drawn.append(replace(edge, points_px=edge.points_px + error[:, None] * across))
    return drawn


def shifted(edge: ContactEdge, by_px: float) -> ContactEdge:
    """An edge drawn so far beside its place, across itself."""
    along = edge.points_px[-1] - edge.points_px[0]
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    return replace(edge, points_px=edge.points_px + by_px * across)


def spoil(
    room: Room, edges: Sequence[ContactEdge], rng: np.random.Generator, share: float, by_px: float = 40.0
) -> list[ContactEdge]:
    """A share of the edges made wrong: drawn beside their place, or between surfaces of which one is another."""
    spoilt = list(edges)
    for number, e in enumerate(rng.permutation(len(edges))[: round(share * len(edges))]):
        edge = edges[e]
        others = np.setdiff1d(room.instance_of[edge.key_frame], edge.instances)
        if number % 2 or len(others) == 0:
            spoilt[e] = shifted(edge, by_px * rng.choice([-1, 1]))
        else:
            a, b = sorted((edge.instances[rng.integers(2)], int(rng.choice(others))))
            spoilt[e] = replace(edge, instances=(a, b))
    return spoilt


def solve(
    room: Room,
    tracks: Tracks,
    edges: Sequence[ContactEdge] | None = None,
    config: EstimationConfig | None = None,
    seed: int = 0,
) -> Estimate:
    """Stage 4 with the true instances; ``edges`` default to the exact ones."""
    rays = triangulate(room.scene, tracks, TriangulationConfig())
    edges = true_edges(room) if edges is None else edges
    track_instance = true_instance(room, tracks)
    return estimate(room.scene, tracks, rays, track_instance, room.instances, edges, config or EstimationConfig(), seed)


def errors(room: Room, planes: Sequence[Plane]) -> tuple[FloatArray, FloatArray]:
    """(S,) angle of the normals to the truth in degrees, (S,) signed distance of the seen centres from the planes."""
    angles, offsets = [], []
    for i, plane in enumerate(planes):
        sine = np.linalg.norm(np.cross(plane.normal, room.planes[i, :3]))
        angles.append(np.rad2deg(np.arctan2(sine, plane.normal @ room.planes[i, :3])))
        offsets.append(plane.normal @ room.seen_center(i) + plane.d)
    return np.array(angles), np.array(offsets)


def depth_errors(room: Room, planes: Sequence[Plane], step_px: int = 20) -> FloatArray:
    """(R,) |depth - true depth| on a grid of rays over all that is drawn; the paper's ε is their mean."""
    found = []
    for k, key_frame in enumerate(room.scene.key_frames):
        camera = room.scene.frame_of(k).camera
        grid = np.mgrid[step_px // 2 : camera.width : step_px, step_px // 2 : camera.height : step_px]
        pixels = grid.reshape(2, -1).T.astype(np.float64)
        for element, i in zip(key_frame.elements, room.instance_of[k], strict=True):
            inside = pixels[shapely.contains_xy(element.amodal, pixels[:, 0], pixels[:, 1])]
            plane = np.append(planes[i].normal, planes[i].d)
            off = _unproject(camera, inside, plane) - _unproject(camera, inside, room.planes[i])
            found.append(np.abs(off @ camera.R_cam_from_world[2]))
    return np.concatenate(found)


def nees(room: Room, planes: Sequence[Plane]) -> FloatArray:
    """(S,) squared error of each plane in its own σ; 3 on average when the covariances are right."""
    return np.array(
        [
            consistency.nees(*consistency.plane_error_at(plane, true[:3], true[3], room.seen_center(i)))
            for i, (plane, true) in enumerate(zip(planes, room.planes, strict=True))
        ]
    )


def _xy(point: shapely.Point) -> FloatArray:
    return np.array([[point.x, point.y]])


def _unproject(camera: Camera, points_px: FloatArray, plane: FloatArray) -> FloatArray:
    rays = camera.rays_world(points_px)
    depth = -(plane[:3] @ camera.center_world + plane[3]) / (rays @ plane[:3])
    return camera.center_world + depth[:, None] * rays


def _random_points(region: MultiPolygon, count: int, rng: np.random.Generator) -> FloatArray:
    left, top, right, bottom = region.bounds
    points = rng.uniform([left, top], [right, bottom], (count * 20, 2))
    return points[shapely.contains_xy(region, points[:, 0], points[:, 1])][:count]
