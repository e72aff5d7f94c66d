"""Drawings against what all other key frames predict: lost elements, exchanged labels, wrong places, near walls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
from shapely import MultiPolygon

from gtlayout.config import Config
from gtlayout.edges import contact_edges
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Instance, Members, Plane, Support
from gtlayout.prepared.measurements import Measurements
from gtlayout.regrouping.drawings import (
    KeyFrameMatch,
    find_contradictions,
    find_rejoins,
    find_swaps,
    match_key_frames,
)
from gtlayout.regrouping.parts import Part, find_parts, reaches_through
from gtlayout.scene import IntArray, Label, Scene
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate
from simulated.simulation import no_tracks

CONFIG = Config()
SEEN = rooms.BOX[:5]
"""Of the box room, what the cameras below see."""
FLOOR, CEILING, LEFT, FAR = 0, 1, 2, 4
CAMERAS = [rooms.level_camera([x, y, 1.25]) for x, y in ((2.0, 1.5), (1.8, 1.0), (2.2, 0.7), (2.0, 0.5))]
PLANES = [replace(surface.plane, support=Support(tracks=20)) for surface in SEEN]
ROOM = rooms.seen_from(CAMERAS, SEEN)
INSTANCES = rooms.instances_of(SEEN, len(CAMERAS))


def relabelled(scene: Scene, k: int, labels: Mapping[int, Label]) -> Scene:
    """The scene with some elements of key frame ``k`` under another label."""
    elements = [
        replace(element, label=labels.get(e, element.label)) for e, element in enumerate(scene.key_frames[k].elements)
    ]
    key_frames = list(scene.key_frames)
    key_frames[k] = replace(key_frames[k], elements=tuple(elements))
    return replace(scene, key_frames=tuple(key_frames))


def apart(scene: Scene, alone: Sequence[tuple[int, int]]) -> list[Instance]:
    """The true instances with some elements, (key frame, element), as instances of their own at the end."""
    kept = [replace(one, members=tuple(m for m in one.members if m not in alone)) for one in INSTANCES]
    labels = [scene.key_frames[k].elements[e].label for k, e in alone]
    return [*kept, *(Instance(f"{label}_9", label, (m,)) for label, m in zip(labels, alone, strict=True))]


def matched(scene: Scene, instances: Sequence[Instance], planes: Sequence[Plane]) -> tuple[KeyFrameMatch, ...]:
    return match_key_frames(scene, instances, planes, CONFIG.regrouping, CONFIG.extent)


def unplaced(plane: Plane) -> Plane:
    return replace(plane, observable=False)


# --- right drawings, exchanged labels, lost elements ---


def test_right_drawings_match_and_give_no_reason_for_anything() -> None:
    matches = matched(ROOM, INSTANCES, PLANES)
    assert [found.matched for found in matches] == [tuple(range(len(SEEN)))] * len(CAMERAS)
    assert min(found.own_iou.min() for found in matches) > 0.999
    assert find_swaps(ROOM, matches, CONFIG.regrouping) == ()
    assert find_rejoins(ROOM, INSTANCES, PLANES, matches, CONFIG.regrouping) == ()
    assert find_contradictions(ROOM, matches, CONFIG.regrouping) == ()


@pytest.mark.parametrize("k", [0, 2])
def test_exchanged_labels_are_found(k: int) -> None:
    scene = relabelled(ROOM, k, {FLOOR: "wall", FAR: "floor"})
    instances = apart(scene, [(k, FLOOR), (k, FAR)])
    # What is really the floor was placed as a wall, and the other way round.
    matches = matched(scene, instances, [*PLANES, PLANES[FLOOR], PLANES[FAR]])
    assert [(swap.first, swap.second) for swap in find_swaps(scene, matches, CONFIG.regrouping)] == [
        ((k, FLOOR), (k, FAR))
    ]


def test_one_wrong_label_alone_is_no_exchange() -> None:
    scene = relabelled(ROOM, 0, {FAR: "slanted"})
    matches = matched(scene, apart(scene, [(0, FAR)]), [*PLANES, PLANES[FAR]])
    assert matches[0].matched[FAR] == FAR
    assert find_swaps(scene, matches, CONFIG.regrouping) == ()


def test_a_lost_element_rejoins_where_nothing_places_it() -> None:
    instances = apart(ROOM, [(1, FAR)])
    nowhere = [*PLANES, unplaced(PLANES[FAR])]
    (rejoin,) = find_rejoins(ROOM, instances, nowhere, matched(ROOM, instances, nowhere), CONFIG.regrouping)
    assert (rejoin.member, rejoin.instance) == ((1, FAR), FAR)
    assert rejoin.iou > 0.999
    # One that has a plane of its own is joined by that, or not at all.
    placed = [*PLANES, PLANES[FAR]]
    assert find_rejoins(ROOM, instances, placed, matched(ROOM, instances, placed), CONFIG.regrouping) == ()


def test_elements_that_were_joined_to_another_wall_go_where_they_are() -> None:
    """The left wall is forgotten in two key frames, and what they show of the far wall was taken for it."""
    forgotten = (1, 2)
    key_frames = [
        replace(one, elements=tuple(e for i, e in enumerate(one.elements) if i != LEFT)) if k in forgotten else one
        for k, one in enumerate(ROOM.key_frames)
    ]
    scene = replace(ROOM, key_frames=tuple(key_frames))
    drawn = [{k: s - (s > LEFT and k in forgotten) for k in range(len(CAMERAS))} for s in range(len(SEEN))]
    members = [{(k, e) for k, e in of.items() if s != LEFT or k not in forgotten} for s, of in enumerate(drawn)]
    astray = {(k, drawn[FAR][k]) for k in forgotten}
    members[LEFT] |= astray
    members[FAR] -= astray
    instances = [replace(one, members=tuple(sorted(of))) for one, of in zip(INSTANCES, members, strict=True)]
    found = find_rejoins(scene, instances, PLANES, matched(scene, instances, PLANES), CONFIG.regrouping)
    assert {(one.member, one.instance) for one in found} == {(member, FAR) for member in astray}


@pytest.mark.parametrize(
    ("label", "amodal"),
    [
        pytest.param("slanted", rooms.draw(rooms.FAR.corners, CAMERAS[1]), id="another label"),
        pytest.param("wall", rooms.pixels(60, 40, 85, 65), id="another place"),
    ],
)
def test_what_looks_like_nothing_stays_lost(label: Label, amodal: MultiPolygon) -> None:
    scene = relabelled(rooms.redraw(ROOM, 1, FAR, amodal), 1, {FAR: label})
    instances, planes = apart(scene, [(1, FAR)]), [*PLANES, unplaced(PLANES[FAR])]
    assert find_rejoins(scene, instances, planes, matched(scene, instances, planes), CONFIG.regrouping) == ()


def test_an_instance_that_the_key_frame_shows_is_not_shown_twice() -> None:
    # The far wall in two pieces: the larger one is it already.
    whole = rooms.draw(rooms.FAR.corners, CAMERAS[1])
    left, _, right, _ = whole.bounds
    cut = left + 0.2 * (right - left)
    larger, smaller = (polygons(whole.intersection(rooms.pixels(a, 0, b, 100))) for a, b in ((cut, 160), (0, cut)))
    scene = rooms.redraw(ROOM, 1, FAR, smaller)
    extra = replace(scene.key_frames[1].elements[FAR], amodal=larger)
    key_frames = list(scene.key_frames)
    key_frames[1] = replace(key_frames[1], elements=(*key_frames[1].elements, extra))
    scene = replace(scene, key_frames=tuple(key_frames))
    alone = (1, len(SEEN))
    instances, planes = apart(scene, [alone]), [*PLANES, unplaced(PLANES[FAR])]
    matches = matched(scene, instances, planes)
    assert matches[1].matched[alone[1]] == FAR
    assert find_rejoins(scene, instances, planes, matches, CONFIG.regrouping) == ()


# --- contradictions ---


def test_an_element_drawn_elsewhere_contradicts_the_others() -> None:
    scene = rooms.redraw(ROOM, 2, FAR, rooms.pixels(0, 60, 40, 100))
    found = find_contradictions(scene, matched(scene, INSTANCES, PLANES), CONFIG.regrouping)
    assert found == (((2, FAR),),)


def test_a_drawing_of_another_place_is_named_as_a_whole() -> None:
    # Upside down: floor and ceiling where the other is, the rest a little off.
    scene = ROOM
    for e, other in ((FLOOR, CEILING), (CEILING, FLOOR)):
        scene = rooms.redraw(scene, 2, e, ROOM.key_frames[2].elements[other].amodal)
    scene = rooms.redraw(scene, 2, 2, rooms.pixels(20, 40, 150, 60))
    found = find_contradictions(scene, matched(scene, INSTANCES, PLANES), CONFIG.regrouping)
    assert found == (tuple((2, e) for e in range(len(SEEN))),)


def test_where_no_others_agree_it_is_the_plane_that_is_wrong() -> None:
    planes = list(PLANES)
    # Far away, so that every key frame is predicted to show it elsewhere.
    planes[FAR] = replace(planes[FAR], d=planes[FAR].d - 9.0)
    scene = rooms.redraw(ROOM, 2, FAR, rooms.pixels(0, 60, 40, 100))
    matches = matched(scene, INSTANCES, planes)
    assert matches[2].own_iou[FAR] < CONFIG.regrouping.max_alone_iou
    agreeing = sum(found.own_iou[FAR] >= CONFIG.regrouping.prediction.min_iou for found in matches)
    assert agreeing < CONFIG.regrouping.min_others
    assert find_contradictions(scene, matches, CONFIG.regrouping) == ()


def test_of_two_drawings_nobody_knows_which_is_wrong() -> None:
    scene = rooms.redraw(ROOM, 1, FAR, rooms.pixels(0, 60, 40, 100))
    two = replace(scene, key_frames=scene.key_frames[:2])
    instances = rooms.instances_of(SEEN, 2)
    matches = matched(two, instances, PLANES)
    assert matches[1].own_iou[FAR] == 0
    assert find_contradictions(two, matches, CONFIG.regrouping) == ()


# --- near walls that were taken for the one they hide ---


def with_near_wall(amodal: MultiPolygon, k: int = 3) -> Scene:
    """The room with a near wall drawn as the far wall's element of key frame ``k``; floor and ceiling end at it."""
    scene = rooms.redraw(ROOM, k, FAR, amodal)
    for e in (FLOOR, CEILING):
        left_over = polygons(ROOM.key_frames[k].elements[e].amodal.difference(amodal.buffer(6.0)))
        scene = rooms.redraw(scene, k, e, left_over)
    return scene


