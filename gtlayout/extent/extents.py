"""Stage 5: the finite part of its plane that each instance covers (paper 3.4)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from shapely import MultiPolygon

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
    sought = [i for i in range(len(instances)) if i not in known]
    unrefined = dict(drawn_before)
    cut = [i for i in sought if i not in drawn_before]
    steps = len(cut) + len(sought)
    progress(0, steps)
    for done, i in enumerate(cut, start=1):
        region = MultiPolygon()
        if i in strips:
            on_strip = faces_on(scene, instances, i, planes, strips[i], max_depth, grid, config)
            region = tidy(on_strip.agreed(), grid, config)
            unrefined[i] = Extent(strips[i], region, region)
            progress(done, steps)
            continue
        if planes[i].observable:
            faces = faces_of(scene, instances, i, planes, frames[i], max_depth, grid, config)
            region = tidy(faces.agreed(), grid, config)
        cameras = [scene.frame_of(k).camera for k, _ in instances[i].members]
        known_of_it = ended(region, planes[i], frames[i], cameras, grid, config)
        unrefined[i] = Extent(frames[i], known_of_it, known_of_it, max(region.area - known_of_it.area, 0.0))
        progress(done, steps)
    touching = unproject_edges(scene, instances, planes, frames, edges, max_depth, config, sought)
    flat_offsets = {pair: by for pair, by in (contact_offsets or {}).items() if not strips.keys() & set(pair)}
    shifts = shifts_on_planes(scene, planes, frames, edges, flat_offsets)
    found = dict(known)
    # Floors and ceilings end where the curved walls do, which are looked for before them.
    for done, i in enumerate(sorted(sought, key=lambda i: i not in strips), start=len(cut) + 1):
        of_it = {j: contact for (k, j), contact in touching.items() if k == i}
        levels = [j for j in of_it if j in strips and instances[i].label in LEVELS]
        neighbours = []
        for j, contact in of_it.items():
            if j in levels or (i in strips and (j in strips or instances[j].label == "slanted")):
                continue
            plane = planes[j]
            if j in strips:
                if (j, i) not in touching:
                    continue
                plane = tangent_plane(strips[j], planes[i], touching[j, i])
            neighbours.append(Neighbour(plane, contact, shifts.get((i, j), 0.0)))
        region = tidy(refine(unrefined[i].unrefined, frames[i], neighbours, grid, config), grid, config)
        for j in levels:
            low, _, high, _ = found[j].region.bounds or (0.0,) * 4
            if low < high:
                arguments = frames[i], planes[i], strips[j], (low, high), of_it[j], grid, config
                region = tidy(up_to_arc(region, *arguments), grid, config)
        found[i] = replace(unrefined[i], region=bordered(region, strips[i]) if i in strips else region)
        progress(done, steps)
    return tuple(found[i] for i in range(len(instances)))


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
