"""Frames of video files: which, when, upright, and the same in any order."""

from __future__ import annotations

from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from videos import HEIGHT, WIDTH, number_in, pictures, write_video

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.video import Video, _index

COUNT = 50
JUMPY_MS = tuple(int(t) for t in np.cumsum(np.random.default_rng(3).integers(5, 90, COUNT)))
B_FRAMES = {"bf": "3", "g": "12", "crf": "20", "x264-params": "b-adapt=0:scenecut=0"}
OPEN_GOP = {**B_FRAMES, "x264-params": "b-adapt=0:scenecut=0:open-gop=1"}
KINDS: dict[str, tuple[str, str, dict[str, str], tuple[int, ...] | None]] = {
    "h264 with B-frames": (".mp4", "libx264", B_FRAMES, None),
    "h264, open groups": (".mkv", "libx264", OPEN_GOP, None),
    "h264, open groups, mp4": (".mp4", "libx264", OPEN_GOP, None),
    "h264, one long group": (".mov", "libx264", {"bf": "2", "g": "1000", "crf": "20"}, None),
    "h264, key frames only": (".mp4", "libx264", {"g": "1"}, None),
    "variable frame rate": (".mp4", "libx264", B_FRAMES, JUMPY_MS),
    "variable frame rate, mkv": (".mkv", "libx264", B_FRAMES, JUMPY_MS),
    "hevc": (".mp4", "libx265", {"x265-params": "keyint=12:bframes=3:open-gop=1:log-level=none"}, None),
    "mpeg4": (".mp4", "mpeg4", {"bf": "2", "g": "12"}, None),
    "mpeg4, avi": (".avi", "mpeg4", {"bf": "2", "g": "12"}, None),
    "vp9": (".webm", "libvpx-vp9", {"g": "12", "deadline": "realtime", "cpu-used": "8"}, None),
    "vp8": (".webm", "libvpx", {"g": "12", "deadline": "realtime", "cpu-used": "8"}, None),
}


@pytest.mark.parametrize("kind", KINDS)
def test_any_order_gives_the_same_frames(kind: str, tmp_path: Path) -> None:
    suffix, codec, options, stamps_ms = KINDS[kind]
    path = write_video(tmp_path / f"a{suffix}", pictures(COUNT), codec=codec, options=options, stamps_ms=stamps_ms)
    video = Video(path)
    in_order = dict(video.frames())
    assert (len(video), video.width, video.height) == (COUNT, WIDTH, HEIGHT)
    assert list(in_order) == list(range(COUNT))
    assert [number_in(image) for image in in_order.values()] == list(range(COUNT))
    expected_s = np.arange(COUNT) / 30 if stamps_ms is None else (np.array(stamps_ms) - stamps_ms[0]) / 1000
    np.testing.assert_allclose(video.times_s, expected_s, atol=6e-4)
    order = np.random.default_rng(1).permutation(COUNT)
    for i in (*order, *range(COUNT - 1, -1, -5), 0, COUNT - 1, COUNT - 1):
        assert np.array_equal(video.frame(int(i)), in_order[int(i)]), i


