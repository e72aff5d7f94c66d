"""Makes the strip of pictures at the top of the README: python docs/strip_pictures.py

The example is solved; a frame, its drawing, the room in 3D and its floor plan stand side by side. Takes half a minute.
"""

from __future__ import annotations

import shutil
from base64 import b64encode
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from playwright.sync_api import sync_playwright

from gtlayout.cli.app import main as gtlayout
from gtlayout.colors import LABEL_COLORS
from gtlayout.io.files import read_json

ROOT = Path(__file__).parents[1]
ROOM = ROOT / "examples/room"
STRIP = ROOT / "docs/strip.jpg"
FRAME = "000016.jpg"
STYLE = """
  body { margin: 0; background: #fff; font: 15px sans-serif; color: #333; width: 1400px; }
  main { display: grid; grid-template-columns: repeat(4, 1fr); gap: 12px; padding: 8px; }
  figure { margin: 0; } figcaption { text-align: center; padding-top: 6px; }
  .box { height: 250px; display: flex; align-items: center; justify-content: center; position: relative; }
  .box > * { max-width: 100%; max-height: 250px; }
"""


def main() -> None:
    """Write the picture."""
    flags = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        room = Path(folder) / "room"
        shutil.copytree(ROOM, room, ignore=shutil.ignore_patterns("gtlayout"))
        for command in (["solve", str(room)], ["report", str(room)], ["export", str(room), "--to", "svg"]):
            if gtlayout(command) != 0:
                raise SystemExit(f"{' '.join(command)} failed")
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=flags)
        page = browser.new_page(viewport={"width": 700, "height": 900})
        page.goto((room / "gtlayout/report.html").as_uri())
        page.wait_for_selector("#room-view[data-drawn]")
        page.wait_for_timeout(1000)
        view = page.locator("#room-view").screenshot(type="png")
        plan = (room / "gtlayout/floor_plan.svg").read_bytes()
        photo = next(ROOM.rglob(FRAME)).read_bytes()
        parts = {
            "a frame": image(photo, "jpeg"),
            "what is drawn on it": drawing(photo, read_json(ROOM / "annotations.json")),
            "the room in 3D": image(view, "png"),
            "its plan": image(plan, "svg+xml"),
        }
        figures = "".join(
            f'<figure><div class="box">{part}</div><figcaption>{caption}</figcaption></figure>'
            for caption, part in parts.items()
        )
        strip = browser.new_page(viewport={"width": 1400, "height": 310})
        strip.set_content(f"<style>{STYLE}</style><main>{figures}</main>")
        strip.wait_for_timeout(500)
        strip.screenshot(path=STRIP, type="jpeg", quality=80)
        browser.close()


def image(data: bytes, kind: str) -> str:
    """An image that holds its own bytes."""
    return f'<img src="data:image/{kind};base64,{b64encode(data).decode()}">'


def drawing(photo: bytes, annotations: dict[str, Any]) -> str:
    """A frame under the elements that are drawn on it, in the colours of their labels."""
    (frame,) = (one for one in annotations["frames"] if one["image"] == FRAME)
    width, height = annotations["image_size"]
    shapes = []
    for element in frame["elements"]:
        red, green, blue, *_ = LABEL_COLORS[element["label"]]
        for ring in element["polygons"]:
            points = " ".join(f"{x},{y}" for x, y in ring)
            color = f"rgb({red},{green},{blue})"
            shapes.append(
                f'<polygon points="{points}" fill="{color}" fill-opacity=".45" stroke="{color}" stroke-width="2"/>'
            )
    picture = f'<image href="data:image/jpeg;base64,{b64encode(photo).decode()}" width="{width}" height="{height}"/>'
    return f'<svg viewBox="0 0 {width} {height}" width="{width}">{picture}{"".join(shapes)}</svg>'


if __name__ == "__main__":
    main()
