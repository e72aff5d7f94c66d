from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import rooms
import shapely
import trimesh
from shapely import MultiPolygon
from solved_rooms import solved

import gtlayout
from gtlayout.cli.app import main
from gtlayout.closing.close import close
from gtlayout.closing.low_walls import low_walls
from gtlayout.closing.plan import Plan
from gtlayout.closing.walls import wall_of
from gtlayout.closing_config import ClosingConfig
from gtlayout.export import export_layout
from gtlayout.export.floor_level import floor_frame
from gtlayout.export.floor_plan import floor_plan
from gtlayout.export.plan_drawing import draw
from gtlayout.export.plan_shapes import STYLES
from gtlayout.geometry.render import render
from gtlayout.solution import Solution

SEEN = (rooms.FLOOR, rooms.CEILING, rooms.LEFT, rooms.RIGHT, rooms.FAR)
FLOOR, CEILING, LEFT, RIGHT, FAR = range(5)


@pytest.fixture(scope="module")
def box() -> Solution:
    """The box room, its near part and near wall never seen."""
    cameras = [rooms.level_camera([x, 1.0, 1.25], focal=200.0, width=320, height=240) for x in (1.5, 2.0, 2.5)]
    return close(solved(cameras, [], SEEN))


def test_what_is_added_is_right_and_goes_to_abreast_of_the_cameras(box: Solution) -> None:
    for surface, extent, inferred in zip(SEEN, box.layout.extents, box.layout.inferred, strict=True):
        true = extent.frame.region([[surface.corners]])
        assert inferred.region.difference(true.buffer(1e-6)).area < 1e-6
        assert inferred.region.intersection(extent.region).area < 1e-9
    area = [e.region.area + i.region.area for e, i in zip(box.layout.extents, box.layout.inferred, strict=True)]
    # From the cameras at y = 1 to the far wall at y = 5: all of the shell.
    assert area[FLOOR] == pytest.approx(4 * 4, rel=0.01) == area[CEILING]
    assert area[LEFT] == pytest.approx(4 * 2.5, rel=0.01) == area[RIGHT]
    assert area[FAR] == pytest.approx(4 * 2.5, rel=0.01)


def test_nothing_seen_is_hidden_by_what_is_inferred(box: Solution) -> None:
    layout = box.layout
    for k in range(len(box.scene.key_frames)):
        camera = box.scene.frame_of(k).camera
        before, _ = layout.render(camera)
        whole = [
            replace(extent, region=MultiPolygon([*extent.region.geoms, *inferred.region.geoms]))
            for extent, inferred in zip(layout.extents, layout.inferred, strict=True)
        ]
        after, _ = render(layout.planes, whole, layout.instances, camera)
        assert (after[before >= 0] == before[before >= 0]).all()


def test_what_a_frame_shows_empty_stays_open() -> None:
    """A wall that is drawn to end within the image, beside nothing, does not go on there."""
    camera = rooms.level_camera([2.0, 1.0, 1.25], focal=120.0, width=320, height=240)
    short = rooms.Surface("wall", rooms.rectangle([0, 3.0, 0], rooms.Y * 0.4, rooms.Z))
    surfaces = (rooms.FLOOR, rooms.CEILING, short, rooms.RIGHT, rooms.FAR)
    closed = close(solved([camera], [], surfaces)).layout
    frame, inferred = closed.extents[LEFT].frame, closed.inferred[LEFT].region
    shown = rooms.rectangle([0, 2.6, 0.3], [0, 0.3, 0], [0, 0, 1.9])
    assert (camera.project(shown)[0] > 4.0).all()
    assert inferred.intersection(frame.region([[shown]])).area == 0
    # Without the frame that shows it, it would go on.
    unseen = rooms.rectangle([0, 1.2, 0.3], [0, 0.8, 0], [0, 0, 1.9])
    assert inferred.intersection(frame.region([[unseen]])).area > 0