def measured(scene: Scene, tracks: Tracks | None = None, instance_of_tracks: IntArray | None = None) -> Measurements:
    tracks = tracks or no_tracks(scene)
    rays = triangulate(scene, tracks, TriangulationConfig())
    none = np.empty(0, dtype=np.int64)
    edges = contact_edges(scene, INSTANCES, CONFIG.edges)
    return Measurements(
        scene, tracks, rays, INSTANCES, none if instance_of_tracks is None else instance_of_tracks, edges
    )


def parts_of(scene: Scene, planes: Sequence[Plane] = PLANES) -> tuple[Part, ...]:
    return find_parts(measured(scene), planes, CONFIG.regrouping, CONFIG.extent)


TALL = rooms.pixels(60, 3, 100, 70)
"""Reaches up beyond the far wall's ceiling line, y = 50 - 80 · 1.25 / 4.5 = 27.8, by 25 px, and down to the floor's."""
CLOSE = replace(CONFIG.regrouping, min_beyond_px=20.0)


def test_a_near_wall_parts_from_the_wall_that_it_hides() -> None:
    scene = with_near_wall(TALL)
    (part,) = find_parts(measured(scene), PLANES, CLOSE, CONFIG.extent)
    assert part == Part((3, FAR), FAR, CEILING)
    # 25 px are within what is asked for by default.
    assert parts_of(scene) == ()


