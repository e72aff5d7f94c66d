"""Synthetic rooms: planar textured polygons, from a footprint, openings and furniture boxes (metres, z up)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from shapely import Polygon

from gtlayout import synth_textures as textures
from gtlayout.layout import PlaneFrame
from gtlayout.scene import FloatArray, ImageArray, Label
from gtlayout.synth_textures import TEXEL_M, Painter

Light = Callable[[FloatArray, FloatArray], FloatArray]
"""(N, 3) points and their (3,) normal → (N,) brightness factors."""

MIP_LEVELS = 6
CLEARANCE_M = 0.3
"""Cameras keep so far away from walls and from furniture that is taller than …"""
LOW_M = 1.0
"""… this: they are held higher."""
_NEAR, _RIGHT, _FAR, _LEFT = range(4)
"""Sides of a box room's footprint, which starts at the origin and runs along x first."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Surface:
    """A planar polygon with a baked texture, seen from the side its normal points to."""

    name: str
    """A structural surface's name in the truth; openings share the plane of the surface drawn before them."""
    label: Label | None
    """None for furniture."""
    frame: PlaneFrame
    """Texture frame: the polygon lies at u, v >= 0."""
    corners_uv: FloatArray
    """(N, 2) simple polygon in ``frame``, metres."""
    mipmaps: tuple[ImageArray, ...]
    """BGR textures, each half the resolution of the one before; texel (0, 0) touches u = v = 0."""

    @property
    def corners_world(self) -> FloatArray:
        """(N, 3)."""
        return self.frame.to_world(self.corners_uv)

    @property
    def normal(self) -> FloatArray:
        """(3,) unit normal, into the room."""
        return np.cross(self.frame.axes[0], self.frame.axes[1])

    @property
    def d(self) -> float:
        """Plane offset: ``normal · X + d = 0``."""
        return -float(self.normal @ self.frame.origin)


@dataclass(frozen=True)
class Room:
    """Surfaces in drawing order: an opening comes after the wall it lies in."""

    surfaces: tuple[Surface, ...]
    standing: Polygon
    """x, y where a camera may be: in the main room, clear of its walls and of all furniture taller than ``LOW_M``."""
    height_m: float
    """The least height of the ceiling above ``standing``."""
    focus: FloatArray
    """(2,) x, y of the middle of what is worth seeing: cameras at the near end (low y) look across it."""

    @property
    def structure(self) -> tuple[Surface, ...]:
        """The room without furniture."""
        return tuple(s for s in self.surfaces if s.label is not None)

    @property
    def furniture(self) -> tuple[Surface, ...]:
        """What stands in front of it."""
        return tuple(s for s in self.surfaces if s.label is None)


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
    shape = tuple(int(np.ceil(extent / TEXEL_M)) for extent in corners_uv.max(axis=0)[::-1])
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


def extrude(
    footprint: FloatArray, height_m: float, walls: Sequence[Painter], light: Light, rng: np.random.Generator
) -> list[Surface]:
    """Floor, ceiling and one wall per side of a counter-clockwise (N, 2) footprint."""
    low = np.column_stack([footprint, np.zeros(len(footprint))])
    high = low + height_m * _UP
    floor = textures.FLOOR_PAINTERS[rng.integers(len(textures.FLOOR_PAINTERS))]
    surfaces = [
        make_surface("floor", "floor", low, floor, light, rng),
        make_surface("ceiling", "ceiling", high[::-1], textures.CEILING_PAINTER, light, rng),
    ]
    for side, paint in enumerate(walls):
        end = (side + 1) % len(footprint)
        # Seen from inside, a side of a counter-clockwise footprint runs from right to left.
        corners = np.stack([low[end], low[side], high[side], high[end]])
        surfaces.append(make_surface(f"wall_{side}", "wall", corners, paint, light, rng))
    return surfaces


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


