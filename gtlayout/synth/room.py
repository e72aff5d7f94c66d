"""Synthetic rooms: a plan, its materials and furniture, and where a camera may stand in it (metres, z up)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import shapely
from shapely import Polygon

from gtlayout.scene import FloatArray
from gtlayout.synth import textures
from gtlayout.synth.curved_plans import bay, round_corner
from gtlayout.synth.furniture import LOW_M, furnish
from gtlayout.synth.kitchen import Run
from gtlayout.synth.materials import paint_plan
from gtlayout.synth.outfit import Outfit
from gtlayout.synth.plans import Plan, l_shaped, polygon, slanted, two_rooms
from gtlayout.synth.surfaces import Box, Light, Surface, lamp_light, make_surface, opening
from gtlayout.synth.textures import Painter, faded
from gtlayout.synth.trim import NO_TRIM, Trim

FlatRoomKind = Literal["box", "l-shaped", "slanted", "two-rooms", "polygon"]
CurvedRoomKind = Literal["bay", "round-corner"]
RoomKind = FlatRoomKind | CurvedRoomKind
ROOM_KINDS: tuple[FlatRoomKind, ...] = get_args(FlatRoomKind)
"""Of data sets and benchmarks: rooms with a round wall are asked for by name."""
CURVED_ROOM_KINDS: tuple[CurvedRoomKind, ...] = get_args(CurvedRoomKind)
CLEARANCE_M = 0.3
"""Cameras keep so far away from walls and tall furniture."""
_NEAR, _RIGHT, _FAR, _LEFT = range(4)
"""Sides of a box room's footprint, which starts at the origin and runs along x first."""
_UP = np.array([0.0, 0.0, 1.0])
_PLANS: dict[RoomKind, Callable[[np.random.Generator], Plan]] = {
    "l-shaped": l_shaped,
    "slanted": slanted,
    "two-rooms": two_rooms,
    "polygon": polygon,
    "bay": bay,
    "round-corner": round_corner,
}


@dataclass(frozen=True)
class Room:
    """Surfaces in drawing order: an opening comes after the wall it lies in."""

    surfaces: tuple[Surface, ...]
    built: int
    """The first so many surfaces are the building, the others furniture."""
    standing: Polygon
    """x, y where a camera may be: in the main room, clear of its walls and of all furniture taller than ``LOW_M``."""
    height_m: float
    """The least height of the ceiling above ``standing``."""
    focus: FloatArray
    """(2,) x, y of the middle of what is worth seeing: cameras at the near end (low y) look across it."""

    @property
    def building(self) -> tuple[Surface, ...]:
        """All that one cannot look behind even in the mind: the structure, its trim, and the reveals of doorways."""
        return self.surfaces[: self.built]

    @property
    def structure(self) -> tuple[Surface, ...]:
        """What gets annotated."""
        return tuple(s for s in self.building if s.label is not None)

    @property
    def furniture(self) -> tuple[Surface, ...]:
        """What stands in front of it."""
        return self.surfaces[self.built :]


def _extrude(
    footprint: FloatArray,
    height_m: float,
    walls: Sequence[Painter],
    light: Light,
    texture: float,
    rng: np.random.Generator,
) -> list[Surface]:
    """Floor, ceiling and one wall per side of a counter-clockwise (N, 2) footprint."""
    low = np.column_stack([footprint, np.zeros(len(footprint))])
    high = low + height_m * _UP
    floor = textures.FLOOR_PAINTERS[rng.integers(len(textures.FLOOR_PAINTERS))]
    surfaces = [
        make_surface("floor", "floor", low, faded(floor, texture), light, rng),
        make_surface("ceiling", "ceiling", high[::-1], faded(textures.CEILING_PAINTER, texture), light, rng),
    ]
    for side, paint in enumerate(walls):
        end = (side + 1) % len(footprint)
        # Seen from inside, a side of a counter-clockwise footprint runs from right to left.
        corners = np.stack([low[end], low[side], high[side], high[end]])
        surfaces.append(make_surface(f"wall_{side}", "wall", corners, faded(paint, texture), light, rng))
    return surfaces


