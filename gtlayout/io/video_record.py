"""``video_frames.json``: of which frames of a video the images of a scene folder were made, and how.

What was drawn on the video, by any tool that numbers its frames, finds its image and its place in it by this file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.lenses import MAX_SIDE_PX, check_lens, finite
from gtlayout.io.cameras.undistort import Undistortion, undistortion
from gtlayout.io.cameras.upright import Upright
from gtlayout.io.files import printable, read_json, write_json_atomic
from gtlayout.io.json_schema import Shape
from gtlayout.io.lens import PARAMETERS, Lens
from gtlayout.io.pixels.turn import AS_STORED, TURNS
from gtlayout.io.pixels.video import MAX_FRAMES, Video
from gtlayout.scene import Frame, VideoOrigin

FILE = "video_frames.json"
FORMAT: Literal["gtlayout-video/1"] = "gtlayout-video/1"
MAX_TIME_S = 1e7


class LensRecord(TypedDict):
    """A lens that was removed."""

    model: str
    """COLMAP's name of it."""
    width: int
    """Of the distorted image, px."""
    height: int
    params: list[float]
    """As COLMAP orders them; pixel (0, 0) is the top-left corner of the image."""


class FrameRecord(TypedDict):
    """One image."""

    image: str
    """Its name in the folder of images."""
    number: int
    """Of the frame in the video, in order of presentation, from 0 on."""
    time_s: float
    """When it is shown, from the first frame on."""
    lenses: list[int]
    """Which of the lenses were removed, in this order; none where the pixels are the video's."""


class VideoRecord(TypedDict):
    """Of which frames of a video the images of a scene folder were made."""

    format: Literal["gtlayout-video/1"]
    video: str
    """File name of the video."""
    frame_count: int
    """Of the whole video."""
    image_size: Annotated[list[int], Shape((2,), {"type": "integer"})]
    """Width, height of the video as players show it, px."""
    orientation: int
    """1 to 8, as EXIF numbers them: how players turn what the video stores. The images stand upright."""
    lenses: list[LensRecord]
    frames: list[FrameRecord]


def origin_in(video: Video, index: int) -> VideoOrigin:
    """Of an image that holds frame ``index`` of a video as it is shown. Raises GtlayoutError as the video does."""
    width, height = video.turn.inverse.size((video.width, video.height))
    way = Upright(video.turn, width, height, (), video.turn, AS_STORED)
    return VideoOrigin(video.path.name, index, float(video.times_s[index]), len(video), way)


def write_video_record(out: Path, origins: Mapping[str, VideoOrigin]) -> None:
    """Write where the images of the scene folder ``out`` are from, by their names.

    Nothing is written when none is of a video, or they are of several. Raises GtlayoutError when the file cannot be
    written.
    """
    ways = {name: origin.resampled for name, origin in origins.items() if isinstance(origin.resampled, Upright)}
    if len({origins[name].video_name for name in ways}) != 1:
        return
    first, way = origins[next(iter(ways))], next(iter(ways.values()))
    lenses = list(dict.fromkeys(lens for each in ways.values() for lens in each.lenses))
    record: VideoRecord = {
        "format": FORMAT,
        "video": first.video_name,
        "frame_count": first.frame_count,
        "image_size": list(way.shown_size),
        "orientation": TURNS.index(way.shown) + 1,
        "lenses": [
            {"model": lens.model, "width": lens.width, "height": lens.height, "params": list(lens.params)}
            for lens in lenses
        ],
        "frames": [
            {
                "image": name,
                "number": origins[name].number,
                "time_s": origins[name].time_s,
                "lenses": [lenses.index(lens) for lens in each.lenses],
            }
            for name, each in ways.items()
        ],
    }
    write_json_atomic(out / FILE, record)


def origin_of(frame: Frame) -> VideoOrigin | None:
    """Where what the frame's camera sees is from, once it is an image file; None when that is not known."""
    if frame.video is not None and isinstance(frame.video.video, Video):
        origin: VideoOrigin | None = origin_in(frame.video.video, frame.video.index)
    else:
        origin = frame.origin
    if origin is None or not isinstance(origin.resampled, Upright) or isinstance(frame.undistort, Upright):
        return None
    if not isinstance(frame.undistort, Undistortion):
        return origin
    return replace(origin, resampled=replace(origin.resampled, lenses=(*origin.resampled.lenses, frame.undistort)))


