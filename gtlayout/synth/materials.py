"""Materials of synthetic rooms: the texture of each panel of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import Polygon

from gtlayout.geometry.polygons import polygons
from gtlayout.scene import OPENINGS
from gtlayout.synth import textures
from gtlayout.synth.arcs import strip_of, whole_texture
from gtlayout.synth.plans import Panel, Plan
from gtlayout.synth.surfaces import Box, Surface, lamp_light, make_surface
from gtlayout.synth.textures import Painter, Texture, faded

_POSTERS = 2
"""Number of posters on a wall, if there is room."""
_POSTER_TRIES = 12
"""Number of places tried for each."""


def paint_plan(plan: Plan, boxes: Sequence[Box], texture: float, rng: np.random.Generator) -> list[Surface]:
    """The building's surfaces in the plan's order.

    Neighbouring walls have different papers, rooms different floors; ``texture`` is the contrast of all but doors and
    windows, see ``faded``.
    """
    lights = [lamp_light(lamp, boxes) for lamp in plan.lamps_world]
    papers = rng.permutation(len(textures.WALL_PAINTERS))
    first_floor = int(rng.integers(len(textures.FLOOR_PAINTERS)))
    surfaces = []
    walls = 0
    rolled_out: dict[str, Texture] = {}
    for panel in plan.panels:
        paint: Painter
        match panel.label:
            case "door":
                paint = textures.door
            case "window":
                paint = textures.window
            case "floor":
                paint = textures.FLOOR_PAINTERS[(first_floor + panel.room) % len(textures.FLOOR_PAINTERS)]
            case "slanted":
                paint = textures.SLANTED_PAINTER
            case "wall" | None if panel.arc is not None:
                wall = panel.part_of or panel.name
                if panel.part_of is None:
                    paper = faded(textures.WALL_PAINTERS[papers[walls % len(papers)]], texture)
                    rolled_out[wall] = whole_texture(paper, panel.arc, float(np.ptp(panel.corners_world[:, 2])), rng)
                    walls += 1
                paint = strip_of(rolled_out[wall], panel.arc.from_left_m(panel.corners_world[0, :2]))
            case "wall":
                paper = textures.WALL_PAINTERS[papers[walls % len(papers)]]
                paint = textures.with_pictures(paper, _posters(panel, plan.panels, rng))
                walls += 1
            case _:
                paint = textures.CEILING_PAINTER
        if panel.label not in OPENINGS and panel.arc is None:
            paint = faded(paint, texture)
        made = make_surface(panel.name, panel.label, panel.corners_world, paint, lights[panel.room], rng)
        surfaces.append(replace(made, arc=panel.arc, part_of=panel.part_of))
    return surfaces


def _posters(
    wall: Panel, panels: Sequence[Panel], rng: np.random.Generator
) -> tuple[tuple[float, float, float, float], ...]:
    """(u, v, width, height) of posters at eye height, clear of each other, of doors and windows, and of wall ends."""
    corners_uv = wall.frame.to_plane(wall.corners_world)
    free = polygons(Polygon(corners_uv).buffer(-0.1, join_style="mitre"))
    for panel in panels:
        if panel.label in OPENINGS and np.abs((panel.corners_world - wall.corners_world[0]) @ wall.normal).max() < 1e-6:
            taken = Polygon(wall.frame.to_plane(panel.corners_world)).buffer(0.1, join_style="mitre")
            free = polygons(free - taken)
    left = float(corners_uv[:, 0].min())
    found: list[tuple[float, float, float, float]] = []
    for _ in range(_POSTER_TRIES):
        width, height = rng.uniform((0.4, 0.4), (0.7, 0.7))
        u, v = rng.uniform((0, 1.15), (wall.width_m, 1.4))
        poster = shapely.box(left + u, v, left + u + width, v + height)
        if free.covers(poster) and len(found) < _POSTERS:
            found.append((float(u), float(v), float(width), float(height)))
            free = polygons(free - poster.buffer(0.15))
    return tuple(found)