def test_a_corner_is_closed_where_two_walls_meet_unseen() -> None:
    """The far and the right wall meet behind nothing: no image shows the far one up to there."""
    narrow = rooms.level_camera([1.5, 1.0, 1.25], focal=300.0, width=320, height=240)
    side = rooms.level_camera([1.5, 1.0, 1.25], focal=200.0, width=320, height=240)
    turned = side.placed(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([1.5, 2.0, 1.25]))
    closed = close(solved([narrow, turned], [], SEEN)).layout
    far = closed.extents[FAR]
    seen = far.frame.to_world(shapely.get_coordinates(far.region))
    whole = far.frame.to_world(shapely.get_coordinates(far.region.union(closed.inferred[FAR].region)))
    assert seen[:, 0].max() < 3.8
    assert whole[:, 0].max() == pytest.approx(4.0, abs=1e-3)
    assert whole[whole[:, 0] > 3.99, 2].min() == pytest.approx(0.0, abs=1e-3)


def low_front() -> Solution:
    """The box room with a run of cupboards 90 cm high along the right wall, to beside the cameras."""
    front = rooms.Surface("wall", rooms.rectangle([3.4, 2.0, 0.0], 0.9 * rooms.Z / rooms.HEIGHT_M, 0.6 * rooms.Y))
    cameras = [rooms.level_camera([x, 1.0, 1.6], focal=200.0, width=320, height=240) for x in (1.2, 1.7, 2.2)]
    return solved(cameras, [], (*SEEN, front))


def test_a_low_front_is_furniture_and_the_wall_behind_it_goes_on() -> None:
    front = 5
    layout = close(low_front()).layout
    assert layout.extents[front].region.area > 1.0
    assert layout.inferred[front].region.is_empty
    right = layout.extents[RIGHT].region.union(layout.inferred[RIGHT].region)
    # As without the front: from the cameras at y = 1 to the far wall, from the floor to the ceiling.
    assert right.area == pytest.approx(4 * 2.5, rel=0.01)
    floor = layout.extents[FLOOR].region.union(layout.inferred[FLOOR].region)
    assert floor.area == pytest.approx(4 * 4, rel=0.01)


def test_a_wall_is_low_only_where_frames_show_what_is_above_it() -> None:
    """By these settings no wall is low, and the front goes on up and to abreast of the cameras."""
    front = 5
    solution = low_front()
    tall = close(solution, replace(solution.config.closing, low_share=1.0))
    extent = tall.layout.extents[front]
    added = extent.frame.to_world(shapely.get_coordinates(tall.layout.inferred[front].region))
    assert added[:, 2].max() == pytest.approx(2.5, abs=0.01)
    assert added[:, 1].min() == pytest.approx(1.0, abs=0.02)
    assert tall.config.closing.low_share == 1.0


def test_a_wall_that_is_taller_than_the_cameras_is_not_low(box: Solution) -> None:
    """Key frames show something else wherever the walls are not, and still one cannot look over them."""
    layout = box.layout
    plan = Plan(floor_frame(box.scene, layout, range(5))[0])
    level = layout.planes[FLOOR]
    walls = {i: wall_of(plan, layout.planes[i], level) for i in (LEFT, RIGHT, FAR)}
    against = {i: shapely.box(-99, -99, 99, 99).difference(layout.extents[i].region) for i in walls}
    config = box.config.closing
    for eyes_height, expected in ((1.25, frozenset()), (2.6, frozenset(walls))):
        assert low_walls(layout, plan, walls, against, eyes_height, 3.0, config) == expected
    unknown = {i: MultiPolygon() for i in walls}
    assert low_walls(layout, plan, walls, unknown, 2.6, 3.0, config) == frozenset()


def test_walls_out_of_square_end_where_they_are_seen() -> None:
    """Where no wall is square to another, nothing tells that one goes on."""
    skew = rooms.rectangle([0, 0, 0], rooms.Y - 0.2 * rooms.X, rooms.Z)
    surfaces = (rooms.FLOOR, rooms.CEILING, rooms.Surface("wall", skew))
    camera = rooms.level_camera([2.0, 1.0, 1.25], focal=200.0, width=320, height=240)
    layout = close(solved([camera], [], surfaces)).layout
    extent = layout.extents[2]
    start = extent.frame.to_world(shapely.get_coordinates(extent.region))[:, 1].min()
    whole = extent.frame.to_world(shapely.get_coordinates(extent.region.union(layout.inferred[2].region)))
    assert whole[:, 1].min() == pytest.approx(start, abs=0.05)


