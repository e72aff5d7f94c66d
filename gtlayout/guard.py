"""Who may speak to a server of gtlayout: on this machine its own page or other programs, or who knows a password."""

from __future__ import annotations

import base64
import secrets
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = "127.0.0.1"
HEADERS = {"X-Content-Type-Options": "nosniff", "Cache-Control": "no-store"}
"""Of every answer."""
PAGE_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""Of the answers of a server that has a page."""
Refusal = Callable[[int, str], Response]
"""Makes an answer of a status and a line that says why."""


@dataclass(frozen=True)
class Credentials:
    """Of HTTP's basic authentication."""

    user: str
    password: str

    def fit(self, authorization: str) -> bool:
        """Whether a request with that header may pass; takes as long for any wrong one."""
        wanted = base64.b64encode(f"{self.user}:{self.password}".encode())
        scheme, _, given = authorization.partition(" ")
        return scheme.lower() == "basic" and secrets.compare_digest(given.strip().encode(), wanted)


@dataclass(frozen=True)
class Admission:
    """What a request needs to be let through."""

    max_body: int
    """Bytes that it has at most."""
    hosts: Collection[str] | None = None
    """Names, with port, that it may call the server by; None where any will do."""
    token: str | None = None
    """First part of its path, where the server has a page of its own; None = it has none, and no page may speak to it.

    Another page in the same browser does not know it.
    """
    credentials: Credentials | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    """Of every answer, besides ``HEADERS``."""

    def refused(self, scope: Scope) -> tuple[int, str] | None:
        """Status and reason, when a request is not let through.

        A site elsewhere could have its name lead to this machine (DNS rebinding): its requests carry that name as Host.
        Browsers say with Origin which page is asking; programs send none.
        """
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if self.hosts is not None and host not in self.hosts:
            return 403, "this server answers only to its own address"
        if self.token is None:
            if origin is not None:
                return 403, "this server does not answer to web pages"
        else:
            if origin != f"http://{host}" and (origin is not None or scope["method"] not in ("GET", "HEAD")):
                return 403, "this server answers only to its own page"
            # The path of OPTIONS may be a mere *.
            given = scope["path"].removeprefix("/").partition("/")[0]
            if not secrets.compare_digest(given.encode(), self.token.encode()):
                return 404, "open the whole address that was printed at the start"
        if self.credentials is not None and not self.credentials.fit(headers.get("authorization", "")):
            return 401, "user name and password are missing or wrong"
        return None


class Guard:
    """Lets through to ``app`` what is admitted; the rest gets 401, 403 or 404, and too long a body 413."""

    def __init__(self, app: ASGIApp, admission: Admission, refusal: Refusal) -> None:
        """``app`` gets Starlette's HTTPException, to be answered, from where it reads too long a body."""
        self._app, self._admission, self._refusal = app, admission, refusal

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        received = 0

        async def receive_some() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > self._admission.max_body:
                raise HTTPException(413, f"the body has more than {self._admission.max_body >> 20} MB")
            return message

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update({**HEADERS, **self._admission.headers})
            await send(message)

        refused = self._admission.refused(scope)
        app = self._app if refused is None else self._answer(*refused)
        await app(scope, receive_some, send_with_headers)

    def _answer(self, status: int, why: str) -> Response:
        answer = self._refusal(status, why)
        if status == 401:
            answer.headers["WWW-Authenticate"] = 'Basic realm="gtlayout"'
        return answer
