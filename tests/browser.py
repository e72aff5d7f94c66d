"""Pages in a real browser: Debian's Chromium, headless, driven by Playwright. Fixtures ``page`` and ``problems``."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Dialog, Page, Route, sync_playwright

CHROMIUM = Path("/usr/bin/chromium")
_FLAGS = (
    "--no-sandbox",  # tests also run as root, for whom Chromium has no sandbox
    "--disable-quic",
    "--no-first-run",
    # Without these Chromium itself asks for hosts of its maker.
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # WebGL without a graphics card.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
_LOOPBACK = ("127.0.0.1", "localhost")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """One browser a test file; its event loop ends with it, so that other tests can have their own."""
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is absent: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(_FLAGS))
        yield browser
        browser.close()


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address at which a folder is served over HTTP, on this machine only."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.fixture
def problems() -> list[str]:
    """What went wrong in ``page`` so far: errors on its console, exceptions, dialogs, requests that would
    leave this machine.
    """
    return []


@pytest.fixture
def page(chromium: Browser, problems: list[str]) -> Iterator[Page]:
    """An empty page, 1280 x 900 px, in a profile of its own. Requests that would leave this machine fail."""

    def local_only(route: Route) -> None:
        address = urlsplit(route.request.url)
        if address.scheme in ("file", "data", "blob") or address.hostname in _LOOPBACK:
            route.continue_()
        else:
            problems.append(f"request: {route.request.url}")
            route.abort()

    def listen(message: ConsoleMessage) -> None:
        if message.type == "error":
            problems.append(f"console: {message.text}")

    def dismiss(dialog: Dialog) -> None:
        problems.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    context = chromium.new_context(viewport={"width": 1280, "height": 900})
    context.route("**/*", local_only)
    shown = context.new_page()
    shown.on("console", listen)
    shown.on("dialog", dismiss)
    shown.on("pageerror", lambda error: problems.append(f"exception: {error}"))
    yield shown
    context.close()
