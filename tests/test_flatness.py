"""Surfaces that bulge: what their tracks show beyond their noise, and what DIN 18202 permits."""

from __future__ import annotations

import csv
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import rooms

from gtlayout.accuracy import Flatness
from gtlayout.api import load_solved, save
from gtlayout.export import export_layout
from gtlayout.flatness.bends import Bend, bends
from gtlayout.flatness.config import FlatnessConfig
from gtlayout.flatness.din18202 import flatness_of, limit_m
from gtlayout.instances import Instance
from gtlayout.method import with_measurements
from gtlayout.report.files import solved_page
from gtlayout.results.tables import dimensions
from gtlayout.scene import FloatArray, Scene
from gtlayout.solution import Solution
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks

FAR, LEFT = 0, 1
SEEN = (rooms.FAR, rooms.LEFT)
VIEWS = 5
EACH = 80
NOISE = 0.004
"""σ of depth, as a share of it."""


def measured(
    bulge_m: float,
    seed: int = 0,
    shared_bend: float = 0.0,
    views: int = VIEWS,
    same_places: bool = False,
    cupboard: bool = False,
) -> tuple[tuple[Bend, ...], ...]:
    """The bends of two walls, of which the far one bulges into the room by a parabola over its 4 m.

    ``shared_bend``: what every key frame bends it by besides, as a share of the depth, by an error of its own.
    ``same_places``: all key frames have tracks of the same points. ``cupboard``: four fifths of the tracks amid the far
    wall are on something that stands 30 cm before it.
    """
    rng = np.random.default_rng(seed)
    cameras = [rooms.level_camera((1.2 + 0.4 * k, 0.5, 1.2)) for k in range(views)]
    scene = rooms.seen_from(cameras, SEEN)
    parts = []
    for k, camera in enumerate(cameras):
        for i, surface in enumerate(SEEN):
            across = surface.corners[1] - surface.corners[0], surface.corners[-1] - surface.corners[0]
            share = (np.random.default_rng(i) if same_places else rng).uniform(0.05, 0.95, (EACH, 2))
            points = surface.corners[0] + share @ np.stack(across)
            rays = points - camera.center_world
            rays /= (rays @ camera.R_cam_from_world[2])[:, None]
            depth = (points - camera.center_world) @ camera.R_cam_from_world[2]
            if i == FAR:
                parabola = 1 - (points[:, 0] / 2 - 1) ** 2
                error = shared_bend * rng.normal() * depth if shared_bend else 0.0
                depth = depth - (bulge_m + error) * parabola
                before = cupboard * (np.abs(points[:, 0] - 2.0) < 0.7) * (np.arange(EACH) % 5 > 0)
                depth = depth - 0.3 * before
            rho = (1 + NOISE * rng.normal(size=EACH)) / depth
            ones = np.ones(EACH, dtype=np.int64)
            parts.append((k * ones, i * ones, np.tile(camera.center_world, (EACH, 1)), rays, rho))
    key_frame, element, center, ray, rho = (np.concatenate(column) for column in zip(*parts, strict=True))
    number = np.arange(len(rho))
    nothing: FloatArray = np.zeros((len(rho), 2))
    tracks = Tracks(key_frame, element, number, key_frame, nothing, np.ones(len(rho)), ())
    triangulated = TriangulatedTracks(center, ray, nothing, rho, NOISE * rho, np.full(len(rho), 10.0))
    planes = np.array([[*surface.plane.normal, surface.plane.d] for surface in SEEN])
    instances = rooms.instances_of(SEEN, views)
    return bends(scene, instances, planes, tracks, triangulated, element, FlatnessConfig())


def judged(found: tuple[tuple[Bend, ...], ...], metric: bool = True) -> list[Flatness]:
    return [one for one in flatness_of(rooms.instances_of(SEEN, VIEWS), found, metric) if one is not None]


@pytest.mark.parametrize("bulge_m", [0.07, -0.07])
def test_a_wall_that_bulges_is_named_and_by_how_much(bulge_m: float) -> None:
    far, left = judged(measured(bulge_m))
    # Over the measured distance, a little less than the wall, a parabola is as much less.
    expected = bulge_m * (far.distance / rooms.WIDTH_M) ** 2
    assert far.status == "out"
    assert 3.0 < far.distance < rooms.WIDTH_M
    assert abs(far.deviation - expected) < 2.5 * far.sigma < 0.05
    assert far.deviation * bulge_m > 0
    assert left.status == "insufficient evidence"


def test_even_walls_are_not_named_and_sigma_is_honest() -> None:
    rooms_measured = [measured(0.0, seed, shared_bend=0.004) for seed in range(4)]
    normalised = np.array([one.deviation / one.sigma for found in rooms_measured for of_one in found for one in of_one])
    assert len(normalised) > 20
    assert 0.3 < np.sqrt(np.mean(normalised**2)) < 1.1
    assert all(one.status != "out" for found in rooms_measured for one in judged(found))


def test_what_only_the_key_frames_share_is_not_the_surface() -> None:
    """One key frame's error cannot be told from a bend, so nothing is said from few."""
    assert measured(0.07, views=2) == ((), ())
    assert [one.status for one in judged(((), ()))] == ["insufficient evidence"] * 2


def test_the_same_texture_seen_again_says_less_than_another() -> None:
    same, other = (measured(0.0, same_places=each)[LEFT] for each in (True, False))
    assert np.mean([one.sigma for one in same]) > 1.02 * np.mean([one.sigma for one in other])