def make_room(seed: int, kind: RoomKind = "box", texture: float = 1.0, trim: Trim = NO_TRIM) -> Room:
    """A furnished room with a door and at least one window; the near end (low y) is left free for a camera.

    ``texture`` in [0, 1] is the contrast of walls, floor and ceiling: 0 is almost blank.
    """
    rng = np.random.default_rng([seed, 0])
    outfit = Outfit.of_room(trim, np.random.default_rng([seed, 6]))
    if kind == "box":
        return _box_room(texture, outfit, rng)
    plan = _PLANS[kind](rng)
    walls = {p.name: p.corners_world[:2] for p in plan.panels if p.label == "wall" and p.room == 0 and p.arc is None}
    run = outfit.place_kitchen(walls, plan.floor(0) - plan.clear)
    if run is not None:
        plan = replace(plan, clear=shapely.union_all([plan.clear, run.place.buffer(CLEARANCE_M)]))
    boxes = furnish(plan, rng)
    painted = paint_plan(plan, boxes, texture, rng)
    furniture = _paint_furniture(boxes, plan.lamps_world, rng)
    building = outfit.fitted(painted, run, texture, plan.lamps_world, boxes)
    standing = standing_place(plan.upright, boxes, run)
    return Room((*building, *furniture), len(building), standing, plan.height_m, plan.focus)


def _box_room(texture: float, outfit: Outfit, rng: np.random.Generator) -> Room:
    """A box room with slightly crooked walls, a door, a window, and furniture that hides parts of floor and walls.

    3.2–4.6 m wide (x), 4.2–5.6 m long (y), 2.4–2.8 m high, every corner moved by up to 6 cm. Door and cupboard stand on
    opposite long walls, sofa and window at the far short one (y = length); the near end is left free for a camera.
    A kitchen takes the cupboard's place.
    """
    width, length, height = rng.uniform((3.2, 4.2, 2.4), (4.6, 5.6, 2.8))
    footprint = np.array([[0, 0], [width, 0], [width, length], [0, length]]) + rng.uniform(-0.06, 0.06, (4, 2))
    mirrored = bool(rng.integers(2))
    boxes = _furniture(width, length, mirrored, rng)
    door_wall, plain_wall = (_RIGHT, _LEFT) if mirrored else (_LEFT, _RIGHT)
    foot = np.pad(footprint[[(plain_wall + 1) % 4, plain_wall]], ((0, 0), (0, 1)))
    far_part = Polygon(footprint) & shapely.box(-1, length / 3, width + 1, length + 1)
    run = outfit.place_kitchen({f"wall_{plain_wall}": foot}, far_part)
    if run is not None:
        del boxes[0]
    lamp = np.array([width / 2, 0.45 * length, height - 0.3])
    light = lamp_light(lamp, boxes)

    def u_side(wall: int, near_m: float, size_m: float) -> float:
        """u of something ``near_m`` from the near end of a long wall, ``size_m`` wide."""
        return length - near_m - size_m if wall == _RIGHT else near_m

    def u_far(x_m: float, size_m: float) -> float:
        """The same on the far wall, from the wall with the door."""
        return width - x_m - size_m if mirrored else x_m

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
    structure = _extrude(footprint, height, painters, light, texture, rng)
    walls = structure[2:]

    door_size = (float(rng.uniform(0.8, 0.95)), float(rng.uniform(1.98, 2.1)))
    door_u = u_side(door_wall, float(rng.uniform(0.48, 0.55)) * length, door_size[0])
    window_size = (float(rng.uniform(0.9, 1.15)), float(rng.uniform(1.0, 1.2)))
    window_u = u_far(width - 0.35 - window_size[0], window_size[0])
    structure += [
        opening(walls[door_wall], "door_0", "door", (door_u, 0.0), door_size, textures.door, light, rng),
        opening(walls[_FAR], "window_0", "window", (window_u, 0.95), window_size, textures.window, light, rng),
    ]
    furniture = _paint_furniture(boxes, lamp[None], rng)
    focus = np.array([width / 2, length / 2])
    building = outfit.fitted(structure, run, texture, lamp[None], boxes)
    standing = standing_place(Polygon(footprint), boxes, run)
    return Room((*building, *furniture), len(building), standing, float(height), focus)


def _paint_furniture(boxes: Sequence[Box], lamps_world: FloatArray, rng: np.random.Generator) -> list[Surface]:
    """Six surfaces a box, lit by the nearest lamp."""
    surfaces = []
    for number, box in enumerate(boxes):
        lamp = lamps_world[np.argmin(np.linalg.norm(lamps_world - box.centre, axis=1))]
        light = lamp_light(lamp, [*boxes[:number], *boxes[number + 1 :]])
        surfaces += [make_surface(f"box_{number}", None, face, box.paint, light, rng) for face in box.faces()]
    return surfaces


def standing_place(upright: Polygon, boxes: Sequence[Box], run: Run | None) -> Polygon:
    """Where a camera may be: of ``upright`` (x, y) the largest part away from border, cupboards and tall furniture."""
    tall = [Polygon(box.faces()[4][:, :2]) for box in boxes if box.centre[2] + box.size[2] / 2 > LOW_M]
    tall += [run.place] if run is not None else []
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
