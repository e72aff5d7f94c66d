"""Stage 2: which elements of different key frames are the same instance (paper 3.2).

Tracked points vote: a point on element i of one key frame that lies on element j of another is a vote for i = j.
Every element gets votes of a second kind, from sample points that are carried over with the depth of the tracks around
them. They decide where little can be tracked.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from shapely import contains_xy

from gtlayout.correspondence.config import CorrespondenceConfig
from gtlayout.geometry.hosts import find_hosts
from gtlayout.geometry.raster import spread_points
from gtlayout.instances import Instance
from gtlayout.scene import OPENINGS, FloatArray, IntArray, Scene
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks

_VOTE_DECIMALS = 9
"""Votes are counts and shares of counts. Rounded to these decimals, their sums are equal on every processor for any
order of summation.
"""


def correspond(
    scene: Scene, tracks: Tracks, rays: TriangulatedTracks, config: CorrespondenceConfig
) -> tuple[tuple[Instance, ...], IntArray]:
    """Group all annotated elements into instances.

    Consecutive key frames are matched by the Hungarian method on the votes: equal labels only, with a minimum number of
    votes. The resulting chains are joined across gaps by the votes between any two key frames. Two elements of one key
    frame never become one instance.

    Returns:
        The instances, in order of first appearance, and (N,) the instance of each track, -1 = none.

    Raises ``GtlayoutError`` when no key frame has an element.
    """
    scene.require_elements()
    first_of = _first_of(scene)
    labels = [element.label for key_frame in scene.key_frames for element in key_frame.elements]
    key_frame_of = np.repeat(np.arange(len(scene.key_frames)), np.diff(first_of))
    seen_on = _elements_under_tracks(scene, tracks, first_of)
    votes = _track_votes(seen_on, tracks, first_of)
    votes += config.carried_weight * _carried_votes(scene, tracks, rays, first_of, config)
    votes = np.round(votes + votes.T, _VOTE_DECIMALS)
    same_label = np.array([[a == b for b in labels] for a in labels])
    votes[~same_label] = 0.0

    group = np.arange(len(labels))
    for k in range(len(scene.key_frames) - 1):
        rows, columns = (np.arange(first_of[i], first_of[i + 1]) for i in (k, k + 1))
        for i, j in zip(*linear_sum_assignment(-votes[np.ix_(rows, columns)]), strict=True):
            if votes[rows[i], columns[j]] >= config.min_votes:
                group[columns[j]] = group[rows[i]]
    return form_instances(scene, tracks, _join_across_gaps(group, key_frame_of, votes, config.min_votes))


def form_instances(scene: Scene, tracks: Tracks, group: IntArray) -> tuple[tuple[Instance, ...], IntArray]:
    """The instances that ``group`` makes of all annotated elements.

    Args:
        group: (E,) a number for each element, all key frames in order; equal numbers are one instance.

    Returns:
        The instances with their hosts, in order of first appearance, and (N,) the instance of each track, -1 = none.
    """
    first_of = _first_of(scene)
    instances = _instances(scene, group)
    instance_of = np.empty(len(group), dtype=np.int64)
    for number, instance in enumerate(instances):
        for k, element in instance.members:
            instance_of[first_of[k] + element] = number
    hosts = find_hosts(scene, instances)
    hosted = tuple(replace(instance, host=host) for instance, host in zip(instances, hosts, strict=True))
    return hosted, _majority(_elements_under_tracks(scene, tracks, first_of), instance_of, tracks, first_of)


def _first_of(scene: Scene) -> IntArray:
    """(K + 1,) number of each key frame's first element when those of all key frames are counted in order."""
    return np.cumsum([0] + [len(key_frame.elements) for key_frame in scene.key_frames])


def _elements_under_tracks(scene: Scene, tracks: Tracks, first_of: IntArray) -> IntArray:
    """(M,) the element (numbered over all key frames) under each observation in a key frame; -1 elsewhere."""
    under = np.full(len(tracks.track), -1)
    for k, key_frame in enumerate(scene.key_frames):
        seen = np.nonzero(tracks.frame == key_frame.frame)[0]
        under[seen] = _element_at(scene, k, tracks.points_px[seen], first_of)
    return under


