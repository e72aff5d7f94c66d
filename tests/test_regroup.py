"""Joining and splitting instances: made planes with known covariances, tracks of known planes, and the whole method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rooms import level_camera, make_scene, pixels, redraw
from shapely import MultiPolygon

from gtlayout import method
from gtlayout.config import Config
from gtlayout.correspondence.matching import form_instances
from gtlayout.instances import Instance, Plane, Support
from gtlayout.planes import estimation
from gtlayout.planes.estimate import Estimate
from gtlayout.prepared.canonical import canonical
from gtlayout.prepared.measurements import Measurements
from gtlayout.regrouping.joins import find_joins, plane_difference
from gtlayout.regrouping.splits import Cluster, cluster_of, find_splits, two_planes
from gtlayout.scene import FloatArray, IntArray, Label, Scene
from gtlayout.solution import Solution
from gtlayout.tracking.config import TriangulationConfig
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks, triangulate
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import chosen, make_tracks

CONFIG = Config()
FACING = np.array([0.0, -1.0, 0.0, 10.0])
"""The plane that the cameras below look at from a distance of 10."""
WHOLE = pixels(0, 0, 100, 80)
"""Ten metres of it."""
SIGMA_NORMAL, SIGMA_D = 0.005, 0.05


# --- joins: two drawings, one in each of two key frames 8 m apart ---


def two_drawings(
    first: MultiPolygon = WHOLE, second: MultiPolygon = WHOLE, label: Label = "wall", behind: Label | None = None
) -> tuple[Scene, list[Instance]]:
    """Each key frame draws one element; ``behind`` adds one that fills what the first drawing leaves free."""
    cameras = [level_camera([x, 0, 0], focal=100.0, width=100, height=80) for x in (0.0, 8.0)]
    drawings: list[list[tuple[Label, MultiPolygon]]] = [[(label, first)], [(label, second)]]
    instances = [Instance(f"{label}_0", label, ((0, 0),)), Instance(f"{label}_1", label, ((1, 0),))]
    if behind:
        drawings[0].append((behind, MultiPolygon([WHOLE.geoms[0].difference(first.geoms[0])])))
        instances.append(Instance(f"{behind}_9", behind, ((0, 1),)))
    return make_scene(cameras, drawings), instances


def made(planes: Sequence[FloatArray], sigma: float = 1.0, shared: float = 0.0) -> Estimate:
    """Planes with σ 0.005 rad and 5 cm, times ``sigma``; ``shared`` is the correlation of the offsets."""
    own = np.diag([SIGMA_NORMAL**2, SIGMA_NORMAL**2, SIGMA_NORMAL**2, SIGMA_D**2])
    across = np.diag([0.0, 0.0, 0.0, shared * SIGMA_D**2])
    count = len(planes)
    covariance = sigma**2 * (np.kron(np.eye(count), own) + np.kron(1 - np.eye(count), across))
    found = tuple(
        Plane(p[:3], float(p[3]), sigma**2 * own, observable=True, support=Support(tracks=50)) for p in planes
    )
    none = np.empty(0)
    return Estimate(found, covariance, np.empty((0, 3)), none, none.astype(np.int64), {}, ())


def joined(scene: Scene, instances: Sequence[Instance], solved: Estimate) -> list[tuple[int, int]]:
    return [join.instances for join in find_joins(scene, instances, solved, CONFIG.regrouping, CONFIG.extent)]


def moved(offset: float = 0.0, turn_deg: float = 0.0) -> FloatArray:
    """The plane that is ``offset`` further away and turned about the vertical through x = 4."""
    turn = np.deg2rad(turn_deg)
    normal = np.array([np.sin(turn), -np.cos(turn), 0.0])
    return np.append(normal, -normal @ [4.0, 10.0 + offset, 0.0])


def test_difference_of_two_planes_in_closed_form() -> None:
    for shared in (0.0, 0.8):
        difference = plane_difference(made([FACING, moved(0.12)], shared=shared), (0, 1))
        assert difference.chi2 == pytest.approx(0.12**2 / (2 * (1 - shared) * SIGMA_D**2))
    turned = plane_difference(made([FACING, np.append([np.sin(0.02), -np.cos(0.02), 0.0], 10.0)]), (0, 1))
    assert turned.chi2 == pytest.approx(np.sin(0.02) ** 2 / (2 * SIGMA_NORMAL**2), rel=1e-3)
    gap, sigma = plane_difference(made([FACING, moved(0.12)]), (0, 1)).at(np.array([[2.0, 10.0, 1.0]]))
    np.testing.assert_allclose(np.abs(gap), 0.12, rtol=1e-9)
    # σ of the distance at (2, 10, 1): |(2, 10, 1)|² σ_normal² + σ_d², twice.
    np.testing.assert_allclose(sigma, np.sqrt(2 * (105 * SIGMA_NORMAL**2 + SIGMA_D**2)))


def test_one_plane_drawn_in_two_key_frames_is_joined() -> None:
    scene, instances = two_drawings()
    assert joined(scene, instances, made([FACING, moved(0.05, 0.3)])) == [(0, 1)]


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(moved(0.3), id="parallel, 30 cm behind it"),
        pytest.param(moved(0.0, 90.0), id="a corner"),
        pytest.param(moved(0.0, 5.0), id="at an angle that the covariance does not allow"),
        pytest.param(-FACING, id="the other side of a wall"),
    ],
)
def test_two_planes_stay_apart(other: FloatArray) -> None:
    scene, instances = two_drawings()
    assert joined(scene, instances, made([FACING, other])) == []


def test_what_is_known_too_vaguely_is_not_joined() -> None:
    scene, instances = two_drawings()
    assert joined(scene, instances, made([FACING, FACING], sigma=1.0)) == [(0, 1)]
    assert joined(scene, instances, made([FACING, FACING], sigma=20.0)) == []
    # Wide σ that all would pass: closeness is asked for as well.
    assert joined(scene, instances, made([FACING, moved(0.4)], sigma=4.0)) == []
    unknown = made([FACING, FACING])
    unknown = replace(unknown, planes=(unknown.planes[0], replace(unknown.planes[1], observable=False)))
    assert joined(scene, instances, unknown) == []


def test_flush_elements_of_one_key_frame_stay_apart() -> None:
    left, right = pixels(0, 0, 50, 80), pixels(50, 0, 100, 80)
    cameras = [level_camera([x, 0, 0], focal=100.0, width=100, height=80) for x in (0.0, 0.5)]
    scene = make_scene(cameras, [[("wall", left), ("wall", right)], [("wall", right)]])
    instances = [Instance("wall_0", "wall", ((0, 0),)), Instance("wall_1", "wall", ((0, 1), (1, 0)))]
    assert joined(scene, instances, made([FACING, FACING])) == []
    # The same two, never seen together.
    alone = [replace(instances[0]), Instance("wall_1", "wall", ((1, 0),)), Instance("floor_0", "floor", ((0, 1),))]
    assert joined(scene, alone[:2], made([FACING, FACING])) == [(0, 1)]


def test_the_unit_of_the_world_does_not_matter() -> None:
    scene, instances = two_drawings()
    for scale in (0.01, 100.0):
        frames = tuple(
            replace(f, camera=replace(f.camera, t_cam_from_world=scale * f.camera.t_cam_from_world))
            for f in scene.frames
        )
        scaled = replace(scene, frames=frames)
        for offset, expected in ((0.05, [(0, 1)]), (0.3, [])):
            solved = made([FACING, moved(offset)])
            to_world = np.diag([1, 1, 1, scale])
            planes = tuple(replace(plane, d=scale * plane.d) for plane in solved.planes)
            both = np.kron(np.eye(2), to_world)
            solved = replace(solved, planes=planes, covariance=both @ solved.covariance @ both)
            assert joined(scaled, instances, solved) == expected


def test_parts_must_touch_and_labels_agree() -> None:
    near, far = pixels(0, 0, 95, 80), pixels(20, 0, 100, 80)
    # The first ends at x = 4.5, the second begins at x = 3 + 2 = 5: half a metre at a depth of ten.
    scene, instances = two_drawings(near, far)
    assert joined(scene, instances, made([FACING, FACING])) == [(0, 1)]
    scene, instances = two_drawings(pixels(0, 0, 85, 80), far)
    assert joined(scene, instances, made([FACING, FACING])) == []
    scene, instances = two_drawings()
    assert joined(scene, [instances[0], replace(instances[1], label="slanted")], made([FACING, FACING])) == []


def test_doors_of_one_wall_are_joined_only_where_they_overlap() -> None:
    # In the world the first is x = 3.5 to 4.5.
    door, same, next_to_it = pixels(85, 20, 95, 80), pixels(6, 20, 16, 80), pixels(17, 20, 27, 80)
    wall = Instance("wall_9", "wall", ())
    for second, expected in ((same, [(0, 1)]), (next_to_it, [])):
        scene, instances = two_drawings(door, second, "door")
        hosted = [replace(instance, host=2) for instance in instances]
        assert joined(scene, [*hosted, wall], made([FACING] * 3)) == expected
        other_host = [hosted[0], replace(hosted[1], host=3), wall, wall]
        assert joined(scene, other_host, made([FACING] * 4)) == []


def test_a_key_frame_that_shows_something_else_there_forbids_it() -> None:
    # The first key frame sees x = 3 … 5 too, and draws the floor of another room there.
    left = pixels(0, 0, 78, 80)
    scene, instances = two_drawings(left, WHOLE, behind="slanted")
    assert joined(scene, instances[:2], made([FACING, FACING])) == [(0, 1)]
    assert joined(scene, instances, made([FACING, FACING, FACING])) == []
    # What stands in front of it may hide it.
    assert joined(scene, instances, made([FACING, FACING, moved(-3.0)])) == [(0, 1)]


# --- splits ---


def seen_on(plane: FloatArray, x: float, sigma: float = 0.001) -> Cluster:
    """A drawing of ``plane · X = -1`` whose key frame's camera is at (x, 0, 0) and looks along y; every tenth track is
    wrong.
    """
    across = np.linspace(-0.5, 0.5, 7)
    ray = np.array([[u, 1.0, v] for u in across for v in across])
    center = np.tile([x, 0.0, 0.0], (len(ray), 1))
    rho = -(ray @ plane) / (1 + center @ plane)
    rho[::10] *= 1.5
    return Cluster(center, ray, rho, np.full(len(ray), sigma))


def test_two_planes_are_told_apart_and_found() -> None:
    facing, oblique = np.array([0.0, -0.2, 0.0]), np.array([-0.1, -0.25, 0.05])
    on = [facing, oblique, facing, oblique, oblique]
    clusters = [seen_on(plane, 0.2 * i) for i, plane in enumerate(on)]
    found = two_planes(clusters, CONFIG.regrouping)
    assert found is not None
    second, planes = found
    assert second.tolist() in ([False, True, False, True, True], [True, False, True, False, False])
    np.testing.assert_allclose(planes[second.astype(int)], on, atol=1e-4)
    for one in (facing, oblique):
        assert two_planes([seen_on(one, 0.2 * i) for i in range(5)], CONFIG.regrouping) is None
    # 2 % further away is within the errors that a key frame's tracks share.
    near = [seen_on(facing if i % 2 else facing / 1.02, 0.2 * i, 0.02 * 0.2) for i in range(4)]
    assert two_planes(near, CONFIG.regrouping) is None
    assert two_planes(clusters[:1], CONFIG.regrouping) is None


def simulated(seed: int = 0) -> tuple[Room, Tracks, TriangulatedTracks]:
    room = make_room(orbit(), [2, 6, 10, 14, 18], seed=seed)
    tracks = make_tracks(room, np.random.default_rng(seed))
    return room, tracks, triangulate(room.scene, tracks, TriangulationConfig())


def form(room: Room, tracks: Tracks, groups: Sequence[set[tuple[int, int]]]) -> tuple[tuple[Instance, ...], IntArray]:
    of = {member: number for number, members in enumerate(groups) for member in members}
    return form_instances(room.scene, tracks, np.array([of[member] for member in sorted(of)]))


def swapped(room: Room, k: int = 2) -> list[set[tuple[int, int]]]:
    """The true instances with the two walls' drawings of one key frame exchanged."""
    groups = [set(instance.members) for instance in room.instances]
    a, b = (i for i, instance in enumerate(room.instances) if instance.label == "wall")
    (in_a,), (in_b,) = ([member for member in groups[i] if member[0] == k] for i in (a, b))
    groups[a] ^= {in_a, in_b}
    groups[b] ^= {in_a, in_b}
    return groups


