"""Reading the frames of a video file one by one, by their number in order of presentation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import chain
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.extras import needs
from gtlayout.io.pixels.turn import AS_STORED, Turn
from gtlayout.limits import VIDEO_MP
from gtlayout.scene import FloatArray, ImageArray, IntArray

if TYPE_CHECKING:
    from av.buffer import Buffer
    from av.container import InputContainer
    from av.packet import Packet
    from av.video.frame import VideoFrame as DecodedFrame
    from av.video.stream import VideoStream

VideoPacket: TypeAlias = "Packet[VideoStream]"
EXTENSIONS = (".mp4", ".mov", ".mkv", ".webm")
OPEN_OPTIONS = {"format_whitelist": "mov,matroska,avi,mpegts", "protocol_whitelist": "file"}
"""Containers that hold their frames themselves: FFmpeg also knows play lists, which make it open what they name."""
MAX_FRAMES = 5_000_000
"""A day at 60 Hz."""
NEAR_FRAMES = 16
"""Decoding this much further costs about what seeking does."""
_READING = Lock()
"""Two threads in one decoder end the process."""


@dataclass(frozen=True)
class _Index:
    """What the packets say, without decoding."""

    times_s: FloatArray
    """(N,) presentation times, ascending, from the first frame on."""
    stamps: IntArray | None
    """(N,) the same in the stream's unit; None = the file does not give every frame one of its own."""
    keys: IntArray
    """(K,) frames that can be decoded without those before them, ascending; the first is 0."""
    key_dts: tuple[int | None, ...]
    """(K,) their decoding times, in the stream's unit."""


