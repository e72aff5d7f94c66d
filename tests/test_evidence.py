"""What stage 4 starts from: how much tracks weigh, and which of them take part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapely import MultiPolygon

from gtlayout.planes.config import EstimationConfig
from gtlayout.planes.evidence import Evidence, followed, gather
from gtlayout.planes.graph import track_weights
from gtlayout.tracking.normalisation import Normalisation
from gtlayout.tracking.tracks import Tracks
from simulated.simulated_room import Room, make_room, orbit
from simulated.simulation import make_tracks, measurements


@pytest.fixture(scope="module")
def room() -> Room:
    return make_room(orbit(), [3, 10, 17])


@pytest.fixture(scope="module")
def tracks(room: Room) -> Tracks:
    return make_tracks(room, np.random.default_rng(0))


def evidence_of(room: Room, tracks: Tracks, config: EstimationConfig) -> Evidence:
    measured = measurements(room, tracks)
    return gather(measured, Normalisation.of(measured.rays), config)


def test_a_track_weighs_by_the_observations_that_the_graph_takes(room: Room, tracks: Tracks) -> None:
    observations = np.bincount(tracks.track)
    assert observations.min() < 6 < observations.max()
    config = replace(EstimationConfig(), full_survival=1e-9, full_tracks=1e-9)
    weight = evidence_of(room, tracks, config).track_weight
    np.testing.assert_allclose(weight, np.minimum(1.0, 3.0 / np.minimum(observations, 6)))


def test_an_instance_is_trusted_by_the_share_of_its_points_that_could_be_followed(room: Room, tracks: Tracks) -> None:
    few = replace(tracks, tried=tuple(10 * tried for tried in tracks.tried))
    config = replace(EstimationConfig(), independent_observations=1e9, full_tracks=1e-9)
    evidence = evidence_of(room, few, config)
    for i, instance in enumerate(room.instances):
        kept, tried = followed(room.scene, few, instance)
        own = evidence.track_weight[evidence.track_instance == i]
        np.testing.assert_allclose(own, min(kept / tried / config.full_survival, 1.0))
        assert own.max() < 1.0


def test_more_tracks_than_the_graph_takes_are_thinned_out_evenly(room: Room, tracks: Tracks) -> None:
    most = 20
    evidence = evidence_of(room, tracks, replace(EstimationConfig(), max_tracks=most))
    for i in range(len(room.instances)):
        own = np.nonzero(evidence.track_instance == i)[0]
        assert len(own) == most
        assert set(tracks.key_frame[own]) == {0, 1, 2}


def test_walls_stand_at_right_angles_to_floors_and_ceilings_and_to_nothing_else(room: Room, tracks: Tracks) -> None:
    labels = [instance.label for instance in room.instances]
    evidence = evidence_of(room, tracks, EstimationConfig())
    for a, first in enumerate(labels):
        for b, second in enumerate(labels):
            assert evidence.perpendicular[a, b] == ((first == "wall") != (second == "wall"))


def test_points_count_on_visible_parts_only_where_there_are_some(room: Room, tracks: Tracks) -> None:
    instance = room.instances[2]
    k, e = instance.members[0]
    key_frames = list(room.scene.key_frames)
    elements = list(key_frames[k].elements)
    elements[e] = replace(elements[e], visible=MultiPolygon())
    key_frames[k] = replace(key_frames[k], elements=tuple(elements))
    scene = replace(room.scene, key_frames=tuple(key_frames))
    own = (tracks.key_frame == k) & (tracks.element == e)
    kept, tried = followed(room.scene, tracks, instance)
    assert followed(scene, tracks, instance) == (kept - int(np.count_nonzero(own)), tried - int(tracks.tried[k][e]))
    nowhere = replace(instance, members=((k, e),))
    assert followed(scene, tracks, nowhere) == (int(np.count_nonzero(own)), int(tracks.tried[k][e]))


def test_tracks_of_an_instance_in_one_key_frame_weigh_so_much_together(room: Room, tracks: Tracks) -> None:
    measured = measurements(room, tracks)
    local = Normalisation.of(measured.rays)
    planes = room.planes.copy()
    planes[:, 3] = local.scale * (planes[:, 3] + planes[:, :3] @ local.origin)
    for most in (0.5, 4.0, 1e9):
        config = replace(EstimationConfig(), max_track_weight=most)
        evidence = gather(measured, local, config)
        robust, weight = track_weights(evidence, planes, config)
        own = robust * evidence.track_weight
        for i in range(len(room.instances)):
            for k in range(3):
                together = (evidence.track_instance == i) & (evidence.track_key_frame == k)
                expected = own[together] * min(1.0, most / max(own[together].sum(), 1e-9))
                np.testing.assert_allclose(weight[together], expected)


def test_the_tracks_of_a_plane_that_is_nowhere_have_no_weight(room: Room, tracks: Tracks) -> None:
    measured = measurements(room, tracks)
    local = Normalisation.of(measured.rays)
    planes = room.planes.copy()
    planes[:, 3] = local.scale * (planes[:, 3] + planes[:, :3] @ local.origin)
    planes[1] = np.nan
    evidence = gather(measured, local, EstimationConfig())
    robust, weight = track_weights(evidence, planes, EstimationConfig())
    nowhere = evidence.track_instance == 1
    assert nowhere.any()
    assert not robust[nowhere].any() and not weight[nowhere].any()
    assert (robust[evidence.track_instance == 0] > 0.5).any()