def test_one_frame_is_decoded_once_going_forward(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    video = Video(write_video(tmp_path / "a:b %d?#é.mp4", pictures(COUNT), options=B_FRAMES))
    assert video.width == WIDTH
    monkeypatch.setattr(Video, "_seek", lambda self, key: pytest.fail("it seeks"))
    for i in (0, 1, 1, 2, 7, 8, 20, 33, 49):
        video.frame(i)


@pytest.mark.parametrize("degrees", [0, 90, 180, -90])
def test_phone_videos_are_shown_upright(degrees: int, tmp_path: Path) -> None:
    video = Video(write_video(tmp_path / "a.mp4", pictures(3), display_degrees=degrees))
    shape = (HEIGHT, WIDTH) if degrees in (0, 180) else (WIDTH, HEIGHT)
    image = video.frame(1)
    assert image.shape[:2] == (video.height, video.width) == shape
    # The light corner is at the top left as stored, and numpy turns counter-clockwise, too.
    expected = np.rot90(pictures(3)[1], degrees // 90)
    assert np.mean((image > 128) == (expected > 128)) > 0.999


def test_a_mirrored_video_is_turned_back(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", pictures(2), display_degrees=180)
    data = path.read_bytes()
    both = np.array([-1, 0, 0, 0, -1], dtype=">i4") * 65536
    matrix = both.tobytes()
    assert data.count(matrix) == 1
    both[4] = 65536
    path.write_bytes(data.replace(matrix, both.tobytes()))
    assert np.mean((Video(path).frame(0) > 128) == (pictures(1)[0][:, ::-1] > 128)) > 0.999


def test_what_an_edit_list_cuts_off_does_not_count(tmp_path: Path) -> None:
    """A phone's trimmed clip: its first second is in the file, to be decoded but not shown."""
    images = pictures(40)
    path = write_video(tmp_path / "a.mp4", images, options={"bf": "0", "g": "1000", "crf": "20"})
    data = path.read_bytes()
    at = data.index(b"elst")
    assert int.from_bytes(data[at + 8 : at + 12], "big") == 1
    start = int.from_bytes(data[at + 16 : at + 20], "big")
    whole = Video(path)
    cut = tmp_path / "cut.mp4"
    # Ten frames in the media's unit, 1/15360 s.
    cut.write_bytes(data[: at + 16] + (start + 10 * 512).to_bytes(4, "big") + data[at + 20 :])
    video = Video(cut)
    assert len(video) == 30
    assert video.times_s[1] == pytest.approx(1 / 30)
    for i in (0, 29, 3):
        assert np.array_equal(video.frame(i), whole.frame(i + 10))


@pytest.mark.parametrize("damage", ["empty", "text", "play list", "no index", "missing", "folder", "sound only"])
def test_no_video_is_one_clear_line(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    whole = write_video(tmp_path / "whole.mp4", pictures(5)).read_bytes()
    if damage == "folder":
        path.mkdir()
    elif damage == "sound only":
        _write_sound(path)
    elif damage != "missing":
        play_list = b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nwhole.mp4\n#EXT-X-ENDLIST\n"
        path.write_bytes(
            {"empty": b"", "text": b"no video", "play list": play_list}.get(damage, whole[: -len(whole) // 2])
        )
    with pytest.raises(GtlayoutError, match=r"^[^\n]*a\.mp4[^\n]*$"):
        _ = Video(path).times_s


def _write_sound(path: Path) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100, layout="mono")
        for _ in range(3):
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), dtype=np.float32), format="fltp", layout="mono")
            frame.sample_rate = 44100
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def test_a_video_cut_off_gives_what_is_left(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mkv", pictures(COUNT), options=B_FRAMES)
    whole = dict(Video(path).frames())
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    left = dict(Video(path).frames())
    assert 5 < len(left) < COUNT
    assert all(np.array_equal(left[i], whole[i]) for i in list(left)[:-6])


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_any_damage_is_a_known_error_or_none(suffix: str, tmp_path: Path) -> None:
    whole = write_video(tmp_path / f"whole{suffix}", pictures(12), options=B_FRAMES).read_bytes()
    rng = np.random.default_rng(0)
    path = tmp_path / f"a{suffix}"
    for _ in range(40):
        data = np.frombuffer(whole, dtype=np.uint8).copy()
        at = rng.integers(0, len(data), rng.integers(1, 30))
        data[at] = rng.integers(0, 256, len(at))
        path.write_bytes(data[: rng.integers(len(data) // 2, 2 * len(data))].tobytes())
        video = Video(path)
        with suppress(GtlayoutError):
            for index, image in video.frames():
                assert image.shape == (video.height, video.width, 3)
                assert np.array_equal(video.frame(index), image)


def test_what_is_lost_is_looked_for_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_video(tmp_path / "a.mp4", pictures(COUNT), options={"g": "1000", "bf": "0", "crf": "10"})
    data = bytearray(path.read_bytes())
    data[_offset_of_frame(path, 20) : data.index(b"moov")] = bytes(data.index(b"moov") - _offset_of_frame(path, 20))
    path.write_bytes(data)
    sought: list[int] = []
    seek = Video._seek

    def noted(self: Video, key: int) -> None:
        sought.append(key)
        seek(self, key)

    monkeypatch.setattr(Video, "_seek", noted)
    assert 10 < len(dict(Video(path).frames())) <= 20
    assert len(sought) <= 2


def test_a_damaged_frame_is_named_and_the_others_stay(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", pictures(COUNT), options={"g": "1", "crf": "10"})
    whole = dict(Video(path).frames())
    data = bytearray(path.read_bytes())
    at = _offset_of_frame(path, 20)
    data[at : at + 200] = b"\xff" * 200
    path.write_bytes(data)
    video = Video(path)
    with pytest.raises(GtlayoutError, match=r"^[^\n]*frame 20 of [^\n]*a\.mp4 \(at 0\.667 s\)[^\n]*$"):
        video.frame(20)
    for i in (19, 21, 49, 0):
        assert np.array_equal(video.frame(i), whole[i])
    assert sorted(dict(video.frames())) == [i for i in range(COUNT) if i != 20]


def _offset_of_frame(path: Path, index: int) -> int:
    with av.open(str(path)) as container:
        position = [packet.pos for packet in container.demux(video=0)][index]
    assert position is not None
    return position


def test_frames_without_times_of_their_own_are_counted(tmp_path: Path) -> None:
    """As in some AVI files: decoding times only, or none at all; seeking then means starting again."""
    second = Fraction(1, 1000)
    assert _index([(None, 80, True), (None, 0, False), (None, 40, False)], second, Fraction(25)).times_s.tolist() == [
        0.0,
        0.04,
        0.08,
    ]
    video = Video(write_video(tmp_path / "a.mp4", pictures(COUNT), options=B_FRAMES))
    video.__dict__["_index"] = _index([(None, None, True)] * COUNT, second, Fraction(25))
    assert video.interval_s == pytest.approx(0.04)
    for i in (30, 3, 4, 49, 0):
        assert number_in(video.frame(i)) == i


def test_a_frame_that_is_not_there_is_a_bug_of_the_caller(tmp_path: Path) -> None:
    video = Video(write_video(tmp_path / "a.mp4", pictures(3)))
    for index in (-1, 3):
        with pytest.raises(IndexError):
            video.frame(index)


def test_a_frame_that_claims_more_than_its_file_does(tmp_path: Path) -> None:
    """VP8 says the size in each key frame (RFC 6386, section 9.1): 12000x12000 px would take 400 MB."""
    path = write_video(tmp_path / "a.webm", pictures(2), codec="libvpx")
    content = path.read_bytes()
    at = content.index(b"\x9d\x01\x2a") + 3
    path.write_bytes(content[:at] + b"\xe0\x2e\xe0\x2e" + content[at + 4 :])
    with pytest.raises(GtlayoutError, match=r"no frame of .* can be decoded"):
        assert Video(path).width * Video(path).height
