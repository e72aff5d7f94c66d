"""Plans of synthetic rooms other than the box: bare panels, before furniture and materials (metres, z up).

The near end (low y) is left free for cameras, what is worth seeing lies at the far end. Half of all plans are mirrored
(x → -x). Rooms are slightly crooked: corners are off by up to ``outlines.CROOKED_M``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely import Polygon

from gtlayout.instances import PlaneFrame
from gtlayout.scene import FloatArray, Label
from gtlayout.synth.arcs import Arc
from gtlayout.synth.outlines import crooked, inset, skew_outline

HEADROOM_M = 2.0
"""Lower places below a slanted ceiling are no good for standing or for tall furniture."""
LAMP_M = 0.3
"""Lamps hang so far below the ceiling."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Panel:
    """A planar part of the building."""

    name: str
    label: Label | None
    """None for the reveal of a doorway, see ``two_rooms``."""
    corners_world: FloatArray
    """(N, 3) simple polygon, counter-clockwise seen from the room; its first edge is level, a wall's at the floor."""
    room: int = 0
    """0 is the room with the cameras."""
    arc: Arc | None = None
    """Of a facet of a round wall what it is a facet of."""
    part_of: str | None = None
    """Of all facets but the first the name of the first, with which they are drawn."""

    @property
    def normal(self) -> FloatArray:
        """(3,) unit normal, into the room."""
        area = np.cross(self.corners_world, np.roll(self.corners_world, -1, axis=0)).sum(axis=0)
        return area / np.linalg.norm(area)

    @property
    def frame(self) -> PlaneFrame:
        """u runs along the first edge from its start; upright panels have v upwards."""
        e_u = self.corners_world[1] - self.corners_world[0]
        e_u = e_u / np.linalg.norm(e_u)
        return PlaneFrame(self.corners_world[0], np.stack([e_u, np.cross(self.normal, e_u)]))

    @property
    def width_m(self) -> float:
        """How far it reaches along u."""
        return float(np.ptp(self.frame.to_plane(self.corners_world)[:, 0]))


@dataclass(frozen=True)
class Plan:
    """A building of one or two rooms, and where furniture may stand in it (x, y)."""

    panels: tuple[Panel, ...]
    """In drawing order: an opening comes after the wall it lies in."""
    lamps_world: FloatArray
    """(rooms, 3)"""
    height_m: float
    """The least height of the ceiling above ``upright``."""
    focus: FloatArray
    """(2,) x, y of the middle of what is worth seeing."""
    upright: Polygon
    """The part of the main room high enough to stand in."""
    clear: shapely.Geometry
    """No furniture here: the near end, and before doors."""
    low_only: shapely.Geometry = field(default_factory=Polygon)
    """No tall furniture here: before windows."""

    def floor(self, room: int) -> Polygon:
        """A room's floor, x and y."""
        panel = next(panel for panel in self.panels if panel.label == "floor" and panel.room == room)
        return Polygon(panel.corners_world[:, :2])


def l_shaped(rng: np.random.Generator) -> Plan:
    """An L: the far right quarter is missing, so that its corner hides part of the far end. Six walls."""
    width, length, height = rng.uniform((4.8, 5.0, 2.4), (5.8, 6.0, 2.8))
    notch = rng.uniform((0.42, 0.36), (0.5, 0.44)) * (width, length)
    corners = [(0, 0), (width, 0), (width, length - notch[1]), (width - notch[0], length - notch[1])]
    corners += [(width - notch[0], length), (0, length)]
    panels = _shell(crooked(corners, rng), height)
    right, front, far = panels[3], panels[4], panels[6]
    door = centred("door_0", "door", front, rng.uniform(0.4, 0.6), door_size(rng))
    windows = [
        centred("window_0", "window", far, rng.uniform(0.45, 0.55), window_size(rng), 0.95),
        centred("window_1", "window", right, rng.uniform(0.5, 0.6), window_size(rng), 0.95),
    ]
    lamps = [(0.45 * width, 0.4 * length, height - LAMP_M)]
    focus = (0.42 * width, 0.52 * length)
    kept = [near_end(width, 0.33 * length), before(door)]
    return mirrored(plan_of([*panels, door, *windows], lamps, height, focus, kept, windows), rng)