class Video:
    """The frames of a video file, upright as its rotation metadata asks; opened when first asked for something.

    It stands where it last read, and holds the frame there: reading on is cheap, anything else seeks to the key frame
    before. Everything raises GtlayoutError, naming the file, when that is no video or damaged beyond use.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._source: tuple[InputContainer, VideoStream] | None = None
        self._decoding: Iterator[tuple[int, DecodedFrame]] | None = None
        self._started_key = 0
        self._held: tuple[int, DecodedFrame] | None = None
        self._lost: set[int] = set()

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def times_s(self) -> FloatArray:
        """(N,) presentation time of each frame, ascending, from the first frame on."""
        return self._index.times_s

    @property
    def interval_s(self) -> float:
        """Median time from one frame to the next; 0 for a single one."""
        return float(np.median(np.diff(self.times_s))) if len(self) > 1 else 0.0

    @property
    def turn(self) -> Turn:
        """From the frames as stored to the upright ones that ``frame`` gives."""
        return self._stored[1]

    @property
    def width(self) -> int:
        """Of the upright frames, px."""
        return self.turn.size(self._stored[0])[0]

    @property
    def height(self) -> int:
        """Of the upright frames, px."""
        return self.turn.size(self._stored[0])[1]

    def frames(self) -> Iterator[tuple[int, ImageArray]]:
        """Every frame that can be decoded, in order: its index, and (H, W, 3) uint8 BGR."""
        for index in range(len(self)):
            with suppress(GtlayoutError):
                yield index, self.frame(index)

    def frame(self, index: int) -> ImageArray:
        """(H, W, 3) uint8 BGR of one frame. Raises GtlayoutError when it cannot be decoded."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        where = f"frame {index} of {self.path} (at {self.times_s[index]:.3f} s)"
        with _READING:
            (width, height), orientation = self._stored
            frame = self._find(index)
        if frame is None or frame.is_corrupt:
            raise GtlayoutError(f"cannot decode {where}: damaged")
        if (frame.width, frame.height) != (width, height):
            raise GtlayoutError(f"{where} is {frame.width}x{frame.height} px, the first is {width}x{height}")
        try:
            bgr = frame.to_ndarray(format="bgr24")
        except (_av().FFmpegError, ValueError) as error:
            raise GtlayoutError(f"cannot decode {where}: {error}") from error
        return orientation.image(bgr.astype(np.uint8, copy=False))

    @cached_property
    def _index(self) -> _Index:
        stream = self._open()
        packets = []
        for packet in self._demux():
            # What an edit list cuts off is there to be decoded, not to be shown.
            if not packet.is_discard:
                packets.append((packet.pts, packet.dts, packet.is_keyframe))
            if len(packets) > MAX_FRAMES:
                raise GtlayoutError(f"{self.path} has more than {MAX_FRAMES} frames: cut it into clips")
        if not packets:
            raise GtlayoutError(f"{self.path} holds no frame: damaged, or cut off")
        return _index(packets, stream.time_base or Fraction(1, 1000), stream.average_rate or Fraction(30))

    @cached_property
    def _stored(self) -> tuple[tuple[int, int], Turn]:
        """(width, height) px as stored, and how to turn that: as the first frame that can be decoded says."""
        self._seek(0)
        self._held = next(self._decoding, None) if self._decoding else None
        if self._held is None:
            raise GtlayoutError(f"no frame of {self.path} can be decoded: damaged, or of an unknown kind")
        frame = self._held[1]
        return (frame.width, frame.height), _orientation(frame)

    def _find(self, index: int) -> DecodedFrame | None:
        """The decoded frame, from where the video stands or from the key frame before."""
        if index in self._lost:
            return None
        key = int(np.searchsorted(self._index.keys, index, side="right")) - 1
        at = self._held[0] if self._held else -1
        reads_on = self._held is not None and at <= index and self._index.keys[key] <= at + NEAR_FRAMES
        if not reads_on:
            self._seek(key)
        found = self._advance(index)
        if found is None and 0 < key <= self._started_key:
            # Some key frames are none: what follows needs a few frames more.
            self._seek(key - 1)
            found = self._advance(index)
        if found is None:
            # All packets up to what came next, or to the end, have been tried.
            self._lost.update(range(index, self._held[0] if self._held else len(self)))
        return found

    def _advance(self, index: int) -> DecodedFrame | None:
        """Decode on up to the frame; None when the video passes it by, or ends."""
        while self._held is None or self._held[0] < index:
            self._held = next(self._decoding, None) if self._decoding else None
            if self._held is None:
                self._decoding = None
                return None
        return self._held[1] if self._held[0] == index else None

    def _seek(self, key: int) -> None:
        """Stand before key frame number ``key``, or before an earlier one."""
        stamps = self._index.stamps
        self._held, self._decoding, self._started_key = None, None, key
        if stamps is not None and key > 0:
            stamp = int(stamps[self._index.keys[key]])
            # Containers seek by time of presentation or of decoding; only the packets tell where that has led.
            for target in (stamp, self._index.key_dts[key]):
                packets = self._seek_to(target)
                first = next(packets, None)
                if first is not None and first.pts is not None and first.pts <= stamp:
                    self._decoding = self._decode(chain([first], packets))
                    return
        self._started_key = 0
        self._open()
        self._decoding = self._decode(self._demux())

    def _seek_to(self, target: int | None) -> Iterator[VideoPacket]:
        if target is not None and self._source is not None:
            container, stream = self._source
            with suppress(_av().FFmpegError):
                container.seek(target, stream=stream)
                yield from self._demux()

    def _open(self) -> VideoStream:
        """Open the file, or open it again: no seeking leads to the start as surely."""
        if self._source is not None:
            self._source[0].close()
        try:
            # As a path and nothing else: FFmpeg would take "a:b.mp4" for an address.
            container = _av().open(f"file:{self.path.absolute()}", options=OPEN_OPTIONS)
        except _av().InvalidDataError as error:
            raise GtlayoutError(f"cannot read video {self.path}: damaged, or no video") from error
        except (_av().FFmpegError, OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or str(error)
            raise GtlayoutError(f"cannot read video {self.path}: {why}") from error
        stream = container.streams.best("video")
        if not isinstance(stream, _av().VideoStream):
            raise GtlayoutError(f"{self.path} holds no video")
        if stream.codec_context is None:
            raise GtlayoutError(f"cannot read video {self.path}: FFmpeg has no decoder for it")
        VIDEO_MP.check(stream.codec_context.width * stream.codec_context.height / 1e6, str(self.path))
        stream.thread_type = "AUTO"
        # A frame may claim more than the file does.
        stream.codec_context.options = {"max_pixels": str(VIDEO_MP.most * 1_000_000)}
        self._source = container, stream
        return stream

    def _demux(self) -> Iterator[VideoPacket]:
        """Packets of frames; they end where the file is cut off or damaged beyond reading."""
        if self._source is not None:
            container, stream = self._source
            with suppress(_av().FFmpegError):
                for packet in container.demux(stream):
                    if packet.size:
                        yield packet

    def _decode(self, packets: Iterator[VideoPacket]) -> Iterator[tuple[int, DecodedFrame]]:
        """Frames with their index, in order; packets that cannot be decoded are passed over."""
        stamps, count = self._index.stamps, 0
        for packet in chain(packets, [None]):
            decoded: list[DecodedFrame] = []
            if self._source is not None:
                with suppress(_av().FFmpegError):
                    decoded = self._source[1].decode(packet)
            for frame in decoded:
                index = count if stamps is None else _position(stamps, frame.pts)
                count += 1
                if index is not None and index < len(self):
                    yield index, frame


def _av() -> ModuleType:
    with needs("video", "reading a video"):
        import av
    return av


def _index(packets: list[tuple[int | None, int | None, bool]], unit_s: Fraction, rate: Fraction) -> _Index:
    """The index from (pts, dts, whether it is a key frame) of each packet, in order of decoding."""
    pts = [pts for pts, _, _ in packets if pts is not None]
    if len(set(pts)) == len(packets):
        stamps = np.array(sorted(pts), dtype=np.int64)
        found = {int(np.searchsorted(stamps, pts)): dts for pts, dts, is_key in packets if is_key and pts is not None}
        dts_of_key = {0: None, **dict(sorted(found.items()))}
        keys = np.array(list(dts_of_key), dtype=np.int64)
        return _Index(_seconds(stamps, unit_s), stamps, keys, tuple(dts_of_key.values()))
    # AVI, for one, may know only in which order its frames are decoded: they are shown at the same times, in whichever.
    start = np.zeros(1, dtype=np.int64)
    dts = [dts for _, dts, _ in packets if dts is not None]
    if len(set(dts)) == len(packets):
        return _Index(_seconds(np.array(sorted(dts), dtype=np.int64), unit_s), None, start, (None,))
    return _Index(np.arange(len(packets)) / float(rate), None, start, (None,))


def _seconds(stamps: IntArray, unit_s: Fraction) -> FloatArray:
    return (stamps - stamps[0]).astype(np.float64) * unit_s.numerator / unit_s.denominator


def _position(stamps: IntArray, pts: int | None) -> int | None:
    if pts is None:
        return None
    index = int(np.searchsorted(stamps, pts))
    return index if index < len(stamps) and stamps[index] == pts else None


def _orientation(frame: DecodedFrame) -> Turn:
    matrix = cast("Mapping[str, Buffer]", frame.side_data).get("DISPLAYMATRIX")
    if matrix is None:
        return AS_STORED
    # ISO 14496-12: of {a, b, u, c, d, v, x, y, w}, the pixel (p, q) is shown at (a p + c q + x, b p + d q + y).
    a, b, _, c, d = (int(value) for value in np.frombuffer(bytes(matrix), dtype=np.int32)[:5])
    swaps_axes = abs(b) > abs(a)
    return Turn(swaps_axes, (c if swaps_axes else a) < 0, (b if swaps_axes else d) < 0)
