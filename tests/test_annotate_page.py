"""The page of ``gtlayout annotate`` in a real browser: a room drawn from nothing, by mouse, pen, fingers and keys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from annotate_server import ROOM, Client, SolvedSession, annotate_server, until
from playwright.sync_api import Page, Route, expect
from shapely import MultiPolygon, Point, Polygon, box

from gtlayout.api import load, load_solved
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.proposals.proposal import Proposal, ProposedEdge, ProposedElement
from gtlayout.proposals.propose import Proposer
from gtlayout.review.findings import Finding
from gtlayout.scene import LABELS, Element, ImageArray
from gtlayout.solution import Solution

Px = list[float]
PATIENCE_MS = 90_000.0
"""For solves on a busy machine."""


def one_wall(_proposer: Proposer, frame: int, _image: ImageArray | None = None) -> Proposal:
    """A proposal: the two sides of a wall were moved by 6 px to lines of the image."""
    corners = np.array([[106.0, 100.0], [206.0, 100.0], [206.0, 300.0], [106.0, 300.0]])
    before = corners - [6.0, 0.0]
    moved = {1: before[[1, 2]], 3: before[[3, 0]]}
    ends = np.roll(corners, -1, axis=0)
    edges = tuple(
        ProposedEdge(start, end, "contact", 2.0, 0.9 - 0.2 * k, moved.get(k))
        for k, (start, end) in enumerate(zip(corners, ends, strict=True))
    )
    wall = Element("wall_0", "wall", MultiPolygon([Polygon(corners)]), MultiPolygon())
    hidden = (np.array([[106.0, 300.0], [106.0, 100.0]]),)
    return Proposal(frame, (ProposedElement(wall, 0, edges, 0.6),), hidden, MultiPolygon([box(300, 0, 480, 360)]))


class Stage:
    """The image of the page: points are px of the image."""

    def __init__(self, page: Page) -> None:
        self.page = page

    def at(self, point: Px) -> tuple[float, float]:
        """Where it is in the window."""
        matrix = "(([x, y]) => { const m = document.querySelector('#stage > g').getScreenCTM(); "
        x, y = self.page.evaluate(matrix + "return [m.a * x + m.e, m.d * y + m.f]; })", point)
        return x, y

    def click(self, point: Px) -> None:
        self.page.mouse.click(*self.at(point))

    def drag(self, *points: Px) -> None:
        first, *others = [self.at(point) for point in points]
        self.page.mouse.move(*first)
        self.page.mouse.down()
        for point in others:
            self.page.mouse.move(*point, steps=4)
        self.page.mouse.up()

    def press(self, *keys: str) -> None:
        self.page.locator("#stage").focus()
        for key in keys:
            self.page.keyboard.press(key)

    def open(self, frame: str) -> None:
        self.page.locator("#strip button", has_text=frame).click()
        expect(self.page.locator("#stage")).to_have_attribute("aria-label", f"Image {frame}")
        self.page.locator("#hint", has_text="proposed").or_(self.page.locator("#hint", has_text="Keys 1")).wait_for()

    def saved(self) -> None:
        """Wait until all is saved."""
        expect(self.page.locator("#saved")).to_have_text("saved")


@pytest.fixture
def stage(page: Page) -> Stage:
    return Stage(page)


def open_page(page: Page, address: str) -> None:
    page.goto(address)
    page.locator("#strip button[aria-current]").wait_for()
    page.locator("#hint", has_text="proposed").or_(page.locator("#hint", has_text="Keys 1")).wait_for()


def entry_of(folder: Path, frame: str) -> dict[str, Any]:
    frames = read_json(folder / "annotations.json")["frames"]
    return next(one for one in frames if one["image"] == frame)


def draw(stage: Stage, element: dict[str, Any]) -> None:
    """By mouse, with the keys that one hand has on the keyboard."""
    stage.press(str(LABELS.index(element["label"]) + 1))
    for point in element["polygons"][0]:
        stage.click(point)
    stage.press("Enter")


def iou(a: list[Px], b: list[Px]) -> float:
    one, other = Polygon(a).buffer(0), Polygon(b).buffer(0)
    return float(one.intersection(other).area / one.union(other).area)


def test_a_room_is_drawn_from_nothing(page: Page, stage: Stage, problems: list[str], undrawn: Path) -> None:
    truth = {frame["image"]: frame for frame in read_json(ROOM / "annotations.json")["frames"]}
    with annotate_server(undrawn) as address:
        open_page(page, address)
        page.locator("#advice", has_text="Draw a first frame").wait_for()
        for frame in ("000008.jpg", "000016.jpg"):
            stage.open(frame)
            for element in truth[frame]["elements"]:
                draw(stage, element)
            stage.saved()
            drawn = entry_of(undrawn, frame)["elements"]
            assert [one["label"] for one in drawn] == [one["label"] for one in truth[frame]["elements"]]
            pairs = zip(drawn, truth[frame]["elements"], strict=True)
            assert min(iou(a["polygons"][0], b["polygons"][0]) for a, b in pairs) > 0.8  # snapped: slivers are wider
        page.locator("#solving", has_text="full solve").wait_for(timeout=PATIENCE_MS)
        page.locator("#strip [data-frame='16'] .badge", has_text="drawn 0.9").wait_for(timeout=PATIENCE_MS)
        page.locator("#room[data-drawn]").wait_for()
        # the room proposes the next frame: its window is corrected, the rest confirmed
        stage.open("000012.jpg")
        page.locator("#draft-count", has_text="proposed").wait_for()
        proposed = page.locator("#elements .draft")
        count = proposed.count()
        assert count >= 5
        page.locator("#elements .draft", has_text="window").first.click()
        corner = page.evaluate("[...document.querySelectorAll('.handles circle')].at(-1).getAttribute('cx')")
        down = page.evaluate("[...document.querySelectorAll('.handles circle')].at(-1).getAttribute('cy')")
        start = [float(corner), float(down)]
        rings = page.locator(".drafts .selected .area").get_attribute("d") or ""
        as_proposed = [list(map(float, corner.split())) for corner in rings.strip("MZ").split("L")]
        stage.press("n")  # without snapping, so that it lands where it is let go
        stage.drag(start, [start[0] - 12, start[1] + 9])
        assert proposed.count() == count - 1
        stage.press("a")
        assert proposed.count() == 0
        stage.saved()
        confirmed = entry_of(undrawn, "000012.jpg")["elements"]
        assert len(confirmed) == count
        window = next(one for one in confirmed if one["label"] == "window")
        moved = window["polygons"][0][-1]
        assert np.hypot(moved[0] - start[0] + 12, moved[1] - start[1] - 9) < 1
        # … which is undone, as it was wrong: confirmed all, moved, confirmed the window
        stage.press("z", "z", "z")
        expect(proposed).to_have_count(count)
        stage.press("a")
        stage.saved()
        confirmed = entry_of(undrawn, "000012.jpg")["elements"]
        assert len(confirmed) == count
        again = next(one for one in confirmed if one["label"] == "window")
        assert iou(again["polygons"][0], window["polygons"][0]) < iou(again["polygons"][0], as_proposed)
        assert iou(again["polygons"][0], as_proposed) > 0.97
        ask = Client(address)

        def solved() -> dict[str, Any]:
            return ask("GET", "state").json["solved"]

        until(lambda: solved()["full"] and "12" in solved()["ious"], PATIENCE_MS / 1000)
        assert solved()["iou"] >= 0.97
    assert problems == []
    assert [key_frame.frame for key_frame in load_solved(undrawn)[0].key_frames] == [8, 12, 16]


def test_keys_alone_suffice(page: Page, stage: Stage, problems: list[str], undrawn: Path, two_drawn: Solution) -> None:
    def arrows(right: int, down: int) -> None:
        """In steps of ten."""
        for key, times in (("Right" if right > 0 else "Left", abs(right)), ("Down" if down > 0 else "Up", abs(down))):
            stage.press(*[f"Shift+Arrow{key}"] * times)

    def drawn() -> Any:
        stage.saved()
        return next(iter(read_json(undrawn / "annotations.json")["frames"]), None)

    with annotate_server(undrawn, SolvedSession(two_drawn)) as address:
        open_page(page, address)
        stage.open("000003.jpg")
        stage.press("3")
        for step in ((-10, -10), (20, 0), (0, 20), (-20, 0)):  # the cross begins in the middle
            arrows(*step)
            stage.press(" ")
        stage.press("Enter")
        wall = {
            "id": "wall_1",
            "label": "wall",
            "polygons": [[[140, 80], [340, 80], [340, 280], [140, 280]]],
            "visible": [],
        }
        assert drawn() == {"elements": [wall], "occlusion_edges": [], "image": "000003.jpg"}
        # the first corner, one to the left; the edge after it is one of occlusion, and no longer; then a corner in it
        stage.press(".", "ArrowLeft", "o")
        assert drawn()["elements"][0]["polygons"][0][0] == [139, 80]
        assert drawn()["occlusion_edges"] == [[[139, 80], [340, 80]]]
        stage.press("o", "i", "Shift+ArrowUp")
        assert drawn()["occlusion_edges"] == []
        assert drawn()["elements"][0]["polygons"][0][:3] == [[139, 80], [239.5, 70], [340, 80]]
        stage.press("Shift+1")
        assert drawn()["elements"][0]["label"] == "floor"
        stage.press("Delete")  # the corner
        assert len(drawn()["elements"][0]["polygons"][0]) == 4
        stage.press("Escape", "]", "Delete")  # the element
        assert drawn() is None
        stage.press("z", "z", "z")
        assert drawn()["elements"][0]["label"] == "wall"
        stage.press("y")
        assert drawn()["elements"][0]["label"] == "floor"
        stage.press("PageDown")
        expect(page.locator("#stage")).to_have_attribute("aria-label", "Image 000004.jpg")
        # what has the focus keeps it when the server is asked again
        page.locator("#advice button").first.focus()
        page.wait_for_timeout(1500)
        expect(page.locator("#advice button").first).to_be_focused()
        stage.press("v")
        # everything can be reached with Tab, has a name, and shows that it is reached
        page.keyboard.press("Tab")
        assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
        names = page.locator("button:visible").evaluate_all("all => all.map((one) => one.innerText.trim())")
        assert len(names) > 50 and all(names)
        assert page.locator("svg#stage, canvas#room").evaluate_all(
            "all => all.every((one) => one.tabIndex === 0 && one.getAttribute('aria-label'))"
        )
    assert problems == []


def test_shapes_are_split_painted_and_marked(
    page: Page, stage: Stage, problems: list[str], drawn: Path, two_drawn: Solution
) -> None:
    with annotate_server(drawn, SolvedSession(two_drawn)) as address:
        open_page(page, address)
        stage.open("000016.jpg")
        before = {one["id"]: one for one in entry_of(drawn, "000016.jpg")["elements"]}
        window = before["e0"]
        assert window["label"] == "window"
        left, top, right, bottom = Polygon(window["polygons"][0]).bounds
        inside = [(left + right) / 2, (top + bottom) / 2]
        # a click selects it, one on an edge marks it, another one takes that back
        stage.click([left + 8, top + 8])
        expect(page.locator("#elements [aria-pressed=true]")).to_contain_text("e0")
        a, b = window["polygons"][0][:2]
        quarter = [0.75 * a[0] + 0.25 * b[0], 0.75 * a[1] + 0.25 * b[1]]
        edges = len(entry_of(drawn, "000016.jpg")["occlusion_edges"])
        stage.click(quarter)
        stage.saved()
        assert entry_of(drawn, "000016.jpg")["occlusion_edges"][edges:] == [[a, b]]
        stage.click(quarter)
        stage.saved()
        assert len(entry_of(drawn, "000016.jpg")["occlusion_edges"]) == edges
        # the brush takes from the visible parts, and gives them back
        stage.press("e")
        stage.drag([left - 5, inside[1]], [right + 5, inside[1]])
        stage.saved()
        erased = entry_of(drawn, "000016.jpg")["elements"][0]["visible"]
        assert erased and not any(Polygon(ring).buffer(0).intersects(Point(inside)) for ring in erased)
        area = sum(Polygon(ring).area for ring in erased)
        stage.press("b")
        stage.drag([left + 10, inside[1]], [right - 10, inside[1]])
        stage.saved()
        painted = entry_of(drawn, "000016.jpg")["elements"][0]["visible"]
        assert sum(Polygon(ring).area for ring in painted) > area + 1000
        # visible parts are proposed where there is texture
        stage.press("t")
        expect(page.locator("#hint")).to_contain_text("Visible parts proposed")
        stage.saved()
        assert entry_of(drawn, "000016.jpg")["elements"][0]["visible"] != painted
        # a cut from top to bottom
        stage.press("v", "x")
        stage.click([inside[0], top - 20])
        stage.click([inside[0], bottom + 20])
        expect(page.locator("#elements li")).to_have_count(len(before) + 1)
        stage.saved()
        halves = entry_of(drawn, "000016.jpg")["elements"][:2]
        assert [half["label"] for half in halves] == ["window", "window"]
        total = sum(Polygon(half["polygons"][0]).area for half in halves)
        assert total == pytest.approx(Polygon(window["polygons"][0]).area, rel=0.01)
        # a corner that neighbours share goes along; with Alt it goes alone
        floor = next(one for one in before.values() if one["label"] == "floor")["polygons"][0]
        rings = [ring for one in before.values() for ring in one["polygons"]]
        shared = next(p for p in floor if sum(p in ring for ring in rings) > 1 and 5 < p[0] < 475)
        page.locator("#elements button", has_text="floor").click()
        stage.press("v", "n")
        stage.drag(shared, [shared[0] + 6, shared[1] - 6])
        stage.saved()
        after = [ring for one in entry_of(drawn, "000016.jpg")["elements"] for ring in one["polygons"]]
        assert not any(shared in ring for ring in after)
    assert problems == []


def test_fingers_pinch_and_a_pen_draws(
    page: Page, stage: Stage, problems: list[str], undrawn: Path, two_drawn: Solution
) -> None:
    page.set_viewport_size({"width": 820, "height": 1180})
    with annotate_server(undrawn, SolvedSession(two_drawn)) as address:
        open_page(page, address)
        stage.open("000003.jpg")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        devices = page.context.new_cdp_session(page)

        def touch(kind: str, *points: tuple[float, float]) -> None:
            at = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]
            devices.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": at})

        (x0, y0), (x1, y1) = stage.at([200, 180]), stage.at([280, 180])
        touch("touchStart", (x0, y0))
        touch("touchStart", (x0, y0), (x1, y1))
        for step in range(1, 11):
            touch("touchMove", (x0 - 4 * step, y0), (x1 + 4 * step, y1))
        touch("touchEnd")
        wider = stage.at([280, 180])[0] - stage.at([200, 180])[0]
        assert wider == pytest.approx(x1 - x0 + 80, rel=0.05)
        stage.press("h", "1")
        for point in ([100.0, 200.0], [300.0, 200.0], [300.0, 300.0]):
            x, y = stage.at(point)
            for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
                pen = {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1, "pointerType": "pen"}
                devices.send("Input.dispatchMouseEvent", pen)
        page.locator("#work button", has_text="wall").click()  # another label begins anew
        stage.press("1")
        for point in ([100.0, 200.0], [300.0, 200.0], [300.0, 300.0], [100.0, 200.0]):
            touch("touchStart", stage.at(point))
            touch("touchEnd")
        stage.saved()
        (floor,) = entry_of(undrawn, "000003.jpg")["elements"]
        assert iou(floor["polygons"][0], [[100, 200], [300, 200], [300, 300]]) > 0.98
    assert problems == []


def test_two_windows_notice_each_other_and_nothing_is_lost(
    page: Page, stage: Stage, problems: list[str], drawn: Path, two_drawn: Solution
) -> None:
    def ids() -> list[str]:
        return [one["id"] for one in entry_of(drawn, "000008.jpg")["elements"]]

    def remove(window: Page, name: str) -> None:
        window.locator("#elements button", has_text=name).click()
        Stage(window).press("Delete")

    with annotate_server(drawn, SolvedSession(two_drawn)) as address:
        open_page(page, address)
        other = page.context.new_page()
        open_page(other, address)
        everything = ids()
        remove(page, "e0 ")
        stage.saved()
        expect(other.locator("#hint")).to_contain_text("was changed in another window")
        expect(other.locator("#elements button", has_text="e0 ")).to_have_count(0)
        # the other window does not hear of what happens now, and draws on
        other.route("**/state", lambda route: route.abort())
        remove(page, "e1 ")
        stage.saved()
        remove(other, "e2 ")
        expect(other.locator("#banner")).to_contain_text("000008.jpg was changed in another window")
        assert ids() == [name for name in everything if name not in ("e0", "e1")]
        other.locator("#banner button", has_text="Keep mine").click()
        Stage(other).saved()
        assert ids() == [name for name in everything if name not in ("e0", "e2")]
        Stage(other).press("z")  # theirs
        Stage(other).saved()
        assert ids() == [name for name in everything if name not in ("e0", "e1")]
        Stage(other).press("z", "z")
        Stage(other).saved()
        assert set(ids()) >= {"e1", "e2"}
        expect(page.locator("#elements button", has_text="e2 ")).to_have_count(1)
        expect(page.locator("#elements button", has_text="e1 ")).to_have_count(1)
        # a damaged file is said, what is drawn stays in the window until it can be saved
        good = (drawn / "annotations.json").read_bytes()
        (drawn / "annotations.json").write_text("{")
        remove(page, "e3 ")
        expect(page.locator("#banner")).to_contain_text("not valid JSON")
        assert (drawn / "annotations.json").read_text() == "{"
        (drawn / "annotations.json").write_bytes(good)
        expect(page.locator("#banner")).to_be_hidden()
        stage.saved()
        assert "e3" not in ids()
    problems[:] = [one for one in problems if "409" not in one and "422" not in one]  # what the browser says of them
    assert problems == []


def test_snapping_of_a_proposal_is_taken_back_with_one_key(
    page: Page,
    stage: Stage,
    problems: list[str],
    drawn: Path,
    two_drawn: Solution,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def corners() -> list[Px]:
        """Of the proposed outline, which is selected."""
        handles = page.locator(".handles circle:not(.new)")
        return handles.evaluate_all("all => all.map((one) => [+one.getAttribute('cx'), +one.getAttribute('cy')])")

    monkeypatch.setattr(Proposer, "propose", one_wall)
    with annotate_server(drawn, SolvedSession(two_drawn)) as address:
        open_page(page, address)
        page.locator("#solving", has_text="IoU").wait_for()
        stage.open("000012.jpg")
        page.locator("#elements .draft button").click()
        assert corners() == [[106, 100], [206, 100], [206, 300], [106, 300]]
        assert page.locator(".drafts .unsure").count() == 1  # with the confidence .3
        stage.press("r")
        assert corners() == [[100, 100], [200, 100], [200, 300], [100, 300]]
        stage.press("Enter")
        stage.saved()
        confirmed = entry_of(drawn, "000012.jpg")
        outline = [[100, 100], [200, 100], [200, 300], [100, 300]]
        (wall,) = confirmed["elements"]
        assert (wall["id"], wall["label"], wall["polygons"]) == ("wall_0", "wall", [outline])
        assert confirmed["occlusion_edges"] == [[[100, 300], [100, 100]]]  # it goes along with the side
        stage.press("z")
        page.locator("#elements .draft button").click()
        stage.press("Enter")
        stage.saved()
        assert entry_of(drawn, "000012.jpg")["occlusion_edges"] == [[[106, 300], [106, 100]]]
        # what is dismissed does not come back
        stage.open("000020.jpg")
        page.locator("#elements .draft button").click()
        stage.press("Delete")
        stage.open("000012.jpg")
        stage.open("000020.jpg")
        assert page.locator("#elements .draft").count() == 0
    assert problems == []


def test_an_answer_from_before_a_save_is_no_change_by_others(
    page: Page, stage: Stage, problems: list[str], drawn: Path, two_drawn: Solution
) -> None:
    with annotate_server(drawn, SolvedSession(two_drawn)) as address:
        open_page(page, address)
        count = page.locator("#elements .shape").count()
        late: list[Route] = []

        def hold(route: Route) -> None:
            """The first; others go through."""
            if late:
                route.continue_()
            else:
                late.append(route)

        page.route("**/state", hold)
        for _ in range(100):
            page.wait_for_timeout(50)
            if late:
                break
        answer = late[0].fetch()  # of now; it arrives after the element is gone
        page.locator("#elements .shape button").first.click()
        stage.press("Delete")
        stage.saved()
        late[0].fulfill(response=answer)
        page.wait_for_timeout(800)
        expect(page.locator("#hint")).not_to_contain_text("another window")
        stage.press("z", "y")
        expect(page.locator("#elements .shape")).to_have_count(count - 1)
    assert problems == []


def test_names_stay_text(
    page: Page,
    stage: Stage,
    problems: list[str],
    drawn: Path,
    two_drawn: Solution,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    evil = "<img src=x onerror=alert(1)>"
    (drawn / "images/000008.jpg").rename(drawn / f"images/{evil}.jpg")
    for file in ("transforms.json", "annotations.json"):
        text = (drawn / file).read_text().replace("000008.jpg", f"{evil}.jpg")
        (drawn / file).write_text(text)
    data = read_json(drawn / "annotations.json")
    data["frames"][0]["elements"][0].update(id=f'"><script>alert(2)</script>{evil}', label=f"wall{evil}")
    data["frames"][0]["elements"][1]["id"] = name = f"<script>alert(3)</script>{evil}"
    write_json_atomic(drawn / "annotations.json", data)
    names = [key_frame["image"] for key_frame in data["frames"]]
    assert names == [f"{evil}.jpg", "000016.jpg"]
    where, expected = np.array([[10.0, 10.0], [60.0, 60.0]]), np.array([[5.0, 5.0], [9.0, 9.0]])
    wrong = Finding(0, f"{evil}.jpg", name, 0, "edge", f"gap {evil}", 9.0, where, expected)
    monkeypatch.setattr("gtlayout.annotate.solver.review", lambda _solution: (wrong,))
    renamed = replace(two_drawn, scene=replace(two_drawn.scene, frames=load(drawn).frames))
    with annotate_server(drawn, SolvedSession(renamed)) as address:
        open_page(page, address)
        page.locator("#findings button", has_text="gap").click()
        expect(page.locator("#elements [aria-pressed=true]")).to_contain_text("<script>")
        expect(page.locator("#hint")).to_have_text(f"gap {evil}")
        expect(page.locator(".findings path")).to_have_count(2)
        expect(page.locator("#strip [aria-current] .count")).to_have_text("1 !")
        assert page.locator(f'#strip [title*="{evil}"], #strip span').count() > 0
        assert page.evaluate("document.querySelectorAll('img[src=x], script:not([src])').length") == 0
        stage.press("Delete")
        stage.saved()
        # what is gone is no longer marked
        expect(page.locator(".findings path")).to_have_count(0)
        expect(page.locator("#findings button")).to_contain_text("drawn anew since")
        expect(page.locator("#strip [aria-current] .count")).to_be_empty()
        assert len(entry_of(drawn, f"{evil}.jpg")["elements"]) == len(data["frames"][0]["elements"]) - 1
    assert problems == []
