"""The command ``gtlayout import``. Loaded only when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from gtlayout.cli.console import (
    FROM_THE_FOLDER,
    Sources,
    print_next,
    print_notes,
    print_warnings,
    progress_bars,
    stdout,
)
from gtlayout.errors import GtlayoutError
from gtlayout.importing.importing import import_scene
from gtlayout.io.annotations.labeling import label_config as read_label_config

DEFAULT_RATE_HZ = 10.0
NO_NEGATIVE = Parameter(negative=())


def import_(
    source: Annotated[Path | None, Parameter(name="SRC")] = None,
    out: Annotated[Path | None, Parameter(name="OUT")] = None,
    /,
    *,
    colmap: Annotated[bool, NO_NEGATIVE] = False,
    rate: Annotated[float | None, Parameter(validator=Number(gt=0))] = None,
    focal: Annotated[float | None, Parameter(validator=Number(gt=0))] = None,
    depth_scale: Path | None = None,
    known_distance: Path | None = None,
    label_config: Literal["cvat", "label-studio"] | None = None,
    sources: Sources = FROM_THE_FOLDER,
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), negative=())] = False,
) -> None:
    """Turn cameras, video and annotations of any known format into a scene folder, undistorted and upright.

    SRC may lack annotations: annotate the images that OUT/key_frames.txt names, or these frames of the video, put the
    tool's export into OUT, and solve it.

    Parameters
    ----------
    source
        A folder with cameras and images or a video; with --colmap a video or a folder of images.
    out
        The scene folder to make; it must not exist or be empty.
    colmap
        Find the cameras with COLMAP: features, sequential matching, incremental mapping, on the CPU.
    rate
        With --colmap and a video: frames to take per second, 10 if not given; of each interval the sharpest.
    focal
        With --colmap: the focal length in px of the extracted images, where it is known; it is then not searched for.
    depth_scale
        Make the scene metric by depth maps: a 16-bit PNG in millimetres called like its frame, or a folder of them.
        With --colmap or COLMAP cameras.
    known_distance
        Make the scene metric by a known distance between two points, each marked in two or more frames:
        {"metres": 2.03, "points": [{"000010.jpg": [x, y], "000040.jpg": [x, y]}, {…}]}.
    label_config
        Print the labels of this task for an annotation tool, ready to load, and do nothing else.
    verbose
        Print every warning.
    """
    console = stdout()
    if label_config is not None:
        console.print(read_label_config(label_config), end="")
        return
    assert source is not None
    assert out is not None
    if rate is not None and not colmap:
        raise GtlayoutError("--rate is how many frames a second --colmap takes from a video: add --colmap")
    if rate is not None and source.is_dir():
        raise GtlayoutError(f"--rate is how many frames a second to take from a video, and {source} is a folder")
    with progress_bars() as progress:
        imported = import_scene(
            source,
            out,
            sources.annotations,
            cameras=sources.cameras,
            rate_hz=(rate or DEFAULT_RATE_HZ) if colmap else None,
            focal_px=focal,
            depth_scale=depth_scale,
            known_distance=known_distance,
            observer=progress,
        )
    for line in imported.messages:
        console.print(line)
    print_warnings(console, imported.scene.warnings, verbose)
    print_notes(console, imported.scene.notes)
    console.print(f"Scene: {out}")
    print_next(console, "check" if imported.scene.key_frames else "annotate", out)
