"""2D layouts of frames: the truth as a layout made with gtlayout shows it, and the pixel error of predicted ones.

The measure is that of the LSUN room layout challenge, as its tool kit computes it (``pixelwiseAccuracy.m``) and as the
paper's Table 3 reports it: the share of pixels that are wrong under the one-to-one matching of predicted segments to
true segments that makes most pixels right. Classes play no part, and each value of a prediction is a segment, 0 too.
What the tool kit leaves open:

* pixels at which the layout shows nothing are not scored (LSUN's truth covers the whole image), and a frame that shows
  nothing at all is left out;
* a missing prediction has error 1.

LSUN's second measure, the error of corners, is not computed: it compares the corners of one of eleven types of cuboid
rooms, which neither a generic layout nor a predicted label image has.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
from cyclopts import Parameter
from rich.console import Console
from rich.progress import track
from scipy.optimize import linear_sum_assignment

from common.command_line import exit_status, new_app
from common.metrics import Metric, markdown_table, mean_over, write_tables
from common.wireframe import Edge, segments_of, visible_edges
from gtlayout.errors import GtlayoutError
from gtlayout.geometry.render import render as render_layout
from gtlayout.io.files import json_text, path_inside, read_json, write_all_atomic, write_json_atomic
from gtlayout.io.pixels.images import decode, read_rgb
from gtlayout.io.scene_folder import load_scene
from gtlayout.layout import Layout
from gtlayout.results.layout_reader import read_layout
from gtlayout.scene import Camera, Frame, ImageArray, Scene

INDEX = "index.json"
INDEX_FORMAT = "gtlayout-layout2d/2"
WIREFRAME_FORMAT = "gtlayout-wireframe/1"
TABLE = "pixel_error"
MAX_LABEL = 255
COLORS = {"contact": (255, 255, 255), "occlusion": (230, 159, 0)}
"""RGB of edges in pictures."""

LabelArray = npt.NDArray[np.integer[Any]]

app = new_app(
    "layout2d", "2D layouts: the truth that a layout made with gtlayout shows, and the pixel error of predicted ones."
)


@app.command
def render(
    scene_dir: Annotated[Path, Parameter(name="SCENE_DIR")],
    /,
    *,
    layout: Path,
    out: Path,
    frames: Literal["key", "all"] = "key",
) -> None:
    """Write what each frame shows of a layout: label image, wireframe as JSON and as a picture, and index.json.

    Parameters
    ----------
    scene_dir
        The scene folder.
    layout
        Folder that holds its layout.json.
    out
        Where the files go.
    frames
        The annotated key frames, or every frame; the layout may lack what only the others show.
    """
    scene = load_scene(scene_dir)
    numbers = range(len(scene.frames)) if frames == "all" else [key_frame.frame for key_frame in scene.key_frames]
    write_truth(scene, read_layout(layout, scene), [scene.frames[i] for i in numbers], out)
    print(f"Truth of {len(numbers)} frames: {out}")


@app.command
def score(
    true_dir: Annotated[Path, Parameter(name="TRUE_DIR")],
    predicted_dir: Annotated[Path, Parameter(name="PREDICTED_DIR")],
    /,
    *,
    out: Path,
) -> None:
    """Print the pixel error of predicted layouts, and write it as Markdown, CSV and JSON.

    Parameters
    ----------
    true_dir
        Folder that `render` wrote, or a folder of such folders, one a scene.
    predicted_dir
        Label images (PNG, any integers or colours, of any size) under the same names.
    out
        Where the tables go.
    """
    rows = score_folder(true_dir, predicted_dir)
    table = rows | {"mean": mean_over(list(rows.values()))}
    write_tables(out, TABLE, table, "frame")
    print(markdown_table(table, "frame"), end="")


def label_image(layout: Layout, camera: Camera) -> ImageArray:
    """(H, W) what the camera sees: 0 = nothing, k = the k-th segment (from 1) of ``segments_of``.

    Raises:
        GtlayoutError: the layout has more segments than 8 bits can tell apart.
    """
    segments = segments_of(layout.instances)
    if len(segments) > MAX_LABEL:
        raise GtlayoutError(f"the layout has {len(segments)} segments: a label image holds {MAX_LABEL} at most")
    instances, _ = render_layout(layout.planes, layout.extents, layout.instances, camera)
    # The last entry is that of -1, "nothing".
    label_of = np.zeros(len(layout.instances) + 1, dtype=np.uint8)
    for label, members in enumerate(segments, start=1):
        label_of[members] = label
    return label_of[instances]


def pixel_error(truth: LabelArray, predicted: LabelArray | None) -> float | None:
    """Share of pixels that are wrong under the best one-to-one matching of predicted to true labels.

    Args:
        truth: (H, W) labels; 0 = not scored.
        predicted: (h, w) labels, each value a segment; of another size it is resized, nearest neighbour. None: there
            is no prediction, so every pixel is wrong.

    Returns:
        0 to 1; None when there is no pixel to score.
    """
    scored = truth != 0
    if not scored.any():
        return None
    if predicted is None:
        return 1.0
    true_labels, true = np.unique(truth[scored], return_inverse=True)
    labels, found = np.unique(_resized(predicted, truth.shape)[scored], return_inverse=True)
    size = (len(true_labels), len(labels))
    overlap = np.bincount(true * len(labels) + found, minlength=size[0] * size[1]).reshape(size)
    matched = overlap[linear_sum_assignment(overlap, maximize=True)].sum()
    return 1.0 - float(matched) / len(true)


def draw_wireframe(image: ImageArray, edges: Sequence[Edge]) -> ImageArray:
    """The (H, W, 3) RGB image with edges drawn over it: contacts white, occlusions orange, both with a dark rim."""
    picture = image.copy()
    width = max(1, round(min(image.shape[:2]) / 200))
    for rim in (True, False):
        for edge in edges:
            # OpenCV counts from the centre of the first pixel, in sixteenths here.
            points = np.round((edge.points_px - 0.5) * 16).astype(np.int32)
            color = (0, 0, 0) if rim else COLORS[edge.kind]
            cv2.polylines(picture, [points], False, color, 3 * width if rim else width, cv2.LINE_AA, 4)
    return picture


def write_truth(scene: Scene, layout: Layout, frames: Sequence[Frame], out_dir: Path) -> None:
    """Write ``<name>.png``, ``<name>_wireframe.json`` and ``<name>_wireframe.png`` of each frame, at last index.json.

    Labels and edges are in the pinhole image. Of a frame whose image file is distorted that image is written, too, as
    ``<name>_image.png``: predictions must be made on it.

    Raises:
        GtlayoutError: an image cannot be read, two frames have one name but for the suffix, or files cannot be written.
    """
    names = [PurePosixPath(frame.name).with_suffix("") for frame in frames]
    if twice := sorted({str(name) for name in names if names.count(name) > 1}):
        raise GtlayoutError(f"{scene.root}: several frames are called {twice[0]}, but for the suffix: rename them")
    index_path = out_dir / INDEX
    # A folder with an index is complete. One that cannot be written says so at the first frame.
    with suppress(OSError):
        index_path.unlink()
    console = Console(stderr=True)
    entries = []
    pairs = list(zip(frames, names, strict=True))
    for frame, name in track(pairs, "frames", console=console, disable=not console.is_terminal):
        image, edges = read_rgb(frame), visible_edges(layout, frame.camera)
        entry = {"image": frame.name, "labels": f"{name}.png", "wireframe": f"{name}_wireframe.json"}
        contents: dict[Path, bytes | str] = {
            out_dir / entry["labels"]: _png(label_image(layout, frame.camera)),
            out_dir / entry["wireframe"]: json_text(_wireframe(frame, edges)),
            out_dir / f"{name}_wireframe.png": _png(draw_wireframe(image, edges)[:, :, ::-1]),
        }
        if frame.undistort is not None:
            entry["undistorted"] = f"{name}_image.png"
            contents[out_dir / entry["undistorted"]] = _png(image[:, :, ::-1])
        write_all_atomic(contents)
        entries.append(entry)
    segments = [
        {
            "label": label,
            "name": layout.instances[members[0]].name,
            "class": layout.instances[members[0]].label,
            "openings": [layout.instances[i].name for i in members[1:]],
        }
        for label, members in enumerate(segments_of(layout.instances), start=1)
    ]
    write_json_atomic(index_path, {"format": INDEX_FORMAT, "segments": segments, "frames": entries})


def score_folder(true_dir: Path, predicted_dir: Path) -> dict[str, list[Metric]]:
    """Frame → its pixel error, and 1 in ``missing`` where there is no prediction: its error is then 1.

    Frames that show nothing of the layout are left out.

    Raises:
        GtlayoutError: there is no truth, no prediction at all, or a file is damaged.
    """
    indices = sorted(true_dir.rglob(INDEX))
    if not indices:
        raise GtlayoutError(f"no {INDEX} in {true_dir}: make it with `layout2d.py render`")
    rows: dict[str, list[Metric]] = {}
    for index in indices:
        folder = index.parent.relative_to(true_dir)
        for image, file in _read_index(index):
            truth = _read_labels(path_inside(index.parent, file, str(index)))
            path = path_inside(predicted_dir / folder, file, str(index))
            predicted = _read_labels(path) if path.is_file() else None
            error = pixel_error(truth, predicted)
            if error is not None:
                missing = Metric("missing", float(predicted is None), "", False)
                rows[(folder / image).as_posix()] = [Metric("pixel_error", error, "", False), missing]
    if not rows:
        raise GtlayoutError(f"{true_dir}: no frame shows anything of the layout")
    if all(missing.value for _, missing in rows.values()):
        raise GtlayoutError(f"{predicted_dir} holds no prediction: they must be called as the labels in {true_dir} are")
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


def _resized(labels: LabelArray, shape: tuple[int, ...]) -> LabelArray:
    """Nearest neighbour, by pixel centres."""
    rows, columns = (((np.arange(n) + 0.5) * m / n).astype(np.int64) for n, m in zip(shape, labels.shape, strict=True))
    return labels[np.ix_(rows, columns)]


def _png(image: npt.NDArray[np.uint8]) -> bytes:
    """Grey, or BGR."""
    return cv2.imencode(".png", image)[1].tobytes()


def _wireframe(frame: Frame, edges: Sequence[Edge]) -> dict[str, Any]:
    return {
        "format": WIREFRAME_FORMAT,
        "image": frame.name,
        "image_size": [frame.camera.width, frame.camera.height],
        "edges": [
            {
                "labels": [segment + 1 for segment in edge.segments],
                "kind": edge.kind,
                "points_px": np.round(edge.points_px, 3),
            }
            for edge in edges
        ],
    }


def _read_index(path: Path) -> list[tuple[str, str]]:
    """(image, file of its labels) of each frame."""
    data = read_json(path)
    if data.get("format") != INDEX_FORMAT:
        raise GtlayoutError(f'{path} is no index of label images: its "format" is not {INDEX_FORMAT!r}')
    try:
        return [(str(frame["image"]), str(frame["labels"])) for frame in data["frames"]]
    except (KeyError, TypeError) as error:
        raise GtlayoutError(f"{path} is damaged: {type(error).__name__} {error}; render it again") from error


def _read_labels(path: Path) -> LabelArray:
    """(H, W) labels; each colour of a colour image is one."""
    image = decode(path, cv2.IMREAD_UNCHANGED)
    if not np.issubdtype(image.dtype, np.integer):
        raise GtlayoutError(f"{path} is no label image: its values are {image.dtype}, integers are expected")
    if image.ndim == 2:
        return image
    return image.astype(np.int64) @ (1 << 16 * np.arange(image.shape[2]))


if __name__ == "__main__":
    sys.exit(main())
