"""The label configurations: exactly this task's words, accepted by the tools."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import get_args

import pytest
from defusedxml import ElementTree
from tools_env import run_tool

from gtlayout.io.annotations.cvat.reader import PROPOSED
from gtlayout.io.annotations.labeling import LABEL_FILES, LabelTool, label_config
from gtlayout.io.annotations.labels import KINDS, label_meanings, meaning
from gtlayout.scene import LABELS

OURS = [kind for kind in KINDS if kind != "ignored"]


def _understood(names: list[str]) -> bool:
    return names == OURS and [meaning(name, label_meanings({})) for name in names] == OURS


def test_cvat_labels() -> None:
    """The rules are those of CVAT's label constructor (``validateParsedLabel`` in ``cvat-ui``)."""
    labels = json.loads(label_config("cvat"))
    *drawn, proposed = labels
    assert _understood([label["name"] for label in drawn])
    assert (proposed["name"], proposed["type"], proposed["attributes"]) == (PROPOSED, "tag", [])
    assert len({label["color"] for label in labels}) == len(labels)
    assert all(re.fullmatch("#[0-9a-f]{6}", label["color"]) for label in labels)
    for label in drawn:
        assert label["type"] == ("polyline" if label["name"] == "occlusion_edge" else "any")
        wanted = ["id"] if label["name"] in LABELS else ["element"] if label["name"] == "visible" else []
        wanted += ["curved"] if label["name"] == "wall" else []
        assert [attribute["name"] for attribute in label["attributes"]] == wanted
        for attribute in label["attributes"]:
            is_box = attribute["name"] == "curved"
            assert attribute["input_type"] == ("checkbox" if is_box else "text")
            assert attribute["mutable"] is True
            assert attribute["values"] == [attribute["default_value"]] == ["false" if is_box else ""]


def test_label_studio_config() -> None:
    root = ElementTree.fromstring(label_config("label-studio"))
    labels = {
        node.tag: [each.get("value", "") for each in node.findall("Label")] for node in root.findall("*[@toName]")
    }
    assert labels == {"PolygonLabels": OURS[:-1], "BrushLabels": OURS[:-1], "VectorLabels": OURS[-1:]}
    assert _understood(labels["PolygonLabels"] + labels["VectorLabels"])
    asked = {view.get("whenLabelValue"): [area.get("name") for area in view] for view in root.findall("View")}
    assert asked == {",".join(LABELS): ["id"], "wall": ["curved"], "visible": ["element"]}


def test_label_studio_accepts_its_config(tmp_path: Path) -> None:
    path = tmp_path / "config.xml"
    path.write_text(label_config("label-studio"))
    controls = json.loads(run_tool("check_label_studio.py", str(path)))
    assert controls == {
        "polygon": ["PolygonLabels", OURS[:-1]],
        "brush": ["BrushLabels", OURS[:-1]],
        "vector": ["VectorLabels", OURS[-1:]],
        "id": ["TextArea", []],
        "curved": ["Choices", ["curved"]],
        "element": ["TextArea", []],
    }


@pytest.mark.parametrize("tool", get_args(LabelTool))
def test_the_wheel_holds_them(tool: LabelTool) -> None:
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["gtlayout.io.annotations.labeling"]
    assert any(Path(LABEL_FILES[tool]).match(pattern) for pattern in patterns)
