"""layout.json's schema: generated from the types that mypy holds the writer to, and as strict as the reader."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict

import numpy as np
import pytest
import rooms
from jsonschema import Draft202012Validator

from gtlayout.config import Config
from gtlayout.instances import Plane
from gtlayout.io.files import json_text
from gtlayout.io.json_schema import OrNull, Shape, schema_of
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.quality.assess import assess
from gtlayout.results.layout_files import write_results
from gtlayout.results.layout_format import layout_schema

COMMITTED = Path(__file__).parents[1] / "docs/layout.schema.json"


@pytest.fixture(scope="module")
def validator() -> Draft202012Validator:
    schema = json.loads(COMMITTED.read_text())
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


@pytest.fixture
def written(tmp_path: Path) -> Any:
    """The box room without its near wall, a plane of which nothing is known included."""
    surfaces = rooms.BOX[:5]
    scene = rooms.seen_from([rooms.level_camera([2.0, y, 1.25]) for y in (1.0, 0.5)], surfaces)
    instances, extents = rooms.instances_of(surfaces, 2), tuple(surface.extent for surface in surfaces)
    nowhere = Plane(np.full(3, np.nan), np.nan, np.full((4, 4), np.nan), observable=False, note="no track places it")
    planes = (*(surface.plane for surface in surfaces[:4]), nowhere)
    layout = Layout(instances, planes, extents, build_mesh(instances, extents), metric=False)
    write_results(tmp_path, scene, layout, assess(scene, instances, planes, extents, Config().quality), Config())
    return json.loads((tmp_path / "layout.json").read_text())


def test_the_committed_schema_is_the_code_s() -> None:
    assert json_text(layout_schema()) == COMMITTED.read_text(), (
        "python -m gtlayout.results.layout_format > docs/layout.schema.json"
    )


def test_what_is_written_is_valid(written: Any, validator: Draft202012Validator) -> None:
    assert written["instances"][4]["plane"]["normal"] == [None, None, None]
    validator.validate(written)


@pytest.mark.parametrize(
    ("spoil", "where"),
    [
        (lambda data: data.pop("metric"), []),
        (lambda data: data.update(colour="red"), []),
        (lambda data: data.update(format="gtlayout-layout/1"), ["format"]),
        (lambda data: data["instances"][0]["plane"]["normal"].pop(), ["instances", 0, "plane", "normal"]),
        (lambda data: data["instances"][1].update(label="roof"), ["instances", 1, "label"]),
        (lambda data: data["instances"][1].update(host=0), ["instances", 1, "host"]),
        (lambda data: data["instances"][2]["plane"]["support"].update(tracks=0.5), None),
        (lambda data: data["instances"][2]["extent"]["polygons"][0][0][0].pop(), None),
        (lambda data: data["mesh"]["faces"][0].append(0), ["mesh", "faces", 0]),
        (lambda data: data["mesh"]["vertices"][0].__setitem__(0, None), ["mesh", "vertices", 0, 0]),
    ],
)
def test_what_is_wrong_is_not(
    spoil: Callable[[Any], object], where: list[object] | None, written: Any, validator: Draft202012Validator
) -> None:
    spoil(written)
    (error,) = validator.iter_errors(written)
    assert where is None or list(error.absolute_path) == where


@dataclass
class Part:
    """Some part."""

    share: float = np.nan
    """NaN when unknown."""
    count: int = 0


class Whole(TypedDict):
    """Made of
    parts.
    """

    kind: Literal["a", "b"]
    parts: list[Part]
    matrix: Annotated[float, Shape((None, 2))]
    """Rows."""
    length: Annotated[float, OrNull()]


def test_schema_of_a_class() -> None:
    part = {
        "description": "Some part.",
        "type": "object",
        "properties": {
            "share": {"description": "null when unknown.", "type": ["number", "null"]},
            "count": {"type": "integer"},
        },
        "required": ["share", "count"],
        "additionalProperties": False,
    }
    pair = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
    assert schema_of(Whole) == {
        "description": "Made of parts.",
        "type": "object",
        "properties": {
            "kind": {"enum": ["a", "b"]},
            "parts": {"type": "array", "items": part},
            "matrix": {"description": "Rows.", "type": "array", "items": pair},
            "length": {"type": ["number", "null"]},
        },
        "required": ["kind", "parts", "matrix", "length"],
        "additionalProperties": False,
    }
    with pytest.raises(TypeError, match="no JSON schema for"):
        schema_of(complex)
