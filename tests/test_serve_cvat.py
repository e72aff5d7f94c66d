"""CVAT's auto-annotation function: run by CVAT's own command against as much of a server as it asks for."""

from __future__ import annotations

import os
import subprocess
import sysconfig
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import pytest
from cvat_server import CvatTask, serving
from serving import FRAMES, SIZE
from tools_env import tools_python

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.cvat.reader import PROPOSED, read_cvat
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.proposals.order import next_frames
from gtlayout.scene import KeyFrame
from gtlayout.serve.solved_room import Found, SolvedRoom

ROOT = Path(__file__).parents[1]
FOREIGN = "kitchen.jpg"


def auto_annotate(task: CvatTask, scene: Path, cache: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """``cvat-cli`` with the packages of the tools, and gtlayout with its own before them."""
    with serving(task) as port:
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(ROOT), sysconfig.get_path("purelib")]),
            "CVAT_ACCESS_TOKEN": "a-token",
            "XDG_CACHE_HOME": str(cache),
            "XDG_CONFIG_HOME": str(cache),
        }
        server = ["--server-host", "http://127.0.0.1", "--server-port", str(port)]
        function = ["--function-module", "gtlayout.serve.cvat", "-p", f"scene=str:{scene}"]
        command = [str(tools_python()), "-m", "cvat_cli", *server, "task", "auto-annotate", "1", *function, *options]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def task_over(folder: Path) -> CvatTask:
    """All frames of the small room, and an image that is none."""
    images = sorted((folder / "images").iterdir())
    return CvatTask([*((path.name, path, SIZE) for path in images), (FOREIGN, images[0], SIZE)])


@dataclass
class Annotated:
    task: CvatTask
    said: str
    shapes: dict[str, list[dict[str, Any]]]
    """By image."""
    tags: dict[str, list[str]]


@pytest.fixture(scope="module")
def annotated(tiny_room: Path, tmp_path_factory: pytest.TempPathFactory) -> Annotated:
    task = task_over(tiny_room)
    done = auto_annotate(task, tiny_room, tmp_path_factory.mktemp("cache"))
    assert done.returncode == 0, done.stderr
    assert task.unknown == []
    (uploaded,) = task.uploaded
    shapes, tags = defaultdict(list), defaultdict(list)
    for shape in uploaded["shapes"]:
        shapes[task.images[shape["frame"]][0]].append(shape)
    for tag in uploaded["tags"]:
        tags[task.images[tag["frame"]][0]].append(task.label_names[tag["label_id"]])
    return Annotated(task, done.stderr, dict(shapes), dict(tags))


def _exported(annotated: Annotated, folder: Path, *, with_tags: bool) -> Path:
    """What was uploaded as CVAT exports it."""
    lines = []
    for i, (image, _, (width, height)) in enumerate(annotated.task.images):
        lines.append(f'<image id="{i}" name={quoteattr(image)} width="{width}" height="{height}">')
        for label in annotated.tags.get(image, []) if with_tags else []:
            lines.append(f'<tag label="{label}" source="auto"></tag>')
        for shape in annotated.shapes.get(image, []):
            numbers = iter(shape["points"])
            points = ";".join(f"{x},{y}" for x, y in zip(numbers, numbers, strict=True))
            label = annotated.task.label_names[shape["label_id"]]
            lines.append(f'<{shape["type"]} label="{label}" source="auto" occluded="0" points="{points}" z_order="0">')
            for each in shape["attributes"]:
                name = annotated.task.attribute_names[each["spec_id"]]
                lines.append(f'<attribute name="{name}">{each["value"]}</attribute>')
            lines.append(f"</{shape['type']}>")
        lines.append("</image>")
    path = folder / "annotations.xml"
    path.write_text(f"<annotations><version>1.1</version>{''.join(lines)}</annotations>")
    return path


def _key_frames(path: Path, served_room: SolvedRoom) -> dict[int, KeyFrame]:
    raw = read_cvat(path.parent, path)
    key_frames, _ = build_key_frames(raw, served_room.scene.frames, (), {})
    return {key_frame.frame: key_frame for key_frame in key_frames}


def test_every_frame_that_is_not_drawn_is_proposed(annotated: Annotated, served_room: SolvedRoom) -> None:
    drawn = {served_room.scene.frames[key_frame.frame].name for key_frame in served_room.scene.key_frames}
    names = {frame.name for frame in served_room.scene.frames}
    assert set(annotated.shapes) == names - drawn
    assert annotated.tags == {name: [PROPOSED] for name in names - drawn}
    assert len(names) == FRAMES
    assert {shape["source"] for shapes in annotated.shapes.values() for shape in shapes} == {"auto"}
    assert all(0 < shape["score"] <= 1 for shapes in annotated.shapes.values() for shape in shapes)