def partition(instances: Sequence[Instance]) -> set[frozenset[tuple[int, int]]]:
    return {frozenset(instance.members) for instance in instances}


def splits_of(
    room: Room, tracks: Tracks, rays: TriangulatedTracks, groups: Sequence[set[tuple[int, int]]]
) -> set[frozenset[tuple[int, int]]]:
    instances, track_instance = form(room, tracks, groups)
    planes = [Plane(p[:3], float(p[3]), np.eye(4), observable=True) for p in room.planes]
    # The plane of each instance is that of most of its drawings.
    on = [planes[int(np.bincount([room.instance_of[k][e] for k, e in one.members]).argmax())] for one in instances]
    measured = Measurements(room.scene, tracks, rays, instances, track_instance, ())
    found = find_splits(measured, on, CONFIG.regrouping, CONFIG.extent)
    return {frozenset(part) for split in found for part in split.parts}


def test_a_wrong_join_is_split_where_it_is_wrong() -> None:
    room, tracks, rays = simulated()
    a, b = (set(instance.members) for instance in room.instances if instance.label == "wall")
    expected = {frozenset(m for m in wall if (m[0] == 2) == odd) for wall in (a, b) for odd in (True, False)}
    assert splits_of(room, tracks, rays, swapped(room)) == expected


