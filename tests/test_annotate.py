"""``gtlayout annotate`` without a browser: who may ask, what is saved and what is refused, and how it ends."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
import shapely
from annotate_server import ROOM, Client, SolvedSession, annotate_server, until
from shapely import MultiPolygon, Polygon, box

from gtlayout.annotate.advice import LOA20_M, SIGMAS, advice, position_sigma
from gtlayout.annotate.entries import digest
from gtlayout.annotate.outdated import is_outdated
from gtlayout.annotate.scene import open_scene
from gtlayout.annotate.shapes import halves, painted, rings_px
from gtlayout.annotate.solver import Solved, Solver
from gtlayout.annotate.store import ConflictError, Store
from gtlayout.annotate.visible import textured_part
from gtlayout.api import load, load_solved
from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.cvat.writer import write_cvat
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.proposal import Proposal
from gtlayout.proposals.propose import Proposer
from gtlayout.quality.headline import Headline
from gtlayout.review.findings import Finding, FindingKind
from gtlayout.scene import Element, KeyFrame
from gtlayout.solution import Solution
from gtlayout.tracking.config import TrackingConfig

SQUARE = [[10.0, 10.0], [90.0, 10.0], [90.0, 90.0], [10.0, 90.0]]
INTERRUPTIBLE = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
"""As in a terminal, also where the tests are started from a shell that ignores it."""


def drawing(label: str = "wall", name: str = "w", **more: Any) -> dict[str, Any]:
    element = {"id": name, "label": label, "polygons": [SQUARE], "visible": [], **more}
    return {"elements": [element], "occlusion_edges": []}


@pytest.fixture
def ask(drawn: Path, two_drawn: Solution) -> Iterator[Client]:
    with annotate_server(drawn, SolvedSession(two_drawn)) as address:
        yield Client(address)


# Who may ask


def test_only_the_page_itself_is_answered(ask: Client) -> None:
    port = ask.address.split(":")[2].split("/")[0]
    assert ask("GET", "").status == 200
    assert ask("GET", "about", headers={"Host": f"localhost:{port}"}).status == 200
    # DNS rebinding: a name that leads here; another port; none at all
    for host in (f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port}.evil.example", f"[::1]:{port}", None):
        assert ask("GET", "about", headers={"Host": host}).status in (400, 403), host
    for origin in ("http://evil.example", "null", f"https://127.0.0.1:{port}", f"http://localhost:{port}"):
        assert ask("GET", "about", headers={"Origin": origin}).status == 403, origin
        assert ask("PUT", "frames/0", {}, headers={"Origin": origin}).status == 403, origin
    assert ask("PUT", "frames/0", {"entry": drawing(), "base": ""}, headers={"Origin": None}).status == 403
    parts = urlsplit(ask.address)
    with socket.create_connection((parts.hostname, parts.port), timeout=20) as raw:
        raw.sendall(f"OPTIONS * HTTP/1.1\r\nHost: {parts.netloc}\r\nOrigin: http://{parts.netloc}\r\n\r\n".encode())
        assert raw.recv(100).startswith(b"HTTP/1.1 404 ")
    for token in ("x", "..", "page", "a" * 22, "%2e%2e", ""):
        assert ask("GET", "about", token=token or "%C3%A9").status == 404, token


def test_a_page_is_served_that_asks_for_nothing_elsewhere(ask: Client) -> None:
    page = ask("GET", "")
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy and "unsafe" not in policy and "http" not in policy
    assert page.headers["referrer-policy"] == "no-referrer"
    assert page.headers["cache-control"] == "no-store"
    names = [path.name for path in (Path(__file__).parents[1] / "gtlayout/annotate/page").iterdir()]
    assert len(names) > 10
    for name in names:
        file = ask("GET", f"page/{name}")
        assert file.status == 200
        text = file.body.decode().replace("http://www.w3.org/2000/svg", "")
        assert "http:" not in text and "https:" not in text and "innerHTML" not in text, name
    for name in ("../app.py", "..%2fapp.py", "nothing.js", "__init__.py"):
        assert ask("GET", f"page/{name}").status == 404, name


# What is drawn


def test_a_drawing_is_saved_and_everything_else_in_the_file_stays(ask: Client, drawn: Path) -> None:
    def with_more(data: dict[str, Any]) -> dict[str, Any]:
        return {**data, "drafts": [{"image": "000003.jpg", "elements": []}], "note": "kept"}

    write_json_atomic(drawn / "annotations.json", with_more(read_json(drawn / "annotations.json")))
    before = read_json(drawn / "annotations.json")
    entry = {**drawing(name="w1"), "mine": 1}
    answer = ask("PUT", "frames/9", {"entry": entry, "base": ""})
    assert answer.status == 200
    after = read_json(drawn / "annotations.json")
    # in its place in the video
    assert [frame["image"] for frame in after["frames"]] == ["000008.jpg", "000009.jpg", "000016.jpg"]
    assert after["frames"][1] == {**entry, "image": "000009.jpg"}
    assert {**after, "frames": [after["frames"][0], after["frames"][2]]} == before
    assert ask("GET", "frames/9").json == {"entry": after["frames"][1], "digest": answer.json["digest"]}
    assert [key_frame.frame for key_frame in load(drawn).key_frames] == [8, 9, 16]
    # nothing drawn takes the frame out of the file again
    emptied = {"entry": {"elements": [], "occlusion_edges": []}, "base": answer.json["digest"]}
    assert ask("PUT", "frames/9", emptied).json == {"digest": ""}
    assert read_json(drawn / "annotations.json") == before


def test_what_was_drawn_elsewhere_is_not_overwritten(ask: Client, drawn: Path) -> None:
    first = ask("GET", "frames/8").json
    others = {**first["entry"], "elements": first["entry"]["elements"][:2]}
    assert ask("PUT", "frames/8", {"entry": others, "base": first["digest"]}).status == 200
    saved = (drawn / "annotations.json").read_bytes()
    mine = ask("PUT", "frames/8", {"entry": drawing(), "base": first["digest"]})
    assert mine.status == 409
    assert mine.json == {"entry": others, "digest": digest(others)}
    assert (drawn / "annotations.json").read_bytes() == saved
    # another frame is nobody else's business, also when a program wrote the file meanwhile
    data = read_json(drawn / "annotations.json")
    data["frames"][1]["elements"].pop()
    write_json_atomic(drawn / "annotations.json", data)
    assert ask("PUT", "frames/8", {"entry": drawing(), "base": digest(others)}).status == 200
    assert read_json(drawn / "annotations.json")["frames"][1] == data["frames"][1]
    assert ask("PUT", "frames/16", {"entry": drawing(), "base": ""}).status == 409


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (None, "no JSON object"),
        ({"elements": {}}, "elements is no list"),
        ({"elements": [1]}, "element number 0 is no JSON object"),
        (drawing(name=""), "its id must be a text"),
        (drawing(name="x" * 201), "its id must be a text"),
        (drawing(label=""), "its label must be a text"),
        ({"elements": drawing()["elements"] * 2}, "two elements are called w"),
        (drawing(polygons=[]), "has no polygon"),
        (drawing(polygons=[SQUARE[:2]]), "fewer than 3 points"),
        (drawing(polygons=[[*SQUARE[:3], [1.0]]]), "no pair of pixels"),
        (drawing(polygons=[[*SQUARE[:3], [1.0, True]]]), "no pair of pixels"),
        (drawing(polygons=[[*SQUARE[:3], [1.0, float("nan")]]]), "no pair of pixels"),
        (drawing(polygons=[[*SQUARE[:3], [1.0, 1e300]]]), "no pair of pixels"),
        (drawing(polygons=[[*SQUARE[:3], [1.0, 10**400]]]), "no pair of pixels"),
        (drawing(visible=3), "visible is no list"),
        (drawing(polygons=[SQUARE * 30000]), "more than 100000 points"),
        ({**drawing(), "occlusion_edges": [[[1, 2]]]}, "fewer than 2 points"),
        ({**drawing(), "blank": [[[1, 2], [3, 4]]]}, "fewer than 3 points"),
    ],
)
def test_what_is_no_drawing_is_refused(tmp_path: Path, entry: object, said: str) -> None:
    frames = load(ROOM).frames
    store = Store(tmp_path, frames)
    with pytest.raises(GtlayoutError, match=said) as raised:
        store.save(3, entry, "")
    assert "frame 000003.jpg" in str(raised.value)
    assert not list(tmp_path.iterdir())


def test_bad_requests_are_answered_with_words(ask: Client, drawn: Path) -> None:
    before = (drawn / "annotations.json").read_bytes()
    assert ask("PUT", "frames/5", b"{").status == 400
    assert ask("PUT", "frames/5", b"[" * 100_000).status == 400
    assert ask("PUT", "frames/5", [1]).status == 400
    assert ask("PUT", "frames/5", {}).status == 422
    assert ask("PUT", "frames/5", b" " * ((1 << 23) + 1)).status == 413
    for path in ("frames/41", "frames/-1", "frames/x", "frames/99999999999999999999", "frames/41/image"):
        assert ask("GET", path).status == 404, path
    assert ask("POST", "frames/5", {}).status == 405
    for shape in ({}, {"op": "split"}, {"op": "paint", "polygons": [[1]]}, {"op": "texture", "polygons": [SQUARE]}):
        answer = ask("POST", "shape", shape)
        assert answer.status == 422 and b"no shape" in answer.body, shape
    line = [[0, 5], [100, 5]]
    beside = ask("POST", "shape", {"op": "split", "polygons": [SQUARE], "line": line})
    assert beside.status == 422 and b"does not cut" in beside.body
    assert (drawn / "annotations.json").read_bytes() == before


def test_a_damaged_file_is_said_and_left_alone(ask: Client, drawn: Path) -> None:
    good = (drawn / "annotations.json").read_text()
    (drawn / "annotations.json").write_text("{")
    assert "not valid JSON" in ask("GET", "state").json["file"]["problem"]
    answer = ask("PUT", "frames/5", {"entry": drawing(), "base": ""})
    assert answer.status == 422 and b"not valid JSON" in answer.body
    assert (drawn / "annotations.json").read_text() == "{"
    (drawn / "annotations.json").write_text(good)
    assert ask("PUT", "frames/5", {"entry": drawing(), "base": ""}).status == 200


def test_a_damaged_frame_is_the_only_one_that_cannot_be_drawn(tmp_path: Path) -> None:
    data = read_json(ROOM / "annotations.json")
    data["frames"][1]["elements"][0]["polygons"] = [[["a", 1], [2, 3], [4, 5]]]
    data["frames"].append({"image": "elsewhere.jpg", "elements": []})
    write_json_atomic(tmp_path / "annotations.json", data)
    store = Store(tmp_path, load(ROOM).frames)
    assert sorted(store.read().place) == [0, 16, 24, 32, 40]
    assert "frame 000008.jpg, element" in store.read().unusable[8]
    assert len(store.read().not_shown) == 1 and "elsewhere.jpg" in store.read().not_shown[0]
    with pytest.raises(GtlayoutError, match="repair it in the file first"):
        store.save(8, drawing(), "")
    with pytest.raises(ConflictError):
        store.save(16, drawing(), "")
    store.save(16, drawing(), digest(data["frames"][2]))
    assert read_json(tmp_path / "annotations.json")["frames"][1] == data["frames"][1]


def test_scenes_that_cannot_be_annotated_are_refused_with_a_way_out(undrawn: Path, tmp_path: Path) -> None:
    room = load(ROOM)
    assert open_scene(undrawn).key_frames == ()
    (undrawn / "annotations.json").write_text("{")  # a file cut short is the store's business
    assert len(open_scene(undrawn).frames) == 41
    (undrawn / "annotations.json").unlink()
    write_cvat(undrawn / "task.xml", room.frames, room.key_frames)
    with pytest.raises(GtlayoutError, match=r"task.xml \(.*annotate works on annotations.json: `gtlayout import"):
        open_scene(undrawn)
    (undrawn / "task.xml").unlink()
    cameras = read_json(undrawn / "transforms.json")
    write_json_atomic(undrawn / "transforms.json", {**cameras, "k1": 0.1, "camera_model": "OPENCV"})
    with pytest.raises(GtlayoutError, match="lens to be undistorted"):
        open_scene(undrawn)
    data = {**read_json(ROOM / "annotations.json"), "image_size": [960, 720]}
    write_json_atomic(tmp_path / "annotations.json", data)
    with pytest.raises(GtlayoutError, match="of another size"):
        Store(tmp_path, room.frames).read()


# The solve behind it


def test_the_room_is_solved_behind_the_page_and_results_are_saved(drawn: Path, two_drawn: Solution) -> None:
    session = SolvedSession(two_drawn)
    with annotate_server(drawn, session) as address:
        ask = Client(address)
        until(lambda: ask("GET", "state").json["solved"] is not None)
        state = ask("GET", "state").json
        assert state["solved"]["full"] and state["solved"]["word"] == two_drawn.quality.headline.word
        assert sorted(map(int, state["solved"]["ious"])) == [8, 16]
        assert load_solved(drawn)[1].instances == two_drawn.instances
        room = ask("GET", "room").json
        assert {one["name"] for one in room["instances"]} == {one.name for one in two_drawn.instances}
        # proposals: nothing where all is drawn, the room where nothing is
        assert ask("GET", "frames/8/proposal").json["elements"] == []
        proposed = ask("GET", "frames/10/proposal").json
        assert {"floor_0", "ceiling_0"} <= {element["id"] for element in proposed["elements"]}
        # a change is solved at once, and in full later
        session.calls.clear()
        entry = ask("GET", "frames/8").json
        assert ask("PUT", "frames/8", {"entry": {**entry["entry"], "mine": 1}, "base": entry["digest"]}).status == 200
        until(lambda: session.calls[:1] == ["quick"])
        until(lambda: session.calls == ["quick", "full"])
        # … and one by another program is noticed
        data = read_json(drawn / "annotations.json")
        write_json_atomic(drawn / "annotations.json", {**data, "note": "by another program"})
        ask("GET", "state")
        until(lambda: session.calls[:3] == ["quick", "full", "quick"])


def test_a_quick_solve_does_not_wait_for_a_full_one(tmp_path: Path, two_drawn: Solution) -> None:
    drawn = [two_drawn.scene.key_frames]
    begun, go_on = threading.Event(), threading.Event()

    class Slow(SolvedSession):
        def solve(self, key_frames: Sequence[KeyFrame]) -> Solution:
            if "full" in self.calls:
                begun.set()
                assert go_on.wait(20)
            return super().solve(key_frames)

    session = Slow(two_drawn)
    solver = Solver(two_drawn.scene, session, lambda: (drawn[0], ()), tmp_path)
    until(lambda: solver.state.solved is not None)
    solver.changed()
    assert begun.wait(20)
    assert solver.state.at_work == "full"
    number = session.calls.count("quick")
    drawn[0] = (*drawn[0],)  # drawn anew: another object
    solver.changed()
    until(lambda: session.calls.count("quick") > number)
    until(lambda: solver.state.at_work == "full" and solver.state.solved is not None and not solver.state.solved.full)
    go_on.set()  # what it finds is of older drawings: the next quick solve goes on from it
    until(lambda: session.calls.count("quick") > number + 1)
    until(lambda: solver.state.solved is not None and solver.state.solved.full and solver.state.at_work is None)
    assert session.calls[-1] == "full"
    assert solver.close()


def test_while_there_is_no_room_it_is_said_what_is_missing(undrawn: Path, two_drawn: Solution) -> None:
    with annotate_server(undrawn, SolvedSession(two_drawn)) as address:
        ask = Client(address)
        until(lambda: ask("GET", "state").json["advice"] != [])
        assert "first frame" in ask("GET", "state").json["advice"][0]["text"]
        assert ask("GET", "room").json is None
        assert ask("GET", "frames/3/proposal").json == {"elements": [], "occlusion_edges": [], "uncovered": []}
        assert ask("PUT", "frames/3", {"entry": drawing("floor"), "base": ""}).status == 200
        until(lambda: ask("GET", "state").json["problem"] == "one frame is not enough")
        assert "second frame" in ask("GET", "state").json["advice"][0]["text"]
        # drafts of the file are shown while there is no room
        data = read_json(undrawn / "annotations.json")
        draft = {**drawing("ceiling", "ceiling_0"), "image": "000007.jpg"}
        write_json_atomic(undrawn / "annotations.json", {**data, "drafts": [draft, {"image": 3}, "x"]})
        assert ask("GET", "state").json["file"]["drafts"] == [7]
        assert ask("GET", "frames/7/proposal").json["elements"][0]["id"] == "ceiling_0"


def test_it_is_enough_when_all_planes_are_certain(two_drawn: Solution) -> None:
    layout = two_drawn.layout
    sigmas = [position_sigma(plane, extent) for plane, extent in zip(layout.planes, layout.extents, strict=True)]
    share = 0.9 * LOA20_M / (SIGMAS * max(sigmas))
    trusted = replace(two_drawn.quality, headline=Headline("trust", ("good",)))

    def scaled(by: float) -> Solution:
        planes = tuple(replace(plane, covariance=by**2 * plane.covariance) for plane in layout.planes)
        return replace(two_drawn, layout=replace(layout, planes=planes), quality=trusted)

    (enough,) = advice(scaled(share), (3, 5))
    assert enough.enough and "LOA20" in enough.text
    first, *_ = advice(scaled(share * 1.2), (3, 5))
    assert not first.enough and first.text.startswith(layout.instances[int(np.argmax(sigmas))].name)
    assert first.frame not in {key_frame.frame for key_frame in two_drawn.scene.key_frames}
    doubted = replace(scaled(share), quality=replace(trusted, headline=Headline("check", ("look at it",))))
    assert next(one.text for one in advice(doubted, ())) == "check: look at it"


def test_findings_end_when_what_they_are_of_is_drawn_anew() -> None:
    def key_frame(*shapes: tuple[str, Polygon], line: float = 0.0, blank: Polygon | None = None) -> KeyFrame:
        elements = tuple(Element(name, "wall", MultiPolygon([shape]), MultiPolygon()) for name, shape in shapes)
        lines = (np.array([[line, 0.0], [0.0, 9.0]]),)
        return KeyFrame(8, elements, lines, MultiPolygon([blank] if blank else []))

    def found(kind: FindingKind, element: str | None, where: Polygon) -> Finding:
        return Finding(0, "a.jpg", element, None, kind, "", 1.0, shapely.get_coordinates(where))

    a, b = ("a", box(0, 0, 50, 50)), ("b", box(60, 0, 100, 50))
    before = key_frame(a, b)
    gap = found("gap", None, box(50, 0, 60, 50))
    edge = replace(found("edge", "b", box(0, 0, 1, 1)), where_px=np.array([[60.0, 0.0], [60.0, 50.0]]))
    hidden = found("occlusion edge missing", "a", box(0, 0, 9, 9))
    assert not any(is_outdated(one, before, key_frame(a, b)) for one in (gap, edge, hidden))
    elsewhere = key_frame(("a", box(0, 0, 50, 40)), b)  # neither the gap nor the edge is there
    assert [is_outdated(one, before, elsewhere) for one in (gap, edge, hidden)] == [True, False, True]
    lower = key_frame(a, ("b", box(60, 0, 100, 49)), line=1.0)
    assert [is_outdated(one, before, lower) for one in (edge, hidden)] == [True, True]
    left = key_frame(("a", Polygon([(1, 0), (50, 0), (50, 50), (0, 50)])), b)
    assert not is_outdated(gap, before, left)
    assert is_outdated(gap, before, key_frame(a, b, ("c", box(51, 1, 59, 49))))
    assert is_outdated(gap, before, key_frame(a, b, blank=box(50, 0, 60, 50)))
    relabelled = replace(before, elements=(before.elements[0], replace(before.elements[1], label="door")))
    assert is_outdated(edge, before, relabelled)
    assert not is_outdated(gap, before, relabelled)
    assert is_outdated(edge, before, None)


# Shapes


def test_brush_and_knife() -> None:
    wall = MultiPolygon([box(0, 0, 100, 50)])
    stroke = np.array([[0.0, 25.0], [100.0, 25.0]])
    mark = painted(MultiPolygon(), stroke, 10.0, wall, erase=False)
    assert mark.area == pytest.approx(100 * 20, rel=0.01)
    assert painted(wall, stroke, 10.0, wall, erase=True).area == pytest.approx(100 * 30, rel=0.01)
    dab = painted(MultiPolygon(), np.array([[0.0, 0.0]]), 10.0, wall, erase=False)
    assert dab.area == pytest.approx(np.pi * 100 / 4, rel=0.05)
    larger, smaller = halves(wall, np.array([[30.0, 10.0], [30.0, 20.0]]))
    assert (larger.bounds, smaller.bounds) == ((30, 0, 100, 50), (0, 0, 30, 50))
    for line in ([[0.0, 60.0], [100.0, 60.0]], [[1.0, 1.0], [1.0, 1.0]]):
        with pytest.raises(GtlayoutError):
            halves(wall, np.array(line))


def test_outlines_do_not_cross_themselves_when_they_are_rounded() -> None:
    needle = MultiPolygon([Polygon([(0, 0), (50, 0.004), (50, 30), (49.996, 0.0061), (0, 20)])])
    rings = rings_px(needle)
    assert rings and all(Polygon(ring).is_valid for ring in rings)
    assert not Polygon(np.round(np.array(needle.geoms[0].exterior.coords), 2)).is_valid
    assert sum(Polygon(ring).area for ring in rings) == pytest.approx(needle.area, abs=0.5)


def test_visible_parts_are_proposed_where_there_is_texture() -> None:
    rng = np.random.default_rng(0)
    gray = np.full((200, 300), 128, dtype=np.uint8)
    gray[:, :150] = rng.integers(0, 255, (200, 150))
    wall, door = MultiPolygon([box(0, 0, 300, 200)]), MultiPolygon([box(0, 0, 40, 200)])
    config = TrackingConfig()
    nothing = np.empty((0, 2))
    seen = textured_part(gray, wall, door, nothing, config)
    assert box(60, 20, 140, 180).difference(seen).area < 50
    assert seen.intersection(box(190, 0, 300, 200)).area == 0
    assert seen.intersection(door).area == 0
    hidden = textured_part(gray, wall, door, np.array([[100.0, 100.0]]), config)
    assert hidden.intersection(box(95, 95, 105, 105)).area == 0
    assert textured_part(np.full((200, 300), 9, dtype=np.uint8), wall, door, nothing, config).is_empty


def test_visible_parts_are_proposed_where_some_are_drawn(two_drawn: Solution) -> None:
    def proposed(solution: Solution) -> Proposal:
        solved = Solved(1, solution, True, 1.0, (), (), Proposer(solution, ProposalConfig()))
        return solved.propose(12, lambda: np.asarray(cv2.imread(str(scene.frames[12].image_path)), dtype=np.uint8))

    scene = two_drawn.scene
    elements = [one.element for one in proposed(two_drawn).elements]
    window = next(one.amodal for one in elements if one.label == "window")
    behind = next(one for one in elements if one.label == "wall" and one.amodal.contains(window.centroid))
    assert 0.3 < behind.visible.area / behind.amodal.difference(window).area < 1
    assert behind.visible.intersection(window).area < 50
    bare = [
        replace(one, elements=tuple(replace(element, visible=MultiPolygon()) for element in one.elements))
        for one in scene.key_frames
    ]
    whole = proposed(replace(two_drawn, scene=replace(scene, key_frames=tuple(bare))))
    assert len(whole.elements) == len(elements)
    assert all(one.element.visible.is_empty for one in whole.elements)


# The command


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_the_command_prints_one_line_and_ends_cleanly(undrawn: Path, end: signal.Signals) -> None:
    call = INTERRUPTIBLE + "from gtlayout.cli.app import main; sys.exit(main())"
    command = [sys.executable, "-c", call, "annotate", str(undrawn)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None and running.stderr is not None
        try:
            address = running.stdout.readline().split()[0]
            ask = Client(address)
            assert ask("GET", "about").json["name"] == undrawn.name
            assert ask("PUT", "frames/3", {"entry": drawing("floor"), "base": ""}).status == 200
            assert len(ask("GET", "frames/3/image").body) > 5000
            running.send_signal(end)
            assert running.wait(timeout=15) == 0
            assert (running.stdout.read(), running.stderr.read()) == ("", "")
        finally:
            running.kill()  # one that does not stop would be waited for without end
    assert json.loads((undrawn / "annotations.json").read_text())["frames"][0]["image"] == "000003.jpg"


def test_the_command_says_what_cannot_be_annotated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["annotate", str(tmp_path / "nowhere")]) == 1
    assert capsys.readouterr().err.startswith("gtlayout: no ")
