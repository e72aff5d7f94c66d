"""Makes the strip of pictures at the top of the README: python docs/strip_pictures.py

The example is solved; a frame, its drawing, the room in 3D and its floor plan stand side by side. The plan is also that
of the page *Read the floor plan*. Takes half a minute.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from gtlayout.io.files import read_json
from pictures import PAGES, ROOM, ROOT, chromium, drawing, image, run, side_by_side

FRAME = "000016.jpg"


def main() -> None:
    """Write the pictures."""
    with TemporaryDirectory() as folder, chromium() as browser:
        room = Path(folder) / "room"
        shutil.copytree(ROOM, room, ignore=shutil.ignore_patterns("gtlayout"))
        for command in (("solve", room), ("report", room), ("export", room, "--to", "svg")):
            run(*command)
        page = browser.new_page(viewport={"width": 700, "height": 900})
        page.goto((room / "gtlayout/report.html").as_uri())
        page.wait_for_selector("#room-view[data-drawn]")
        page.wait_for_timeout(1000)
        view = page.locator("#room-view").screenshot(type="png")
        plan = (room / "gtlayout/floor_plan.svg").read_bytes()
        photo = next(ROOM.rglob(FRAME)).read_bytes()
        annotations = read_json(ROOM / "annotations.json")
        (frame,) = (one for one in annotations["frames"] if one["image"] == FRAME)
        parts = {
            "a frame": image(photo, "jpeg"),
            "what is drawn on it": drawing(photo, annotations["image_size"], frame["elements"]),
            "the room in 3D": image(view, "png"),
            "its plan": image(plan, "svg+xml"),
        }
        side_by_side(browser, parts, ROOT / "docs/strip.jpg", width=1400, height=310, box=250, quality=80)
        sheet = browser.new_page(viewport={"width": 900, "height": 900})
        sheet.set_content(f'<body style="margin: 0">{image(plan, "svg+xml")}</body>')
        sheet.wait_for_timeout(500)
        sheet.locator("img").screenshot(path=PAGES / "floor_plan.jpg", type="jpeg", quality=75)


if __name__ == "__main__":
    main()
