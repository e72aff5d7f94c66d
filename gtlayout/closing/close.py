"""What closes a room where nobody looked, from its solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.closing.contradicted import contradicted
from gtlayout.closing.covering import covering
from gtlayout.closing.free_space import sights
from gtlayout.closing.plan import Plan
from gtlayout.closing.standing import standing
from gtlayout.closing.storey import Storey
from gtlayout.closing_config import ClosingConfig
from gtlayout.errors import GtlayoutError
from gtlayout.export.floor_level import floor_frame
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.polygons import grid_for, polygons
from gtlayout.geometry.strip import strip_of
from gtlayout.instances import Extent
from gtlayout.solution import Solution


def close(solution: Solution, config: ClosingConfig | None = None) -> Solution:
    """The solution with ``layout.inferred``: for each instance what closes the room where nobody looked.

    It is a layer of its own, apart from the extents. Nothing else of the solution changes: quality, dimensions and mesh
    are those of what was seen. Doors, windows and curved walls are not continued. Where nothing tells which
    way is up, the room is not closed, and the scene's warnings say so.

    ``config`` is that of the solution's own when not given; the solution keeps it.
    """
    config = config or solution.config.closing
    solution = replace(solution, config=replace(solution.config, closing=config))
    scene, layout, extent_config = solution.scene, solution.layout, solution.config.extent
    shown = tuple(
        i
        for i, (instance, plane, extent) in enumerate(zip(layout.instances, layout.planes, layout.extents, strict=True))
        if instance.host is None and plane.observable and not extent.region.is_empty and strip_of(extent) is None
    )
    try:
        plan = Plan(floor_frame(scene, layout, shown)[0])
    except GtlayoutError as error:
        scene = replace(scene, warnings=(*scene.warnings, f"not closed: {error}"))
        nothing = tuple(Extent(extent.frame, MultiPolygon(), MultiPolygon()) for extent in layout.extents)
        return replace(solution, scene=scene, layout=replace(layout, inferred=nothing))
    depth = median_depth(scene, layout.instances, layout.planes)
    max_depth, grid = extent_config.max_depth_ratio * depth, grid_for(depth)
    eyes = np.mean([frame.camera.center_world for frame in scene.frames], axis=0)
    seen = sights(scene, plan, layout, shown, max_depth, config.gap * depth, extent_config)
    height = float((eyes - plan.frame.origin) @ plan.up)
    against = {
        i: contradicted(
            scene, layout.instances, layout.planes, i, layout.extents[i].frame, max_depth, extent_config, config
        )
        for i in shown
    }
    storey = Storey.of(layout, plan, shown, seen, against, height, depth, grid, config)
    levels = {i: storey.level(i) for i in (*storey.floors, *storey.uppers)}
    covered = {i: covering(storey, level, i) for i, level in levels.items()}
    whole = {i: plan.onto(layout.planes[i], layout.extents[i].frame, region) for i, region in covered.items()}
    whole |= {i: standing(storey, levels, i, covered) for i in storey.walls}
    inferred = []
    for i, extent in enumerate(layout.extents):
        region = MultiPolygon()
        if i in whole:
            taken = shapely.union_all([extent.region, against[i]])
            region = _wide(shapely.difference(whole[i], taken, grid_size=grid), config.min_width * depth)
        inferred.append(Extent(extent.frame, region, region))
    return replace(solution, layout=replace(layout, inferred=tuple(inferred)))


def _wide(region: shapely.Geometry, width: float) -> MultiPolygon:
    """The parts of a region that are at least so wide."""
    with np.errstate(divide="ignore", invalid="ignore"):  # GEOS, where corners all but coincide
        opened = region.buffer(-width / 2, join_style="mitre").buffer(width / 2, join_style="mitre")
    return polygons(opened.intersection(region))
