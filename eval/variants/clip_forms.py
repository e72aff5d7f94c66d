"""The forms in which people have a clip: other units, worlds, frames, files. Each is the same scene to a human eye.

Frames that are left out are the dense ones: key frames stay, because without one its elements would be lost, too.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import av
import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from shapely.affinity import scale as scaled

from gtlayout.io.annotations.annotation_files import NATIVE_FILE
from gtlayout.io.annotations.native import write_annotations
from gtlayout.io.cameras.nerfstudio import FILE_NAME as TRANSFORMS_FILE
from gtlayout.io.cameras.nerfstudio import write_transforms
from gtlayout.io.files import write_atomic, write_json_atomic
from gtlayout.io.pixels.exports import JPEG_QUALITY
from gtlayout.io.pixels.images import encoded, read_rgb, stored_bgr
from gtlayout.io.pixels.video import Video
from gtlayout.io.scene_folder import load_scene
from gtlayout.io.units import SCENE_FILE
from gtlayout.scene import Camera, Element, Frame, KeyFrame, Scene, VideoFrame
from variants.variant import Makers, Similarity, Variant, all_drawn, variant, with_cameras, with_frames
from variants.variant import with_key_frames as keep_key_frames

FAR_M = np.array([6000.0, -6400.0, 4800.0])
"""10⁴ m: as far as a national grid's origin is from a town."""
TURN = Rotation.from_rotvec(np.deg2rad(100.0) * np.array([0.48, -0.6, 0.64])).as_matrix()
"""No axis of the world stays near where it was."""
X264 = {"crf": "23", "g": "30", "threads": "1", "x264-params": "mbtree=0"}
"""FFmpeg's usual quality, and a key frame a second as phones have it; the same bytes every time, which more threads or
the tree of macroblocks would not give."""


def forms(scene: Scene) -> Makers:
    """Name → how to make that form of ``scene``. A scaled camera file says nothing of metres: it has no unit."""
    return {
        "as it is": lambda _folder: variant(scene, scene, all_drawn(scene)),
        "without a unit": partial(_moved, scene, Similarity()),
        **{f"cameras × {factor:g}": partial(_moved, scene, Similarity(factor)) for factor in (0.1, 7.3, 1000.0)},
        "world moved": partial(_moved, scene, Similarity(1.0, TURN, FAR_M), metric=scene.metric),
        "every 2nd frame": partial(_every, scene, 2),
        "every 3rd frame": partial(_every, scene, 3),
        "half of the key frames": partial(_half_of_key_frames, scene),
        "mp4": partial(_video, scene),
        "images × ½": partial(_half_size, scene),
    }


def _moved(scene: Scene, moved: Similarity, _folder: Path, *, metric: bool = False) -> Variant:
    given = with_cameras(scene, [moved.camera(frame.camera) for frame in scene.frames])
    return variant(scene, replace(given, metric=metric), all_drawn(scene), moved=moved)


def _every(scene: Scene, step: int, _folder: Path) -> Variant:
    """Every n-th frame from the first on, and all key frames."""
    kept = sorted({*range(0, len(scene.frames), step), *(key_frame.frame for key_frame in scene.key_frames)})
    return variant(scene, with_frames(scene, kept), all_drawn(scene))


def _half_of_key_frames(scene: Scene, _folder: Path) -> Variant:
    """Every second one from the first on."""
    kept = range(0, len(scene.key_frames), 2)
    return variant(scene, keep_key_frames(scene, kept), [all_drawn(scene)[k] for k in kept])


def _video(scene: Scene, folder: Path) -> Variant:
    """All frames in one H.264 file, read by the program as it reads any video."""
    path = folder / "clip.mp4"
    write_video(path, scene)
    video = Video(path)
    frames = tuple(replace(frame, video=VideoFrame(video, i)) for i, frame in enumerate(scene.frames))
    return variant(scene, replace(scene, frames=frames), all_drawn(scene))


def write_video(path: Path, scene: Scene) -> None:
    """Write the image files of all frames as they are, lens distortion included, at 30 frames a second."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options=X264)
        stream.pix_fmt = "yuv420p"
        stream.height, stream.width = stored_bgr(scene.frames[0]).shape[:2]
        for frame in scene.frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(stored_bgr(frame), format="bgr24")))
        container.mux(stream.encode())


def _half_size(scene: Scene, folder: Path) -> Variant:
    """A scene folder with images of half the width and height, and with cameras and elements to match."""
    frames = tuple(_half_frame(frame, folder, i) for i, frame in enumerate(scene.frames))
    key_frames = tuple(
        _half_key_frame(key_frame, scene.frames[key_frame.frame].camera) for key_frame in scene.key_frames
    )
    write_transforms(folder / TRANSFORMS_FILE, frames)
    write_annotations(folder / NATIVE_FILE, frames, key_frames)
    write_json_atomic(folder / SCENE_FILE, {"metric": scene.metric})
    given = load_scene(folder)
    return variant(scene, given, sources_by_id(scene, given))


def sources_by_id(scene: Scene, written: Scene) -> list[tuple[int, list[int]]]:
    """Where the key frames of a scene that was written and read again come from: frames in order, elements by id."""
    number = {key_frame.frame: k for k, key_frame in enumerate(scene.key_frames)}
    sources = []
    for key_frame in written.key_frames:
        k = number[key_frame.frame]
        ids = [element.id for element in scene.key_frames[k].elements]
        sources.append((k, [ids.index(element.id) for element in key_frame.elements]))
    return sources


def _half_frame(frame: Frame, folder: Path, number: int) -> Frame:
    """The file's name keeps the order of frames, whatever they were called."""
    rgb = read_rgb(frame)
    size = (frame.camera.width // 2, frame.camera.height // 2)
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    name = f"{number:06d}_{re.sub(r'[^A-Za-z0-9_-]', '_', Path(frame.name).stem)}.jpg"
    bgr = cv2.cvtColor(small, cv2.COLOR_RGB2BGR)
    write_atomic(folder / "images" / name, encoded(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]))
    return Frame(name, folder / "images" / name, _half_camera(frame.camera))


def _half_camera(camera: Camera) -> Camera:
    x, y = _shrink(camera)
    return replace(camera, K=np.diag([x, y, 1.0]) @ camera.K, width=camera.width // 2, height=camera.height // 2)


def _shrink(camera: Camera) -> tuple[float, float]:
    """Exactly a half only where the size is even; pixel (0, 0) is a corner, so nothing shifts."""
    return (camera.width // 2) / camera.width, (camera.height // 2) / camera.height


def _half_key_frame(key_frame: KeyFrame, camera: Camera) -> KeyFrame:
    x, y = _shrink(camera)

    def half(element: Element) -> Element:
        amodal, visible = (scaled(of, x, y, origin=(0, 0)) for of in (element.amodal, element.visible))
        return replace(element, amodal=amodal, visible=visible)

    edges = tuple(edge * (x, y) for edge in key_frame.occlusion_edges)
    return replace(key_frame, elements=tuple(map(half, key_frame.elements)), occlusion_edges=edges)
