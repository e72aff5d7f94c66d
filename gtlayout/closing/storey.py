"""What closing a room starts from: its plan, and which instances bound it how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import LineString, MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.closing.ends import with_ends
from gtlayout.closing.free_space import Sight, free_space, inner
from gtlayout.closing.low_walls import low_walls
from gtlayout.closing.plan import Plan
from gtlayout.closing.rooms import rooms
from gtlayout.closing.walls import Wall, spans_of, stands, wall_of
from gtlayout.closing_config import ClosingConfig
from gtlayout.instances import Plane
from gtlayout.layout import Layout


@dataclass(frozen=True)
class Level:
    """A room in plan at the height of one of its surfaces."""

    walls: dict[int, Wall]
    stands: dict[int, list[LineString]]
    """Where each wall stands: seen, or continued."""
    rooms: tuple[MultiPolygon, ...]


@dataclass(frozen=True)
class Storey:
    """The instances that bound rooms, and what is seen of them."""

    layout: Layout
    plan: Plan
    floors: tuple[int, ...]
    uppers: tuple[int, ...]
    """Ceilings and slanted surfaces."""
    walls: dict[int, Wall]
    """At the height of the cameras, with the corners that nobody saw; without low ones, which bound no room."""
    sights: tuple[Sight, ...]
    same: float
    """Nearer than this is the same place, world unit."""
    reach: float
    """Nothing is further away, world unit."""
    grid: float
    config: ClosingConfig

    @classmethod
    def of(
        cls,
        layout: Layout,
        plan: Plan,
        shown: tuple[int, ...],
        sights: tuple[Sight, ...],
        against: Mapping[int, BaseGeometry],
        eyes_height: float,
        depth: float,
        grid: float,
        config: ClosingConfig,
    ) -> Storey:
        """Of the instances ``shown``, seen from a height over the plan, at a median ``depth``.

        ``against`` is the part of each one's plane, in its frame, where a key frame shows something else.
        """
        tilt = {i: float(layout.planes[i].normal @ plan.up) for i in shown}
        label = {i: layout.instances[i].label for i in shown}
        upright = np.sin(np.deg2rad(config.max_tilt_deg))
        floors = tuple(i for i in shown if label[i] == "floor" and tilt[i] > upright)
        uppers = tuple(i for i in shown if label[i] in {"ceiling", "slanted"} and tilt[i] < -upright)
        level = Plane(plan.up, -float(plan.up @ plan.frame.origin) - eyes_height, np.zeros((4, 4)), observable=True)
        same = config.same_place * depth
        walls = {}
        for i in shown:
            if label[i] == "wall" and abs(tilt[i]) <= upright:
                bare = wall_of(plan, layout.planes[i], level)
                rings = [ring for sight in sights if sight.index == i for ring in sight.rings]
                if rings:
                    walls[i] = replace(bare, spans=spans_of(bare, rings, 2 * same))
        low = low_walls(layout, plan, walls, against, eyes_height, depth, config)
        walls = {i: wall for i, wall in walls.items() if i not in low}
        free = inner(free_space(sights, walls, grid), same)
        walls = with_ends(walls, free, [sight.eye for sight in sights], same, config)
        corners = np.concatenate([plan.frame.to_plane(_corners(layout, i)) for i in shown])
        reach = 2 * float(np.linalg.norm(np.ptp(corners, axis=0))) + depth
        return cls(layout, plan, floors, uppers, walls, sights, same, reach, grid, config)

    def seen(self, index: int) -> MultiPolygon:
        """What is seen of a floor or an upper surface, in plan."""
        extent = self.layout.extents[index]
        region: MultiPolygon = shapely.transform(
            extent.region, lambda uv: self.plan.frame.to_plane(extent.frame.to_world(uv))
        )
        return region

    def level(self, index: int) -> Level:
        """The room at the height of a floor or an upper surface."""
        surface, planes = self.layout.planes[index], self.layout.planes
        walls = {i: wall_of(self.plan, planes[i], surface, one.spans, one.ends) for i, one in self.walls.items()}
        free = free_space(self.sights, walls, self.grid)
        standing = stands(walls, inner(free, self.same), self.same)
        return Level(walls, standing, rooms(free, walls, standing, self.same, self.grid))


def _corners(layout: Layout, index: int) -> np.typing.NDArray[np.float64]:
    extent = layout.extents[index]
    return extent.frame.to_world(shapely.get_coordinates(extent.region))
