"""Stage 5: the finite part of its plane that each instance covers (paper 3.4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.edges import ContactEdge
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.consensus import faces_of, tidy
from gtlayout.extent.known_part import known_part
from gtlayout.extent.on_cylinder import faces_on, tangent_plane, up_to_arc
from gtlayout.extent.refine import Neighbour, refine, unproject_edges
from gtlayout.extent.shifts import shifts_on_planes
from gtlayout.geometry.depth import median_depth
from gtlayout.geometry.polygons import grid_for
from gtlayout.geometry.strip import StripFrame, bordered
from gtlayout.instances import ContactOffsets, Extent, Instance, Plane, PlaneFrame
from gtlayout.scene import Camera, Scene

LEVELS = frozenset({"floor", "ceiling"})
Touching = Mapping[tuple[int, int], BaseGeometry]
"""(instance, neighbour) → where they touch, on the instance's surface."""


def compute_extents(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    edges: Sequence[ContactEdge],
    config: ExtentConfig,
    contact_offsets: ContactOffsets | None = None,
    known: Mapping[int, Extent] | None = None,
    drawn_before: Mapping[int, Extent] | None = None,
    strips: Mapping[int, StripFrame] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[Extent, ...]:
    """Each instance's extent: what its unprojected elements agree on, by vote, refined to the planes it touches.

    Where ``contact_offsets`` say that the line drawn between two instances lies beside that in which their planes meet,
    both end where the cameras see the drawn one.

    A host (wall) also covers its doors and windows, which keep extents of their own. Unobservable
    planes get empty regions. An extent ends where the depth is unknown. Those that are ``known``, by the index of their
    instance, stay; ``drawn_before`` are only refined again. Walls that have ``strips`` are curved: they lie on these
    and not on their planes, whatever was known of them, and what touches them ends there. ``progress`` is called with
    (surfaces done, surfaces in all): each is first cut out, then refined.
    """
    strips = strips or {}
    known, drawn_before = (
        {i: one for i, one in (given or {}).items() if i not in strips and not isinstance(one.frame, StripFrame)}
        for given in (known, drawn_before)
    )
    depth = median_depth(scene, instances, planes)
    max_depth, grid = config.max_depth_ratio * depth, grid_for(depth)
    frames = [strips.get(i) or plane_frame(plane, scene) for i, plane in enumerate(planes)]
    room = _Room(scene, instances, planes, frames, strips, max_depth, grid, config)
    sought = [i for i in range(len(instances)) if i not in known]
    cut = [i for i in sought if i not in drawn_before]
    steps = len(cut) + len(sought)
    unrefined, found = dict(drawn_before), dict(known)
    progress(0, steps)
    for done, i in enumerate(cut, start=1):
        unrefined[i] = room.cut_out(i)
        progress(done, steps)
    touching = unproject_edges(scene, instances, planes, frames, edges, max_depth, config, sought)
    flat_offsets = {pair: by for pair, by in (contact_offsets or {}).items() if not strips.keys() & set(pair)}
    shifts = shifts_on_planes(scene, planes, frames, edges, flat_offsets)
    # Floors and ceilings end where the curved walls do, which are looked for before them.
    for done, i in enumerate(sorted(sought, key=lambda i: i not in strips), start=len(cut) + 1):
        neighbours = room.neighbours(i, touching, shifts)
        region = tidy(refine(unrefined[i].unrefined, frames[i], neighbours, grid, config), grid, config)
        region = room.up_to_arcs(region, i, touching, found)
        found[i] = replace(unrefined[i], region=bordered(region, strips[i]) if i in strips else region)
        progress(done, steps)
    return tuple(found[i] for i in range(len(instances)))


@dataclass(frozen=True)
class _Room:
    """What all surfaces of a room are cut out with."""

    scene: Scene
    instances: Sequence[Instance]
    planes: Sequence[Plane]
    frames: Sequence[PlaneFrame]
    strips: Mapping[int, StripFrame]
    max_depth: float
    grid: float
    config: ExtentConfig

    def cut_out(self, i: int) -> Extent:
        """An extent by the vote of its drawings alone."""
        if i in self.strips:
            strip = self.strips[i]
            on_strip = faces_on(
                self.scene, self.instances, i, self.planes, strip, self.max_depth, self.grid, self.config
            )
            region = tidy(on_strip.agreed(), self.grid, self.config)
            return Extent(strip, region, region)
        plane, frame, region = self.planes[i], self.frames[i], MultiPolygon()
        if plane.observable:
            faces = faces_of(self.scene, self.instances, i, self.planes, frame, self.max_depth, self.grid, self.config)
            region = tidy(faces.agreed(), self.grid, self.config)
        cameras = [self.scene.frame_of(k).camera for k, _ in self.instances[i].members]
        known_of_it = ended(region, plane, frame, cameras, self.grid, self.config)
        return Extent(frame, known_of_it, known_of_it, max(region.area - known_of_it.area, 0.0))

    def neighbours(self, i: int, touching: Touching, shifts: Mapping[tuple[int, int], float]) -> list[Neighbour]:
        """The planes at which an extent may end; of a curved wall that which touches it where they meet."""
        found = []
        for (k, j), contact in touching.items():
            plane = self.planes[j]
            if k != i or self._by_arc(i, j) or (i in self.strips and self.instances[j].label == "slanted"):
                continue
            if j in self.strips:
                if i in self.strips or (j, i) not in touching:
                    continue
                plane = tangent_plane(self.strips[j], self.planes[i], touching[j, i])
            found.append(Neighbour(plane, contact, shifts.get((i, j), 0.0)))
        return found

    def up_to_arcs(self, region: MultiPolygon, i: int, touching: Touching, found: Mapping[int, Extent]) -> MultiPolygon:
        """The region of a floor or ceiling up to the curved walls that stand on it, whose extents are ``found``."""
        for (k, j), contact in touching.items():
            if k == i and self._by_arc(i, j) and not found[j].region.is_empty:
                low, _, high, _ = found[j].region.bounds
                on_plane = up_to_arc(
                    region,
                    self.frames[i],
                    self.planes[i],
                    self.strips[j],
                    (low, high),
                    contact,
                    self.grid,
                    self.config,
                )
                region = tidy(on_plane, self.grid, self.config)
        return region

    def _by_arc(self, i: int, j: int) -> bool:
        return j in self.strips and self.instances[i].label in LEVELS


def extents_without(
    scene: Scene,
    instances: Sequence[Instance],
    planes: Sequence[Plane],
    key_frames: Sequence[int],
    config: ExtentConfig,
) -> tuple[tuple[Extent, ...], ...]:
    """For each of some key frames the extents as all other key frames see them, not refined.

    Instances that nothing else shows, and unobservable ones, get empty regions. The boundaries of all polygons are
    intersected once for all of them.
    """
    depth = median_depth(scene, instances, planes)
    max_depth, grid = config.max_depth_ratio * depth, grid_for(depth)
    by_instance = []
    for i, (plane, instance) in enumerate(zip(planes, instances, strict=True)):
        frame = plane_frame(plane, scene)
        regions = [MultiPolygon()] * len(key_frames)
        if plane.observable:
            faces = faces_of(scene, instances, i, planes, frame, max_depth, grid, config)
            for number, k in enumerate(key_frames):
                cameras = [scene.frame_of(other).camera for other, _ in instance.members if other != k]
                drawn = tidy(faces.agreed_without(k), grid, config)
                regions[number] = ended(drawn, plane, frame, cameras, grid, config)
        by_instance.append([Extent(frame, region, region) for region in regions])
    return tuple(zip(*by_instance, strict=True))


def ended(
    region: MultiPolygon, plane: Plane, frame: PlaneFrame, cameras: Sequence[Camera], grid: float, config: ExtentConfig
) -> MultiPolygon:
    """The part of the region whose depth is known; ``cameras`` are those it was drawn in."""
    known = known_part(region, plane, frame, cameras, config)
    return region if known is region else tidy(known, grid, config)


def plane_frame(plane: Plane, scene: Scene) -> PlaneFrame:
    """A frame whose origin lies opposite the cameras' mean position, so that coordinates stay small."""
    centre = np.mean([frame.camera.center_world for frame in scene.frames], axis=0)
    origin = centre - (plane.normal @ centre + plane.d) * plane.normal
    return PlaneFrame.across(plane.normal, origin)
