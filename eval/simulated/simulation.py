"""Tracks with chosen errors in simulated rooms, and how far planes solved from them are off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import MultiPolygon

from common import consistency
from gtlayout.edges import ContactEdge
from gtlayout.geometry.similarity import Similarity
from gtlayout.instances import Plane
from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.estimate import Estimate
from gtlayout.planes.estimation import estimate
from gtlayout.prepared.canonical import Canonical
from gtlayout.prepared.measurements import Measurements, Prepared
from gtlayout.scene import FloatArray, IntArray, Scene
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_edges import true_edges
from simulated.simulated_room import Room, unproject


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
            on_plane = unproject(camera, start_px, plane)
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
    return tracks.only(np.isin(np.arange(len(tracks)), index))


def no_tracks(scene: Scene) -> Tracks:
    """What tracking returns when nothing could be tracked."""
    none = np.empty(0, dtype=np.int64)
    tried = tuple(np.zeros(len(key_frame.elements), dtype=np.int64) for key_frame in scene.key_frames)
    return Tracks(none, none, none, none, np.empty((0, 2)), np.empty(0), tried)


def true_instance(room: Room, tracks: Tracks) -> IntArray:
    """(N,) the instance each track was sampled on."""
    pairs = zip(tracks.key_frame, tracks.element, strict=True)
    return np.array([room.instance_of[k][e] for k, e in pairs], dtype=np.int64)


def solve(
    room: Room,
    tracks: Tracks,
    edges: Sequence[ContactEdge] | None = None,
    config: EstimationConfig | None = None,
    seed: int = 0,
) -> Estimate:
    """Stage 4 with the true instances; ``edges`` default to the exact ones."""
    return estimate(measurements(room, tracks, edges), config or EstimationConfig(), seed)


def measurements(room: Room, tracks: Tracks, edges: Sequence[ContactEdge] | None = None) -> Measurements:
    """What stages 1 to 3 would hand on, with the true instances; ``edges`` default to the exact ones."""
    return Measurements(
        scene=room.scene,
        tracks=tracks,
        rays=triangulate(room.scene, tracks, TriangulationConfig()),
        instances=tuple(room.instances),
        track_instance=true_instance(room, tracks),
        edges=true_edges(room) if edges is None else tuple(edges),
    )


def as_given(measured: Measurements) -> Prepared:
    """The same with its own scene for a canonical one."""
    scene = measured.scene
    elements = tuple(tuple(range(len(key_frame.elements))) for key_frame in scene.key_frames)
    own = Similarity(np.eye(3), np.zeros(3), 1.0)
    return Prepared(**vars(measured), form=Canonical(scene, scene, own, tuple(range(len(scene.frames))), elements))


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
            off = unproject(camera, inside, plane) - unproject(camera, inside, room.planes[i])
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


def _random_points(region: MultiPolygon, count: int, rng: np.random.Generator) -> FloatArray:
    left, top, right, bottom = region.bounds
    points = rng.uniform([left, top], [right, bottom], (count * 20, 2))
    return points[shapely.contains_xy(region, points[:, 0], points[:, 1])][:count]
