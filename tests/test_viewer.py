"""The viewers: what happens where none can start, and what the web viewer serves to whom."""

from __future__ import annotations

import signal
import socket
import sys
from pathlib import Path
from urllib.parse import parse_qs, urlsplit
from urllib.request import urlopen

import psutil
import pytest
import rerun as rr
from web_viewer import web_viewer

import gtlayout.viewer.process
from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.observer import Observer
from gtlayout.viewer.process import open_log, require_viewer, serve_log
from gtlayout.viewer.session import rerun_observer


def test_no_viewer_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    log = tmp_path / "log.rrd"
    with pytest.raises(GtlayoutError, match="does not exist: make it with"):
        open_log(log)
    log.touch()
    with pytest.raises(GtlayoutError, match="no display"):
        open_log(log)
    with pytest.raises(GtlayoutError, match="no display"), rerun_observer("spawn", log, Observer()):
        pass


def test_connect_needs_a_listening_viewer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        require_viewer(port)
    with pytest.raises(GtlayoutError, match="no rerun viewer listens"):
        require_viewer(port)


@pytest.mark.parametrize(
    ("program", "says"),
    [("", None), ("print('loading'); print('no screen', file=sys.stderr); sys.exit(3)", "no screen")],
)
def test_view_hands_the_log_to_the_viewer(
    program: str, says: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python stands in for the viewer: the log it is handed is a program that notes its arguments."""
    log, got = tmp_path / "a log.rrd", tmp_path / "got"
    log.write_text(f"import pathlib, sys\npathlib.Path({str(got)!r}).write_text(repr(sys.argv))\n{program}\n")
    monkeypatch.setattr(gtlayout.viewer.process, "rerun_command", lambda: sys.executable)
    monkeypatch.setenv("DISPLAY", ":0")
    if says is None:
        open_log(log)
    else:
        with pytest.raises(GtlayoutError, match=f"status 3: {says}"):
            open_log(log)
    assert got.read_text() == repr([str(log)])


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.rrd"
    recording = rr.RecordingStream("test")
    recording.save(path)
    recording.log("text", rr.TextDocument("hello"), static=True)
    recording.disconnect()
    return path


def listens_on(port: int) -> set[str]:
    """Addresses on which a process that was started here, or one of its own, listens."""
    started = psutil.Process().children(recursive=True)
    sockets = [each for process in started for each in process.net_connections("tcp")]
    return {each.laddr.ip for each in sockets if each.status == psutil.CONN_LISTEN and each.laddr.port == port}


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_web_viewer_is_served_to_this_machine_alone_and_stops(log: Path, free_ports: int, end: signal.Signals) -> None:
    with web_viewer(log, free_ports, end) as address:
        assert address.startswith(f"http://127.0.0.1:{free_ports}/?")
        assert parse_qs(urlsplit(address).query) == {"url": [f"rerun+http://127.0.0.1:{free_ports + 1}/proxy"]}
        with urlopen(address, timeout=5) as answer:
            assert b"Rerun Viewer" in answer.read()
        assert listens_on(free_ports) == listens_on(free_ports + 1) == {"127.0.0.1"}
    for port in (free_ports, free_ports + 1):
        socket.create_server(("127.0.0.1", port)).close()  # fails if anything is left behind


@pytest.mark.parametrize("offset", [0, 1])
def test_taken_port_is_one_clear_line(
    offset: int, log: Path, free_ports: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", free_ports + offset)):
        assert main(["view", str(log.parent), "--layout", str(log.parent), "--web", "--port", str(free_ports)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"port {free_ports + offset}" in error and "choose another with --port" in error


def test_web_viewer_needs_a_log(tmp_path: Path, free_ports: int) -> None:
    with pytest.raises(GtlayoutError, match="does not exist: make it with"):
        serve_log(tmp_path / "log.rrd", free_ports, print)


def test_server_that_ends_is_an_error(
    log: Path, free_ports: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    program = tmp_path / "rerun"
    program.write_text("#!/bin/sh\necho it broke >&2\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setattr(gtlayout.viewer.process, "rerun_command", lambda: str(program))
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(GtlayoutError, match="status 3: it broke"):
        serve_log(log, free_ports, print)
    assert signal.getsignal(signal.SIGTERM) is before