def test_right_drawings_do_not_part() -> None:
    assert find_parts(measured(ROOM), PLANES, CLOSE, CONFIG.extent) == ()
    # Not drawn up to the ceiling, nor beyond it.
    low = with_near_wall(rooms.pixels(60, 35, 100, 65))
    assert find_parts(measured(low), PLANES, CLOSE, CONFIG.extent) == ()


def test_a_contact_of_its_own_keeps_an_element() -> None:
    # The same element, but the wall at its left is drawn up to it.
    scene = with_near_wall(TALL)
    beside = polygons(ROOM.key_frames[3].elements[2].amodal.union(rooms.pixels(20, 3, 60, 70)))
    held = rooms.redraw(scene, 3, 2, beside)
    assert any({2, FAR} == set(edge.instances) and edge.key_frame == 3 for edge in measured(held).edges)
    assert find_parts(measured(held), PLANES, CLOSE, CONFIG.extent) == ()
    # Not when that wall is held by nothing but this.
    hanging = list(PLANES)
    hanging[2] = replace(hanging[2], support=Support(tracks=0, contact_edges=1))
    assert len(find_parts(measured(held), hanging, CLOSE, CONFIG.extent)) == 1


def test_tracks_of_its_own_keep_an_element() -> None:
    scene = with_near_wall(TALL)
    count = CONFIG.regrouping.min_tracks
    for sampled, expected in ((count, 0), (count - 1, 1)):
        number = np.arange(sampled)
        tracks = Tracks(
            key_frame=np.full(sampled, 3),
            element=np.full(sampled, FAR),
            track=np.repeat(number, 2),
            frame=np.tile([2, 3], sampled),
            points_px=np.repeat(np.column_stack([70.0 + number, np.full(sampled, 50.0)]), 2, axis=0),
            sigma_px=np.ones(sampled),
            tried=no_tracks(scene).tried,
        )
        made = measured(scene, tracks, np.full(sampled, FAR))
        assert len(find_parts(made, PLANES, CLOSE, CONFIG.extent)) == expected