def test_what_stands_before_a_wall_is_not_a_bulge() -> None:
    free, furnished = (judged(measured(0.0, cupboard=each))[FAR] for each in (False, True))
    assert furnished.status == free.status == "insufficient evidence"
    assert abs(furnished.deviation) < 2.5 * furnished.sigma < 0.05


def test_a_plane_that_is_off_its_tracks_is_as_flat(monkeypatch: pytest.MonkeyPatch) -> None:
    before = measured(0.07)[FAR]
    turned = replace(rooms.FAR, corners=rooms.FAR.corners + np.array([[0, 0.02, 0], [0, 0.08, 0]] * 2)[[0, 1, 3, 2]])
    monkeypatch.setattr("test_flatness.SEEN", (turned, rooms.LEFT))
    after = measured(0.07)[FAR]
    assert len(after) == len(before)
    assert after[0].deviation == pytest.approx(before[0].deviation, abs=0.01)


def test_what_din_18202_permits() -> None:
    """Table 3, and between its columns straight lines, rounded to millimetres."""
    assert [limit_m(6, each) for each in (0.1, 1, 2, 4, 10, 15, 30)] == [0.003, 0.005, 0.007, 0.01, 0.02, 0.025, 0.025]
    assert [limit_m(line, 4) for line in (3, 5, 6, 7)] == [0.01, 0.015, 0.01, 0.008]


def test_the_verdict_needs_all_directions_and_a_unit() -> None:
    wall = (Instance("wall_0", "wall", ()),)
    floor = (Instance("floor_0", "floor", ()),)
    door = (Instance("door_0", "door", (), 0),)
    flat, noisy, bulge = Bend(0.002, 0.001, 4.0), Bend(0.002, 0.008, 2.0), Bend(-0.03, 0.007, 2.0)

    def status(*found: Bend, of: tuple[Instance, ...] = wall, metric: bool = True) -> str:
        (one,) = flatness_of(of, (found,), metric)
        return one.status if one else "none"

    assert status(flat) == "within"
    assert status(flat, noisy) == "insufficient evidence"
    assert status(flat, noisy, bulge) == "out"
    assert status(bulge, metric=False) == "insufficient evidence"
    assert status(bulge, of=door) == "none"
    assert flatness_of(wall, ((flat, bulge),), True)[0] == Flatness(-0.03, 0.007, 2.0, 0.007, 6, "out")
    # 3.5 mm over 1 m: a floor may not be off by 4, a wall by 5.
    (of_floor,), (of_wall,) = (flatness_of(of, ((flat,),), True) for of in (floor, wall))
    assert of_floor is not None and of_wall is not None
    assert (of_floor.line, of_wall.line) == (3, 6)


def with_bulge(solution: Solution) -> Solution:
    """As if its first wall bulged."""
    layout = solution.layout
    wall = next(i for i, instance in enumerate(layout.instances) if instance.label == "wall")
    bulging = Flatness(0.048, 0.009, 3.6, 0.009, 6, "out")
    flatness = tuple(bulging if i == wall else one for i, one in enumerate(layout.flatness))
    return replace(solution, layout=replace(layout, flatness=flatness))


def test_a_solved_even_room_has_no_uneven_surface(room_solution: Solution) -> None:
    layout = room_solution.layout
    assert [one is None for one in layout.flatness] == [one.host is not None for one in layout.instances]
    known = [one for one in layout.flatness if one is not None and np.isfinite(one.deviation)]
    assert known
    assert all(one.status != "out" and 0 < one.sigma < 0.1 and 0.5 < one.distance < 6 for one in known)
    assert not [line for line in dimensions(layout) if "flatness" in line]


def test_it_is_kept_when_the_scale_is_measured(room_solution: Solution) -> None:
    """Twice the unit is twice the bulge."""
    scene: Scene = replace(room_solution.scene, scale_sigma_share=0.01)
    after = with_measurements(replace(room_solution, scene=scene))
    assert after.layout.scale is not None
    assert after.layout.flatness == flatness_of(room_solution.instances, after.bends, True)
    for of_one, other in zip(after.bends, room_solution.bends, strict=True):
        assert [one.deviation for one in of_one] == pytest.approx(
            [after.layout.scale.factor * one.deviation for one in other]
        )
    bend = Bend(0.01, 0.002, 3.0)
    assert bend.scaled(2.0) == Bend(0.02, 0.004, 6.0)


def test_it_is_in_every_file(room_solution: Solution, room: Path, tmp_path: Path) -> None:
    bulging = with_bulge(room_solution)
    name = next(instance.name for instance in room_solution.instances if instance.label == "wall")
    (line,) = [line for line in dimensions(bulging.layout) if "flatness" in line]
    assert line == (
        f"flatness {name}: bulges into the room by 48 ± 9 mm over 3.6 m (out: DIN 18202, table 3, line 6 permits 9 mm)"
    )
    save(bulging, tmp_path / "solved")
    scene, layout = load_solved(room, tmp_path / "solved")
    for one, other in zip(layout.flatness, bulging.layout.flatness, strict=True):
        np.testing.assert_equal(one and asdict(one), other and asdict(other))
    export_layout(tmp_path / "room.csv", scene, layout, "csv")
    rows = [row for row in csv.DictReader((tmp_path / "room.csv").open(encoding="utf-8")) if row["kind"] == "flatness"]
    assert len(rows) == sum(one is not None for one in layout.flatness)
    (row,) = [row for row in rows if row["of"] == name]
    assert (row["value"], row["unit"], row["sigma"], row["status"]) == ("0.048", "m", "0.009", "out")
    page = solved_page(bulging, "plotly.js")
    assert f'<tr class="out"><td>{name}</td><td class="n">+48 mm</td><td class="n">9 mm</td>' in page
