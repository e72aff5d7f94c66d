"""A scene while it is annotated."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from threadpoolctl import threadpool_limits

from gtlayout.config import Config
from gtlayout.edges import contact_edges
from gtlayout.memory import LastingMemory
from gtlayout.method import Solved, lay_out, solve_with_memory, with_measurements
from gtlayout.observer import Observer, Stages
from gtlayout.planes.estimation import estimate
from gtlayout.scene import FloatArray, KeyFrame, Scene
from gtlayout.session.changed import Change, with_still_planes
from gtlayout.session.grouped import Grouped, grouped
from gtlayout.session.redrawing import Redrawing, compare
from gtlayout.session.tracked import carried
from gtlayout.solution import Solution

_SHRINK = 2.0
"""Quality after a quick solve is judged on images smaller by this factor."""
_CONVERGED_BELOW = 1e-3
"""Coefficients of planes are known to a few times this: depths are 2.5 in the median there."""
_ARC_SEGMENTS = 2
"""Extents differ from those with the usual arcs by a share of 3e-4 at most, and take a third less."""


class Session:
    """A scene that is solved again after each change of its drawing.

    A thread may call ``quick`` while another is in ``solve``; no two solves in full run at a time. Two threads at once
    keep their bytes when the process has one BLAS thread throughout: see ``threadpoolctl``.
    """

    def __init__(self, scene: Scene, config: Config | None = None) -> None:
        self._scene = scene
        self._config = config or Config()
        self._memory = LastingMemory()
        self._last: Solved | None = None
        self._in_full = threading.Lock()

    def solve(self, key_frames: Sequence[KeyFrame]) -> Solution:
        """What ``gtlayout.solve`` gives for the scene with these drawings, to the last bit.

        Features and tracks of key frames, matches of images, cameras and depths are taken from earlier solves where
        what they depend on is the same. Raises GtlayoutError as that does.
        """
        scene = replace(self._scene, key_frames=_in_order(key_frames))
        with self._in_full:
            solved = solve_with_memory(scene, self._config, self._memory, Stages())
            self._memory.forget_unused()
            self._last = solved
        return _measured(solved)

    def quick(self, key_frames: Sequence[KeyFrame]) -> Solution:
        """Nearly what ``solve`` gives, from the last solution on: what changed since, and what depends on it.

        Elements are known by their key frame and id. Those that were there keep their tracks and, with the same label,
        their instance; new ones join an instance by their tracks and their place. Planes are solved from where they
        were, without a search; those that hardly move stay where they are. Extents are made anew where planes, contacts
        or drawings changed. Cameras are not looked at again, instances are neither joined nor split, and no drawing is
        found to contradict the others: that needs ``solve``, which the next quick one goes on from.

        Solves in full when there is no solution to go on from. Raises GtlayoutError as ``solve`` does.
        """
        last, ordered = self._last, _in_order(key_frames)
        redrawing = (
            None if last is None or not any(one.elements for one in ordered) else compare(last.prepared, ordered)
        )
        if last is None or redrawing is None:
            return self.solve(key_frames)
        with threadpool_limits(limits=1, user_api="blas"):
            solved = self._again(last, redrawing)
        self._last = solved
        return _measured(solved)

    def _again(self, last: Solved, redrawing: Redrawing) -> Solved:
        stage = Stages(Observer())
        config = _for_small_changes(self._config)
        with stage("tracking"):
            tracked = carried(last.prepared, redrawing, config, self._memory)
        with stage("correspondence"):
            found = grouped(last.prepared, last.solution, redrawing, tracked, config)
        with stage("edges"):
            out = set(found.regrouping.left_out)
            idle = {i for i, one in enumerate(found.regrouping.instances) if set(one.members) & out}
            edges = contact_edges(redrawing.scene, found.regrouping.instances, config.edges, self._memory)
            edges = tuple(edge for edge in edges if not idle & set(edge.instances))
        prepared = replace(
            last.prepared,
            scene=redrawing.scene,
            form=redrawing.form,
            tracks=tracked.tracks,
            rays=tracked.rays,
            camera_response=tracked.response,
            instances=found.regrouping.instances,
            track_instance=found.regrouping.track_instance,
            edges=edges,
            left_out=found.regrouping.left_out,
            curved=tuple(
                replace(wall, instance=new)
                for new, origin in enumerate(found.origin)
                for wall in last.prepared.curved
                if wall.instance == origin
            ),
        )
        with stage("estimation"):
            known = _known_planes(last, found)
            solved = estimate(prepared.flat, config.estimation, config.seed, known)
            solved, still = with_still_planes(solved, known, _corners(last, found))
        cameras = [prepared.given_scene.frame_of(k).camera for k in range(len(prepared.scene.key_frames))]
        with stage("extents"):
            change = Change(
                redrawing,
                last.solution.layout,
                last.prepared.edges,
                prepared.instances,
                edges,
                found.origin,
                still,
                cameras,
            )
            stay, refined_again = change.kept_extents()
        return Solved(prepared, lay_out(prepared, solved, config, stage, stay, refined_again, _SHRINK))


def _measured(solved: Solved) -> Solution:
    """The solution with what was measured by hand; the next solve goes on from that without."""
    with threadpool_limits(limits=1, user_api="blas"):
        return with_measurements(solved.solution)


def _in_order(key_frames: Sequence[KeyFrame]) -> tuple[KeyFrame, ...]:
    return tuple(sorted(key_frames, key=lambda key_frame: key_frame.frame))


def _for_small_changes(config: Config) -> Config:
    """Settings for a solve from a good start: nothing is annealed, and rounds end at a change that nobody sees."""
    return replace(
        config,
        estimation=replace(config.estimation, annealing=(), converged_below=_CONVERGED_BELOW),
        extent=replace(config.extent, arc_segments=_ARC_SEGMENTS),
    )


def _known_planes(last: Solved, found: Grouped) -> FloatArray:
    """(S, 4) planes before, in the canonical world; NaN for new instances and those whose plane was unobservable."""
    planes = last.solution.planes
    before = np.array([[*plane.normal, plane.d] if plane.observable else [np.nan] * 4 for plane in planes])
    local = last.prepared.form.similarity.planes(before)
    return np.array([[np.nan] * 4 if origin is None else local[origin] for origin in found.origin])


def _corners(last: Solved, found: Grouped) -> list[FloatArray]:
    """(N, 3) the corners of the extents before, in the canonical world."""
    form, extents = last.prepared.form.similarity, last.solution.layout.extents
    return [
        np.empty((0, 3))
        if origin is None
        else form.points(extents[origin].frame.to_world(shapely.get_coordinates(extents[origin].region)))
        for origin in found.origin
    ]
