"""Stage 2 and hosts: the true instances of simulated rooms, and rules that hold whatever the votes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

import gtlayout
from gtlayout.correspondence.config import CorrespondenceConfig
from gtlayout.correspondence.matching import correspond
from gtlayout.errors import GtlayoutError
from gtlayout.geometry.hosts import find_hosts
from gtlayout.instances import Instance
from gtlayout.quality.assess import assess
from gtlayout.quality.config import QualityConfig
from gtlayout.scene import Camera, Element, FloatArray, Frame, IntArray, KeyFrame, Label, Scene
from gtlayout.tracking.config import TrackingConfig, TriangulationConfig
from gtlayout.tracking.track import track
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import triangulate
from simulated.simulated_room import Room, as_multi, box_faces, look_at, make_room, orbit
from simulated.simulation import chosen, make_tracks, no_tracks, true_instance

CONFIG = CorrespondenceConfig()
TRACKS_ONLY = replace(CONFIG, carried_weight=0.0)


def group(scene: Scene, tracks: Tracks, config: CorrespondenceConfig = CONFIG) -> tuple[tuple[Instance, ...], IntArray]:
    return correspond(scene, tracks, triangulate(scene, tracks, TriangulationConfig()), config)


def partition(instances: Iterable[Instance]) -> set[frozenset[tuple[int, int]]]:
    return {frozenset(instance.members) for instance in instances}


def check_rules(scene: Scene, instances: Sequence[Instance]) -> None:
    """Every element in exactly one instance, one element per key frame, one label, unique names."""
    members = [member for instance in instances for member in instance.members]
    everything = [(k, e) for k, key_frame in enumerate(scene.key_frames) for e in range(len(key_frame.elements))]
    assert sorted(members) == everything
    assert len({instance.name for instance in instances}) == len(instances)
    for instance in instances:
        assert len({k for k, _ in instance.members}) == len(instance.members)
        assert {scene.key_frames[k].elements[e].label for k, e in instance.members} == {instance.label}


@pytest.mark.parametrize("config", [CONFIG, TRACKS_ONLY])
@pytest.mark.parametrize("seed", range(3))
def test_shuffled_elements_find_each_other(seed: int, config: CorrespondenceConfig) -> None:
    room = make_room(orbit(), [2, 6, 10, 14, 18], seed=seed)
    tracks = make_tracks(room, np.random.default_rng(seed), drifting=0.1)
    instances, track_instance = group(room.scene, tracks, config)
    check_rules(room.scene, instances)
    assert partition(instances) == partition(room.instances)
    # The numbering may differ, what a track lies on may not.
    same = [[set(a.members) == set(b.members) for b in room.instances] for a in instances]
    renumbered = np.argmax(same, axis=1)[track_instance]
    assert np.mean(renumbered == true_instance(room, tracks)) > 0.98


def test_a_wall_that_leaves_the_image_and_comes_back_is_one_instance() -> None:
    # Look at the far corner, turn to the near one, look back: no track lasts that long.
    cameras = []
    for i, turn_deg in enumerate(np.concatenate([np.linspace(0, 100, 12), np.linspace(100, 0, 12)])):
        center = np.array([1.6 + 0.03 * i, 2.0 - 0.02 * i, 1.4])
        heading = np.deg2rad(50 - turn_deg)
        cameras.append(look_at(center, center + np.array([np.cos(heading), np.sin(heading), -0.08])))
    room = make_room(cameras, [1, 6, 11, 17, 22])
    walls = [instance for instance in room.instances if instance.label == "wall"]
    assert any({0, 4} == {k for k, _ in wall.members} for wall in walls), "the camera is meant to lose sight of a wall"
    instances, _ = group(room.scene, make_tracks(room, np.random.default_rng(0)))
    check_rules(room.scene, instances)
    # (Of the ceiling it sees separate slivers, which nothing in the images ties together.)
    assert partition(i for i in instances if i.label == "wall") == partition(walls)


def test_long_tracks_join_across_a_key_frame_that_lacks_the_element() -> None:
    room = make_room(orbit(), [6, 10, 14])
    wall = next(i for i, plane in enumerate(room.planes) if plane[1] < -0.9)
    missing = int(np.nonzero(room.instance_of[1] == wall)[0][0])
    key_frames = list(room.scene.key_frames)
    left = tuple(e for i, e in enumerate(key_frames[1].elements) if i != missing)
    key_frames[1] = replace(key_frames[1], elements=left)
    scene = replace(room.scene, key_frames=tuple(key_frames))
    tracks = make_tracks(room, np.random.default_rng(0))
    there = ~((tracks.key_frame == 1) & (tracks.element == missing))
    lower = (tracks.key_frame == 1) & (tracks.element > missing)
    tracks = chosen(replace(tracks, element=tracks.element - lower), np.nonzero(there)[0])
    instances, _ = group(scene, tracks, TRACKS_ONLY)
    check_rules(scene, instances)
    expected = {(k, e) for k, e in room.instances[wall].members if k != 1}
    assert expected in [set(instance.members) for instance in instances]


def test_labels_are_respected() -> None:
    room = make_room(orbit(), [6, 10, 14])
    elements = list(room.scene.key_frames[1].elements)
    floor = next(e for e, element in enumerate(elements) if element.label == "floor")
    elements[floor] = replace(elements[floor], label="slanted")
    key_frames = (room.scene.key_frames[0], KeyFrame(10, tuple(elements)), room.scene.key_frames[2])
    scene = replace(room.scene, key_frames=key_frames)
    instances, _ = group(scene, make_tracks(room, np.random.default_rng(0)))
    check_rules(scene, instances)
    assert ((1, floor),) in [instance.members for instance in instances]
    # The floor of the other two key frames stays together.
    assert [len(instance.members) for instance in instances if instance.label == "floor"] == [2]


def test_too_few_tracks_join_nothing() -> None:
    scene, tracks = paired(2)
    instances, _ = group(scene, tracks, TRACKS_ONLY)
    assert partition(instances) == {frozenset({(0, 0)}), frozenset({(1, 0)})}
    scene, tracks = paired(3)
    assert partition(group(scene, tracks, TRACKS_ONLY)[0]) == {frozenset({(0, 0), (1, 0)})}


def test_two_elements_of_one_key_frame_stay_apart() -> None:
    # Drawn as one wall in the first and the last key frame, as two in the middle one: votes for both halves.
    whole, left, right = shapely.box(10, 10, 190, 190), shapely.box(10, 10, 110, 190), shapely.box(110, 10, 190, 190)
    scene = flat_scene([[whole], [left, right], [whole]])
    x, y = np.meshgrid(np.arange(20, 190, 10.0), np.arange(20, 190, 20.0))
    points_px = np.column_stack([x.ravel(), y.ravel()])
    sampled_on = [np.zeros(len(points_px)), (points_px[:, 0] > 110), np.zeros(len(points_px))]
    tracks = standing(scene, points_px, np.array(sampled_on, dtype=np.int64))
    instances, _ = group(scene, tracks, TRACKS_ONLY)
    check_rules(scene, instances)
    # The larger half has more votes.
    assert partition(instances) == {frozenset({(0, 0), (1, 0), (2, 0)}), frozenset({(1, 1)})}


@pytest.mark.parametrize("seed", range(10))
def test_the_rules_hold_for_nonsense_votes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    labels: list[Label] = ["wall", "wall", "floor", "door"]
    regions = [
        [shapely.box(x, y, x + 60, y + 60) for x, y in rng.uniform(5, 130, (rng.integers(1, 5), 2))] for _ in range(5)
    ]
    scene = flat_scene(regions, [[labels[rng.integers(4)] for _ in frame] for frame in regions])
    count = 300
    key_frame = rng.integers(5, size=count)
    element = np.array([rng.integers(len(regions[k])) for k in key_frame])
    tracks = Tracks(
        key_frame,
        element,
        np.repeat(np.arange(count), 5),
        np.tile(np.arange(5), count),
        rng.uniform(0, 200, (5 * count, 2)),
        np.ones(count),
        tuple(np.full(len(frame), 50) for frame in regions),
    )
    instances, track_instance = group(scene, tracks)
    check_rules(scene, instances)
    assert track_instance.min() >= -1 and track_instance.max() < len(instances)
    again, again_instance = group(scene, tracks)
    assert again == instances
    assert np.array_equal(again_instance, track_instance)


def test_a_track_belongs_to_where_most_of_its_positions_fall() -> None:
    left, right = shapely.box(10, 10, 100, 190), shapely.box(100, 10, 190, 190)
    scene = flat_scene([[left, right]] * 3)
    y = np.arange(20, 190, 10.0)
    on_left, on_right = np.column_stack([0 * y + 50, y]), np.column_stack([0 * y + 150, y])
    start = np.concatenate([on_left, on_right, [[98.0, 100.0]]])
    element = np.repeat([0, 1, 0], [len(y), len(y), 1])
    tracks = standing(scene, start, np.array([element, element, element]))
    # The last point of the first key frame was sampled a hair left of the line; elsewhere it is on the right.
    last = 2 * len(y)
    moved = tracks.points_px.copy()
    moved[(tracks.track == last) & (tracks.frame > 0)] = [103.0, 100.0]
    instances, track_instance = group(scene, replace(tracks, points_px=moved), TRACKS_ONLY)
    assert len(instances) == 2
    right_instance = next(i for i, instance in enumerate(instances) if (0, 1) in instance.members)
    assert track_instance[last] == right_instance
    assert track_instance[0] != right_instance


def test_without_tracks_every_element_is_its_own_instance() -> None:
    scene = make_room(orbit(), [6, 10]).scene
    instances, track_instance = group(scene, no_tracks(scene))
    check_rules(scene, instances)
    assert len(instances) == sum(len(key_frame.elements) for key_frame in scene.key_frames)
    assert track_instance.shape == (0,)


@pytest.mark.parametrize("drawn_through", [True, False])
def test_a_door_finds_the_wall_it_lies_in(drawn_through: bool) -> None:
    door = shapely.box(60, 60, 90, 150)
    wall = shapely.box(0, 0, 120, 150)
    regions: list[BaseGeometry] = [shapely.box(120, 0, 200, 150), shapely.box(0, 150, 200, 200), door, wall]
    if not drawn_through:
        regions[3] = wall.difference(door)
    assert hosts_of(regions, ["wall", "floor", "door", "wall"]) == [None, None, 3, None]


def test_hosts_are_walls_or_none() -> None:
    door, floor = shapely.box(60, 60, 90, 150), shapely.box(0, 150, 200, 200)
    assert hosts_of([door, floor], ["door", "floor"]) == [None, None]
    # A skylight may lie in a ceiling, a door may not.
    above = shapely.box(40, 40, 120, 170)
    assert hosts_of([door, above], ["window", "ceiling"]) == [1, None]
    assert hosts_of([door, above], ["door", "ceiling"]) == [None, None]
    # One opening never hosts another.
    assert hosts_of([door, shapely.box(50, 50, 100, 160)], ["window", "door"]) == [None, None]


def test_doors_of_a_simulated_room_get_their_host() -> None:
    corners = np.array([[2.0, 5, 0], [2.0, 5, 2], [2.9, 5, 2], [2.9, 5, 0]])
    room: Room = make_room(
        orbit(), [2, 6, 10, 14], [*box_faces(), replace(box_faces()[5], label="door", corners=corners)]
    )
    instances, _ = group(room.scene, make_tracks(room, np.random.default_rng(0)))
    check_rules(room.scene, instances)
    (door,) = (instance for instance in instances if instance.label == "door")
    assert len(door.members) == 4
    assert door.host is not None
    k, e = instances[door.host].members[0]
    np.testing.assert_allclose(room.planes[room.instance_of[k][e]], [0, -1, 0, 5], atol=1e-12)


def hosts_of(regions: Sequence[BaseGeometry], labels: Sequence[Label]) -> list[int | None]:
    scene = flat_scene([list(regions)], [list(labels)])
    instances = [Instance(f"{label}_{i}", label, ((0, i),)) for i, label in enumerate(labels)]
    return find_hosts(scene, instances)


def flat_scene(regions: Sequence[Sequence[BaseGeometry]], labels: Sequence[Sequence[Label]] | None = None) -> Scene:
    """A key frame per list of regions, 200x200 px, the camera moving sideways."""
    frames, key_frames = [], []
    for k, drawn in enumerate(regions):
        t = np.array([-0.1 * k, 0.0, 0.0])
        camera = Camera(np.array([[200.0, 0, 100], [0, 200, 100], [0, 0, 1]]), np.eye(3), t, 200, 200)
        frames.append(Frame(f"{k}.png", Path(f"/nowhere/{k}.png"), camera))
        elements = [
            Element(f"e{e}", "wall" if labels is None else labels[k][e], as_multi(r), MultiPolygon())
            for e, r in enumerate(drawn)
        ]
        key_frames.append(KeyFrame(k, tuple(elements)))
    return Scene(Path("/nowhere"), tuple(frames), tuple(key_frames), metric=True)


def standing(scene: Scene, points_px: FloatArray, element: IntArray) -> Tracks:
    """Points sampled in every key frame, (key frames, points) ``element``; each stands still throughout."""
    frames, count = len(scene.frames), len(points_px)
    total = frames * count
    return Tracks(
        np.repeat(np.arange(frames), count),
        element.ravel(),
        np.repeat(np.arange(total), frames),
        np.tile(np.arange(frames), total),
        np.repeat(np.tile(points_px, (frames, 1)), frames, axis=0),
        np.ones(total),
        tuple(np.full(len(key_frame.elements), count) for key_frame in scene.key_frames),
    )


def paired(count: int) -> tuple[Scene, Tracks]:
    """Two key frames with one wall each, and ``count`` tracks sampled in the first."""
    scene = flat_scene([[shapely.box(10, 10, 190, 190)]] * 2)
    points_px = np.column_stack([np.arange(count) * 10.0 + 50, np.full(count, 100.0)])
    both = standing(scene, points_px, np.zeros((2, count), dtype=np.int64))
    return scene, chosen(both, np.arange(count))


@pytest.mark.parametrize("empty", [0, 1, 2])
def test_a_key_frame_without_elements_changes_nothing(empty: int) -> None:
    room = make_room(orbit(), [2, 6, 10], seed=0)
    tracks = make_tracks(room, np.random.default_rng(0))
    key_frames = list(room.scene.key_frames)
    key_frames[empty] = replace(key_frames[empty], elements=(), occlusion_edges=())
    scene = replace(room.scene, key_frames=tuple(key_frames))
    elsewhere = chosen(tracks, np.nonzero(tracks.key_frame != empty)[0])
    instances, _ = group(scene, elsewhere)
    check_rules(scene, instances)
    whole = {frozenset(member for member in i.members if member[0] != empty) for i in room.instances} - {frozenset()}
    assert partition(instances) == whole


@pytest.mark.parametrize("key_frames", [(), (KeyFrame(0, ()),), (KeyFrame(0, ()), KeyFrame(3, ()))])
def test_nothing_annotated_at_all_is_one_line(key_frames: tuple[KeyFrame, ...]) -> None:
    scene = replace(make_room(orbit(), [2], seed=0).scene, key_frames=key_frames)
    for work in (
        lambda: group(scene, no_tracks(scene)),
        lambda: track(scene, TrackingConfig(), 0),
        lambda: assess(scene, (), (), (), QualityConfig()),
        lambda: gtlayout.solve(scene),
    ):
        with pytest.raises(GtlayoutError, match=r"no element is annotated in any frame, .* draw the surfaces"):
            work()
