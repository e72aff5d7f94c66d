"""``gtlayout synth --count``: rooms that differ, as far as they may, and go on where they were left."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.scene_folder import load_scene
from gtlayout.synth import SynthConfig, synthesize
from gtlayout.synth.data_set import make_data_set, make_rooms, varied
from gtlayout.synth.levels import CLEAN, POOR, TYPICAL

FLAGS = ("--frames", "3", "--key-every", "2", "--width", "96", "--height", "72", "--oversample", "1", "--blur", "0")
SMALL = SynthConfig(frames=3, key_every=2, width=96, height=72, oversample=1)
QUICK = ("shutter_share",)
"""Given by these flags: blur takes time."""


def _files(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def _ignored(_done: int, _total: int) -> None:
    pass


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of three rooms, by the command line."""
    out = tmp_path_factory.mktemp("synth") / "set"
    assert main(["synth", str(out), "--count", "3", *FLAGS]) == 0
    return out


def test_rooms_differ_in_all_that_may_vary_and_in_nothing_else() -> None:
    rooms = [varied(number, SMALL, ()) for number in range(200)]
    assert len({room.seed for room in rooms}) == 200
    assert len({(room.room, room.camera) for room in rooms[:10]}) == 10
    assert {room.camera for room in rooms} == {"orbit", "dolly"}
    for values, clean, poor in (
        ([room.texture for room in rooms], CLEAN.texture, POOR.texture),
        ([room.noise_sigma for room in rooms], CLEAN.noise_sigma, POOR.noise_sigma),
        ([room.shutter_share for room in rooms], CLEAN.shutter_share, POOR.shutter_share),
        ([room.exposure_sigma_ev for room in rooms], CLEAN.exposure_sigma_ev, POOR.exposure_sigma_ev),
        ([room.annotator.edge_sigma_px for room in rooms], 0, POOR.annotator.edge_sigma_px),
        ([room.annotator.swapped_share for room in rooms], 0, POOR.annotator.swapped_share),
        ([room.camera_errors.rotation_sigma_deg for room in rooms], 0, POOR.camera_errors.rotation_sigma_deg),
        ([room.trim.baseboard_thickness_m for room in rooms], 0, POOR.trim.baseboard_thickness_m),
        ([room.trim.kitchen_share for room in rooms], 0, POOR.trim.kitchen_share),
    ):
        low, high = sorted((clean, poor))
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    shares = [
        [room.texture, room.annotator.edge_sigma_px, room.camera_errors.position_sigma_m, room.trim.door_reveal_m]
        for room in rooms
    ]
    assert np.abs(np.corrcoef(shares, rowvar=False) - np.eye(4)).max() < 0.2, "independent of one another"
    same = ("frames", "key_every", "width", "height", "oversample", "jpeg_quality", "hfov_deg", "replay")
    assert {getattr(room, name) == getattr(SMALL, name) for room in rooms for name in same} == {True}


def test_from_clean_to_poor_leads_through_typical() -> None:
    rooms = [varied(number, SMALL, ()) for number in range(50)]
    assert [room.noise_sigma > TYPICAL.noise_sigma for room in rooms] == [
        room.texture < TYPICAL.texture for room in rooms
    ]
    assert [room.annotator.missing_share > 0 for room in rooms] == [
        room.annotator.corner_sigma_px > TYPICAL.annotator.corner_sigma_px for room in rooms
    ]


def test_a_room_follows_from_its_number_and_the_seed() -> None:
    assert varied(17, SMALL, ()) == varied(17, SMALL, ())
    assert varied(17, SMALL, ()) != varied(18, SMALL, ())
    assert varied(17, SMALL, ()).seed != varied(17, replace(SMALL, seed=1), ()).seed


def test_what_is_given_holds_and_changes_nothing_else() -> None:
    config = replace(SMALL, annotator=replace(SMALL.annotator, missing_share=0.5))
    given = ("room", "texture", "missing_share", "position_sigma_m", "kitchen_share")
    for number in range(20):
        free, held = varied(number, config, ()), varied(number, config, given)
        assert (held.room, held.texture, held.annotator.missing_share) == ("box", 1.0, 0.5)
        assert (held.camera_errors.position_sigma_m, held.trim.kitchen_share) == (0, 0)
        assert (
            replace(
                held,
                room=free.room,
                texture=free.texture,
                trim=replace(held.trim, kitchen_share=free.trim.kitchen_share),
                annotator=replace(held.annotator, missing_share=free.annotator.missing_share),
                camera_errors=replace(held.camera_errors, position_sigma_m=free.camera_errors.position_sigma_m),
            )
            == free
        )