def test_drawings_without_tracks_go_where_they_fit() -> None:
    room, tracks, rays = simulated()
    groups = swapped(room)
    walls = [i for i, instance in enumerate(room.instances) if instance.label == "wall"]
    whole = splits_of(room, tracks, rays, groups)
    # In key frame 3 neither wall has tracks.
    bare = [member for i in walls for member in room.instances[i].members if member[0] == 3]
    here = np.array([(k, e) not in bare for k, e in zip(tracks.key_frame, tracks.element, strict=True)])
    index = np.nonzero(here)[0]
    fewer = chosen(tracks, index)
    assert splits_of(room, fewer, triangulate(room.scene, fewer, TriangulationConfig()), groups) == whole


@pytest.mark.parametrize("seed", range(2))
def test_right_instances_are_not_split(seed: int) -> None:
    room, tracks, rays = simulated(seed)
    groups = [set(instance.members) for instance in room.instances]
    assert splits_of(room, tracks, rays, groups) == set()
    # Depths of one key frame too small by almost a third, as by a wrong pose: two clusters, but one surface as drawn.
    wrong = replace(rays, rho=np.where(tracks.key_frame == 2, rays.rho * 1.4, rays.rho))
    assert two_planes_found(room, tracks, wrong)
    assert splits_of(room, tracks, wrong, groups) == set()


