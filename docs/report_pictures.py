"""Makes the pictures of the page *Read the report*: python docs/report_pictures.py

The example is solved with one wrong drawing, and its report opened in headless Chromium. Takes a minute.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from playwright.sync_api import Page

from gtlayout.io.files import read_json, write_json_atomic
from pictures import PAGES, ROOM, chromium, run

PICTURES = PAGES / "report"
WRONG = "000016.jpg"
"""The key frame in which the floor is drawn too low."""
MOVED_PX = 14.0
SAME_CORNER_PX = 4.0


def main() -> None:
    """Write all pictures."""
    PICTURES.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder, chromium() as browser:
        room = Path(folder) / "room"
        shutil.copytree(ROOM, room, ignore=shutil.ignore_patterns("gtlayout"))
        drawings = read_json(room / "annotations.json")
        move_floor(next(frame for frame in drawings["frames"] if frame["image"] == WRONG))
        write_json_atomic(room / "annotations.json", drawings)
        run("solve", room)
        run("report", room)
        page = browser.new_page(viewport={"width": 1000, "height": 900})
        page.goto((room / "gtlayout/report.html").as_uri())
        page.wait_for_selector("#room-view[data-drawn]")
        picture(page, "#next", "next")
        picture(page, "#room", "room")
        worst = page.locator("details.plane", has_text="disagree").or_(page.locator("details.plane")).first
        worst.evaluate("panel => { panel.open = true; }")
        picture(page, "details.plane[open]", "plane")
        picture(page, "#frames figure", "frame")
        # As on paper: A4 less its margins, at 96 px an inch.
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 695, "height": 2000})
        picture(page, "main", "paper")


def move_floor(frame: dict[str, Any]) -> None:
    """The upper border of the floor in a key frame goes down, and with it the corners that its neighbours share."""
    (floor,) = (element for element in frame["elements"] if element["label"] == "floor")
    bottom = max(y for ring in floor["polygons"] for _, y in ring)
    wrong = [point for ring in floor["polygons"] for point in ring if point[1] < bottom - 2 * MOVED_PX]
    places = [tuple(point) for point in wrong]
    for element in frame["elements"]:
        for ring in element["polygons"]:
            for point in ring:
                near = any(abs(point[0] - x) + abs(point[1] - y) < SAME_CORNER_PX for x, y in places)
                if near and element["label"] not in ("door", "window"):
                    point[1] = min(point[1] + MOVED_PX, bottom)


def picture(page: Page, selector: str, name: str) -> None:
    """A part of the page."""
    page.wait_for_timeout(1000)
    page.locator(selector).first.screenshot(path=PICTURES / f"{name}.jpg", type="jpeg", quality=72)


if __name__ == "__main__":
    main()