def test_without_an_upright_direction_nothing_is_closed_and_that_is_said() -> None:
    camera = rooms.facing_camera()
    slanted = rooms.facing(10, 10, 90, 70, "slanted")
    closed = close(solved([camera], [], (slanted,)))
    assert [inferred.region.is_empty for inferred in closed.layout.inferred] == [True]
    assert "not closed" in closed.scene.warnings[-1]


def test_files_hold_a_layer_of_their_own_and_no_figure_counts_it(
    room: Path, room_solution: Solution, tmp_path: Path
) -> None:
    closed = gtlayout.close(room_solution)
    assert closed.quality is room_solution.quality
    gtlayout.save(room_solution, tmp_path / "open")
    gtlayout.save(closed, tmp_path / "closed")
    assert (tmp_path / "open" / "quality.json").read_bytes() == (tmp_path / "closed" / "quality.json").read_bytes()
    files = [json.loads((tmp_path / name / "layout.json").read_text()) for name in ("open", "closed")]
    assert any(row["extent"]["inferred"] for row in files[1]["instances"])
    for row in (row for data in files for row in data["instances"]):
        row["extent"].pop("inferred")
    assert files[0] == files[1]
    # The mesh of what was seen is the same; only a comment says that there is more.
    plys = [(tmp_path / name / "layout.ply").read_bytes() for name in ("open", "closed")]
    assert plys[1].replace(b"comment inferred: not in this file\n", b"") == plys[0] != plys[1]
    kept = json.loads((tmp_path / "closed" / "config.json").read_text())["config"]["closing"]
    assert kept == asdict(ClosingConfig())

    (scene, before), (_, after) = (gtlayout.load_solved(room, tmp_path / name) for name in ("open", "closed"))
    assert before.inferred == ()
    for one, other in zip(after.inferred, closed.layout.inferred, strict=True):
        assert one.region.symmetric_difference(other.region).area < 1e-9
    scores = [asdict(gtlayout.evaluate(scene, layout)) for layout in (before, after)]
    np.testing.assert_equal(scores[0], scores[1])

    export_layout(tmp_path / "room.glb", scene, after, "glb")
    export_layout(tmp_path / "room.obj", scene, after, "obj")
    export_layout(tmp_path / "room.usda", scene, after, "usd")
    nodes = trimesh.load_scene(tmp_path / "room.glb").geometry
    assert nodes["inferred_floor_0"].visual.material.name == "inferred" != nodes["floor_0"].visual.material.name
    area = after.inferred[0].region.area
    assert nodes["inferred_floor_0"].area == pytest.approx(area, rel=0.02)
    assert "usemtl inferred" in (tmp_path / "room.obj").read_text()
    assert "newmtl inferred" in (tmp_path / "room.mtl").read_text()
    assert 'def Mesh "inferred_floor_0"' in (tmp_path / "room.usda").read_text()
    export_layout(tmp_path / "room.ifc", scene, after, "ifc")
    assert "'floor_0 inferred'" in (tmp_path / "room.ifc").read_text()
    guessed = [line for line in draw(floor_plan(scene, after)).lines if line.layer == "inferred"]
    assert guessed
    assert STYLES["inferred"].dashes_mm
    assert not [line for line in draw(floor_plan(scene, before)).lines if line.layer == "inferred"]
    export_layout(tmp_path / "room.csv", scene, after, "csv")
    (row,) = [line for line in (tmp_path / "room.csv").read_text().splitlines() if line.startswith("inferred,floor_0")]
    assert row == f"inferred,floor_0,{area},m²,,,,inferred"

    assert main(["solve", str(room), "--close", "--out", str(tmp_path / "cli")]) == 0
    written = (tmp_path / "cli" / "layout.json").read_bytes()
    assert written == (tmp_path / "closed" / "layout.json").read_bytes()