def test_what_gets_nothing_is_said(annotated: Annotated, served_room: SolvedRoom) -> None:
    lines = annotated.said.splitlines()
    assert f"{FOREIGN}: nothing is proposed, it has no camera" in lines
    for key_frame in served_room.scene.key_frames:
        name = served_room.scene.frames[key_frame.frame].name
        assert f"{name}: nothing is proposed, it is drawn already" in lines
    assert f"proposing from {served_room.version}" in lines
    assert sum("nothing is proposed" in line for line in lines) == 1 + len(served_room.scene.key_frames)


def test_an_export_reads_as_what_was_proposed(annotated: Annotated, served_room: SolvedRoom, tmp_path: Path) -> None:
    """Confirmed: the tags are gone. Labels, ids, visible parts and occlusion edges are those of the proposals."""
    read = _key_frames(_exported(annotated, tmp_path, with_tags=False), served_room)
    assert len(read) == len(annotated.shapes)
    for index, key_frame in read.items():
        found = served_room.find(served_room.scene.frames[index].name)
        assert isinstance(found, Found)
        proposed = served_room.propose(found).key_frame()
        wanted = {element.id: element for element in proposed.elements}
        assert {element.id: element.label for element in key_frame.elements} == {
            name: element.label for name, element in wanted.items()
        }
        for element in key_frame.elements:
            for own, theirs in (
                (element.amodal, wanted[element.id].amodal),
                (element.visible, wanted[element.id].visible),
            ):
                assert own.symmetric_difference(theirs).area < 0.01 * theirs.area + 1.0
        assert len(key_frame.occlusion_edges) == len(proposed.occlusion_edges)


def test_what_is_not_confirmed_is_no_drawing(annotated: Annotated, tmp_path: Path) -> None:
    raw = read_cvat(tmp_path, _exported(annotated, tmp_path, with_tags=True))
    assert raw.key_frames == ()
    first = min(annotated.shapes)
    assert raw.warnings == ()
    assert raw.notes == (
        "annotations.xml: image left out: its tag 'proposed' says that nobody has confirmed what is drawn "
        f"({len(annotated.shapes)}, first in {first})",
    )


def test_other_tags_say_nothing_of_that(tmp_path: Path) -> None:
    image = '<image id="0" name="a.jpg" width="9" height="9">'
    wall = '<polygon label="wall" points="0,0;9,0;9,9"></polygon></image>'
    path = tmp_path / "annotations.xml"
    path.write_text(f'<annotations>{image}<tag label="kitchen"></tag>{wall}</annotations>')
    assert [raw.image for raw in read_cvat(tmp_path, path).key_frames] == ["a.jpg"]


def test_the_next_frames_only_what_is_sure_enough_and_a_task_without_the_tag(
    annotated: Annotated, tiny_room: Path, served_room: SolvedRoom, tmp_path: Path
) -> None:
    scores = sorted(shape["score"] for shapes in annotated.shapes.values() for shape in shapes)
    limit = scores[len(scores) // 2]
    task = task_over(tiny_room)
    task.labels = [label for label in task.labels if label["name"] != PROPOSED]
    options = ("--conf-threshold", str(limit), "--allow-unmatched-labels", "-p", "next=int:3")
    done = auto_annotate(task, tiny_room, tmp_path, *options)
    assert done.returncode == 0, done.stderr
    names = [task.images[frame][0] for frame in next_frames(served_room.scene, 3)]
    assert f"proposing only {', '.join(names)}" in done.stderr.splitlines()
    (uploaded,) = task.uploaded
    wanted = [shape["score"] for name in names for shape in annotated.shapes[name]]
    assert min(wanted) < limit
    assert sorted(shape["score"] for shape in uploaded["shapes"]) == sorted(s for s in wanted if s >= limit)
    assert uploaded["tags"] == []


def test_a_scene_without_drawings_says_what_to_do(tiny_room: Path, tmp_path: Path) -> None:
    bare = tmp_path / "room"
    bare.mkdir()
    (bare / "images").symlink_to(tiny_room / "images")
    (bare / "transforms.json").symlink_to(tiny_room / "transforms.json")
    task = task_over(tiny_room)
    done = auto_annotate(task, bare, tmp_path)
    assert done.returncode != 0
    assert "nothing is drawn in it yet, so nothing can be proposed: draw the first two frames" in done.stderr
    assert GtlayoutError.__name__ in done.stderr
    assert task.uploaded == []
