"""Who may speak to the server: programs, not web pages; on this machine, or with a password."""

from __future__ import annotations

import base64
import secrets
from collections.abc import Collection
from dataclasses import dataclass

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

HEADERS = {"X-Content-Type-Options": "nosniff", "Cache-Control": "no-store"}


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


class Guard:
    """Lets requests through to ``app``; the rest gets 401 or 403, as JSON.

    No web page may speak to it: browsers say with ``Origin`` that one does, and ``Host`` tells the name of a site that
    was made to lead here (DNS rebinding). Label Studio's server sends no ``Origin``.
    """

    def __init__(self, app: ASGIApp, hosts: Collection[str] | None, credentials: Credentials | None) -> None:
        """``hosts`` are the names, with port, that it may be called by; None where any may be."""
        self._app, self._hosts, self._credentials = app, hosts, credentials

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI application."""
        refused = self._refused(Headers(scope=scope)) if scope["type"] == "http" else None
        await (self._app if refused is None else refused)(scope, receive, send)

    def _refused(self, headers: Headers) -> JSONResponse | None:
        if self._hosts is not None and headers.get("host", "") not in self._hosts:
            return problem(403, "this server answers only to its own address")
        if "origin" in headers:
            return problem(403, "this server does not answer to web pages")
        if self._credentials is not None and not self._credentials.fit(headers.get("authorization", "")):
            refused = problem(401, "user name and password are missing or wrong")
            refused.headers["WWW-Authenticate"] = 'Basic realm="gtlayout"'
            return refused
        return None


def problem(status: int, message: str) -> JSONResponse:
    """What went wrong, as Label Studio shows it."""
    return JSONResponse({"error": message}, status, HEADERS)