def test_the_command_makes_the_rooms_as_if_each_were_made_alone(three: Path, tmp_path: Path) -> None:
    assert sorted(path.name for path in three.iterdir()) == ["data_set.json", "room_0000", "room_0001", "room_0002"]
    for number in (0, 2):
        synthesize(tmp_path / str(number), varied(number, SMALL, QUICK))
        assert _files(three / f"room_{number:04d}") == _files(tmp_path / str(number))
        assert len(load_scene(three / f"room_{number:04d}").key_frames) == 2
    settings = json.loads((three / "data_set.json").read_text())
    assert settings["width"] == 96
    assert settings["baseboard_share"] == 0.8
    assert not {"room", "noise_sigma", "edge_sigma_px", "door_reveal_m"} & set(settings)


def test_flags_hold_for_all_rooms_even_at_their_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[SynthConfig] = []

    def note(rooms: dict[Path, SynthConfig], *_: object) -> int:
        made.extend(rooms.values())
        return len(rooms)

    monkeypatch.setattr("gtlayout.synth.data_set.make_rooms", note)
    flags = ("--room", "box", "--noise", "2", "--corner-error-px", "0", "--camera", "rotation", "--width", "240")
    assert main(["synth", str(tmp_path / "set"), "--count", "12", *flags]) == 0
    found = {(room.room, room.noise_sigma, room.annotator.corner_sigma_px, room.camera, room.width) for room in made}
    assert found == {("box", 2.0, 0.0, "rotation", 240)}
    assert len({room.texture for room in made}) == 12
    assert {room.height for room in made} == {360}
    settings = json.loads((tmp_path / "set/data_set.json").read_text())
    assert (settings["room"], settings["noise_sigma"], settings["corner_sigma_px"]) == ("box", 2.0, 0.0)


def test_an_interrupted_set_goes_on(three: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "set"

    def interrupt(done: int, _total: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_data_set(out, 3, SMALL, QUICK, 2, interrupt)
    names = {path.name for path in out.iterdir()}
    done = sorted(names - {"data_set.json"})
    assert done
    assert set(done) < {"room_0000", "room_0001", "room_0002"}, "nothing is left of a room that was not finished"
    touched = f"{done[0]}/images/000000.jpg"
    (out / touched).write_bytes(b"mine")
    told: list[tuple[int, int]] = []
    assert make_data_set(out, 3, SMALL, QUICK, 1, lambda done, total: told.append((done, total))) == 3 - len(done)
    assert told == [(number, 3) for number in range(len(done), 4)]
    changed = {name for name, content in _files(out).items() if _files(three)[name] != content}
    assert changed == {touched}
    assert main(["synth", str(out), "--count", "3", *FLAGS]) == 0
    assert capsys.readouterr().out == f"Rooms: {out} (0 made, 3 were there)\n"


def test_what_is_there_is_never_mixed_with_other_things(three: Path, tmp_path: Path) -> None:
    before = _files(three)
    with pytest.raises(GtlayoutError, match=r"made with another room, width: give the same flags"):
        make_data_set(three, 3, replace(SMALL, width=100), ("room", *QUICK), 1, _ignored)
    assert _files(three) == before
    (tmp_path / "mine.txt").write_text("mine")
    for out in (tmp_path, tmp_path / "mine.txt"):
        with pytest.raises(GtlayoutError, match="holds no data set made by synth"):
            make_data_set(out, 1, SMALL, (), 1, _ignored)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    with pytest.raises(GtlayoutError, match=r"^mine.txt: .*mine.txt exists and is not an empty folder"):
        make_rooms({tmp_path / "mine.txt": SMALL}, 1, _ignored)


def test_a_set_without_rooms_takes_other_flags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gtlayout.synth.data_set.make_rooms", lambda rooms, *_: len(rooms))
    for width in (96, 100):
        assert make_data_set(tmp_path, 1, replace(SMALL, width=width), (), 1, _ignored) == 1
        assert json.loads((tmp_path / "data_set.json").read_text())["width"] == width


@pytest.mark.parametrize(
    ("flags", "status", "message"),
    [
        (("--count", "0"), 2, "--count"),
        (("--count", "many"), 2, "many"),
        (("--count", "2", "--frames", "1"), 1, "gtlayout: synthetic scene: frames must be at least 2\n"),
        (("--count", "2", "--camera", "dolly", "--replay", "no.txt"), 1, "gtlayout: cannot read no.txt"),
    ],
)
def test_wrong_flags_write_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], flags: tuple[str, ...], status: int, message: str
) -> None:
    assert main(["synth", str(tmp_path / "out"), *flags]) == status
    assert message in capfd.readouterr().err
    assert not list(tmp_path.iterdir())