def make_room(seed: int) -> Room:
    """A box room with slightly crooked walls, a door, a window, and furniture that hides parts of floor and walls.

    3.2–4.6 m wide (x), 4.2–5.6 m long (y), 2.4–2.8 m high, every corner moved by up to 6 cm. Door and cupboard stand on
    opposite long walls, sofa and window at the far short one (y = length); the near end is left free for a camera.
    """
    rng = np.random.default_rng([seed, 0])
    width, length, height = rng.uniform((3.2, 4.2, 2.4), (4.6, 5.6, 2.8))
    footprint = np.array([[0, 0], [width, 0], [width, length], [0, length]]) + rng.uniform(-0.06, 0.06, (4, 2))
    mirrored = bool(rng.integers(2))
    boxes = _furniture(width, length, mirrored, rng)
    lamp = np.array([width / 2, 0.45 * length, height - 0.3])
    light = lamp_light(lamp, boxes)

    def u_side(wall: int, near_m: float, size_m: float) -> float:
        """u of something ``near_m`` from the near end of a long wall, ``size_m`` wide."""
        return length - near_m - size_m if wall == _RIGHT else near_m

    def u_far(x_m: float, size_m: float) -> float:
        """The same on the far wall, from the wall with the door."""
        return width - x_m - size_m if mirrored else x_m

    door_wall, plain_wall = (_RIGHT, _LEFT) if mirrored else (_LEFT, _RIGHT)
    pictures = {
        door_wall: ((u_side(door_wall, 0.3 * length, 0.5), 1.3, 0.5, 0.7),),
        plain_wall: (
            (u_side(plain_wall, 0.2 * length, 0.7), 1.2, 0.7, 0.5),
            (u_side(plain_wall, 0.85 * length, 0.4), 1.4, 0.4, 0.55),
        ),
        _FAR: ((u_far(0.6, 0.7), 1.3, 0.7, 0.5),),
        _NEAR: (),
    }
    papers = rng.permutation(len(textures.WALL_PAINTERS))
    painters = [textures.with_pictures(textures.WALL_PAINTERS[papers[wall]], pictures[wall]) for wall in range(4)]
    structure = extrude(footprint, height, painters, light, rng)
    walls = structure[2:]

    door_size = (float(rng.uniform(0.8, 0.95)), float(rng.uniform(1.98, 2.1)))
    door_u = u_side(door_wall, float(rng.uniform(0.48, 0.55)) * length, door_size[0])
    window_size = (float(rng.uniform(0.9, 1.15)), float(rng.uniform(1.0, 1.2)))
    window_u = u_far(width - 0.35 - window_size[0], window_size[0])
    structure += [
        opening(walls[door_wall], "door_0", "door", (door_u, 0.0), door_size, textures.door, light, rng),
        opening(walls[_FAR], "window_0", "window", (window_u, 0.95), window_size, textures.window, light, rng),
    ]
    furniture = [
        make_surface(
            f"box_{number}", None, face, box.paint, lamp_light(lamp, boxes[:number] + boxes[number + 1 :]), rng
        )
        for number, box in enumerate(boxes)
        for face in box.faces()
    ]
    focus = np.array([width / 2, length / 2])
    return Room(tuple(structure + furniture), standing_place(Polygon(footprint), boxes), float(height), focus)


def standing_place(upright: Polygon, boxes: Sequence[Box]) -> Polygon:
    """Where a camera may be: of ``upright`` (x, y) the largest part away from its border and from tall furniture."""
    tall = [Polygon(box.faces()[4][:, :2]) for box in boxes if box.centre[2] + box.size[2] / 2 > LOW_M]
    free = upright.buffer(-CLEARANCE_M, join_style="mitre")
    free -= shapely.union_all([footprint.buffer(CLEARANCE_M, join_style="mitre") for footprint in tall])
    return max((part for part in shapely.get_parts(free) if isinstance(part, Polygon)), key=lambda part: part.area)


def _furniture(width: float, length: float, mirrored: bool, rng: np.random.Generator) -> list[Box]:
    """Cupboard, bookshelf, sofa and a table; laid out for a door at x = 0, mirrored if it is at x = width."""
    boxes: list[Box] = []

    def add(
        low: tuple[float, float, float], size: tuple[float, float, float], paint: Painter, yaw: float = 0.0
    ) -> None:
        centre = np.array(low) + np.array(size) / 2
        if mirrored:
            centre[0] = width - centre[0]
        boxes.append(Box(centre, np.array(size), -yaw if mirrored else yaw, paint))

    tall = float(rng.uniform(1.5, 1.95))
    add((width - 0.55, float(rng.uniform(0.5, 0.55)) * length, 0.0), (0.45, 1.1, tall), textures.CABINET_PAINTER)
    add((0.1, 0.72 * length, 0.0), (0.3, 0.6, float(rng.uniform(0.9, 1.2))), textures.BOOKS_PAINTER)

    sofa_x, sofa_y, sofa_width = 0.55, length - 1.0, float(rng.uniform(1.3, 1.6))
    add((sofa_x, sofa_y, 0.0), (sofa_width, 0.7, 0.42), textures.FABRIC_PAINTER)
    add((sofa_x, sofa_y + 0.7, 0.0), (sofa_width, 0.2, 0.85), textures.FABRIC_PAINTER)
    for x in (sofa_x - 0.15, sofa_x + sofa_width):
        add((x, sofa_y, 0.0), (0.15, 0.9, 0.6), textures.FABRIC_PAINTER)

    table = np.array([rng.uniform(0.42, 0.52) * width, rng.uniform(0.55, 0.6) * length])
    yaw = float(rng.uniform(-0.4, 0.4))
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    add((table[0] - 0.45, table[1] - 0.3, 0.45), (0.9, 0.6, 0.05), textures.WOOD_PAINTER, yaw)
    for corner in ((-0.4, -0.25), (0.4, -0.25), (0.4, 0.25), (-0.4, 0.25)):
        x, y = table + turn @ corner
        add((x - 0.03, y - 0.03, 0.0), (0.06, 0.06, 0.45), textures.WOOD_PAINTER, yaw)
    return boxes
