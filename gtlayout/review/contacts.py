"""Contact edges that lie off the line in which their planes meet, and occlusion edges that nobody drew."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import shapely

from gtlayout.planes.left_out import ExpectedContact, contacts_without_their_key_frame
from gtlayout.prediction.predict import occlusion_edges
from gtlayout.prepared.measurements import Measurements
from gtlayout.regrouping.drawings import KeyFrameMatch
from gtlayout.review.config import ReviewConfig
from gtlayout.review.findings import Finding, named, side_along
from gtlayout.solution import Solution
from gtlayout.tracking.triangulation import triangulate


def contact_findings(solution: Solution, matches: Sequence[KeyFrameMatch], config: ReviewConfig) -> Iterator[Finding]:
    """The contact edges that are off by more than their σ allows; where one instance hides the other, that is said."""
    scene = solution.scene
    element_of = {(k, i): e for i, one in enumerate(solution.instances) for k, e in one.members}
    by_key_frame = {found.key_frame: found for found in matches}
    for contact in _expected(solution):
        z = contact.distance_px / float(np.hypot(contact.sigma_px, config.sigma_drawn_px))
        if z <= config.min_z or contact.distance_px <= config.min_distance_px:
            continue
        alone = any(len(solution.instances[i].members) < 2 for i in contact.instances)
        if alone and contact.sigma_px > config.max_alone_sigma_px:
            continue
        k = contact.key_frame
        elements = [scene.key_frames[k].elements[element_of[k, i]] for i in contact.instances]
        front = _front(solution, by_key_frame[k], contact, config)
        if front is None and contact.expected_px is None:
            continue
        # The smaller one has fewer other edges to look at.
        smaller = min(elements, key=lambda element: element.amodal.area)
        if front is None:
            other = elements[0] if smaller is elements[1] else elements[1]
            yield Finding(
                k,
                scene.frame_of(k).name,
                smaller.id,
                side_along(smaller, contact.drawn_px),
                "edge",
                f"edge between {named(smaller)} and {named(other)} {contact.distance_px:.0f} px from where the planes "
                f"meet (z {z:.0f}): move it, or draw an occlusion edge if they do not touch there",
                z,
                contact.drawn_px[[0, -1]],
                None if contact.expected_px is None else contact.expected_px[[0, -1]],
            )
        else:
            before, behind = elements[front], elements[1 - front]
            yield Finding(
                k,
                scene.frame_of(k).name,
                before.id,
                side_along(before, contact.drawn_px),
                "occlusion edge missing",
                f"{named(before)} hides a part of {named(behind)}, and they are drawn as if they touched there "
                f"(z {z:.0f}): draw an occlusion edge along their border",
                z,
                contact.drawn_px[[0, -1]],
            )


def _expected(solution: Solution) -> tuple[ExpectedContact, ...]:
    rays = triangulate(solution.scene, solution.tracks, solution.config.triangulation)
    # A curved wall does not meet others where its plane would.
    curved = solution.layout.curved.keys()
    edges = tuple(edge for edge in solution.edges if not curved & set(edge.instances))
    measured = Measurements(solution.scene, solution.tracks, rays, solution.instances, solution.track_instance, edges)
    pairs = {(min(edge.instances), max(edge.instances)) for edge in edges}
    ignored = pairs - set(solution.estimate.contact_offsets)
    return contacts_without_their_key_frame(measured, solution.planes, ignored, solution.config.estimation)


def _front(solution: Solution, found: KeyFrameMatch, contact: ExpectedContact, config: ReviewConfig) -> int | None:
    """Which of its two instances hides the other along a contact, by what the other key frames show; None = neither."""
    camera = solution.scene.frame_of(contact.key_frame).camera
    lines: Mapping[int, list[shapely.LineString]] = {0: [], 1: []}
    for edge in occlusion_edges(
        found.prediction, solution.planes, solution.instances, camera, solution.config.regrouping.prediction
    ):
        if {edge.front, edge.behind} == set(contact.instances):
            lines[contact.instances.index(edge.front)].append(shapely.LineString(edge.points_px))
    reach = config.max_occlusion_px * camera.annotation_scale
    points = shapely.points(contact.drawn_px)
    share = [float(np.mean(shapely.dwithin(shapely.union_all(lines[side]), points, reach))) for side in (0, 1)]
    front = int(np.argmax(share))
    return front if share[front] >= config.min_occlusion_share else None
