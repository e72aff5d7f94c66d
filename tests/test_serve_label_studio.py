"""The ML backend: what Label Studio's own SDK and our reader make of its predictions, and who may ask for them."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from serving import SIZE, ask, running
from shapely import MultiPolygon, Polygon
from tools_env import run_tool

from gtlayout.guard import Admission, Credentials, Guard
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.io.annotations.label_studio.control_tags import control_tags
from gtlayout.io.annotations.label_studio.reader import read_label_studio
from gtlayout.io.annotations.labeling import label_config
from gtlayout.io.annotations.labels import label_meanings
from gtlayout.serve.label_studio import MAX_BODY, backend, problem
from gtlayout.serve.predictions import predictions
from gtlayout.serve.solved_room import Found, SolvedRoom
from gtlayout.serve.solving import BackgroundSolves, Stamp

CONFIG = label_config("label-studio")
NAMES = ("000005.jpg", "000008.jpg", "kitchen.jpg")
"""Of a frame that is not drawn, of one that is, and of none."""
TASKS = [{"id": 7 + i, "data": {"image": f"/data/upload/1/1a2b3c4d-{name}"}} for i, name in enumerate(NAMES)]


class Drawings:
    """What stands behind ``BackgroundSolves``: another number, other drawings."""

    def __init__(self, room: SolvedRoom | None) -> None:
        self.room, self.number, self.made = room, 1, 0

    def make(self) -> SolvedRoom | None:
        self.made += 1
        return self.room

    def stamp(self) -> Stamp:
        return (("annotations", self.number, 0),)

    def solved(self) -> BackgroundSolves:
        solves = BackgroundSolves(self.make, self.stamp)
        assert solves.refresh()
        solves.wait()
        return solves


@pytest.fixture(scope="module")
def drawings(served_room: SolvedRoom) -> Drawings:
    return Drawings(served_room)


def guarded(drawings: Drawings, **admission: Any) -> Guard:
    return Guard(backend(drawings.solved()), Admission(MAX_BODY, **admission), problem)


@pytest.fixture(scope="module")
def address(drawings: Drawings) -> Iterator[str]:
    with running(guarded(drawings)) as url:
        yield url


@pytest.fixture(scope="module")
def predicted(address: str) -> dict[str, Any]:
    status, answer = ask(f"{address}/predict", {"tasks": TASKS, "label_config": CONFIG, "project": "1.1", "params": {}})
    assert status == 200
    return answer


def test_each_task_has_a_prediction_and_what_is_not_known_an_empty_one(
    predicted: dict[str, Any], served_room: SolvedRoom
) -> None:
    results = predicted["results"]
    assert [each["model_version"] for each in results] == [served_room.version] * 3
    assert predicted["model_version"] == served_room.version
    assert [bool(each["result"]) for each in results] == [True, True, False]
    assert 0 < results[0]["score"] <= 1
    assert results[2]["score"] == 0
    assert all(0 <= each["score"] <= 1 for each in results[0]["result"] if each["type"] != "textarea")
    ids = [each["id"] for each in results[0]["result"] if each["type"] != "textarea"]
    assert len(set(ids)) == len(ids)
    vectors = [each["value"]["vertices"] for each in results[0]["result"] if each["type"] == "vectorlabels"]
    assert vectors
    for vertices in vectors:
        assert [each["prevPointId"] for each in vertices] == [None, *(each["id"] for each in vertices[:-1])]


def test_label_studio_finds_nothing_wrong_and_converts_them(
    predicted: dict[str, Any], served_room: SolvedRoom, tmp_path: Path
) -> None:
    for name, content in (("config.xml", CONFIG), ("results.json", predicted), ("tasks.json", TASKS)):
        (tmp_path / name).write_text(content if isinstance(content, str) else json.dumps(content))
    paths = [str(tmp_path / name) for name in ("config.xml", "results.json", "tasks.json")]
    assert json.loads(run_tool("check_predictions.py", *paths, str(tmp_path))) == [[], [], []]
    coco = json.loads((tmp_path / "result.json").read_text())
    names = {each["id"]: each["name"] for each in coco["categories"]}
    first = coco["annotations"][0]["image_id"]
    drawn: dict[str, list[Polygon]] = {}
    for each in coco["annotations"]:
        if each["image_id"] == first:
            points = iter(each["segmentation"][0])
            drawn.setdefault(names[each["category_id"]], []).append(Polygon(list(zip(points, points, strict=True))))
    wanted: dict[str, list[MultiPolygon]] = {}
    for element in _key_frame_of(served_room, NAMES[0]).elements:
        wanted.setdefault(element.label, []).append(element.amodal)
        if not element.visible.is_empty:
            wanted.setdefault("visible", []).append(element.visible)
    assert drawn.keys() == wanted.keys()
    for label, regions in wanted.items():
        area = sum(region.area for region in regions)
        assert sum(polygon.area for polygon in drawn[label]) == pytest.approx(area, rel=1e-3)


def test_submitted_they_read_as_what_was_proposed(
    predicted: dict[str, Any], served_room: SolvedRoom, tmp_path: Path
) -> None:
    """Labels, ids, whose visible parts they are, and occlusion edges."""
    path = tmp_path / "export.json"
    both = zip(TASKS, predicted["results"], strict=True)
    path.write_text(json.dumps([{**task, "annotations": [{"id": 1, "result": each["result"]}]} for task, each in both]))
    key_frames, _ = build_key_frames(read_label_studio(tmp_path, path), served_room.scene.frames, (), {})
    assert [key_frame.frame for key_frame in key_frames] == [5, 8]
    for key_frame in key_frames:
        wanted = _key_frame_of(served_room, served_room.scene.frames[key_frame.frame].name)
        assert {(each.id, each.label) for each in key_frame.elements} == {(e.id, e.label) for e in wanted.elements}
        by_id = {element.id: element for element in wanted.elements}
        for element in key_frame.elements:
            assert element.amodal.symmetric_difference(by_id[element.id].amodal).area < 1.0
            assert element.visible.symmetric_difference(by_id[element.id].visible).area < 1.0
        assert len(key_frame.occlusion_edges) == len(wanted.occlusion_edges)
        for edge, other in zip(key_frame.occlusion_edges, wanted.occlusion_edges, strict=True):
            assert edge == pytest.approx(other, abs=1e-6)


def test_the_tags_are_those_of_the_configuration(address: str, caplog: pytest.LogCaptureFixture) -> None:
    """Other names, the labels capitalised, no text fields and nothing to draw occlusion edges with."""
    config = (
        '<View><Image name="photo" value="$frame"/><RectangleLabels name="boxes" toName="photo"><Label value="Wall"/>'
        '</RectangleLabels><PolygonLabels name="outline" toName="photo"><Label value="Wall 1"/><Label value="Ground"/>'
        "</PolygonLabels></View>"
    )
    tasks = [{"data": {"frame": "https://host/images/000005.jpg?x=1"}}]
    status, answer = ask(f"{address}/predict", {"tasks": tasks, "label_config": config})
    assert status == 200
    found = answer["results"][0]["result"]
    assert {(each["from_name"], each["to_name"], each["type"]) for each in found} == {
        ("outline", "photo", "polygonlabels")
    }
    assert {each["value"]["polygonlabels"][0] for each in found} == {"Wall 1", "Ground"}
    (said,) = [each.message for each in caplog.records if "label_config" in each.message]
    assert said.startswith("/images/000005.jpg: label_config has nothing to draw ")
    assert said.endswith("occlusion_edge, visible, window with: not proposed")


def test_the_requests_of_label_studio_are_answered(
    address: str, drawings: Drawings, served_room: SolvedRoom, caplog: pytest.LogCaptureFixture
) -> None:
    """As ``tests/test_api.py`` of label-studio-ml-backend asks, and ``api_connector.py`` of Label Studio."""
    for path in ("/", "/health"):
        status, answer = ask(f"{address}{path}")
        assert status == 200
        assert answer["status"] == "UP"
        assert answer["state"] == "ready"
        assert answer["problem"] == ""
    setup = {"project": "1.1000000000", "schema": CONFIG, "hostname": "http://localhost:8080", "extra_params": {}}
    assert ask(f"{address}/setup", setup) == (200, {"model_version": served_room.version})
    assert ask(f"{address}/webhook", {"action": "PROJECT_UPDATED"}) == (200, {"status": "Unknown event"})
    event = {"action": "ANNOTATION_CREATED", "project": {"id": 1, "label_config": CONFIG}, "annotation": {}}
    made = drawings.made
    status, answer = ask(f"{address}/webhook", event)
    assert (status, answer) == (201, {"result": "no newer drawings in the scene folder", "status": "ok"})
    assert drawings.made == made
    assert "export the annotations to it" in caplog.text
    drawings.number += 1
    status, answer = ask(f"{address}/webhook", {"action": "START_TRAINING", "project": {"id": 1}})
    assert (status, answer) == (201, {"result": "solving again", "status": "ok"})
    while ask(f"{address}/health")[1]["state"] == "solving":
        pass
    assert drawings.made == made + 1


def test_nothing_drawn_is_no_error() -> None:
    with running(backend(Drawings(None).solved())) as url:
        assert ask(f"{url}/health")[1]["state"] == "nothing drawn"
        status, answer = ask(f"{url}/predict", {"tasks": TASKS, "label_config": CONFIG})
    assert status == 200
    assert [each["result"] for each in answer["results"]] == [[], [], []]


@pytest.mark.parametrize(
    ("path", "data", "status", "said"),
    [
        ("/predict", b"{", 400, "the body is not valid JSON"),
        ("/predict", b"[" * 100_000, 400, "the body is not valid JSON"),
        ("/predict", [], 400, "the body must be a JSON object"),
        ("/predict", {"tasks": {"id": 1}, "label_config": CONFIG}, 400, "tasks must be a list"),
        ("/predict", {"tasks": [1], "label_config": CONFIG}, 400, "a task has no data"),
        (
            "/predict",
            {"tasks": [{"data": {"image": 3}}], "label_config": CONFIG},
            400,
            "no image in its data's 'image'",
        ),
        ("/predict", {"tasks": [], "label_config": None}, 400, "label_config must be a text"),
        ("/predict", {"tasks": [], "label_config": "<View>"}, 400, "label_config is not XML"),
        ("/predict", {"tasks": [], "label_config": "<!DOCTYPE x [<!ENTITY a 'b'>]><x>&a;</x>"}, 400, "is not XML"),
        ("/setup", {"project": "1.1", "schema": "<View></View>"}, 400, "has no PolygonLabels on an Image"),
        ("/train", {}, 404, "Not Found"),
        ("/health", {}, 405, "Method Not Allowed"),
        ("/webhook", b" " * (MAX_BODY + 1), 413, "the body has more than 64 MB"),
    ],
)
def test_what_is_wrong_is_said_as_json(address: str, path: str, data: object, status: int, said: str) -> None:
    found, answer = ask(f"{address}{path}", data)
    assert (found, list(answer)) == (status, ["error"])
    assert said in answer["error"]


def test_a_bug_is_an_answer_and_the_server_goes_on(
    address: str, served_room: SolvedRoom, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(served_room, "find", lambda _image: 1 / 0)
    status, answer = ask(f"{address}/predict", {"tasks": TASKS, "label_config": CONFIG})
    assert status == 500
    assert "ZeroDivisionError" in answer["error"]
    assert ask(f"{address}/health")[0] == 200


def test_web_pages_and_other_names_are_refused(drawings: Drawings) -> None:
    with running(guarded(drawings, hosts={"127.0.0.1:1"})) as url:
        assert ask(f"{url}/health")[0] == 403
        assert ask(f"{url}/health", headers={"Host": "evil.example:1"})[0] == 403
        assert ask(f"{url}/health", headers={"Host": "127.0.0.1:1"})[0] == 200
        for origin in ("http://evil.example", "http://127.0.0.1:1", "null"):
            status, answer = ask(f"{url}/health", headers={"Host": "127.0.0.1:1", "Origin": origin})
            assert (status, answer) == (403, {"error": "this server does not answer to web pages"})
        # A form or a script without leave from here can only send other types.
        for kind in ("text/plain", "application/x-www-form-urlencoded", ""):
            headers = {"Host": "127.0.0.1:1", "Content-Type": kind}
            assert ask(f"{url}/webhook", {"action": "START_TRAINING"}, headers)[0] == 415


def test_a_password_is_asked_for(drawings: Drawings) -> None:
    def with_header(text: str) -> int:
        header = {"Authorization": "Basic " + base64.b64encode(text.encode()).decode()}
        return ask(f"{url}/health", headers=header)[0]

    with running(guarded(drawings, credentials=Credentials("me", "gehéim:1"))) as url:
        assert ask(f"{url}/health") == (401, {"error": "user name and password are missing or wrong"})
        assert ask(f"{url}/health", headers={"Authorization": "Bearer abc"})[0] == 401
        assert [with_header(text) for text in ("me:gehéim:1", "me:gehéim:2", "you:gehéim:1", "")] == [
            200,
            401,
            401,
            401,
        ]


def test_a_task_of_another_field_is_refused(served_room: SolvedRoom) -> None:
    tags = control_tags(CONFIG, label_meanings({}))
    (empty,) = predictions([{"data": {"image": "kitchen.jpg", "other": "000005.jpg"}}], tags, served_room)
    assert empty["result"] == []
    size = predictions([{"data": {"image": "000005.jpg"}}], tags, served_room)[0]["result"][0]
    assert (size["original_width"], size["original_height"]) == SIZE


def _key_frame_of(served_room: SolvedRoom, name: str) -> Any:
    found = served_room.find(name)
    assert isinstance(found, Found)
    return served_room.propose(found).key_frame()