def polygon(rng: np.random.Generator) -> Plan:
    """Five or six walls, none at right angles or parallel to another; two of five have a corner that points inwards."""
    height = rng.uniform(2.4, 2.8)
    corners = skew_outline(rng)
    panels = _shell(corners, height)
    towards = [-panel.normal[1] * panel.width_m for panel in panels[2:]]
    first, second = (panels[2 + int(k)] for k in np.argsort(towards)[::-1][:2])
    door = centred("door_0", "door", first, rng.uniform(0.4, 0.6), door_size(rng))
    window = centred("window_0", "window", second, rng.uniform(0.4, 0.6), window_size(rng), 0.95)
    focus = shapely.get_coordinates(Polygon(corners).centroid)[0]
    lamps = [(*focus, height - LAMP_M)]
    near = corners[:, 1].min() + 0.33 * np.ptp(corners[:, 1])
    kept = [near_end(6.0, near), before(door)]
    return mirrored(plan_of([*panels, door, window], lamps, height, focus, kept, [window]), rng)


def slanted(rng: np.random.Generator) -> Plan:
    """An attic: low walls on one long side or both, sloping surfaces above them, a window in the roof."""
    width, length, height = rng.uniform((4.0, 4.4, 2.45), (4.8, 5.4, 2.7))
    knee, tangent = rng.uniform(1.05, 1.25), np.tan(np.deg2rad(rng.uniform(40, 50)))
    sloped = (False, bool(rng.integers(2)), False, True)
    base = crooked([(0, 0), (width, 0), (width, length), (0, length)], rng)
    top = inset(base, sloped, (height - knee) / tangent)
    upright = Polygon(inset(base, sloped, (HEADROOM_M - knee) / tangent))
    panels = [
        Panel("floor", "floor", at_height(base, 0.0)),
        Panel("ceiling", "ceiling", at_height(top, height)[::-1]),
    ]

    def upper(corner: int, wall: int, neighbour: int) -> list[FloatArray]:
        """A wall's upper corners above a corner of the base, upwards: two where only its neighbour slopes."""
        eave, ridge = at_height(base[corner], knee), at_height(top[corner], height)
        return [eave] if sloped[wall] else [eave, ridge] if sloped[neighbour] else [ridge]

    for side in range(4):
        end = (side + 1) % 4
        corners = [*at_height(base[[end, side]], 0.0), *upper(side, side, side - 1), *upper(end, side, end)[::-1]]
        panels.append(Panel(f"wall_{side}", "wall", np.stack(corners)))
    slopes = [
        Panel(
            f"slanted_{side}",
            "slanted",
            np.stack([*at_height(base[[(side + 1) % 4, side]], knee), *at_height(top[[side, (side + 1) % 4]], height)]),
        )
        for side in (1, 3)
        if sloped[side]
    ]
    # Where a door fits below the slopes of the far wall.
    size = door_size(rng)
    below = inset(base, sloped, (size[1] - knee) / tangent)
    low, high = np.sort(panels[4].frame.to_plane(at_height(below[[2, 3]], 0.0))[:, 0])
    door = _opening("door_0", "door", panels[4], (rng.uniform(low + 0.15, high - size[0] - 0.15), 0.0), size)
    window = centred("window_0", "window", slopes[-1], rng.uniform(0.55, 0.7), (0.8, 1.0), 0.35)
    lamps = [(*top.mean(axis=0), height - LAMP_M)]
    kept = [near_end(width, 0.33 * length), before(door)]
    plan = plan_of([*panels, *slopes, door, window], lamps, HEADROOM_M, (width / 2, length / 2), kept, [])
    return mirrored(replace(plan, upright=upright), rng)


