"""Which planes and extents another drawing of a scene leaves as they were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from gtlayout.edges import ContactEdge
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.layout import Layout
from gtlayout.planes.estimate import Estimate
from gtlayout.prediction.predict import Prediction, predict
from gtlayout.scene import OPENINGS, SAME_BORDER_PX, Camera, FloatArray
from gtlayout.session.redrawing import Redrawing

_STILL_SIGMAS = 0.2
"""A plane that moved by less than so many σ, anywhere on its extent, counts as unmoved: nobody could tell."""


def with_still_planes(
    solved: Estimate, before: FloatArray, corners: Sequence[FloatArray]
) -> tuple[Estimate, tuple[bool, ...]]:
    """The estimate with planes that hardly moved where they were, and which these are.

    Args:
        solved: Of S instances.
        before: (S, 4) their planes before, in the same world; NaN = there was none.
        corners: (S,) the (N, 3) corners of their extents before.
    """
    planes, still = [], []
    for plane, old, points in zip(solved.planes, before, corners, strict=True):
        unmoved = _is_still(plane, old, points)
        still.append(unmoved)
        planes.append(replace(plane, normal=old[:3], d=float(old[3])) if unmoved else plane)
    return replace(solved, planes=tuple(planes)), tuple(still)


def _is_still(plane: Plane, old: FloatArray, points: FloatArray) -> bool:
    """Whether a plane moved by less than anybody could tell at (N, 3) points on it before, (4,) ``old``."""
    if not plane.observable or np.isnan(old).any() or len(points) == 0:
        return False
    moved = np.abs(points @ plane.normal + plane.d)
    return bool((moved <= _STILL_SIGMAS * plane.sigma_offset(points)).all())


@dataclass(frozen=True)
class Change:
    """Another drawing of a solved scene: instances, edges and planes that did not move."""

    redrawing: Redrawing
    layout: Layout
    """Before."""
    edges_before: tuple[ContactEdge, ...]
    instances: tuple[Instance, ...]
    """Now, in canonical numbers of elements."""
    edges: tuple[ContactEdge, ...]
    origin: tuple[int | None, ...]
    """Of each instance its index before."""
    still: tuple[bool, ...]
    cameras: Sequence[Camera]
    """(K,) of the key frames, in the world of the layout."""

    def kept_extents(self) -> tuple[dict[int, Extent], dict[int, Extent]]:
        """The extents that stay, by the index of the instance now, and those of which only neighbours changed."""
        away = {i for i, still in enumerate(self.still) if not still}
        redrawn = away | self._redrawn_instances() | self._where_drawing_changed()
        beside = {i for edge in self.edges for i in edge.instances if set(edge.instances) & away}
        beside |= self._with_other_contacts()
        hosts = {host for i in redrawn | beside if i >= 0 and (host := self.instances[i].host) is not None}
        moved = redrawn | beside | hosts
        before = {i: self.layout.extents[o] for i, o in enumerate(self.origin) if o is not None and i not in redrawn}
        stay = {i: extent for i, extent in before.items() if i not in moved}
        return stay, {i: extent for i, extent in before.items() if i in moved}

    def _redrawn_instances(self) -> set[int]:
        """Those with an element that is drawn otherwise, and those that lost one. A new key frame is no such change."""
        known_frames = self.redrawing.key_frame_before
        moved = set()
        for i, (instance, origin) in enumerate(zip(self.instances, self.origin, strict=True)):
            here = [member for member in instance.members if member[0] in known_frames]
            lost = origin is not None and len(here) < len(self.layout.instances[origin].members)
            if origin is None or lost or not all(self.redrawing.same_outline(member) for member in here):
                moved.add(i)
        return moved

    def _with_other_contacts(self) -> set[int]:
        """Those that touch others, or elsewhere, in key frames that were there."""
        now_of = {before: now for now, before in self.redrawing.key_frame_before.items()}
        number = {origin: i for i, origin in enumerate(self.origin) if origin is not None}
        before = {
            (now_of[edge.key_frame], *sorted(number.get(i, -1) for i in edge.instances)): edge.points_px
            for edge in self.edges_before
            if edge.key_frame in now_of
        }
        now = {
            (edge.key_frame, *sorted(edge.instances)): edge.points_px
            for edge in self.edges
            if edge.key_frame in self.redrawing.key_frame_before
        }
        changed = [key for key in before.keys() | now.keys() if not _same(before.get(key), now.get(key))]
        return {i for _, *pair in changed for i in pair}

    def _where_drawing_changed(self) -> set[int]:
        """Those whose extent before is seen where a key frame now shows something else."""
        moved: set[int] = set()
        for k, camera in enumerate(self.cameras):
            before = self.redrawing.key_frame_before.get(k)
            areas = None if before is None else self._differences(k, before)
            if areas is not None and not areas:
                continue
            seen = predict(self.layout.planes, self.layout.extents, self.layout.instances, camera)
            if areas is None:
                own, areas = self._news(k, seen, camera)
                moved |= own
            changed = shapely.union_all(areas)
            for i, origin in enumerate(self.origin):
                if origin is not None and shapely.intersects(seen.amodal[origin], changed):
                    moved.add(i)
        return moved

    def _differences(self, k: int, before: int) -> list[BaseGeometry]:
        """Where a key frame that was there shows something else."""
        redrawing = self.redrawing
        areas: list[BaseGeometry] = []
        gone = {(before, e) for e in range(len(redrawing.before.key_frames[before].elements))}
        for e, element in enumerate(redrawing.scene.key_frames[k].elements):
            was = redrawing.was.get((k, e))
            if was is not None and redrawing.same_surface((k, e)):
                gone.discard(was)
            if not redrawing.same_outline((k, e)):
                known = was is not None and redrawing.same_surface((k, e))
                outline = redrawing.element_before(was).amodal if was is not None and known else MultiPolygon()
                areas.append(element.amodal.symmetric_difference(outline))
        return [*areas, *(redrawing.element_before(member).amodal for member in sorted(gone))]

    def _news(self, k: int, seen: Prediction, camera: Camera) -> tuple[set[int], list[BaseGeometry]]:
        """Where a new key frame shows something else than what is predicted, and the instances that it shows there."""
        elements = self.redrawing.scene.key_frames[k].elements
        openings = shapely.union_all([element.amodal for element in elements if element.label in OPENINGS])
        moved, areas = set(), []
        thin = SAME_BORDER_PX / 2 * camera.annotation_scale
        for i, (instance, origin) in enumerate(zip(self.instances, self.origin, strict=True)):
            for e in (e for number, e in instance.members if number == k):
                drawn = elements[e].amodal
                drawn = drawn if instance.label in OPENINGS else drawn.difference(openings)
                expected = MultiPolygon() if origin is None else seen.visible[origin]
                news = drawn.symmetric_difference(expected).buffer(-thin)
                if not news.is_empty:
                    moved.add(i)
                    areas.append(news.buffer(thin))
        return moved, areas


def _same(before: FloatArray | None, now: FloatArray | None) -> bool:
    return before is not None and now is not None and np.array_equal(before, now)
