"""Stage 7: IoU counted by hand, σ in closed form, verdicts with their reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
from shapely import MultiPolygon

from gtlayout.instances import Extent, Instance, Plane, Support
from gtlayout.quality.assess import Quality, assess
from gtlayout.quality.config import QualityConfig
from gtlayout.quality.depth import drawn_pixels
from gtlayout.quality.measures import InstanceQuality
from gtlayout.scene import Scene

CAMERA = rooms.facing_camera()


def _assess(
    scene: Scene, surfaces: Sequence[rooms.Surface], planes: Sequence[Plane] | None = None, **limits: float
) -> Quality:
    """``surfaces`` is the layout; element e of each key frame belongs to surface e."""
    return assess(
        scene,
        rooms.instances_of(surfaces, len(scene.key_frames)),
        planes or [surface.plane for surface in surfaces],
        [surface.extent for surface in surfaces],
        QualityConfig(**limits),
    )


def test_perfect_layout_scores_one() -> None:
    surfaces = rooms.BOX[:5]
    quality = _assess(rooms.seen_from([rooms.level_camera([2.0, 1.0, 1.25])], surfaces), surfaces)
    assert quality.iou == 1.0
    assert quality.accepted
    assert quality.openings_iou is None
    assert {judged.verdict for judged in quality.instances} == {"ok"}
    assert {judged.reason for judged in quality.instances} == {""}


def test_iou_counted_by_hand() -> None:
    """Two frames of two elements. The second draws 40x40 of 50x40 px (0.8) and is off by 10 of 40 px (0.6)."""
    drawn: list[rooms.Drawing] = [
        ("wall", rooms.pixels(0, 0, 40, 40)),
        ("wall", rooms.pixels(60, 0, 100, 40)),
    ]
    exact: list[rooms.Drawing] = [
        ("wall", rooms.pixels(0, 0, 50, 40)),
        ("wall", rooms.pixels(60, 10, 100, 50)),
    ]
    surfaces = (rooms.facing(0, 0, 50, 40), rooms.facing(60, 10, 100, 50))
    quality = _assess(rooms.make_scene([CAMERA, CAMERA], [exact, drawn]), surfaces)
    assert [(e.key_frame, e.element, e.instance) for e in quality.elements] == [
        (0, 0, 0),
        (0, 1, 1),
        (1, 0, 0),
        (1, 1, 1),
    ]
    assert [e.iou for e in quality.elements] == pytest.approx([1.0, 1.0, 0.8, 0.6])
    assert quality.frames == pytest.approx((1.0, 0.7))
    assert quality.iou == pytest.approx(0.85)
    assert [judged.iou for judged in quality.instances] == pytest.approx([0.9, 0.8])
    assert quality.worst_frame == 1
    assert quality.worst_element == 3
    assert quality.accepted
    assert not _assess(rooms.make_scene([CAMERA], [drawn]), surfaces).accepted


def test_frames_count_alike_however_many_elements_they_show() -> None:
    """Frame 0: one element at 1.0; frame 1: the same and one that the layout lacks, at 0: mean of 1.0 and 0.5."""
    wall, lost = rooms.facing(0, 0, 40, 40), rooms.facing(60, 0, 100, 40)
    extents = [wall.extent, Extent(lost.extent.frame, rooms.NOTHING, rooms.NOTHING)]
    one: list[rooms.Drawing] = [("wall", rooms.pixels(0, 0, 40, 40))]
    both: list[rooms.Drawing] = [*one, ("wall", rooms.pixels(60, 0, 100, 40))]
    instances = (Instance("wall_0", "wall", ((0, 0), (1, 0))), Instance("wall_1", "wall", ((1, 1),)))
    scene = rooms.make_scene([CAMERA, CAMERA], [one, both])
    quality = assess(scene, instances, [wall.plane, lost.plane], extents, QualityConfig())
    assert quality.iou == pytest.approx(0.75)
    assert (quality.worst_frame, quality.elements[quality.worst_element].instance) == (1, 1)


@pytest.mark.parametrize("through", [False, True], ids=["tiled", "drawn on top"])
def test_openings_count_with_their_wall_and_alone(through: bool) -> None:
    """Wall 60x40 px; its door is drawn 10x30 and rendered 20x30 px. The wall with its door is exact either way."""
    door_px, wall_px = rooms.pixels(40, 20, 50, 50), rooms.pixels(20, 10, 80, 50)
    tiled = MultiPolygon([wall_px.difference(door_px)])
    surfaces = (rooms.facing(20, 10, 80, 50), rooms.facing(40, 20, 60, 50, "door", host=0))
    scene = rooms.make_scene([CAMERA], [[("wall", wall_px if through else tiled), ("door", door_px)]])
    quality = _assess(scene, surfaces)
    assert [e.iou for e in quality.elements] == pytest.approx([1.0, 0.5])
    assert quality.iou == 1.0
    assert quality.openings_iou == pytest.approx(0.5)
    assert [judged.verdict for judged in quality.instances] == ["ok", "weak"]
    # Without a host it is an element like any other, and bites a piece out of the wall.
    alone = _assess(scene, (surfaces[0], replace(surfaces[1], host=None)))
    assert alone.openings_iou is None
    assert alone.iou < 1.0


def test_frame_with_nothing_but_a_door_does_not_count() -> None:
    wall, door = rooms.facing(0, 0, 100, 80), rooms.facing(40, 20, 60, 50, "door", host=0)
    instances = (Instance("wall_0", "wall", ((0, 0),)), Instance("door_1", "door", ((1, 0),), host=0))
    drawings: list[list[rooms.Drawing]] = [
        [("wall", rooms.pixels(0, 0, 100, 80))],
        [("door", rooms.pixels(40, 20, 60, 50))],
    ]
    scene = rooms.make_scene([CAMERA, CAMERA], drawings)
    quality = assess(scene, instances, [wall.plane, door.plane], [wall.extent, door.extent], QualityConfig())
    assert quality.iou == 1.0
    assert np.isnan(quality.frames[1])
    assert quality.worst_frame == 0


def test_sigmas_of_a_facing_wall() -> None:
    """σ of d is σ of the depth of a wall the camera looks at squarely; the normal's σ is an angle."""
    surface = rooms.facing(20, 10, 80, 70)
    covariance = np.diag([np.deg2rad(2.0) ** 2, 0.0, np.deg2rad(1.0) ** 2, 0.3**2])
    scene = rooms.seen_from([CAMERA], [surface])
    (judged,) = _assess(scene, [surface], [replace(surface.plane, covariance=covariance)]).instances
    assert judged.sigma_normal_deg == pytest.approx(2.0)
    assert judged.depth == pytest.approx(rooms.WALL_DEPTH)
    assert judged.sigma_depth == pytest.approx(0.3)
    assert (judged.verdict, judged.reason) == ("ok", "")