def _element_at(scene: Scene, k: int, points_px: FloatArray, first_of: IntArray) -> IntArray:
    """(N,) the element of key frame ``k`` under each pixel, -1 = none; doors and windows lie on top of walls."""
    elements = scene.key_frames[k].elements
    under = np.full(len(points_px), -1)
    for e in sorted(range(len(elements)), key=lambda e: elements[e].label in OPENINGS):
        under[contains_xy(elements[e].amodal, points_px[:, 0], points_px[:, 1])] = first_of[k] + e
    return under


def _track_votes(seen_on: IntArray, tracks: Tracks, first_of: IntArray) -> FloatArray:
    """(E, E) how many tracks were sampled on element i and seen on element j of another key frame."""
    sampled_on = (first_of[tracks.key_frame] + tracks.element)[tracks.track]
    votes = np.zeros((first_of[-1], first_of[-1]))
    counts = seen_on >= 0
    np.add.at(votes, (sampled_on[counts], seen_on[counts]), 1.0)
    return votes


def _carried_votes(
    scene: Scene, tracks: Tracks, rays: TriangulatedTracks, first_of: IntArray, config: CorrespondenceConfig
) -> FloatArray:
    """(E, E) how many of the points spread over element i land on element j with the depth of the tracks around them.

    Only certain depths count, and each element has the same number of points, so that these votes matter where tracks
    are few.
    """
    votes = np.zeros((first_of[-1], first_of[-1]))
    known = rays.sigma_rho < config.max_relative_sigma * rays.rho
    for k, key_frame in enumerate(scene.key_frames):
        here = known & (tracks.key_frame == k)
        if np.count_nonzero(here) < config.depth_neighbours:
            continue
        tree, rho = cKDTree(rays.key_px[here]), rays.rho[here]
        camera = scene.frame_of(k).camera
        for e, element in enumerate(key_frame.elements):
            points_px = spread_points(element.amodal, config.carried_points)
            _, neighbours = tree.query(points_px, k=config.depth_neighbours)
            depth = 1.0 / np.median(rho[neighbours], axis=1)
            points_world = camera.center_world + depth[:, None] * camera.rays_world(points_px)
            for other in range(len(scene.key_frames)):
                if other == k:
                    continue
                projected_px, depth_there = scene.frame_of(other).camera.project(points_world)
                landed = _element_at(scene, other, projected_px[depth_there > 0], first_of)
                np.add.at(votes[first_of[k] + e], landed[landed >= 0], 1.0 / len(points_px))
    return votes


def _join_across_gaps(group: IntArray, key_frame_of: IntArray, votes: FloatArray, min_votes: float) -> IntArray:
    """Merge chains that vote for each other and share no key frame, best supported first."""
    names, group = np.unique(group, return_inverse=True)
    chain = np.eye(len(names), dtype=bool)[group]
    support = np.round(chain.T @ votes @ chain, _VOTE_DECIMALS)
    shown = np.zeros((len(names), key_frame_of.max() + 1), dtype=bool)
    shown[group, key_frame_of] = True
    while True:
        possible = np.triu(support, k=1) * ~(shown @ shown.T)
        a, b = np.unravel_index(np.argmax(possible), possible.shape)
        if possible[a, b] < min_votes:
            return group
        group[group == b] = a
        support[a] += support[b]
        support[:, a] += support[:, b]
        support[b] = support[:, b] = 0.0
        shown[a] |= shown[b]


def _instances(scene: Scene, group: IntArray) -> tuple[Instance, ...]:
    """Instances in order of first appearance, named by label and number."""
    everything = [(k, e) for k, key_frame in enumerate(scene.key_frames) for e in range(len(key_frame.elements))]
    _, first = np.unique(group, return_index=True)
    numbers: Counter[str] = Counter()
    instances = []
    for g in group[np.sort(first)]:
        members = tuple(everything[e] for e in np.nonzero(group == g)[0])
        k, e = members[0]
        label = scene.key_frames[k].elements[e].label
        instances.append(Instance(f"{label}_{numbers[label]}", label, members))
        numbers[label] += 1
    return tuple(instances)


def _majority(seen_on: IntArray, instance_of: IntArray, tracks: Tracks, first_of: IntArray) -> IntArray:
    """(N,) the instance on which most positions of each track in key frames fall; where it was sampled decides ties."""
    sampled = instance_of[first_of[tracks.key_frame] + tracks.element]
    votes = np.zeros((len(tracks), instance_of.max() + 1))
    counts = seen_on >= 0
    np.add.at(votes, (tracks.track[counts], instance_of[seen_on[counts]]), 1.0)
    votes[np.arange(len(tracks)), sampled] += 0.5
    return np.argmax(votes, axis=1)
