"""The page of a run: what it says of the scenes, what it compares, and that it works in a browser."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from html import unescape
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from browser import served
from playwright.sync_api import Page

from gtlayout.batch.page.compare_runs import comparison
from gtlayout.batch.page.histogram import HEIGHT, histogram
from gtlayout.batch.page.run_data import FAILURES, run_data
from gtlayout.batch.page.run_page import write_run_report
from gtlayout.batch.record import RECORD_FILE, SOLVE_LOG_FILE, Failure, Record, scene_folder, write_record
from gtlayout.batch.run_folder import Run, read_run, write_run
from gtlayout.cli.app import main
from gtlayout.config import Config
from gtlayout.quality.headline import Word

HOSTILE = "<script>alert(1)<&'\">?#%25:é"
REASON = "</script><img src=x onerror=alert(2)>{{ 7*7 }}"
PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c4890000000d49444154789c6360f8cf500f0003860180"
    "5a34cd6b0000000049454e44ae426082"
)


VERSION = "1.2.3"


def solved(scene: str, iou: float, headline: Word | None = "trust", **more: Any) -> Record:
    """``headline`` is that of a scene whose IoU is accepted."""
    known: dict[str, Any] = {
        "status": "accepted" if iou >= 0.8 else "not accepted",
        "headline": headline if iou >= 0.8 else "redo",
        "headline_reason": f"IoU {iou:.3f}, for example",
        "predicted": "trustworthy",
        "iou": iou,
        "sigma_depth_share": 0.02,
        "metric": True,
        "instances": 6,
        "weak": 1,
        "unobservable": 1,
        "worst_element": "wall_1 = e2 in 000010.jpg",
        "worst_element_iou": iou / 2,
        "seconds": 2.0,
        "peak_memory_mib": 300.0,
    }
    return Record(scene, **{**known, **more})


def failed(scene: str, failure: Failure, reason: str = "", **more: Any) -> Record:
    return Record(scene, "failed", failure, reason, seconds=1.0, **more)


def made_run(folder: Path, records: list[Record], not_yet: tuple[str, ...] = (), **config: Any) -> Path:
    names = sorted([record.scene for record in records] + list(not_yet))
    write_run(folder, names, {**asdict(Config()), **config}, VERSION)
    for record in records:
        place = scene_folder(folder, record.scene)
        write_record(place / RECORD_FILE, replace(record, configuration=VERSION))
        (place / SOLVE_LOG_FILE).write_text("log")
        if record.status != "failed":
            (place / "report.html").write_text("<title>scene</title>")
            (place / "thumbnail.jpg").write_bytes(PIXEL)
    return folder


RECORDS = [
    solved("a/fine", 0.95, depth_error_median=0.01),
    solved("a/doubtful", 0.93, "check", predicted="doubtful", depth_error_median=0.05),
    solved("b/bad", 0.7),
    solved("b/far", 0.9, "check"),
    solved("b/unknown", 0.9, "redo", headline_reason="depth is known for only 7 %", predicted="doubtful"),
    solved("b/worse", 0.5, metric=False, depth_error_median=0.3),
    solved(HOSTILE, 0.6, reason=REASON),
    failed("c/slow", "timeout", "not done in 5 s"),
    failed("c/none", "input", "no cameras in /data/c/none; looked for x", source="/data/c/none"),
    failed("c/torn", "input", "/data/c/torn/annotations.json is not valid JSON", source="/data/c/torn"),
]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return made_run(tmp_path / "night 1", RECORDS, ("z/not yet",))


def scenes_of(data: dict[str, Any]) -> list[dict[str, Any]]:
    return [dict(zip(data["table"]["keys"], values, strict=True)) for values in data["table"]["rows"]]


def test_data_says_what_came_of_the_run(run: Path) -> None:
    data = run_data(read_run(run), run)
    json.dumps(data, allow_nan=False)
    assert (data["scenes"], data["finished"], data["not_yet"]) == (11, 10, ["z/not yet"])
    assert data["groups"] == {"failed": 3, "redo": 4, "check": 2, "trust": 1}
    assert data["status"] == {"accepted": 4, "not accepted": 3, "failed": 3}
    assert data["accept_share"] == 0.4
    assert data["seconds"] == 17.0
    assert data["scenes_per_hour"] == pytest.approx(3600 * 10 / 17)
    assert data["peak_memory_mib"] == 300
    assert [(one["kind"], one["count"]) for one in data["failures"]] == [("input", 2), ("timeout", 1)]
    assert data["crossed"]["accepted"] == {"trustworthy": 2, "doubtful": 2}
    drawn = {one["title"].split(" (")[0]: one["histogram"] for one in data["distributions"]}
    assert drawn["reprojection IoU"]["count"] == 7
    assert drawn["depth error ε"]["count"] == 2, "scenes without a unit are left out"


def test_scenes_stand_worst_first(run: Path) -> None:
    rows = scenes_of(run_data(read_run(run), run))
    assert [one["name"] for one in rows] == [
        *("c/none", "c/torn", "c/slow"),
        *("b/worse", HOSTILE, "b/bad", "b/unknown"),
        *("b/far", "a/doubtful", "a/fine"),
    ]
    assert [one["verdict"] for one in rows][:4] == ["failed: input", "failed: input", "failed: timeout", "redo"]
    assert [one["status"] for one in rows][3:] == [
        *("not accepted", "not accepted", "not accepted", "accepted, doubtful"),
        *("accepted", "accepted, doubtful", "accepted"),
    ]
    assert rows[1]["reason"] == "annotations.json is not valid JSON"
    assert rows[0]["reason"] == "no cameras in the scene's folder; looked for x"
    assert rows[3]["weak"] == 2


def test_annotators_get_what_only_they_can_mend(run: Path) -> None:
    back = run_data(read_run(run), run)["send_back"]
    expected = ["c/none", "c/torn", "b/worse", HOSTILE, "b/bad", "b/unknown"]
    assert [line.split("\t")[0] for line in back] == expected
    assert [line.split("\t")[1] for line in back[2:6:3]] == ["IoU 0.500, for example", "depth is known for only 7 %"]


def test_records_without_a_headline_go_by_their_measures(tmp_path: Path) -> None:
    """Those of earlier versions, which a run may be compared with."""
    records = [solved("a", 0.9, None), solved("b", 0.9, None, predicted="doubtful"), solved("c", 0.7)]
    records[2] = replace(records[2], headline=None, headline_reason="", reason="IoU below 0.8")
    data = run_data(read_run(made_run(tmp_path, records)), tmp_path)
    assert [(one["name"], one["verdict"]) for one in scenes_of(data)] == [("c", "redo"), ("b", "check"), ("a", "trust")]
    assert data["send_back"] == ["c\tIoU below 0.8"]


def test_every_failure_has_its_words(tmp_path: Path) -> None:
    records = [failed(kind, kind) for kind in FAILURES]
    found = run_data(read_run(made_run(tmp_path, records)), tmp_path)["failures"]
    assert [one["kind"] for one in found] == ["input", "bug", "timeout", "died", "memory", "worker"]
    assert all(one["means"] for one in found)


def test_links_lead_to_the_run_from_wherever_the_page_is(run: Path, tmp_path: Path) -> None:
    for folder in (run, tmp_path, tmp_path / "pages/of runs"):
        for one in scenes_of(run_data(read_run(run), folder)):
            assert ":" not in one["folder"], "would be read as a scheme"
            assert (folder / unquote(one["folder"])).resolve() == scene_folder(run, one["name"]).resolve()


def test_damaged_records_are_not_finished_and_figures_that_are_none_not_known(tmp_path: Path) -> None:
    records = [
        solved("a", 0.9, peak_memory_mib=float("nan")),
        solved("b", 0.9, seconds="x"),
        solved("c", 0.9, weak=[1]),
    ]
    run = made_run(tmp_path, records)
    write_run_report(run, run / "report.html")
    data = run_data(read_run(run), run)
    assert [(one["name"], one["memory"]) for one in scenes_of(data)] == [("a", None)]
    assert data["not_yet"] == ["b", "c"]


def test_run_without_a_finished_scene(tmp_path: Path, page: Page, problems: list[str]) -> None:
    run = made_run(tmp_path, [], ("a",))
    write_run_report(run, run / "report.html")
    page.goto((run / "report.html").as_uri())
    assert "0 of 0 scenes to trust, 1 not yet finished" in page.locator("#verdict h2").inner_text()
    assert problems == []


def test_histogram_counts_every_value() -> None:
    values = [0.0, 0.1, 0.799, 0.8, 0.81, 1.0]
    drawn = histogram(values, 0.0, 1.0, 0.8)
    assert drawn is not None
    assert sum(bar["count"] for bar in drawn["bars"]) == len(values)
    assert sum(bar["count"] for bar in drawn["bars"] if bar["below"]) == 3
    assert max(bar["height"] for bar in drawn["bars"]) == HEIGHT
    assert drawn["ticks"][0]["text"] == "0"
    assert drawn["ticks"][-1]["text"] == "1"


def test_histogram_keeps_its_scale_when_one_value_is_huge() -> None:
    drawn = histogram([*(0.1 * i for i in range(100)), 1e6])
    assert drawn is not None
    assert drawn["bars"][-1]["to"] is None, "the last bar holds what lies beyond"
    assert float(drawn["bars"][-1]["from"]) < 20
    assert sum(bar["count"] for bar in drawn["bars"]) == 101
    assert histogram([]) is None
    same = histogram([0.0, 0.0])
    assert same is not None
    assert [bar["count"] for bar in same["bars"]] == [2]


def compared(tmp_path: Path, here: list[Record], there: list[Record], **config: Any) -> dict[str, Any]:
    run, other = (
        read_run(made_run(tmp_path / name, records, **more))
        for name, records, more in (("here", here, config), ("there", there, {}))
    )
    return comparison(run, other, tmp_path)


def names(changes: list[dict[str, Any]]) -> list[str]:
    return [one["here"]["name"] for one in changes]


def test_comparison_says_what_got_better_and_worse_by_how_much(tmp_path: Path) -> None:
    there = [solved(f"s{i}", 0.9, depth_error_median=0.02) for i in range(8)] + [solved("gone", 0.9)]
    here = [
        there[0],
        solved("s1", 0.86, depth_error_median=0.02),
        solved("s2", 0.85, depth_error_median=0.02),
        failed("s3", "died"),
        solved("s4", 0.79),
        solved("s5", 0.95, depth_error_median=0.02),
        solved("s6", 0.9001, depth_error_median=0.03),
        solved("s7", 0.9, depth_error_median=0.01),
        solved("new", 0.9),
    ]
    data = compared(tmp_path, here, there, seed=7)
    assert names(data["worse"]) == ["s3", "s4", "s2", "s1", "s6"]
    assert names(data["better"]) == ["s5", "s7"]
    assert (data["both"], data["same"], data["only_here"], data["only_there"]) == (8, 1, ["new"], ["gone"])
    assert data["settings"] == [{"name": "seed", "here": "7", "there": "0"}]
    assert data["worse"][2]["iou"] == pytest.approx(-0.05)
    assert data["worse"][4]["depth_error"] == pytest.approx(0.01)
    assert [(one["name"], one["here"], one["there"]) for one in data["status"]] == [
        ("trust", 6, 8),
        ("check", 0, 0),
        ("redo", 1, 0),
        ("failed", 1, 0),
        ("accepted", 6, 8),
        ("not accepted", 1, 0),
    ]
    assert data["medians"][0]["count"] == 7
    assert data["medians"][0]["there"] == "0.9000"


def test_comparison_goes_by_the_headline_where_both_have_one(tmp_path: Path) -> None:
    """A scene that is to be checked now got worse, whatever its IoU; one that had no headline did not."""
    there = [solved("a", 0.9), solved("b", 0.9, "redo"), solved("c", 0.9, None), solved("d", 0.7)]
    there[3] = replace(there[3], headline=None)
    here = [solved("a", 0.95, "check"), solved("b", 0.85, "check"), solved("c", 0.9, "redo"), solved("d", 0.9, "redo")]
    data = compared(tmp_path, here, there)
    assert (names(data["worse"]), names(data["better"]), data["same"]) == (["a"], ["d", "b"], 1)


def test_comparison_with_itself_finds_nothing(run: Path) -> None:
    itself: Run = read_run(run)
    data = comparison(itself, itself, run)
    assert (data["worse"], data["better"], data["settings"], data["same"]) == ([], [], [], 10)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["{run}", "--against", "{empty}"], "is no run"),
        (["{run}", "--layout", "{empty}"], "--layout is for one scene"),
        (["{empty}", "--against", "{run}"], "--against compares two runs"),
    ],
)
def test_what_does_not_fit_together_is_said(
    run: Path, tmp_path: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert main(["report", *(one.format(run=run, empty=tmp_path / "empty") for one in arguments)]) == 1
    assert said in capsys.readouterr().err
    assert not (run / "report.html").exists()


def test_page_has_names_only_as_text(run: Path, tmp_path: Path) -> None:
    assert main(["report", str(run), "--against", str(run), "--out", str(tmp_path / "page.html")]) == 0
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<script>alert" not in html
    assert "<img src=x" not in html
    assert HOSTILE in unescape(html)
    write_run_report(run, tmp_path / "again.html", run)
    assert (tmp_path / "again.html").read_text(encoding="utf-8") == html


def load_images(page: Page, selector: str) -> int:
    """How many there are; raises when one of them cannot be loaded."""
    loaded = """selector => Promise.all([...document.querySelectorAll(selector)].map((image) => {
        image.loading = "eager";
        return image.decode();
    })).then((images) => images.length)"""
    return int(page.evaluate(loaded, selector))


def test_page_works_in_a_browser(run: Path, page: Page, problems: list[str]) -> None:
    assert main(["report", str(run)]) == 0
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((run / "report.html").as_uri())

    def shown() -> list[str]:
        return page.locator("#table tbody td.scene").all_inner_texts()

    assert shown()[0] == "c/none"
    assert len(shown()) == 10
    assert page.locator("#table td.why", has_text=REASON).count() == 1, "text stays text"
    assert page.locator("img[src=x]").count() == 0
    assert load_images(page, "#table img") == 7
    assert all(url.startswith((run.as_uri(), "data:")) for url in asked)

    column = "#table tbody td.iou"
    for descending in (False, True):
        page.locator("#table th button", has_text="IoU").click()
        values = page.locator(column).all_inner_texts()
        assert values[7:] == ["–"] * 3, "unknown ones last"
        assert values[:7] == sorted(values[:7], reverse=descending)
    page.locator("[data-group=redo]").click()
    assert shown() == ["b/unknown", "b/bad", HOSTILE, "b/worse"]
    page.locator("#find").fill("WORSE")
    assert shown() == ["b/worse"]
    page.locator("[data-find='failed: timeout']").click()
    assert shown() == ["c/slow"]

    page.locator("#copy").click()
    assert page.locator("#copied").inner_text() != ""
    assert page.evaluate("getSelection().toString()").startswith("c/none\tno cameras in the scene's folder")

    # Links: the log of what failed, the page of what did not.
    page.locator("#find").fill("")
    for pile, address in (("failed", "/log.txt"), ("redo", "/report.html")):
        page.locator(f"[data-group={pile}]").click()
        with page.expect_navigation():
            page.locator("#table td.scene a").nth(1).click()
        assert page.url.endswith(address)
        page.go_back()
    assert problems == []


def test_page_works_from_a_server(run: Path, page: Page, problems: list[str]) -> None:
    write_run_report(run, run / "report.html")
    with served(run) as root:
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(f"{root}/report.html")
        assert load_images(page, "#table img") == 7
        assert all(url.startswith(root) for url in asked)
    assert problems == []


def test_page_shows_many_scenes_some_at_a_time(tmp_path: Path, page: Page, problems: list[str]) -> None:
    records = [solved(f"s{i:03d}", 0.5 + i / 1000) for i in range(450)]
    run = made_run(tmp_path / "run", records)
    write_run_report(run, run / "report.html")
    page.goto((run / "report.html").as_uri())
    rows = page.locator("#table tbody tr")
    assert rows.count() == 200
    page.locator("#more").click()
    page.locator("#more").click()
    assert rows.count() == 450
    assert not page.locator("#more").is_visible()
    assert problems == []


def test_comparison_works_in_a_browser_and_on_a_phone(
    run: Path, tmp_path: Path, page: Page, problems: list[str]
) -> None:
    changed = [replace(one, iou=one.iou - 0.1) if one.iou else one for one in RECORDS]
    other = made_run(tmp_path / "other", changed, seed=3)
    out = tmp_path / "page.html"
    assert main(["report", str(run), "--against", str(other), "--out", str(out)]) == 0
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(out.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert "7 better" in page.locator("#against > p").first.inner_text()
    assert page.locator("#better tbody tr").count() == 7
    assert page.locator("#settings td").all_inner_texts() == ["seed", "0", "3"]
    assert load_images(page, "#better img") == 7
    assert problems == []