def test_sigma_of_depth_on_the_floor_is_taken_along_the_ray() -> None:
    """The floor's height known to 1 cm: at row 75, 1.25 m below and 4 m away, that is 1 cm · 4 / 1.25 of depth."""
    camera = rooms.level_camera([2.0, 1.0, 1.25])
    scene = rooms.make_scene([camera], [[("floor", rooms.pixels(60, 70, 100, 80))]])
    plane = replace(rooms.FLOOR.plane, covariance=np.diag([0, 0, 0, 0.01**2]))
    (judged,) = _assess(scene, [rooms.FLOOR], [plane]).instances
    assert judged.depth == pytest.approx(4.0)
    assert judged.sigma_depth == pytest.approx(0.01 * 4.0 / 1.25)


def test_verdicts_say_why() -> None:
    surface = rooms.facing(20, 10, 80, 70)
    scene = rooms.seen_from([CAMERA], [surface])

    def judged(plane: Plane, drawn: Scene = scene) -> tuple[str, str]:
        (quality,) = _assess(drawn, [surface], [plane]).instances
        return quality.verdict, quality.reason

    def known_to(normal_deg: float, depth: float) -> Plane:
        return replace(surface.plane, covariance=np.diag([np.deg2rad(normal_deg) ** 2, 0, 0, depth**2]))

    assert judged(known_to(2.9, 0.29)) == ("ok", "")
    assert judged(known_to(3.1, 0.0)) == ("weak", "normal uncertain by more than 3°")
    assert judged(known_to(0.0, 0.31)) == ("weak", "depth uncertain by more than 3 %")
    half = rooms.redraw(scene, 0, 0, rooms.pixels(20, 10, 50, 70))
    assert judged(known_to(3.1, 0.0), half) == ("weak", "IoU below 0.8; normal uncertain by more than 3°")
    lost = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False, note="no track places it")
    assert judged(lost) == ("unobservable", "no track places it")


