"""Who may speak to gtlayout's servers: what neither the page nor the backend of Label Studio asks."""

from __future__ import annotations

import socket

import pytest
from serving import running
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from gtlayout.guard import HEADERS, PAGE_HEADERS, Admission, Guard


async def length(request: Request) -> Response:
    return PlainTextResponse(str(len(await request.body())))


def guarded(token: str | None = None) -> Guard:
    """Behind it is one path, which tells how long the body is."""
    path = "/" if token is None else f"/{token}"
    app = Starlette(routes=[Route(path, length, methods=["POST"])])
    headers = {} if token is None else PAGE_HEADERS
    admission = Admission(1 << 20, token=token, headers=headers)
    return Guard(app, admission, lambda status, why: PlainTextResponse(why, status))


def answered(url: str, head: str, body: bytes = b"") -> str:
    """The answer to a request as it stands."""
    host, port = url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=20) as connection:
        connection.sendall(f"{head}\r\nHost: {host}:{port}\r\nConnection: close\r\n".encode() + body)
        parts = []
        while part := connection.recv(1 << 16):
            parts.append(part)
    return b"".join(parts).decode().lower()


@pytest.mark.parametrize(("token", "status"), [(None, 404), ("abc", 404)])
def test_a_path_without_a_slash_is_answered(token: str | None, status: int) -> None:
    with running(guarded(token)) as url:
        origin = f"\r\nOrigin: {url}" if token else ""
        answer = answered(url, f"OPTIONS * HTTP/1.1{origin}", b"\r\n")
    assert answer.startswith(f"http/1.1 {status} ")


def test_a_body_that_does_not_say_how_long_it_is_has_the_same_limit() -> None:
    def chunked(size: int) -> bytes:
        return b"Transfer-Encoding: chunked\r\n\r\n%x\r\n%s\r\n0\r\n\r\n" % (size, b"x" * size)

    with running(guarded()) as url:
        right = answered(url, "POST / HTTP/1.1", chunked(1 << 20))
        wrong = answered(url, "POST / HTTP/1.1", chunked((1 << 20) + 1))
    assert right.startswith("http/1.1 200 ") and right.endswith(str(1 << 20))
    assert wrong.startswith("http/1.1 413 ") and wrong.endswith("the body has more than 1 mb")


def test_every_answer_has_the_headers_also_refusals() -> None:
    with running(guarded("abc")) as url:
        for path in ("/abc", "/abcd"):
            answer = answered(url, f"POST {path} HTTP/1.1\r\nOrigin: {url}\r\nContent-Length: 0", b"\r\n")
            assert answer.startswith("http/1.1 200 " if path == "/abc" else "http/1.1 404 ")
            for name, value in {**HEADERS, **PAGE_HEADERS}.items():
                assert f"\r\n{name}: {value}\r\n".lower() in answer
