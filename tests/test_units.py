"""scene.json: the unit of the cameras becomes the metre once, and a unit that cannot be right is doubted."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rooms
from camera_formats import FORMATS, cameras_in_general_position

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.instances import Instance, Plane
from gtlayout.io.pixels.images import read_depth
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.units import METRES
from gtlayout.quality.assess import assess
from gtlayout.quality.config import QualityConfig
from gtlayout.quality.headline import Headline
from gtlayout.quality.unit import depth_doubt, unit_doubt

Edit = Callable[[Path, Callable[[Any], object]], None]
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1, "in": 0.0254, "ft": 0.3048}


def say(root: Path, data: object) -> None:
    (root / "scene.json").write_text(json.dumps(data))


def test_the_units_are_these() -> None:
    assert METRES == UNITS


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("beside", [{}, {"metric": True}])
def test_positions_become_metres(tiny: Path, unit: str, beside: dict[str, bool]) -> None:
    before = load_scene(tiny)
    say(tiny, {"unit": unit, **beside})
    scene = load_scene(tiny)
    assert scene.metric
    assert scene.warnings == before.warnings
    for a, b in zip(before.frames, scene.frames, strict=True):
        np.testing.assert_allclose(b.camera.center_world, UNITS[unit] * a.camera.center_world, rtol=1e-15)
        np.testing.assert_array_equal(b.camera.R_cam_from_world, a.camera.R_cam_from_world)


def test_depth_maps_are_millimetres_whatever_the_unit(tiny: Path) -> None:
    (tiny / "depth").mkdir()
    (tiny / "depth/001.png").write_bytes(cv2.imencode(".png", np.full((48, 64), 1500, np.uint16))[1].tobytes())
    say(tiny, {"unit": "ft"})
    assert (read_depth(load_scene(tiny).frames[1]) == 1.5).all()


def test_a_unit_goes_before_that_of_the_format(tmp_path: Path) -> None:
    FORMATS["scannet"](tmp_path, cameras_in_general_position())
    before = load_scene(tmp_path).frames[1].camera.center_world
    say(tmp_path, {"unit": "mm"})
    np.testing.assert_allclose(load_scene(tmp_path).frames[1].camera.center_world, before / 1000)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        *(
            (data, r'scene.json must be {"unit": …} with one of "mm", "cm", "m", "in", "ft", or')
            for data in (
                *({}, {"unit": "yd"}, {"unit": None}, {"unit": 1}, {"unit": ["mm"]}, {"units": "mm"}),
                *({"metric": 1}, {"metric": None}, {"metric": "true"}, {"unit": "mm", "scale": 2}),
            )
        ),
        ({"unit": "mm", "metric": False}, r'"metric": false says that the unit is not known, "unit": "mm" that it is'),
        ([], "must hold a JSON object"),
    ],
)
def test_a_unit_that_is_none(tiny: Path, data: object, says: str) -> None:
    say(tiny, data)
    with pytest.raises(GtlayoutError, match=says):
        load_scene(tiny)


def test_import_writes_metres(tiny: Path, tmp_path: Path) -> None:
    say(tiny, {"unit": "in"})
    assert main(["import", str(tiny), str(tmp_path / "out/scene")]) == 0
    assert json.loads((tmp_path / "out/scene/scene.json").read_text()) == {"metric": True}
    before, after = load_scene(tiny), load_scene(tmp_path / "out/scene")
    for a, b in zip(before.frames, after.frames, strict=True):
        np.testing.assert_allclose(b.camera.center_world, a.camera.center_world, atol=1e-12)


@pytest.mark.parametrize(
    ("depth", "says"),
    [
        (0.29, "no room is that size"),
        (0.31, None),
        (29, None),
        (31, "looks like centimetres"),
        (2500, "looks like millimetres"),
        (30_000, "no room is that size"),
        (np.nan, None),
    ],
)
def test_depths_that_rooms_have(depth: float, says: str | None) -> None:
    found = depth_doubt(depth, QualityConfig())
    assert (found is None) == (says is None)
    assert says is None or found is None or says in found


def verdict(size: float, metric: bool) -> Headline:
    """On the box room without the wall behind the camera, so many times as large, drawn perfectly in two frames."""
    surfaces = [rooms.Surface(surface.label, size * surface.corners) for surface in rooms.BOX[:-1]]
    camera = rooms.level_camera(size * np.array([2.0, 0.5, 1.25]))
    scene = replace(rooms.seen_from([camera] * 2, surfaces), metric=metric)
    planes, extents = [surface.plane for surface in surfaces], [surface.extent for surface in surfaces]
    return assess(scene, rooms.instances_of(surfaces, 2), planes, extents, QualityConfig()).headline


@pytest.mark.parametrize(("size", "says"), [(1, None), (0.001, "no room is that size"), (1000, "like millimetres")])
def test_the_verdict_does_not_trust_the_unit_of_a_room_that_cannot_be(size: float, says: str | None) -> None:
    found = verdict(size, metric=True)
    doubts = [reason for reason in found.reasons if "counts as metric" in reason]
    assert bool(doubts) == (says is not None)
    if says is not None:
        assert found.word != "trust"
        assert says in found.reasons[0]
        assert 'name the unit of the cameras in scene.json ({"unit": "mm"}, cm, m, in or ft)' in doubts[0]
    assert not any("counts as metric" in reason for reason in verdict(size, metric=False).reasons)


@pytest.mark.parametrize(("height", "doubted"), [(9.9, False), (10.1, True), (-40, True), (np.nan, False)])
def test_no_camera_is_so_high_above_the_floor(height: float, doubted: bool) -> None:
    """Whichever way its plane is turned; what is drawn is near. A floor of which nothing is known says nothing."""
    scene = rooms.seen_from([rooms.level_camera([0, 0, 1])] * 3, [rooms.FAR])
    floor = Plane(np.array([0.0, 0, 1]), height - 1, np.zeros((4, 4)), observable=bool(np.isfinite(height)))
    instances = [Instance("floor_0", "floor", ()), Instance("wall_0", "wall", ())]
    planes = [floor, rooms.FAR.plane]
    found = unit_doubt(scene, instances, planes, np.array([2.0, 3.0]), QualityConfig())
    assert (found is not None) == doubted
    assert found is None or "m above the floor (median), higher than any room" in found
    assert unit_doubt(replace(scene, metric=False), instances, planes, np.array([2.0]), QualityConfig()) is None
