"""The sizes of a synthetic room's trim, and that a room is what it was beside it."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from gtlayout.errors import GtlayoutError
from gtlayout.scene import OPENINGS
from gtlayout.synth.levels import LEVELS
from gtlayout.synth.outfit import Outfit
from gtlayout.synth.room import RoomKind, make_room
from gtlayout.synth.trim import HOME_TRIM, NO_TRIM, SPREAD, Trim


def sizes_of(trim: Trim, seed: int) -> Trim:
    return Outfit.of_room(trim, np.random.default_rng(seed)).sizes


def test_every_room_has_sizes_of_its_own_within_a_third() -> None:
    rooms = [sizes_of(HOME_TRIM, seed) for seed in range(40)]
    for field in fields(Trim):
        asked, drawn = getattr(HOME_TRIM, field.name), [getattr(sizes, field.name) for sizes in rooms]
        if field.name.endswith("_m"):
            assert (1 - SPREAD) * asked <= min(drawn) < 0.8 * asked
            assert 1.2 * asked < max(drawn) <= (1 + SPREAD) * asked
        else:
            assert set(drawn) == {asked}
    assert sizes_of(NO_TRIM, 0) == NO_TRIM
    assert [LEVELS[level].trim for level in ("clean", "typical", "poor")] == [NO_TRIM, HOME_TRIM, HOME_TRIM]


@pytest.mark.parametrize("wrong", [{"baseboard_height_m": -0.1}, {"kitchen_share": 1.5}, {"door_reveal_m": np.inf}])
def test_what_is_no_size_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(GtlayoutError, match=f"synthetic scene: {next(iter(wrong))} must"):
        Trim(**wrong)


@pytest.mark.parametrize("kind", ["box", "two-rooms"])
def test_a_room_is_the_same_but_for_its_trim(kind: RoomKind) -> None:
    bare, trimmed = make_room(1, kind), make_room(1, kind, trim=replace(HOME_TRIM, kitchen_share=0))
    by_name = {surface.name: surface for surface in trimmed.building}
    assert len(trimmed.building) > len(bare.building)
    for surface in bare.building:
        np.testing.assert_array_equal(by_name[surface.name].mipmaps[0], surface.mipmaps[0])
        if surface.label not in OPENINGS:
            np.testing.assert_array_equal(by_name[surface.name].corners_world, surface.corners_world)
    for before, after in zip(bare.furniture, trimmed.furniture, strict=True):
        np.testing.assert_array_equal(before.mipmaps[0], after.mipmaps[0])
    assert bare.standing.equals(trimmed.standing)
