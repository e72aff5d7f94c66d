"""What the scripts that make the pictures of the documentation share: a browser, and drawings as SVG."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, sync_playwright

from gtlayout.cli.app import main as gtlayout
from gtlayout.colors import LABEL_COLORS

ROOT = Path(__file__).parents[1]
ROOM = ROOT / "examples/room"
PAGES = ROOT / "docs/pages"
Ring = list[list[float]]
"""Corners, px."""
_WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_STYLE = """
  body { margin: 0; background: #fff; font: 18px sans-serif; color: #333; }
  main { display: grid; grid-auto-flow: column; gap: 12px; padding: 8px; }
  figure { margin: 0; } figcaption { text-align: center; padding-top: 6px; }
  .box { display: flex; align-items: center; justify-content: center; position: relative; }
  .box > * { max-width: 100%; max-height: 100%; }
"""


@contextmanager
def chromium() -> Iterator[Browser]:
    """Debian's Chromium, headless, with WebGL on the CPU."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox", *_WEBGL])
        yield browser
        browser.close()


def run(*command: str | Path) -> None:
    """A command of gtlayout; the script ends where it fails."""
    if gtlayout([str(word) for word in command]) != 0:
        raise SystemExit(f"gtlayout {' '.join(map(str, command))} failed")


def image(data: bytes, kind: str) -> str:
    """An image that holds its own bytes, as HTML."""
    return f'<img src="data:image/{kind};base64,{b64encode(data).decode()}">'


def drawing(
    photo: bytes,
    size: tuple[int, int],
    elements: Iterable[Mapping[str, Any]] = (),
    *,
    visible: Iterable[Ring] = (),
    occlusion_edges: Iterable[Ring] = (),
    blank: Iterable[Ring] = (),
    view: tuple[float, float, float, float] | None = None,
) -> str:
    """A frame under what is drawn on it, as SVG: elements in the colours of their labels, occlusion edges in pink.

    ``view``: the part to show, as x, y, width, height in px; all of it when not given.
    """
    shapes = []
    for element in elements:
        red, green, blue = LABEL_COLORS[element["label"]]
        color = f"rgb({red},{green},{blue})"
        style = f'fill="{color}" fill-opacity=".45" stroke="{color}" stroke-width="2"'
        shapes += [f'<polygon points="{_points(ring)}" {style}/>' for ring in element["polygons"]]
    yellow = 'fill="#ffe14d" fill-opacity=".5" stroke="#b38f00" stroke-width="1.5"'
    shapes += [f'<polygon points="{_points(ring)}" {yellow}/>' for ring in visible]
    grey = 'fill="#444" fill-opacity=".6" stroke="#fff" stroke-width="1.5" stroke-dasharray="5 3"'
    shapes += [f'<polygon points="{_points(ring)}" {grey}/>' for ring in blank]
    pink = 'fill="none" stroke="#ff2bd6" stroke-width="5"'
    shapes += [f'<polyline points="{_points(line)}" {pink}/>' for line in occlusion_edges]
    width, height = size
    under = f'<image href="data:image/jpeg;base64,{b64encode(photo).decode()}" width="{width}" height="{height}"/>'
    part = " ".join(f"{value:g}" for value in view or (0, 0, width, height))
    return f'<svg viewBox="{part}" width="{width}" height="{height}">{under}{"".join(shapes)}</svg>'


def side_by_side(
    browser: Browser, panels: Mapping[str, str], path: Path, *, width: int, height: int, box: int, quality: int = 75
) -> None:
    """Write a JPEG of pictures (HTML) above their captions; ``box``: the height of each picture, px."""
    figures = "".join(
        f'<figure><div class="box" style="height: {box}px">{part}</div><figcaption>{caption}</figcaption></figure>'
        for caption, part in panels.items()
    )
    page = browser.new_page(viewport={"width": width, "height": height})
    columns = f"grid-template-columns: repeat({len(panels)}, minmax(0, 1fr))"
    page.set_content(f'<style>{_STYLE}</style><main style="{columns}">{figures}</main>')
    page.wait_for_timeout(500)
    path.parent.mkdir(exist_ok=True)
    page.screenshot(path=path, type="jpeg", quality=quality)
    page.close()


def _points(ring: Ring) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in ring)