def two_rooms(rng: np.random.Generator) -> Plan:
    """A room whose far wall has an open doorway to a second room.

    The wall is 12–20 cm thick. The doorway's reveal has no label: nobody annotates strips of a hand's width, nor may
    one draw through them, for they hide the second room as the wall does. The second floor begins in the near face
    of the wall, where it meets the first.
    """
    width, length, height = rng.uniform((3.8, 4.0, 2.4), (4.8, 4.8, 2.8))
    base = crooked([(0, 0), (width, 0), (width, length), (0, length)], rng)
    main = _shell(base, height)
    # The second room, in a frame along the wall: s to the right, t away from the cameras.
    span = float(np.linalg.norm(base[2] - base[3]))
    along = (base[2] - base[3]) / span
    axes = np.stack([along, [-along[1], along[0]]])
    thick, size = rng.uniform(0.12, 0.2), (rng.uniform(0.9, 1.05), rng.uniform(2.0, 2.1))
    low = rng.uniform(0.3, 0.5) * (span - size[0])
    left, right, far = rng.uniform((-0.8, span + 0.2, thick + 2.8), (-0.2, span + 0.8, thick + 3.6))
    second_height = max(size[1] + 0.15, height + rng.uniform(-0.15, 0.15))
    far_end = crooked([(right, far), (left, far)], rng)
    outline = base[3] + np.array([(left, thick), (right, thick), *far_end]) @ axes
    posts = base[3] + np.array([(low, 0), (low + size[0], 0), (low + size[0], thick), (low, thick)]) @ axes

    main[4] = _with_doorway(main[4], posts[:2], size[1])
    second = [
        replace(panel, name=name, room=1)
        for panel, name in zip(
            _shell(outline, second_height),
            ("floor_1", "ceiling_1", *(f"wall_{number}" for number in range(4, 8))),
            strict=True,
        )
    ]
    second[0] = replace(
        second[0], corners_world=at_height(np.vstack([outline[0], posts[[3, 0, 1, 2]], outline[1:]]), 0.0)
    )
    second[2] = _with_doorway(second[2], posts[[2, 3]], size[1])
    foot, head = at_height(posts, 0.0), at_height(posts, size[1])
    reveals = [
        Panel("reveal_0", None, np.stack([foot[0], foot[3], head[3], head[0]]), 1),
        Panel("reveal_1", None, np.stack([foot[2], foot[1], head[1], head[2]]), 1),
        Panel("reveal_2", None, head[[3, 2, 1, 0]], 1),
    ]
    door = centred("door_0", "door", main[5], rng.uniform(0.4, 0.55), door_size(rng))
    windows = [
        centred("window_0", "window", main[3], rng.uniform(0.45, 0.6), window_size(rng), 0.95),
        centred("window_1", "window", second[4], rng.uniform(0.35, 0.65), window_size(rng), 0.95),
    ]
    lamps = [(width / 2, 0.45 * length, height - LAMP_M), (*outline.mean(axis=0), second_height - LAMP_M)]
    kept = [
        near_end(width, 0.33 * length),
        before(door),
        Polygon(posts).buffer(0.9, join_style="mitre", cap_style="square"),
    ]
    panels = [*main, *second, *reveals, door, *windows]
    return mirrored(plan_of(panels, lamps, height, (width / 2, 0.55 * length), kept, windows), rng)


def plan_of(
    panels: Sequence[Panel],
    lamps: Sequence[Sequence[float]],
    height_m: float,
    focus: Sequence[float] | FloatArray,
    clear: Sequence[Polygon],
    windows: Sequence[Panel],
) -> Plan:
    """A plan of panels in drawing order; no tall furniture before the ``windows``."""
    low_only = shapely.union_all([before(window, 0.6) for window in windows])
    upright = Polygon(panels[0].corners_world[:, :2])
    arrays = np.array(lamps, float), float(height_m), np.array(focus, float)
    return Plan(tuple(panels), *arrays, upright, shapely.union_all(clear), low_only)


