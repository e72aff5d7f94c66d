"""Rooms of every kind and views of them, made once for all tests."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from shapely import Point

from gtlayout.scene import Camera, FloatArray, KeyFrame
from gtlayout.synth.annotate import annotate
from gtlayout.synth.render import cast
from gtlayout.synth.room import ROOM_KINDS, Room, RoomKind, make_room

SEED = 1
WIDTH, HEIGHT = 200, 150
Drawn = tuple[KeyFrame, dict[str, str]]

every_kind = pytest.mark.parametrize("kind", ROOM_KINDS)


@cache
def the_room(kind: RoomKind) -> Room:
    return make_room(SEED, kind)


@cache
def views(kind: RoomKind) -> tuple[Camera, ...]:
    return views_of(the_room(kind))


def views_of(room: Room) -> tuple[Camera, ...]:
    """From where one may stand in the near half, towards what is worth seeing."""
    rng = np.random.default_rng(SEED)
    low, high = np.reshape(room.standing.bounds, (2, 2))
    found: list[Camera] = []
    while len(found) < 6:
        centre = np.append(rng.uniform(low, high), 1.5)
        ahead = np.append(room.focus, 1.3) + rng.normal(0, 0.3, 3) - centre
        if room.standing.contains(Point(centre)) and ahead[1] > 0 and np.linalg.norm(ahead[:2]) > 0.8:
            found.append(camera_at(centre, ahead))
    return tuple(found)


@cache
def drawn(kind: RoomKind) -> tuple[Drawn, ...]:
    room = the_room(kind)
    return tuple(annotate(room, c, cast(room.surfaces, c), 0, np.random.default_rng(0)) for c in views(kind))


def camera_at(centre: FloatArray, ahead: FloatArray) -> Camera:
    """An upright camera that looks ``ahead``."""
    forward = ahead / np.linalg.norm(ahead)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    R_cam_from_world = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[130.0, 0, WIDTH / 2], [0, 130, HEIGHT / 2], [0, 0, 1]])
    return Camera(K, R_cam_from_world, -R_cam_from_world @ centre, WIDTH, HEIGHT)