def with_origins(root: Path, frames: Sequence[Frame]) -> tuple[tuple[Frame, ...], list[str]]:
    """The frames with what ``video_frames.json`` in the scene folder says of them, and a warning; as they are without.

    Images of another size than the file says were not made so: they are counted in the warning. Raises GtlayoutError,
    naming file and image, when something in the file is not what it should be.
    """
    path = root / FILE
    if not path.exists():
        return tuple(frames), []
    origins = _read(path)
    found: list[Frame] = []
    other_size: list[str] = []
    for frame in frames:
        origin = origins.get(frame.name)
        if origin is None:
            found.append(frame)
            continue
        assert isinstance(origin.resampled, Upright)
        lens = frame.undistort if isinstance(frame.undistort, Undistortion) else None
        file_size = (lens.width, lens.height) if lens else (frame.camera.width, frame.camera.height)
        fits = origin.resampled.seen_size == file_size
        found.append(replace(frame, origin=origin) if fits else frame)
        if not fits:
            other_size.append(frame.name)
    if not other_size:
        return tuple(found), []
    return tuple(found), [
        f"{path}: {len(other_size)} images do not have the size that they were made with, first {other_size[0]}: what "
        "is drawn on the video is not found in them"
    ]


def _read(path: Path) -> dict[str, VideoOrigin]:
    data = read_json(path)
    if data.get("format") != FORMAT:
        raise GtlayoutError(f"{path}: format is {data.get('format')!r}, expected {FORMAT!r}")
    if not isinstance(data.get("video"), str) or not data["video"]:
        raise GtlayoutError(f"{path}: video must be the name of a file")
    count = _whole(data.get("frame_count"), 1, MAX_FRAMES, f"{path}: frame_count")
    size = data.get("image_size")
    if not isinstance(size, list) or len(size) != 2:
        raise GtlayoutError(f"{path}: image_size must be [width, height] in pixels")
    width, height = (_whole(value, 1, MAX_SIDE_PX, f"{path}: image_size") for value in size)
    turn = TURNS[_whole(data.get("orientation"), 1, len(TURNS), f"{path}: orientation") - 1]
    lenses = [_lens(value, f"{path}: lens {i}") for i, value in enumerate(_list(data, "lenses", str(path)))]
    stored = turn.inverse.size((width, height))
    origins: dict[str, VideoOrigin] = {}
    for i, entry in enumerate(_list(data, "frames", str(path))):
        if not isinstance(entry, dict) or not isinstance(entry.get("image"), str):
            raise GtlayoutError(f"{path}: entry {i} of frames names no image")
        where = f"{path}: image {printable(entry['image'])}"
        if entry["image"] in origins:
            raise GtlayoutError(f"{where} occurs twice")
        number = _whole(entry.get("number"), 0, count - 1, f"{where}: number")
        time_s = finite(entry.get("time_s"))
        if time_s is None or not 0 <= time_s <= MAX_TIME_S:
            raise GtlayoutError(f"{where}: time_s must be seconds, not {entry.get('time_s')!r}")
        which = [_whole(value, 0, len(lenses) - 1, f"{where}: lenses") for value in _list(entry, "lenses", where)]
        way = Upright(turn, *stored, tuple(lenses[k] for k in which), turn, AS_STORED)
        before = (width, height)
        for lens in way.lenses:
            if (lens.width, lens.height) != before:
                raise GtlayoutError(
                    f"{where}: a lens is for {lens.width}x{lens.height} px, not {before[0]}x{before[1]}"
                )
            before = (int(lens.target.width), int(lens.target.height))
        origins[entry["image"]] = VideoOrigin(printable(data["video"]), number, time_s, count, way)
    return origins


def _lens(value: Any, where: str) -> Undistortion:
    if not isinstance(value, dict) or not isinstance(value.get("model"), str):
        raise GtlayoutError(f"{where} has no model")
    params = value.get("params")
    if not isinstance(params, list) or any(finite(each) is None for each in params):
        raise GtlayoutError(f"{where}: params must be finite numbers")
    width, height = (_whole(value.get(key), 2, MAX_SIDE_PX, f"{where}: {key}") for key in ("width", "height"))
    if value["model"] not in PARAMETERS:
        raise GtlayoutError(f"{where}: {printable(value['model'])} is no camera model of COLMAP")
    if len(params) != len(PARAMETERS[value["model"]]):
        raise GtlayoutError(f"{where}: {value['model']} does not have {len(params)} params")
    camera = Lens(value["model"], width, height, tuple(map(float, params)))
    check_lens(camera, where)
    found = undistortion(camera)
    if found is None:
        raise GtlayoutError(f"{where} has no distortion")
    return found


def _whole(value: Any, least: int, most: int, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise GtlayoutError(f"{where} must be a whole number from {least} to {most}, not {value!r}")
    return value


def _list(data: dict[str, Any], key: str, where: str) -> list[Any]:
    value = data.get(key)
    if not isinstance(value, list):
        raise GtlayoutError(f"{where}: {key} must be a list")
    return value
