"""Plans of synthetic rooms with a round wall: a bay, and a round corner (metres, z up)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from shapely import Point

from gtlayout.scene import FloatArray
from gtlayout.synth.arcs import Arc
from gtlayout.synth.plans import (
    LAMP_M,
    Panel,
    Plan,
    at_height,
    before,
    centred,
    door_size,
    mirrored,
    near_end,
    plan_of,
    window_size,
)

Side = FloatArray | Arc
"""Where a straight wall begins, (2,), or a round one."""


def bay(rng: np.random.Generator) -> Plan:
    """A box whose far wall opens into a half round bay as high as the room: five flat walls and a round one."""
    width, length, height = rng.uniform((4.2, 4.4, 2.4), (5.2, 5.2, 2.8))
    radius = float(rng.uniform(0.9, 1.3))
    middle = np.array([width * rng.uniform(0.42, 0.58), length])
    sides: list[Side] = [np.array([0.0, 0.0]), np.array([width, 0.0]), np.array([width, length])]
    sides += [Arc(middle, radius, 0.0, np.pi), middle - (radius, 0.0), np.array([0.0, length])]
    panels = round_shell(sides, height)
    right, left = panels_named(panels, "wall_1"), panels_named(panels, "wall_5")
    door = centred("door_0", "door", left, rng.uniform(0.35, 0.6), door_size(rng))
    window = centred("window_0", "window", right, rng.uniform(0.4, 0.6), window_size(rng), 0.95)
    lamps = [(width / 2, 0.5 * length, height - LAMP_M)]
    kept = [near_end(width, 0.33 * length), before(door), Point(middle).buffer(radius + 0.3)]
    focus = (middle[0], 0.75 * length)
    return mirrored(plan_of([*panels, door, window], lamps, height, focus, kept, [window]), rng)


def round_corner(rng: np.random.Generator) -> Plan:
    """A box whose far right corner is a quarter of a circle that runs into both walls without an edge."""
    width, length, height = rng.uniform((4.2, 4.4, 2.4), (5.2, 5.2, 2.8))
    radius = float(rng.uniform(1.0, 1.8))
    sides: list[Side] = [np.array([0.0, 0.0]), np.array([width, 0.0])]
    sides += [Arc(np.array([width, length]) - radius, radius, 0.0, np.pi / 2), np.array([width - radius, length])]
    sides += [np.array([0.0, length])]
    panels = round_shell(sides, height)
    far, left = panels_named(panels, "wall_3"), panels_named(panels, "wall_4")
    door = centred("door_0", "door", left, rng.uniform(0.35, 0.6), door_size(rng))
    window = centred("window_0", "window", far, rng.uniform(0.4, 0.6), window_size(rng), 0.95)
    lamps = [(width / 2, 0.5 * length, height - LAMP_M)]
    kept = [near_end(width, 0.33 * length), before(door)]
    focus = (0.6 * width, 0.6 * length)
    return mirrored(plan_of([*panels, door, window], lamps, height, focus, kept, [window]), rng)


def round_shell(sides: Sequence[Side], height_m: float) -> list[Panel]:
    """Floor, ceiling and a wall for each side of a counter-clockwise footprint; a round one is many facets.

    Its first facet has its label, the others are part of that.
    """
    runs = [side.points_xy() if isinstance(side, Arc) else side[None] for side in sides]
    outline = np.concatenate([run[:-1] if isinstance(s, Arc) else run for run, s in zip(runs, sides, strict=True)])
    panels = [
        Panel("floor", "floor", at_height(outline, 0.0)),
        Panel("ceiling", "ceiling", at_height(outline, height_m)[::-1]),
    ]
    for number, (side, run) in enumerate(zip(sides, runs, strict=True)):
        name, following = f"wall_{number}", runs[(number + 1) % len(runs)][:1]
        arc = side if isinstance(side, Arc) else None
        ends = run if arc is not None else np.concatenate([run, following])
        for facet, (start, end) in enumerate(pairwise(ends)):
            low, high = at_height(np.stack([end, start]), 0.0), at_height(np.stack([start, end]), height_m)
            corners = np.concatenate([low, high])
            if facet == 0:
                panels.append(Panel(name, "wall", corners, arc=arc))
            else:
                panels.append(Panel(f"{name}_facet_{facet}", None, corners, arc=arc, part_of=name))
    return panels


def panels_named(panels: Sequence[Panel], name: str) -> Panel:
    """The panel of that name."""
    return next(panel for panel in panels if panel.name == name)
