"""The parts of synthetic rooms: planar textured polygons and furniture boxes under a lamp (metres, z up)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from shapely import Polygon

from gtlayout.instances import PlaneFrame
from gtlayout.scene import OPENINGS, FloatArray, ImageArray, Label
from gtlayout.synth.arcs import Arc
from gtlayout.synth.textures import TEXEL_M, Painter

Light = Callable[[FloatArray, FloatArray], FloatArray]
"""(N, 3) points and their (3,) normal → (N,) brightness factors."""

MIP_LEVELS = 6
_SAME_TEXELS = 1e-6
"""Furniture is a whole number of texels deep or wide, but for rounding, which must not add one more."""


@dataclass(frozen=True)
class Surface:
    """A planar polygon with a baked texture, seen from the side its normal points to."""

    name: str
    """A structural surface's name in the truth; openings share the plane of the surface drawn before them."""
    label: Label | None
    """None for what nobody annotates by itself: furniture, trim, and the reveal of a doorway."""
    frame: PlaneFrame
    """Texture frame: the polygon lies at u, v >= 0."""
    corners_uv: FloatArray
    """(N, 2) simple polygon in ``frame``, metres."""
    mipmaps: tuple[ImageArray, ...]
    """BGR textures, each half the resolution of the one before; texel (0, 0) touches u = v = 0."""
    part_of: str | None = None
    """Of trim the surface that it is drawn with, of a recessed opening its wall."""
    holes_uv: tuple[FloatArray, ...] = ()
    """(N, 2) polygons that are cut out, for what lies behind: recessed openings."""
    arc: Arc | None = None
    """Of a facet of a round wall what it is a facet of. All facets but the first are ``part_of`` it."""

    @cached_property
    def corners_world(self) -> FloatArray:
        """(N, 3)."""
        return self.frame.to_world(self.corners_uv)

    @cached_property
    def holes_world(self) -> tuple[FloatArray, ...]:
        """(N, 3) each."""
        return tuple(self.frame.to_world(hole) for hole in self.holes_uv)

    @cached_property
    def normal(self) -> FloatArray:
        """(3,) unit normal, into the room."""
        return np.cross(self.frame.axes[0], self.frame.axes[1])

    @cached_property
    def d(self) -> float:
        """Plane offset: ``normal · X + d = 0``."""
        return -float(self.normal @ self.frame.origin)


@dataclass(frozen=True)
class Box:
    """A furniture box standing upright."""

    centre: FloatArray
    """(3,)"""
    size: FloatArray
    """(3,) along its own x, y, z."""
    yaw_rad: float
    paint: Painter

    @property
    def axes(self) -> FloatArray:
        """(3, 3) rows: its x, y, z in the world."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def distance(self, points: FloatArray) -> FloatArray:
        """(N,) distances of (N, 3) points, 0 inside."""
        local = np.abs((points - self.centre) @ self.axes.T) - self.size / 2
        return np.linalg.norm(np.maximum(local, 0), axis=1)

    def faces(self) -> list[FloatArray]:
        """Six (4, 3) quads, counter-clockwise from outside, first edge horizontal."""
        x, y, z = self.axes * self.size[:, None] / 2
        sides = [(x, y, z), (y, -x, z), (-x, -y, z), (-y, x, z), (z, x, y), (-z, -x, y)]
        return [self.centre + out + np.stack([-e - f, e - f, e + f, -e + f]) for out, e, f in sides]


def make_surface(
    name: str, label: Label | None, corners_world: FloatArray, paint: Painter, light: Light, rng: np.random.Generator
) -> Surface:
    """A surface from (N, 3) planar corners, counter-clockwise seen from the room; u runs along the first edge."""
    normal = np.cross(corners_world, np.roll(corners_world, -1, axis=0)).sum(axis=0)
    normal /= np.linalg.norm(normal)
    e_u = corners_world[1] - corners_world[0]
    e_u = e_u / np.linalg.norm(e_u)
    axes = np.stack([e_u, np.cross(normal, e_u)])
    corners_uv = (corners_world - corners_world[0]) @ axes.T
    low = corners_uv.min(axis=0)
    frame = PlaneFrame(corners_world[0] + low @ axes, axes)
    corners_uv = corners_uv - low
    shape = tuple(int(np.ceil(extent / TEXEL_M - _SAME_TEXELS)) for extent in corners_uv.max(axis=0)[::-1])
    albedo = cv2.GaussianBlur(paint(rng, (shape[0], shape[1])), (0, 0), 0.8)
    # Whole texels at every level, so that the levels stay aligned.
    beyond = [-size % 2 ** (MIP_LEVELS - 1) for size in shape]
    albedo = cv2.copyMakeBorder(albedo, 0, beyond[0], 0, beyond[1], cv2.BORDER_REPLICATE)
    height, width = albedo.shape[:2]
    v, u = np.mgrid[0:height:16, 0:width:16] * TEXEL_M
    points = frame.to_world(np.column_stack([u.ravel(), v.ravel()]))
    brightness = light(points, normal).reshape(u.shape).astype(np.float32)
    texture = albedo * cv2.resize(brightness, (width, height), interpolation=cv2.INTER_LINEAR)[..., None]
    mipmaps = [np.clip(np.rint(texture), 0, 255).astype(np.uint8)]
    for _ in range(MIP_LEVELS - 1):
        mipmaps.append(cv2.resize(mipmaps[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(np.uint8))
    return Surface(name, label, frame, corners_uv, tuple(mipmaps))


def lamp_light(lamp_world: FloatArray, boxes: Sequence[Box]) -> Light:
    """A ceiling lamp, ambient light, and darkness in the crevices around furniture."""

    def light(points: FloatArray, normal: FloatArray) -> FloatArray:
        to_lamp = lamp_world - points
        distance = np.linalg.norm(to_lamp, axis=1)
        cosine = np.clip(to_lamp @ normal / distance, 0, None)
        brightness: FloatArray = 0.62 + 0.5 * cosine / (1 + (distance / 3) ** 2) + 0.05 * normal[0]
        for box in boxes:
            gap = box.distance(points)
            brightness *= 1 - 0.4 * np.exp(-gap / 0.12)
        return brightness

    return light


def host_of(surfaces: Sequence[Surface], number: int) -> int | None:
    """The surface that a door or window lies in, None for all others.

    A recessed one names it, else it is drawn before the opening and shares its plane.
    """
    opening = surfaces[number]
    if opening.label not in OPENINGS:
        return None
    corners = opening.corners_world
    for other, surface in enumerate(surfaces[:number]):
        if opening.part_of is not None:
            if opening.part_of == surface.name:
                return other
            continue
        off = np.abs(corners @ surface.normal + surface.d).max()
        inside = Polygon(surface.corners_uv).buffer(1e-6).covers(Polygon(surface.frame.to_plane(corners)))
        if surface.label not in OPENINGS and off < 1e-6 and opening.normal @ surface.normal > 0 and inside:
            return other
    return None


def opening(
    wall: Surface,
    name: str,
    label: Label,
    low_uv: tuple[float, float],
    size: tuple[float, float],
    paint: Painter,
    light: Light,
    rng: np.random.Generator,
) -> Surface:
    """A door or window: a rectangle in the plane of ``wall``, ``low_uv`` its lower left corner in the wall's frame."""
    corners_uv = np.array(low_uv) + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size
    return make_surface(name, label, wall.frame.to_world(corners_uv), paint, light, rng)