def test_a_wall_that_others_draw_beyond_the_ceiling_may_go_beyond_it() -> None:
    scene = with_near_wall(TALL)
    others: Members = INSTANCES[FAR].members[:3]
    for k, e in others:
        scene = rooms.redraw(
            scene, k, e, polygons(scene.key_frames[k].elements[e].amodal.union(rooms.pixels(70, 0, 90, 60)))
        )
    made = replace(measured(scene), edges=measured(ROOM).edges[:0])
    assert find_parts(made, PLANES, CLOSE, CONFIG.extent) == ()
    edges = tuple(edge for edge in measured(ROOM).edges if edge.key_frame != 3)
    assert find_parts(replace(made, edges=edges), PLANES, CLOSE, CONFIG.extent) == ()


def test_an_element_is_asked_before_it_rejoins() -> None:
    scene = with_near_wall(TALL)
    instances = tuple(apart(scene, [(3, FAR)]))
    made = replace(
        measured(scene), instances=instances, edges=tuple(e for e in measured(ROOM).edges if e.key_frame < 3)
    )
    planes = [*PLANES, unplaced(PLANES[FAR])]
    assert reaches_through(made, planes, (3, FAR), FAR, CLOSE, CONFIG.extent) == CEILING
    assert reaches_through(made, planes, (3, FAR), FAR, CONFIG.regrouping, CONFIG.extent) is None
