"""Makes the picture of the viewer on the page *Use the result*: python docs/viewer_pictures.py

The example is solved, and its log opened in rerun's web viewer, in headless Chromium. Takes a minute or two.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import urlsplit

import cv2
import numpy as np
from playwright.sync_api import Page, Route

from gtlayout.colors import instance_colors
from pictures import PAGES, ROOM, chromium, run

PATIENCE_S = 240
MANY_PIXELS = 2000
"""In the colour of the first surface: the room is drawn."""


def main() -> None:
    """Write the picture."""
    with TemporaryDirectory() as folder, chromium() as browser:
        room = Path(folder) / "room"
        shutil.copytree(ROOM, room, ignore=shutil.ignore_patterns("gtlayout"))
        run("solve", room, "--rerun", "save")
        command = [sys.executable, "-m", "gtlayout", "view", str(room), "--web", "--port", str(free_port())]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as viewer:
            assert viewer.stdout is not None
            try:
                page = browser.new_page(viewport={"width": 1100, "height": 700})
                page.route("**/*", local_only)
                page.goto(viewer.stdout.readline().strip())
                wait_for_room(page)
                page.screenshot(path=PAGES / "viewer.jpg", type="jpeg", quality=75, timeout=PATIENCE_S * 1000)
            finally:
                viewer.terminate()


def free_port() -> int:
    """A port that is free now, the one after it most probably, too."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
    return port


def local_only(route: Route) -> None:
    """Rerun's page asks the network for a font and for news: it gets neither."""
    address = urlsplit(route.request.url)
    if address.scheme in ("data", "blob") or address.hostname in ("127.0.0.1", "localhost"):
        route.continue_()
    else:
        route.abort()


def wait_for_room(page: Page) -> None:
    """Until its first surface is seen."""
    floor = instance_colors(0).astype(int)
    give_up = time.monotonic() + PATIENCE_S
    while time.monotonic() < give_up:
        page.wait_for_timeout(2000)
        shot = cv2.imdecode(np.frombuffer(page.screenshot(timeout=PATIENCE_S * 1000), np.uint8), cv2.IMREAD_COLOR)
        assert shot is not None
        if (np.abs(shot[..., ::-1].astype(int) - floor).max(axis=2) < 8).sum() > MANY_PIXELS:
            page.wait_for_timeout(5000)
            return
    raise SystemExit("the viewer did not draw the room")


if __name__ == "__main__":
    main()