def test_centroid_that_misses_the_plane_is_weak_not_a_crash() -> None:
    """A floor drawn above its horizon: no depth there at all."""
    camera = rooms.level_camera([2.0, 1.0, 1.25])
    scene = rooms.make_scene([camera], [[("floor", rooms.pixels(60, 10, 100, 20))]])
    (judged,) = _assess(scene, [rooms.FLOOR]).instances
    assert np.isnan(judged.depth)
    assert judged.verdict == "weak"
    assert "depth uncertain" in judged.reason


def test_limits_come_from_the_configuration() -> None:
    surface = rooms.facing(20, 10, 80, 70)
    scene = rooms.redraw(rooms.seen_from([CAMERA], [surface]), 0, 0, rooms.pixels(20, 10, 50, 70))
    assert not _assess(scene, [surface]).accepted
    quality = _assess(scene, [surface], accept_iou=0.5)
    assert quality.accepted
    assert quality.instances[0].verdict == "ok"


def _known_to(surface: rooms.Surface, depth: float) -> Plane:
    return replace(surface.plane, covariance=np.diag([0, 0, 0, depth**2]))


def test_predicted_share_by_hand() -> None:
    """Three quarters of the pixels known to 1 % of their depth and a quarter to 9 %: 3 % in the mean."""
    surfaces = (rooms.facing(0, 0, 60, 80), rooms.facing(60, 0, 80, 80))
    planes = [_known_to(surfaces[0], 0.1), _known_to(surfaces[1], 0.9)]
    scene = rooms.seen_from([CAMERA], surfaces)
    quality = _assess(scene, surfaces, planes)
    assert quality.sigma_depth_share == pytest.approx(0.03)
    assert quality.predicted == "trustworthy"
    assert _assess(scene, surfaces, planes, trusted_sigma_depth_share=0.029).predicted == "doubtful"


def test_both_verdicts_are_independent() -> None:
    """A perfect rendering of nobody knows what, and a bad rendering of planes known well."""
    surface = rooms.facing(20, 10, 80, 70)
    scene = rooms.seen_from([CAMERA], [surface])
    vague = _assess(scene, [surface], [_known_to(surface, 0.6)])
    assert (vague.accepted, vague.predicted) == (True, "doubtful")
    half = rooms.redraw(scene, 0, 0, rooms.pixels(20, 10, 50, 70))
    sharp = _assess(half, [surface], [_known_to(surface, 0.1)])
    assert (sharp.accepted, sharp.predicted) == (False, "trustworthy")


def test_what_is_unobservable_counts_as_wholly_unknown() -> None:
    surfaces = (rooms.facing(0, 0, 76, 80), rooms.facing(76, 0, 80, 80), rooms.facing(80, 0, 100, 80))
    scene = rooms.seen_from([CAMERA], surfaces)
    lost = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False)
    exact = [surface.plane for surface in surfaces]
    small, large = _assess(scene, surfaces, [exact[0], lost, exact[2]]), _assess(scene, surfaces, [*exact[:2], lost])
    assert [small.sigma_depth_share, large.sigma_depth_share] == pytest.approx([0.04, 0.2])
    assert (small.predicted, large.predicted) == ("trustworthy", "doubtful")
    # No more than wholly, however large σ is.
    assert _assess(scene, surfaces, [*exact[:2], _known_to(surfaces[2], 1e6)]).sigma_depth_share == pytest.approx(0.2)


