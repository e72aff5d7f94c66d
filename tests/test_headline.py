"""The headline: each rule by itself, what it names, and which word wins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import rooms
from shapely import box

from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent, Plane
from gtlayout.quality.assess import Quality, assess
from gtlayout.quality.config import QualityConfig
from gtlayout.quality.headline import Headline
from gtlayout.scene import Scene

LEFT, MIDDLE, RIGHT = SURFACES = tuple(rooms.facing(x, 0, x + 32, 80) for x in (0, 32, 64))
"""Three walls, a third of the drawn pixels each, at a depth of 10 m."""
CAMERA = rooms.facing_camera()
LOST = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False, note="no track places it")


def known_to(surface: rooms.Surface, share: float) -> Plane:
    """Depth known to that share of it."""
    return replace(surface.plane, covariance=np.diag([0, 0, 0, (share * rooms.WALL_DEPTH) ** 2]))


def judged(
    planes: Sequence[Plane] | None = None,
    scene: Scene | None = None,
    extents: Sequence[Extent] | None = None,
    **limits: float,
) -> Quality:
    scene = scene or rooms.seen_from([CAMERA, CAMERA], SURFACES)
    return assess(
        scene,
        rooms.instances_of(SURFACES, len(scene.key_frames)),
        planes or [surface.plane for surface in SURFACES],
        extents or [surface.extent for surface in SURFACES],
        QualityConfig(**limits),
    )


def headline(*args: object, **kwargs: object) -> Headline:
    return judged(*args, **kwargs).headline  # type: ignore[arg-type]


def half_drawn(frames: int, of: int) -> Scene:
    """Every wall is drawn half as high as it is in the first frames: an IoU of .5 each there."""
    scene = rooms.seen_from([CAMERA] * of, SURFACES)
    for k in range(frames):
        for e, x in enumerate((0, 32, 64)):
            scene = rooms.redraw(scene, k, e, rooms.pixels(x, 0, x + 32, 40))
    return scene


def test_trust_says_what_it_rests_on() -> None:
    assert headline() == Headline("trust", ("IoU 1.000, σ of depth 0.0 %; all instances are ok",))
    one_weak = headline([known_to(LEFT, 0.035), MIDDLE.plane, RIGHT.plane])
    assert one_weak == Headline(
        "trust", ("IoU 1.000, σ of depth 1.2 %; 2 of 3 instances, 67 % of what is drawn, are ok",)
    )


def test_unobservable_element_is_to_be_checked() -> None:
    """However small it is, and if all else is fine."""
    found = headline([LEFT.plane, MIDDLE.plane, LOST], accept_iou=0.5, trusted_sigma_depth_share=0.4)
    assert found.word == "check"
    assert found.reasons[0].startswith("wall_2 is unobservable: ")
    assert "wall_0, wall_1, wall_2 are unobservable" in " ".join(headline([LOST] * 3).reasons)


def test_depth_as_uncertain_as_itself_is_to_be_checked() -> None:
    planes = [LEFT.plane, MIDDLE.plane, known_to(RIGHT, 1.01)]
    found = headline(planes, trusted_sigma_depth_share=0.4)
    assert found == Headline("check", ("wall_2 is of unknown depth: the σ is as large as the depth itself",))
    assert headline([*planes[:2], known_to(RIGHT, 0.99)], trusted_sigma_depth_share=0.4).word == "trust"


@pytest.mark.parametrize(("iou", "word"), [(0.49, "trust"), (0.51, "check")])
def test_frame_below_half_is_to_be_checked(iou: float, word: str) -> None:
    """One frame of four has an IoU of .5."""
    found = headline(scene=half_drawn(1, 4), min_frame_iou=iou)
    assert found.word == word
    if word == "check":
        assert found.reasons == (
            "1 of 4 key frames is below an IoU of 0.51: look at the elements and the camera of 0.png (0.500) first",
        )


def test_default_for_a_frame_is_half() -> None:
    assert QualityConfig().min_frame_iou == 0.5


def room_m(*cameras_at_y: float) -> float:
    """The 95 % quantile of the distances at which the three walls are seen from there, on the grid of the pixels."""
    x, z = np.meshgrid((np.arange(0, 96, 4) + 0.5 - 50) / 100, (40 - np.arange(0, 80, 4) - 0.5) / 100)
    rays = np.sqrt(1 + x**2 + z**2)
    return float(np.quantile(np.concatenate([(10 - y) * rays.ravel() for y in cameras_at_y]), 0.95))


@pytest.mark.parametrize(("times", "word"), [(1.59, "trust"), (1.61, "check")])
def test_extent_out_of_all_proportion_is_to_be_checked(times: float, word: str) -> None:
    """One of the walls goes on far beyond what any camera shows, 4 m below them, as a strip too thin for a pixel: the
    IoU does not tell. It is not ok, either.
    """
    aside = np.sqrt((times * room_m(0.0)) ** 2 - 10**2 - 4**2)
    strip = box(0, 0, aside - RIGHT.corners[0, 0], 1e-6)
    far = replace(RIGHT.extent, region=polygons(RIGHT.extent.region.union(strip)))
    quality = judged(extents=[LEFT.extent, MIDDLE.extent, far])
    assert quality.iou == 1.0
    assert quality.instances[2].reach == pytest.approx(times)
    assert quality.headline.word == word
    if word == "check":
        assert quality.headline.reasons == (
            "wall_2 is out of all proportion to what was seen of the room: look at wall_2 first, "
            "whose 25.6 m² reach 1.61 times as far as the room",
        )
        assert quality.instances[2].verdict == "weak"
        assert (
            quality.instances[2].reason
            == "its extent is out of all proportion: it reaches 1.6 times as far as the room"
        )


def test_reach_is_from_the_nearest_camera_that_drew_it() -> None:
    """To the corner at (−5, 10, 4) from the two cameras 10 m away, not from the one 15 m away."""
    cameras = [rooms.level_camera([0, -5, 0], 100.0, 100, 80), CAMERA, CAMERA]
    left, middle, _ = judged(scene=rooms.seen_from(cameras, SURFACES)).instances
    assert left.reach / middle.reach == pytest.approx(np.linalg.norm([5, 10, 4]) / np.linalg.norm([1.8, 10, 4]))
    assert np.isnan(judged([LOST] * 3).instances[0].reach), "nothing is known to compare it with"


def test_doubtful_prediction_is_to_be_checked_and_blames_the_worst() -> None:
    planes = [known_to(LEFT, 0.02), known_to(MIDDLE, 0.08), known_to(RIGHT, 0.025)]
    assert headline(planes) == Headline(
        "check", ("σ of depth is 4.2 % in the mean, more than 4 %: look at wall_1 first, which adds most",)
    )
    assert headline(planes, trusted_sigma_depth_share=0.05).word == "trust"


def test_most_of_what_is_drawn_must_be_ok() -> None:
    planes = [known_to(LEFT, 0.035), known_to(MIDDLE, 0.035), RIGHT.plane]
    assert headline(planes) == Headline(
        "check",
        ("only 1 of 3 instances, 33 % of what is drawn, are ok: look at wall_0 first, the largest of the others",),
    )
    assert headline([*planes[:2], known_to(RIGHT, 0.035)]).reasons == (
        "no instance is ok: look at wall_0 first, the largest",
    )
    assert headline(planes, min_ok_share=0.3).word == "trust"


def test_iou_that_is_not_accepted_is_to_be_redone() -> None:
    found = headline(scene=half_drawn(2, 3))
    assert found.word == "redo"
    assert found.reasons[0] == "IoU 0.667 is below 0.8: redraw wall_0 = e0 in 0.png (0.500) first"
    assert headline(scene=half_drawn(2, 3), accept_iou=0.6).word == "trust"


def test_what_cannot_be_placed_is_not_to_be_redrawn() -> None:
    found = headline([LEFT.plane, MIDDLE.plane, LOST], extents=[LEFT.extent, MIDDLE.extent, _nothing()])
    assert found.reasons[0] == "IoU 0.667 is below 0.8: worst is wall_2 = e2 in 0.png (0.000), whose depth is not known"


def _nothing() -> Extent:
    return replace(RIGHT.extent, region=rooms.NOTHING, unrefined=rooms.NOTHING)


def test_little_known_depth_is_to_be_redone() -> None:
    """A third of the pixels to 9 %, the rest to 11 %: the drawings are met perfectly, and nobody knows where it is."""
    planes = [known_to(LEFT, 0.09), known_to(MIDDLE, 0.11), known_to(RIGHT, 0.11)]
    quality = judged(planes)
    assert quality.accepted
    assert quality.known_share == pytest.approx(1 / 3)
    assert quality.headline.word == "redo"
    assert quality.headline.reasons[0].startswith("depth is known to 10 % for only 33 % of what is drawn: film again")
    assert headline([known_to(LEFT, 0.09), known_to(MIDDLE, 0.09), planes[2]]).word == "check"


def test_redo_wins_and_all_reasons_are_given() -> None:
    """Unknown depth comes before drawings: new drawings would not mend it."""
    found = headline([known_to(LEFT, 0.2), known_to(MIDDLE, 2.0), LOST], scene=half_drawn(2, 2), min_frame_iou=0.2)
    assert found.word == "redo"
    assert [reason.split()[0] for reason in found.reasons] == ["depth", "IoU", "wall_2", "wall_1", "σ", "no"]


def test_drawing_too_small_to_be_sampled_is_no_crash() -> None:
    """Two pixels between those of the grid: nothing is known of what is drawn, though the instance is ok."""
    surface = rooms.facing(1, 1, 3, 3)
    scene = rooms.seen_from([CAMERA], [surface])
    quality = assess(scene, rooms.instances_of([surface], 1), [surface.plane], [surface.extent], QualityConfig())
    assert quality.instances[0].verdict == "ok"
    assert quality.headline.word == "redo"
    assert quality.headline.reasons[0].startswith("depth is known to 10 % for only 0 % of what is drawn")


def test_many_names_are_counted() -> None:
    surfaces = [rooms.facing(x, 0, x + 10, 80) for x in range(0, 100, 10)]
    scene = rooms.seen_from([CAMERA], surfaces)
    extents = [replace(surface.extent, region=rooms.NOTHING) for surface in surfaces]
    quality = assess(scene, rooms.instances_of(surfaces, 1), [LOST] * 10, extents, QualityConfig())
    assert any(reason.startswith("wall_0, wall_1, wall_2 and 7 more are unobs") for reason in quality.headline.reasons)
    assert quality.known_share == 0.0


def test_the_blame_goes_by_the_share_of_the_depth() -> None:
    """A wall 20 m away with σ .8 m is known better than one 5 m away with σ .5 m."""
    near, far = (rooms.facing(x, 0, x + 50, 80) for x in (0, 50))
    near, far = replace(near, corners=near.corners / 2), replace(far, corners=far.corners * 2)
    planes = [
        replace(surface.plane, covariance=np.diag([0, 0, 0, sigma**2])) for surface, sigma in ((near, 0.5), (far, 0.8))
    ]
    scene = rooms.seen_from([CAMERA], (near, far))
    instances = rooms.instances_of((near, far), 1)
    quality = assess(scene, instances, planes, [near.extent, far.extent], QualityConfig(known_sigma_depth_share=0.2))
    assert "look at wall_0 first, which adds most" in quality.headline.reasons[0]
