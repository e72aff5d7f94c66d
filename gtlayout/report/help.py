"""What would help a plane most: redraw an edge, draw another key frame, or measure by tape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from gtlayout.figures import figure, percent
from gtlayout.geometry.rays import depth_on_plane
from gtlayout.layout import Layout
from gtlayout.quality.assess import Quality
from gtlayout.quality.config import QualityConfig
from gtlayout.results.evidence import EdgeSeen, EvidenceSeen
from gtlayout.scene import FloatArray, IntArray, Scene

TAPE_SIGMA_M = 0.003
"""Of a length measured by hand."""
_TAPE_HELPS = 0.7
"""A tape measure is proposed where σ falls below this share."""
_MORE_DEG = 4.0
"""Another key frame is proposed from where a plane is seen under such an angle to all that show it already."""
_GRAZING = 0.17
"""Sine of the angle under which a plane is hardly seen."""
_TRIED = 5
"""Frames that are looked at, because another plane may hide this one."""


@dataclass(frozen=True)
class Viewpoints:
    """The cameras of all frames, as arrays."""

    center: FloatArray
    """(F, 3) world."""
    projection: FloatArray
    """(F, 3, 4) world to pixels."""
    size: IntArray
    """(F, 2) width and height."""

    @classmethod
    def of(cls, scene: Scene) -> Viewpoints:
        """Of every frame of the video."""
        cameras = [frame.camera for frame in scene.frames]
        return cls(
            np.array([camera.center_world for camera in cameras]),
            np.array(
                [camera.K @ np.column_stack([camera.R_cam_from_world, camera.t_cam_from_world]) for camera in cameras]
            ),
            np.array([[camera.width, camera.height] for camera in cameras]),
        )


def helps(scene: Scene, layout: Layout, quality: Quality, seen: EvidenceSeen, i: int, views: Viewpoints) -> list[str]:
    """What to do for instance ``i``, in this order: what contradicts, what is missing, what a tape measure would do.

    Empty where its evidence agrees and it is known well enough.
    """
    found = [*_redrawn(scene, layout, seen, i)]
    if quality.instances[i].verdict != "ok":
        found += [one for one in (_another_frame(scene, layout, seen, i, views), _by_tape(layout, seen, i)) if one]
    return found


def worst_edge(scene: Scene, seen: EvidenceSeen, i: int) -> EdgeSeen | None:
    """The contact edge of an instance that lies farthest from where its planes meet, if that is suspiciously far."""
    most_px = QualityConfig().disagreeing_edge_px
    own = [edge for edge in seen.edges if i in edge.instances and edge.used]
    far = [edge for edge in own if edge.misfit_px > most_px * scene.frame_of(edge.key_frame).camera.annotation_scale]
    return max(far, key=lambda edge: edge.misfit_px, default=None)


def _redrawn(scene: Scene, layout: Layout, seen: EvidenceSeen, i: int) -> list[str]:
    found, name = [], layout.instances[i].name
    if edge := worst_edge(scene, seen, i):
        other = layout.instances[edge.instances[0] if edge.instances[1] == i else edge.instances[1]].name
        found.append(
            f"Redraw the edge of {name} with {other} in {scene.frame_of(edge.key_frame).name}: it lies "
            f"{figure(edge.misfit_px, 0)} px from where the two planes meet. If they do not touch there, draw an "
            "occlusion edge."
        )
    support = layout.planes[i].support
    if support.outvoted > QualityConfig().disagreeing_share:
        found.append(
            f"Look at the visible parts of {name}: {percent(support.outvoted)} of the tracks on them lie off the plane."
        )
    return found


def _another_frame(scene: Scene, layout: Layout, seen: EvidenceSeen, i: int, views: Viewpoints) -> str | None:
    plane, middle, name = layout.planes[i], seen.trails[i].middle, layout.instances[i].name
    drawn = [scene.key_frames[k].frame for k, _ in layout.instances[i].members]
    if not np.isfinite(middle).all():
        return f"Draw {name} in more frames, with the instances that it meets: nothing places it yet."
    ray = views.center - middle
    ray /= np.maximum(np.linalg.norm(ray, axis=1), 1e-12)[:, None]
    angle_deg = np.rad2deg(np.arccos(np.clip(ray @ ray[drawn].T, -1, 1))).min(axis=1)
    px = views.projection @ np.append(middle, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = px[:, :2] / px[:, 2:]
    shown = (px[:, 2] > 0) & ((at > 0) & (at < views.size)).all(axis=1) & (ray @ plane.normal > _GRAZING)
    shown[[key_frame.frame for key_frame in scene.key_frames]] = False
    order = np.argsort(-np.where(shown, angle_deg, -1.0).round(3), kind="stable")[:_TRIED]
    for frame in order.tolist():
        if shown[frame] and angle_deg[frame] >= _MORE_DEG and not _hidden(layout, i, views.center[frame], middle):
            return (
                f"Draw {scene.frames[frame].name}, too: it shows {name} from "
                f"{figure(float(angle_deg[frame]), 0)}° farther aside than any drawing does."
            )
    return f"Film {name} again with more motion along it: no other frame shows it from farther aside."


def _hidden(layout: Layout, i: int, center: FloatArray, middle: FloatArray) -> bool:
    """Whether another instance lies between a camera and the middle of instance ``i``."""
    for j, (plane, extent) in enumerate(zip(layout.planes, layout.extents, strict=True)):
        if j == i or extent.region.is_empty or j == layout.instances[i].host or layout.instances[j].host == i:
            continue
        share = float(depth_on_plane(plane.normal @ center + plane.d, np.asarray((middle - center) @ plane.normal)))
        if 0 < share < 1 - _GRAZING:
            u, v = extent.frame.to_plane(center + share * (middle - center)[None])[0]
            if shapely.contains_xy(extent.region, u, v):
                return True
    return False


def _by_tape(layout: Layout, seen: EvidenceSeen, i: int) -> str | None:
    """The distance that would tell most: the other plane's σ and the tape's stay, as if the two were independent."""
    own = float(layout.planes[i].sigma_offset(seen.trails[i].middle))
    if not layout.metric or not np.isfinite(own):
        return None
    best = (np.inf, "")
    for one in layout.dimensions:
        if i in (one.first, one.second):
            j = one.second if one.first == i else one.first
            other = float(layout.planes[j].sigma_offset(one.ends_world[1 if one.second == j else 0]))
            left = own * np.hypot(other, TAPE_SIGMA_M) / np.sqrt(own**2 + other**2 + TAPE_SIGMA_M**2)
            best = min(best, (left, layout.instances[j].name))
    if not best[0] < _TAPE_HELPS * own:
        return None
    return (
        f"Measure from {layout.instances[i].name} to {best[1]} by tape: its σ would fall from "
        f"{figure(100 * own, 1)} to about {figure(100 * best[0], 1)} cm."
    )