def two_planes_found(room: Room, tracks: Tracks, rays: TriangulatedTracks) -> bool:
    """Whether the tracks alone would split an instance."""
    origin = np.mean([frame.camera.center_world for frame in room.scene.frames], axis=0)
    used = np.ones(len(tracks), dtype=bool)
    return any(
        two_planes(
            [cluster_of(tracks, rays, used, m, origin, CONFIG.regrouping) for m in one.members], CONFIG.regrouping
        )
        for one in room.instances
    )


# --- the whole method ---

QUICK = replace(
    CONFIG,
    estimation=replace(
        CONFIG.estimation, starts=1, rounds=2, initialization=replace(CONFIG.estimation.initialization, draws=30)
    ),
)


def solve(
    room: Room,
    tracks: Tracks,
    groups: Sequence[set[tuple[int, int]]],
    config: Config = QUICK,
    restarts: range | None = None,
) -> Solution:
    """The method with tracks and a grouping that are given instead of found in images."""
    orders = canonical(room.scene).elements
    number = [{e: n for n, e in enumerate(order)} for order in orders]
    renumbered = replace(
        tracks,
        element=np.array([number[k][e] for k, e in zip(tracks.key_frame, tracks.element, strict=True)]),
        tried=tuple(tried[list(order)] for tried, order in zip(tracks.tried, orders, strict=True)),
    )
    regrouped = [{(k, number[k][e]) for k, e in group} for group in groups]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(method, "track", lambda *_, **__: renumbered)
        patch.setattr(method, "with_wide_baselines", lambda scene, tracks, *_, **__: tracks)
        patch.setattr(method, "correspond", lambda scene, *_: form(replace(room, scene=scene), renumbered, regrouped))
        return method.solve(room.scene, config, restarts=restarts)


