"""Furniture of synthetic rooms: pieces made of boxes, put where they fit (metres, z up)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from gtlayout.geometry.polygons import polygons
from gtlayout.scene import FloatArray
from gtlayout.synth import textures
from gtlayout.synth.plans import Plan
from gtlayout.synth.surfaces import Box

LOW_M = 1.0
"""Cameras are held higher than furniture that reaches up to here."""
_GAP_M = 0.06
"""Between furniture and walls or other furniture."""
_TRIES = 300
"""After so many places that do not fit, a piece is left out."""


@dataclass(frozen=True)
class Piece:
    """A piece of furniture at the origin: its back along x >= 0, y into the room."""

    boxes: tuple[Box, ...]
    size: FloatArray
    """(3,)"""

    def moved(self, to_xy: FloatArray, yaw_rad: float) -> list[Box]:
        """Its boxes, turned about the origin and moved to ``to_xy`` (2,)."""
        turn = np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])
        return [
            replace(box, centre=np.append(to_xy + turn @ box.centre[:2], box.centre[2]), yaw_rad=box.yaw_rad + yaw_rad)
            for box in self.boxes
        ]


Maker = Callable[[np.random.Generator], Piece]


def furnish(plan: Plan, rng: np.random.Generator) -> list[Box]:
    """Boxes in both rooms: along the walls, and a table before the focus. No two overlap, nothing leaves its room."""
    boxes: list[Box] = []
    for room, makers in enumerate(_MAIN_AND_SECOND[: len(plan.lamps_world)]):
        floor = plan.floor(room)
        # Outlines that coincide but for the last bit leave lines beside polygons: a collection, which covers nothing.
        free = polygons(floor - plan.clear)
        if room == 0:
            table = _table(rng)
            spot = plan.focus + rng.uniform(-0.25, 0.25, 2)
            yaw = float(rng.uniform(-np.pi, np.pi))
            placed = _beside(table, spot, yaw)
            if free.covers(placed):
                boxes += table.moved(spot, yaw)
                free = polygons(free - placed.buffer(0.5))
        for make in makers:
            piece = make(rng)
            tall = piece.size[2] > LOW_M
            allowed = polygons(polygons(free - plan.low_only) & (plan.upright if tall and room == 0 else floor))
            found = _place(piece, floor, allowed, rng)
            if found is not None:
                spot, yaw = found
                boxes += piece.moved(spot, yaw)
                free = polygons(free - _beside(piece, spot, yaw))
    return boxes


def _place(
    piece: Piece, floor: Polygon, allowed: MultiPolygon, rng: np.random.Generator
) -> tuple[FloatArray, float] | None:
    """Where a piece may stand with its back to a wall: (2,) x, y and yaw; None when no place was found."""
    corners = shapely.get_coordinates(shapely.orient_polygons(floor).exterior)
    sides = np.diff(corners, axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    for _ in range(_TRIES):
        side = int(rng.choice(len(sides), p=lengths / lengths.sum()))
        along = sides[side] / lengths[side]
        inwards = np.array([-along[1], along[0]])
        at = corners[side] + rng.uniform(0, lengths[side]) * along + _GAP_M * inwards
        yaw = float(np.arctan2(along[1], along[0]))
        if allowed.covers(_beside(piece, at, yaw)):
            return at, yaw
    return None


def _beside(piece: Piece, at: FloatArray, yaw: float) -> Polygon:
    """The piece's place on the floor, with half a gap around it."""
    low, high = -_GAP_M / 2, piece.size[:2] + _GAP_M / 2
    corners = np.array([(low, low), (high[0], low), (high[0], high[1]), (low, high[1])])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return Polygon(at + corners @ turn.T)


def _piece(*parts: tuple[tuple[float, float, float], tuple[float, float, float], textures.Painter]) -> Piece:
    """From (low corner, size, painter) of each box."""
    boxes = tuple(Box(np.array(low) + np.array(size) / 2, np.array(size), 0.0, paint) for low, size, paint in parts)
    high = np.max([np.array(low) + np.array(size) for low, size, _ in parts], axis=0)
    return Piece(boxes, high)


def _cupboard(rng: np.random.Generator) -> Piece:
    size = float(rng.uniform(0.9, 1.2)), 0.45, float(rng.uniform(1.5, 1.95))
    return _piece(((0.0, 0.0, 0.0), size, textures.CABINET_PAINTER))


def _bookshelf(rng: np.random.Generator) -> Piece:
    size = float(rng.uniform(0.6, 0.9)), 0.3, float(rng.uniform(1.1, 1.9))
    return _piece(((0.0, 0.0, 0.0), size, textures.BOOKS_PAINTER))


def _sideboard(rng: np.random.Generator) -> Piece:
    size = float(rng.uniform(0.9, 1.4)), 0.4, float(rng.uniform(0.6, 0.85))
    return _piece(((0.0, 0.0, 0.0), size, textures.WOOD_PAINTER))


def _sofa(rng: np.random.Generator) -> Piece:
    width, fabric = float(rng.uniform(1.3, 1.6)), textures.FABRIC_PAINTER
    return _piece(
        ((0.15, 0.2, 0.0), (width, 0.7, 0.42), fabric),
        ((0.15, 0.0, 0.0), (width, 0.2, 0.85), fabric),
        ((0.0, 0.0, 0.0), (0.15, 0.9, 0.6), fabric),
        ((0.15 + width, 0.0, 0.0), (0.15, 0.9, 0.6), fabric),
    )


def _armchair(rng: np.random.Generator) -> Piece:
    fabric = textures.FABRIC_PAINTER
    return _piece(
        ((0.1, 0.15, 0.0), (0.55, 0.6, 0.42), fabric),
        ((0.1, 0.0, 0.0), (0.55, 0.15, float(rng.uniform(0.75, 0.95))), fabric),
        ((0.0, 0.0, 0.0), (0.1, 0.75, 0.6), fabric),
        ((0.65, 0.0, 0.0), (0.1, 0.75, 0.6), fabric),
    )


def _table(rng: np.random.Generator) -> Piece:
    wood, height = textures.WOOD_PAINTER, float(rng.uniform(0.42, 0.55))
    legs = [((x, y, 0.0), (0.06, 0.06, height), wood) for x in (0.02, 0.82) for y in (0.02, 0.52)]
    return _piece(((0.0, 0.0, height), (0.9, 0.6, 0.05), wood), *legs)


_MAIN_AND_SECOND: tuple[tuple[Maker, ...], ...] = (
    (_sofa, _cupboard, _bookshelf, _sideboard, _armchair),
    (_sideboard, _armchair),
)
