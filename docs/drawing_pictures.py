"""Makes the pictures of the page *What to draw*: python docs/drawing_pictures.py

Right and wrong drawings side by side, on the example and on synthetic rooms made for it. Takes half a minute.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import shapely
from playwright.sync_api import Browser

from gtlayout.api import load
from gtlayout.io.files import read_json
from gtlayout.io.pixels.images import read_depth
from pictures import PAGES, ROOM, Ring, chromium, drawing, run, side_by_side

PICTURES = PAGES / "drawing"
FRAME = "000016.jpg"
WINDOW = (10.0, 60.0, 240.0, 180.0)
"""Where a window is in it: x, y, width, height, px."""
BEFORE_M = 0.05
"""What is nearer than the surface drawn there by more than this stands before it."""
RIGHT, WRONG = '<b style="color: #187a35">✓ right</b>: ', '<b style="color: #b3261e">✗ wrong</b>: '
ROOMS = {"corner": ("--room", "l-shaped", "--seed", "3"), "kitchen": ("--kitchen", "1", "--seed", "1")}
ROOMS |= {"doorway": ("--room", "two-rooms", "--seed", "3")}
"""The synthetic rooms, each with what asks for it."""


def main() -> None:
    """Write all pictures."""
    with TemporaryDirectory() as folder, chromium() as browser:
        example = frame_of(ROOM, FRAME)
        elements = example["elements"]
        furniture = furniture_of(ROOM, FRAME)
        cut = [without(element, furniture) for element in elements]
        sides = {"straight through the furniture": elements, "up to the furniture": cut}
        two(browser, "through", ROOM, example, {text: {"elements": drawn} for text, drawn in sides.items()})
        parts = [ring for element in elements for ring in element["visible"]]
        whole = [ring for element in elements for ring in element["polygons"] if element["label"] != "window"]
        sides = {"where the surface itself is seen": parts, "sofa and shelves are not the wall": whole}
        two(browser, "visible", ROOM, example, {text: {"visible": drawn} for text, drawn in sides.items()})
        panes = [element for element in elements if element["label"] != "window"] + panes_of(elements)
        sides = {"frame and glass together, in one piece": elements, "each pane, without its frame": panes}
        near = {text: {"elements": drawn, "view": WINDOW} for text, drawn in sides.items()}
        two(browser, "windows", ROOM, example, near)
        for name, options in ROOMS.items():
            run("synth", Path(folder) / name, *options, "--frames", "9", "--width", "480", "--height", "360")
        occluded(browser, Path(folder))
        doorway(browser, Path(folder) / "doorway")
        key_frames(Path(folder))


def occluded(browser: Browser, rooms: Path) -> None:
    """Neighbours in the image that do not touch: a corner that stands out, and a worktop before a wall."""
    texts = "pink where the two do not touch", "near and far wall seem to meet"
    for name, wrong in (("corner", texts[1]), ("kitchen", "front and wall above seem to meet")):
        frame = frame_of(rooms / name, "000008.jpg")
        elements = {"elements": frame["elements"]}
        sides = {texts[0]: elements | {"occlusion_edges": frame["occlusion_edges"]}, wrong: elements}
        two(browser, name, rooms / name, frame, sides)


def doorway(browser: Browser, room: Path) -> None:
    """What is seen through an open door: drawn with its occlusion edges, or left blank."""
    frame = frame_of(room, "000008.jpg")
    opening = shapely.box(*shapely.MultiLineString(frame["occlusion_edges"]).bounds)
    here = [one for one in frame["elements"] if not opening.buffer(4).contains(area(one))]
    drawn = {"elements": frame["elements"], "occlusion_edges": frame["occlusion_edges"]}
    blank = {"elements": [without(one, opening) for one in here], "blank": rings(opening)}
    texts = "the next room, with pink round the opening", "nothing in the opening: left blank"
    side_by_side(
        browser,
        {RIGHT + texts[0]: panel(room, frame, drawn), RIGHT + texts[1]: panel(room, frame, blank)},
        PICTURES / "doorway.jpg",
        width=1000,
        height=412,
        box=365,
    )


def key_frames(folder: Path) -> None:
    """The frames that ``gtlayout import`` names, of the example as if nothing were drawn on it."""
    bare = folder / "bare"
    shutil.copytree(
        ROOM, bare, ignore=shutil.ignore_patterns("annotations.json", "depth", "gt_planes.json", "gtlayout")
    )
    run("import", bare, folder / "scene")
    sheet = cv2.imread(str(folder / "scene/key_frames.jpg"))
    assert sheet is not None
    width = 900
    small = cv2.resize(sheet, (width, round(sheet.shape[0] * width / sheet.shape[1])), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(PICTURES / "key_frames.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, 75])


def frame_of(room: Path, name: str) -> dict[str, Any]:
    """What is drawn on an image of a room."""
    (frame,) = (one for one in read_json(room / "annotations.json")["frames"] if one["image"] == name)
    return frame


def panel(room: Path, frame: dict[str, Any], drawn: dict[str, Any]) -> str:
    """The image of a frame under a drawing, as HTML."""
    size = read_json(room / "annotations.json")["image_size"]
    return drawing((room / "images" / frame["image"]).read_bytes(), size, **drawn)


def two(browser: Browser, name: str, room: Path, frame: dict[str, Any], sides: dict[str, dict[str, Any]]) -> None:
    """A picture of a right drawing beside a wrong one."""
    panels = {
        mark + caption: panel(room, frame, drawn)
        for mark, (caption, drawn) in zip((RIGHT, WRONG), sides.items(), strict=True)
    }
    side_by_side(browser, panels, PICTURES / f"{name}.jpg", width=1000, height=412, box=365)


def furniture_of(room: Path, name: str) -> shapely.Geometry:
    """Where something stands before what is drawn, px: by the true depth and the true planes."""
    truth = read_json(room / "gt_planes.json")
    scene = load(room)
    frame = next(one for one in scene.frames if one.image_path.name == name)
    depth_m = read_depth(frame)
    camera = frame.camera
    rows, columns = np.indices(depth_m.shape) + 0.5
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(camera.K).T
    hidden = np.zeros(depth_m.shape, np.uint8)
    for element in frame_of(room, name)["elements"]:
        plane = truth["planes"][truth["elements"][name][element["id"]]]
        normal_cam = camera.R_cam_from_world @ np.array(plane["normal"])
        offset_cam = plane["d"] - normal_cam @ camera.t_cam_from_world
        surface_m = -offset_cam / (rays @ normal_cam)
        mask = np.zeros(depth_m.shape, np.uint8)
        for ring in element["polygons"]:
            cv2.fillPoly(mask, [np.round(ring).astype(np.int32)], 1)
        hidden |= mask & (depth_m < surface_m - BEFORE_M) & (depth_m > 0)
    cleaned = cv2.morphologyEx(hidden, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    outlines, _ = cv2.findContours(cleaned, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    simple = [cv2.approxPolyDP(outline, 2.0, closed=True)[:, 0] for outline in outlines]
    return shapely.union_all([shapely.Polygon(ring).buffer(0) for ring in simple if len(ring) > 2])


def without(element: dict[str, Any], hole: shapely.Geometry) -> dict[str, Any]:
    """An element that leaves out an area of the image."""
    return element | {"polygons": rings(area(element).difference(hole))}


def panes_of(elements: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each window in two, without its frame."""
    panes = []
    for element in elements:
        if element["label"] == "window":
            left, top, right, bottom = area(element).bounds
            middle = (left + right) / 2
            for sides in ((left + 4, middle - 3), (middle + 3, right - 4)):
                panes.append(element | {"polygons": rings(shapely.box(sides[0], top + 5, sides[1], bottom - 5))})
    return panes


def area(element: dict[str, Any]) -> shapely.Geometry:
    """What an element covers, px."""
    return shapely.union_all([shapely.Polygon(ring).buffer(0) for ring in element["polygons"]])


def rings(region: shapely.Geometry) -> list[Ring]:
    """The outlines of an area without holes."""
    parts = shapely.get_parts(region)
    return [shapely.get_coordinates(part.exterior).tolist() for part in parts if part.geom_type == "Polygon"]


if __name__ == "__main__":
    main()