@pytest.fixture(scope="module")
def right() -> tuple[Room, Tracks, Solution]:
    """A room solved with its true instances."""
    room = make_room(orbit(), [3, 10, 17])
    tracks = make_tracks(room, np.random.default_rng(0))
    return room, tracks, solve(room, tracks, [set(instance.members) for instance in room.instances])


def check_same(found: Solution, expected: Solution) -> None:
    """Names and their order, members, hosts, tracks, planes: all of it."""
    assert found.layout.instances == expected.layout.instances
    assert np.array_equal(found.track_instance, expected.track_instance)
    for plane, same in zip(found.layout.planes, expected.layout.planes, strict=True):
        np.testing.assert_array_equal(plane.normal, same.normal)
        assert plane.d == same.d


def test_a_wall_cut_in_two_ends_as_one(right: tuple[Room, Tracks, Solution]) -> None:
    room, tracks, expected = right
    groups = [set(instance.members) for instance in room.instances]
    later = {(k, e) for k, e in groups[room.index("wall")] if k > 0}
    groups[room.index("wall")] -= later
    found = solve(room, tracks, [*groups, later])
    check_same(found, expected)
    assert expected.scene.warnings == ()
    (said,) = found.scene.warnings
    assert said.startswith("wall e") and "010.png are one plane" in said and said.endswith("joined")


def test_two_walls_with_exchanged_drawings_end_right(right: tuple[Room, Tracks, Solution]) -> None:
    room, tracks, expected = right
    found = solve(room, tracks, swapped(room, 1))
    check_same(found, expected)
    assert [line.rsplit(" ", 1)[1] for line in found.scene.warnings] == ["split"] * 2 + ["joined"] * 2


@pytest.mark.parametrize(("astray", "told"), [("first", False), ("second", True)])
def test_only_the_solve_that_is_kept_tells_that_it_was_led_astray(
    right: tuple[Room, Tracks, Solution], monkeypatch: pytest.MonkeyPatch, astray: str, told: bool
) -> None:
    """Two solves, of which the second is a restart and the only one asked for."""
    room, tracks, _ = right
    calls: list[str] = []
    honest = estimation.optimise

    def spoiled(*arguments: Any) -> Any:
        calls.append("second" if calls else "first")
        solution, uncertainty = honest(*arguments)
        if calls[-1] == astray:
            solution = replace(solution, planes=solution.planes * [1, 1, 1, 2.0])
        return solution, uncertainty

    monkeypatch.setattr(estimation, "optimise", spoiled)
    groups = [set(instance.members) for instance in room.instances]
    found = solve(room, tracks, groups, replace(QUICK, restarts=2), range(1, 2))
    assert calls == ["first", "second"]
    assert any("its start is kept" in line for line in found.scene.warnings) == told


def relabelled(room: Room, first: tuple[int, int], second: tuple[int, int]) -> Room:
    """The room with the labels of two elements of one key frame exchanged."""
    (k, a), (_, b) = first, second
    key_frames = list(room.scene.key_frames)
    elements = list(key_frames[k].elements)
    elements[a], elements[b] = (
        replace(elements[a], label=elements[b].label),
        replace(elements[b], label=elements[a].label),
    )
    key_frames[k] = replace(key_frames[k], elements=tuple(elements))
    return replace(room, scene=replace(room.scene, key_frames=tuple(key_frames)))


