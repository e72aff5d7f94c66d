"""Contact edges of simulated rooms: exact, as a hand draws them, and wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import shapely

from gtlayout.edges import ContactEdge
from gtlayout.instances import ContactOffsets
from gtlayout.scene import FloatArray
from simulated.simulated_room import Room

EDGE_STEP_PX, MIN_EDGE_PX = 4.0, 20.0
"""Distance of the points on an edge, and the shortest one that is drawn."""


def true_edges(room: Room, offsets: ContactOffsets | None = None) -> tuple[ContactEdge, ...]:
    """The images of the segments that two faces share, as stage 3 should find them; not derived from the polygons.

    Segments of pairs in ``offsets`` are moved by these, as the foot of a baseboard is.
    """
    edges: list[ContactEdge] = []
    face_of = [next(f for f in room.faces if np.array_equal(f.plane, plane)) for plane in room.planes]
    for k in range(len(room.scene.key_frames)):
        for a, b in combinations(sorted(set(room.instance_of[k].tolist())), 2):
            shared = [p for p in face_of[a].corners if (np.abs(face_of[b].corners - p).max(axis=1) < 1e-12).any()]
            if len(shared) != 2:
                continue
            offset = (offsets or {}).get((a, b), np.zeros(3))
            edges += _drawn_edge(room, k, (a, b), shared[0] + offset, shared[1] + offset)
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
        along, across = _directions(edge)
        position = (edge.points_px - edge.points_px.mean(axis=0)) @ along
        error = shift_px * rng.normal() + tilt_px * rng.normal() * position / position.std()
        drawn.append(replace(edge, points_px=edge.points_px + error[:, None] * across))
    return drawn


def shifted(edge: ContactEdge, by_px: float) -> ContactEdge:
    """An edge drawn so far beside its place, across itself."""
    return replace(edge, points_px=edge.points_px + by_px * _directions(edge)[1])


def _directions(edge: ContactEdge) -> tuple[FloatArray, FloatArray]:
    """(2,) from end to end of an edge, px, and (2,) the unit vector across."""
    along = edge.points_px[-1] - edge.points_px[0]
    return along, np.array([-along[1], along[0]]) / np.linalg.norm(along)


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