def _shell(footprint: FloatArray, height_m: float) -> list[Panel]:
    """Floor, ceiling and one wall per side of a counter-clockwise (N, 2) footprint."""
    low, high = at_height(footprint, 0.0), at_height(footprint, height_m)
    panels = [Panel("floor", "floor", low), Panel("ceiling", "ceiling", high[::-1])]
    for side in range(len(footprint)):
        end = (side + 1) % len(footprint)
        # Seen from inside, a side of a counter-clockwise footprint runs from right to left.
        panels.append(Panel(f"wall_{side}", "wall", np.stack([low[end], low[side], high[side], high[end]])))
    return panels


def _with_doorway(wall: Panel, posts: FloatArray, height_m: float) -> Panel:
    """A rectangular wall without its doorway; ``posts`` (2, 2) are its left and right edge seen from the room."""
    left, right, *high = wall.corners_world
    foot, head = at_height(posts, 0.0), at_height(posts, height_m)
    return replace(wall, corners_world=np.stack([left, foot[0], head[0], head[1], foot[1], right, *high]))


def _opening(name: str, label: Label, wall: Panel, low_uv: tuple[float, float], size: tuple[float, float]) -> Panel:
    corners_uv = np.array(low_uv) + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size
    return Panel(name, label, wall.frame.to_world(corners_uv), wall.room)


def centred(
    name: str, label: Label, wall: Panel, share: float, size: tuple[float, float], sill_m: float = 0.0
) -> Panel:
    """An opening whose middle is at a share of the wall's width, but not within 15 cm of its ends."""
    u = float(np.clip(share * wall.width_m - size[0] / 2, 0.15, wall.width_m - size[0] - 0.15))
    return _opening(name, label, wall, (u, sill_m), size)


def door_size(rng: np.random.Generator) -> tuple[float, float]:
    """Width and height of a door, m."""
    return float(rng.uniform(0.8, 0.95)), float(rng.uniform(1.98, 2.1))


def window_size(rng: np.random.Generator) -> tuple[float, float]:
    """Width and height of a window, m."""
    return float(rng.uniform(0.9, 1.15)), float(rng.uniform(1.0, 1.2))


def before(panel: Panel, depth_m: float = 0.9) -> Polygon:
    """The place in front of an upright panel, x and y."""
    start, end = panel.corners_world[:2, :2]
    out = depth_m * panel.normal[:2]
    return Polygon([start, end, end + out, start + out])


def near_end(reach_m: float, up_to_y_m: float) -> Polygon:
    """The place that is left to the cameras, x and y."""
    return shapely.box(-reach_m, -10.0, 2 * reach_m, up_to_y_m)


def at_height(points_xy: FloatArray, height_m: float) -> FloatArray:
    """(…, 2) → (…, 3)."""
    return np.concatenate([points_xy, np.full((*points_xy.shape[:-1], 1), height_m)], axis=-1)


def mirrored(plan: Plan, rng: np.random.Generator) -> Plan:
    """Half of the time the plan with x → -x; a panel's first edge stays its first, and the turning sense is mended."""
    if rng.integers(2):
        return plan
    flip = np.array([-1.0, 1.0, 1.0])
    panels = [
        replace(
            panel,
            corners_world=flip * np.roll(panel.corners_world[::-1], 2, axis=0),
            arc=None if panel.arc is None else panel.arc.mirrored(),
        )
        for panel in plan.panels
    ]
    regions = [
        shapely.transform(region, lambda points: points * (-1.0, 1.0))
        for region in (plan.upright, plan.clear, plan.low_only)
    ]
    return Plan(tuple(panels), flip * plan.lamps_world, plan.height_m, flip[:2] * plan.focus, *regions)