def test_pixels_drawn_where_the_plane_is_not_seen_count_as_unknown() -> None:
    """A floor drawn as much above its horizon (row 50) as below it."""
    camera = rooms.level_camera([2.0, 1.0, 1.25])
    scene = rooms.make_scene([camera], [[("floor", rooms.pixels(60, 20, 100, 80))]])
    assert _assess(scene, [rooms.FLOOR]).sigma_depth_share == pytest.approx(0.5, abs=0.05)


def test_causes_are_given_for_what_is_uncertain_only() -> None:
    surface = rooms.facing(20, 10, 80, 70)
    scene = rooms.seen_from([CAMERA], [surface])
    thin = Support(tracks=3, survived=0.5, parallax_deg=1.0, outvoted=0.0, contact_edges=1, edge_px=1.0)

    def judged(plane: Plane, drawn: Scene = scene) -> InstanceQuality:
        return _assess(drawn, [surface], [replace(plane, support=thin)]).instances[0]

    said = ("seen under 1.0° of parallax", "held by 3 tracks")
    assert judged(_known_to(surface, 0.6)).causes == said
    assert judged(replace(surface.plane, observable=False)).causes == said
    assert judged(surface.plane).causes == ()
    badly_drawn = judged(surface.plane, rooms.redraw(scene, 0, 0, rooms.pixels(20, 10, 50, 70)))
    assert (badly_drawn.verdict, badly_drawn.causes) == ("weak", ())


def test_what_covers_no_pixel_and_is_not_rendered_scores_nothing() -> None:
    """An element smaller than a pixel, of an instance behind the camera: nothing to agree about is no agreement."""
    behind = rooms.Surface("wall", rooms.facing(20, 10, 80, 70).corners * [1, -1, 1])
    surfaces = (rooms.facing(20, 10, 80, 70), behind)
    crumb = rooms.pixels(90.1, 70.1, 90.4, 70.4)
    scene = rooms.make_scene([CAMERA], [[("wall", rooms.pixels(20, 10, 80, 70)), ("wall", crumb)]])
    assert [element.iou for element in _assess(scene, surfaces).elements] == [1.0, 0.0]


def test_drawn_pixels_are_looked_at_in_their_centres() -> None:
    """A wall seen squarely: the ray through the centre of pixel (x, y) reaches it √(100 + u² + v²) metres away."""
    surface = rooms.facing(0, 0, 100, 80)
    scene = rooms.seen_from([CAMERA], [surface])
    known = _known_to(surface, 0.2)
    found = drawn_pixels(scene, rooms.instances_of([surface], 1), [known])
    y, x = np.mgrid[0:80:4, 0:100:4].reshape(2, -1) + 0.5
    expected = np.sqrt(100 + ((x - 50) / 10) ** 2 + ((y - 40) / 10) ** 2)
    np.testing.assert_allclose(np.sort(found.distance), np.sort(expected))
    np.testing.assert_allclose(found.sigma_share, 0.02)


def test_where_nothing_is_drawn_nothing_is_known() -> None:
    surface = rooms.facing(20, 10, 80, 70)
    scene = rooms.make_scene([CAMERA], [[("wall", rooms.pixels(90.1, 70.1, 90.4, 70.4))]])
    quality = _assess(scene, [surface], [_known_to(surface, 0.01)])
    assert (quality.sigma_depth_share, quality.known_share, quality.instances[0].drawn_share) == (1.0, 0.0, 0.0)
    assert quality.predicted == "doubtful"
