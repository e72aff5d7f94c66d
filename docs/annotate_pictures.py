"""Makes the pictures of the page *Annotate your room in ten minutes*: python docs/annotate_pictures.py

The example is annotated from nothing in headless Chromium, with the drawings that come with it. Takes some minutes.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from playwright.sync_api import Page, expect

from gtlayout.io.files import read_json
from gtlayout.scene import LABELS
from pictures import PAGES, ROOM, chromium

PICTURES = PAGES / "annotate"
FIRST, SECOND, THIRD = "000008.jpg", "000016.jpg", "000024.jpg"
PATIENCE_MS = 300_000.0


def main() -> None:
    """Write all pictures."""
    drawings = {frame["image"]: frame for frame in read_json(ROOM / "annotations.json")["frames"]}
    PICTURES.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder, chromium() as browser:
        room = Path(folder) / "room"
        shutil.copytree(ROOM, room, ignore=shutil.ignore_patterns("annotations.json", "gtlayout"))
        page = browser.new_page(viewport={"width": 1280, "height": 860})
        page.set_default_timeout(PATIENCE_MS)
        with served(room) as address:
            page.goto(address)
            go(page, FIRST)
            elements = drawings[FIRST]["elements"]
            for element in elements[:-1]:
                draw(page, element)
            page.locator("#stage").press(str(LABELS.index(elements[-1]["label"]) + 1))
            for point in elements[-1]["polygons"][0][:3]:
                page.mouse.click(*place(page, point))
            picture(page, "drawing")
            page.locator("#stage").press("Escape")
            draw(page, elements[-1])
            page.locator("#stage").press("Escape")
            page.locator("#stage").press("t")
            expect(page.locator("#hint")).to_contain_text("Visible parts proposed")
            page.locator("#elements button", has_text="wall").first.click()
            page.locator("#stage").press("b")
            picture(page, "visible")
            go(page, SECOND)
            for element in drawings[SECOND]["elements"]:
                draw(page, element)
            page.locator("#stage").press("Escape")
            page.locator("#stage").press("t")
            expect(page.locator("#solving")).to_contain_text("full solve", timeout=PATIENCE_MS)
            page.locator("#stage").press("Escape")
            picture(page, "solved")
            go(page, THIRD)
            page.locator("#elements .draft").nth(2).click()
            picture(page, "proposed")
            page.set_viewport_size({"width": 820, "height": 1180})
            picture(page, "tablet")


@contextmanager
def served(room: Path) -> Iterator[str]:
    """The address of the page of ``gtlayout annotate``, while it runs."""
    command = [sys.executable, "-m", "gtlayout", "annotate", str(room)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        try:
            yield running.stdout.readline().split()[0]
        finally:
            running.terminate()


def go(page: Page, frame: str) -> None:
    """To a frame, when all is saved."""
    page.locator("#strip button", has_text=frame).click()
    expect(page.locator("#stage")).to_have_attribute("aria-label", f"Image {frame}")
    page.locator("#hint", has_text="proposed").or_(page.locator("#hint", has_text="Keys 1")).wait_for()


def draw(page: Page, element: dict[str, Any]) -> None:
    """An element, corner by corner."""
    page.locator("#stage").press(str(LABELS.index(element["label"]) + 1))
    for point in element["polygons"][0]:
        page.mouse.click(*place(page, point))
    page.locator("#stage").press("Enter")


def place(page: Page, point: list[float]) -> tuple[float, float]:
    """Where a point of the image is in the window."""
    matrix = "(([x, y]) => { const m = document.querySelector('#stage > g').getScreenCTM(); "
    x, y = page.evaluate(matrix + "return [m.a * x + m.e, m.d * y + m.f]; })", point)
    return x, y


def picture(page: Page, name: str) -> None:
    """What the page shows, once images are there."""
    page.wait_for_timeout(1500)
    page.screenshot(path=PICTURES / f"{name}.jpg", type="jpeg", quality=65)


if __name__ == "__main__":
    main()
