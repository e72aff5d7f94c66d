"""A scene solved again after a change of its drawings, with the tracks of the first solve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from gtlayout.correspondence.matching import correspond
from gtlayout.edges import contact_edges
from gtlayout.method import lay_out, regrouped
from gtlayout.observer import Stages
from gtlayout.prepared.canonical import Canonical, canonical
from gtlayout.prepared.measurements import Prepared
from gtlayout.scene import IntArray, KeyFrame, Scene
from gtlayout.solution import Solution
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate


def solve_again(solution: Solution, scene: Scene) -> Solution:
    """Solve ``scene``, the scene of ``solution`` with other drawings on the same frames.

    Points that would not have been sampled with these drawings are left out, and none is added. So an element that
    is drawn somewhere else has those points of all elements that lie in its visible part.
    """
    config, stage = solution.config, Stages()
    tracks = _on_drawings(solution.tracks, solution.scene, scene)
    form = canonical(replace(scene, warnings=()))
    tracks = _in_form(tracks, form)
    rays = triangulate(form.scene, tracks, config.triangulation)
    instances, track_instance = correspond(form.scene, tracks, rays, config.correspondence)
    edges = contact_edges(form.scene, instances, config.edges)
    prepared = Prepared(form.scene, tracks, rays, instances, track_instance, edges, form)
    prepared, solved = regrouped(prepared, config, stage)
    return lay_out(prepared, solved, config, stage)


def _on_drawings(tracks: Tracks, before: Scene, after: Scene) -> Tracks:
    """The tracks by the element that their point lies on in its key frame, without those that lie on none."""
    element = np.full(len(tracks), -1)
    tried = []
    for k, (old, new) in enumerate(zip(before.key_frames, after.key_frames, strict=True)):
        own = tracks.key_frame == k
        if old is new:
            element[own] = tracks.element[own]
            tried.append(tracks.tried[k])
            continue
        element[own] = _elements_at(tracks, np.nonzero(own)[0], old, new)
        of_name = {one.id: int(count) for one, count in zip(old.elements, tracks.tried[k], strict=True)}
        tried.append(np.array([of_name.get(one.id, 0) for one in new.elements], dtype=np.int64))
    return replace(tracks, element=element, tried=tuple(tried)).only(element >= 0)


def _elements_at(tracks: Tracks, index: IntArray, old: KeyFrame, new: KeyFrame) -> IntArray:
    """(n,) the element of the new drawing that each track lies on: its own, if it still does; -1 = none."""
    names = [one.id for one in new.elements]
    regions = [one.amodal if one.visible.is_empty else one.visible for one in new.elements]
    at_key = tracks.frame == old.frame
    where = dict(zip(tracks.track[at_key].tolist(), tracks.points_px[at_key], strict=True))
    found = np.full(len(index), -1)
    for number, t in enumerate(index.tolist()):
        point = shapely.Point(where[t])
        name = old.elements[tracks.element[t]].id
        own = names.index(name) if name in names else None
        hit = [e for e, region in enumerate(regions) if region.intersects(point)]
        found[number] = own if own in hit else hit[0] if hit else -1
    return found


def _in_form(tracks: Tracks, form: Canonical) -> Tracks:
    """The inverse of ``Canonical.given_tracks``."""
    orders = [np.argsort(np.array(order, dtype=np.int64)) for order in form.elements]
    element = np.array([orders[k][e] for k, e in zip(tracks.key_frame, tracks.element, strict=True)], dtype=np.int64)
    return replace(
        tracks,
        element=element,
        frame=np.searchsorted(np.unique(form.same_camera_as), tracks.frame),
        tried=tuple(
            tried[np.array(order, dtype=np.int64)] for tried, order in zip(tracks.tried, form.elements, strict=True)
        ),
    )