def test_exchanged_labels_are_named_and_take_no_part(right: tuple[Room, Tracks, Solution]) -> None:
    room, tracks, expected = right
    floor, wall = (
        next(m for m in room.instances[room.index(label)].members if m[0] == 1) for label in ("floor", "wall")
    )
    spoiled = relabelled(room, floor, wall)
    groups = [set(instance.members) - {floor, wall} for instance in room.instances]
    found = solve(spoiled, tracks, [*groups, {floor}, {wall}])
    (said,) = found.scene.warnings
    names = {room.scene.key_frames[1].elements[e].id for _, e in (floor, wall)}
    assert said.startswith("010.png: ") and "swapped?" in said and all(f" {name} " in said for name in names)
    alone = {i for i, one in enumerate(found.instances) if set(one.members) <= {floor, wall}}
    assert len(alone) == 2
    assert not np.isin(found.track_instance, sorted(alone)).any()
    assert not any(alone & set(edge.instances) for edge in found.edges)
    sampled = (tracks.key_frame == 1) & np.isin(tracks.element, [floor[1], wall[1]])
    assert (found.track_instance[sampled] == -1).all()
    for i, one in enumerate(found.instances):
        assert found.planes[i].observable == (i not in alone)
        if i not in alone:
            (true,) = (
                p for p, same in zip(expected.planes, expected.instances, strict=True) if one.members[0] in same.members
            )
            assert found.planes[i].normal @ true.normal > np.cos(np.deg2rad(1.0))


def test_a_lost_element_finds_back(right: tuple[Room, Tracks, Solution]) -> None:
    room, tracks, expected = right
    wall = room.index("wall")
    lost = next(m for m in room.instances[wall].members if m[0] == 2)
    here = (tracks.key_frame == lost[0]) & (tracks.element == lost[1])
    bare = chosen(tracks, np.nonzero(~here)[0])
    # An occlusion edge all round it: no contact places it either.
    key_frames = list(room.scene.key_frames)
    ring = np.array(key_frames[2].elements[lost[1]].amodal.geoms[0].exterior.coords)
    key_frames[2] = replace(key_frames[2], occlusion_edges=(ring,))
    cut = replace(room, scene=replace(room.scene, key_frames=tuple(key_frames)))
    groups = [set(instance.members) - {lost} for instance in room.instances]
    found = solve(cut, bare, [*groups, {lost}])
    assert partition(found.instances) == partition(expected.instances)
    (said,) = found.scene.warnings
    assert "are one plane by where its outline must lie" in said


def test_a_wall_that_others_were_joined_to_gives_them_back() -> None:
    """Without tracks only the drawings show that two of a wall's elements are another wall."""
    room, tracks, _ = simulated()
    a, b = (i for i, instance in enumerate(room.instances) if instance.label == "wall")
    groups = [set(instance.members) for instance in room.instances]
    own, astray = ({member for member in groups[i] if member[0] >= 3} for i in (a, b))
    bare = np.array([(k, e) not in astray for k, e in zip(tracks.key_frame, tracks.element, strict=True)])
    groups[a] ^= own | astray
    groups[b] -= astray
    found = solve(room, chosen(tracks, np.nonzero(bare)[0]), [*groups, own])
    assert partition(found.instances) == partition(room.instances)
    said = [line for line in found.scene.warnings if "by where its outline must lie" in line]
    assert len(said) == len(astray)


@pytest.mark.parametrize("whole", [False, True])
def test_what_contradicts_the_others_is_named_and_left_out(right: tuple[Room, Tracks, Solution], whole: bool) -> None:
    room, tracks, _ = right
    elements = room.scene.key_frames[1].elements
    wall = next(m for m in room.instances[room.index("wall")].members if m[0] == 1)
    strips = [pixels(0, 60 * e, 640, 60 * e + 50) for e in range(len(elements))]
    wrong = range(len(elements)) if whole else [wall[1]]
    scene = room.scene
    for e in wrong:
        scene = redraw(scene, 1, e, strips[e] if whole else pixels(0, 0, 60, 60))
    # Nothing was tracked on what was drawn beside every surface.
    here = (tracks.key_frame == 1) & np.isin(tracks.element, list(wrong))
    found = solve(
        replace(room, scene=scene),
        chosen(tracks, np.nonzero(~here)[0]),
        [set(instance.members) for instance in room.instances],
    )
    (said,) = found.scene.warnings
    named = "the whole drawing" if whole else f"wall {elements[wall[1]].id}"
    assert said.startswith(f"010.png: {named} contradicts what the other key frames show there and is left out")
    alone = {(1, e) for e in wrong}
    assert {one.members[0] for one in found.instances if len(one.members) == 1} == alone
    assert all(
        plane.observable == (one.members[0] not in alone)
        for plane, one in zip(found.planes, found.instances, strict=True)
    )
