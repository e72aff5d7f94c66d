"""Scene folders to test with: the real clips, where they lie beside the checkout, and a tiny made one."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gtlayout.io.files import write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.method import solve
from gtlayout.scene import Scene
from gtlayout.solution import Solution
from gtlayout.synth import SynthConfig, synthesize

pytest_plugins = ("annotate_server", "browser", "serving", "web_viewer")
SHARED_DATA = Path(__file__).parents[2] / "shared/data"
TINY_SIZE = (64, 48)
TINY_FRAMES = 5


@pytest.fixture(scope="session", params=["office", "redkitchen"])
def real_clip(request: pytest.FixtureRequest) -> Path:
    """Each real clip in turn."""
    clip = SHARED_DATA / str(request.param)
    if not clip.is_dir():
        pytest.skip(f"real clip {clip.name} is not beside the checkout")
    return clip


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """A correct scene folder: 5 frames of 64x48 px, ``transforms.json``, two annotated frames; no depth."""
    width, height = TINY_SIZE
    rng = np.random.default_rng(0)
    frames = []
    for i in range(TINY_FRAMES):
        name = f"images/{i:03d}.png"
        ok, png = cv2.imencode(".png", rng.integers(0, 255, (height, width, 3), dtype=np.uint8))
        assert ok
        (tmp_path / "images").mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(png.tobytes())
        world_from_cam = np.eye(4)
        world_from_cam[:3, 3] = [0.1 * i, 0.0, 0.0]
        frames.append({"file_path": name, "transform_matrix": world_from_cam})
    intrinsics = {"fl_x": 60.0, "fl_y": 60.0, "cx": width / 2, "cy": height / 2, "w": width, "h": height}
    write_json_atomic(tmp_path / "transforms.json", {**intrinsics, "frames": frames})
    wall = {
        "id": "e0",
        "label": "wall",
        "polygons": [[[0, 0], [64, 0], [64, 48], [0, 48]]],
        "visible": [[[5, 5], [30, 5], [30, 30]]],
    }
    key_frames = [{"image": f"{i:03d}.png", "elements": [wall], "occlusion_edges": []} for i in (1, 3)]
    annotations = {"format": "gtlayout-annotations/1", "image_size": list(TINY_SIZE), "frames": key_frames}
    write_json_atomic(tmp_path / "annotations.json", annotations)
    return tmp_path


@pytest.fixture
def edit_json() -> Callable[[Path, Callable[[Any], object]], None]:
    """Change a JSON file in place: ``edit_json(path, lambda data: data["frames"].pop())``."""

    def edit(path: Path, change: Callable[[Any], object]) -> None:
        data = json.loads(path.read_text())
        change(data)
        path.write_text(json.dumps(data))

    return edit


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small synthetic room with depth and truth. Copy it before changing it."""
    folder = tmp_path_factory.mktemp("synthetic") / "room"
    synthesize(folder, SynthConfig(frames=24, width=320, height=240))
    return folder


@pytest.fixture(scope="session")
def room_solution(room: Path) -> Solution:
    """That room solved with default settings, once for all tests."""
    return solve(load_scene(room))


@pytest.fixture(scope="session")
def small_room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Solved in half the time; a door, a window, an occlusion edge in each key frame, the usual errors of a hand."""
    folder = tmp_path_factory.mktemp("small") / "room"
    synthesize(
        folder, SynthConfig(seed=3, room="l-shaped", frames=11, key_every=5, width=240, height=180, oversample=1)
    )
    return folder


@pytest.fixture(scope="session")
def office_part() -> Scene:
    """The first four key frames of the real clip."""
    clip = SHARED_DATA / "office"
    if not clip.is_dir():
        pytest.skip("real clip office is not beside the checkout")
    whole = load_scene(clip)
    key_frames = whole.key_frames[:4]
    return replace(whole, frames=whole.frames[: key_frames[-1].frame + 3], key_frames=key_frames)


@pytest.fixture(scope="session")
def office_solution(office_part: Scene) -> Solution:
    """The same solved."""
    return solve(office_part)
