"""JSON Schema (draft 2020-12) of the types that are written as JSON: typed dictionaries, dataclasses and their parts.

What ``gtlayout.io.files.json_text`` makes of a value is what counts: arrays are lists, NaN is null.
"""

from __future__ import annotations

import ast
import inspect
import math
import types
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from textwrap import dedent
from typing import Annotated, Any, Literal, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict

Schema = dict[str, Any]

_SCALARS: dict[Any, Schema] = {
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": "number"},
    str: {"type": "string"},
}


@dataclass(frozen=True)
class OrNull:
    """Marks a number that is null where it is not known."""


@dataclass(frozen=True)
class Shape:
    """What an array looks like in JSON."""

    lengths: tuple[int | None, ...]
    """Along each axis; None = any."""
    item: Schema | None = None
    """Of a single entry; a number when not given."""


def schema_of(kind: Any) -> Schema:
    """The schema of values of a type.

    Raises:
        TypeError: no rule for such a type.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _marked(*arguments)
    if kind in _SCALARS:
        return dict(_SCALARS[kind])
    if origin is Literal:
        return {"const": arguments[0]} if len(arguments) == 1 else {"enum": list(arguments)}
    if origin in (Union, types.UnionType):
        return {"anyOf": [{"type": "null"} if each is type(None) else schema_of(each) for each in arguments]}
    if origin in (list, Sequence):
        return {"type": "array", "items": schema_of(arguments[0])}
    if is_typeddict(kind) or is_dataclass(kind):
        return _object(kind)
    raise TypeError(f"no JSON schema for {kind}")


def _marked(kind: Any, mark: Any) -> Schema:
    if isinstance(mark, OrNull):
        return {"type": [schema_of(kind)["type"], "null"]}
    if isinstance(mark, Shape):
        schema = mark.item or schema_of(float)
        for length in reversed(mark.lengths):
            schema = {"type": "array", "items": schema}
            if length is not None:
                schema |= {"minItems": length, "maxItems": length}
        return schema
    return schema_of(mark)  # a dictionary made from a dataclass


def _object(kind: Any) -> Schema:
    descriptions = _field_docstrings(kind)
    # A dataclass says by its default that a number may be unknown.
    unknown = {each.name for each in fields(kind) if _is_nan(each.default)} if is_dataclass(kind) else set()
    properties, required = {}, []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if get_origin(hint) is NotRequired:
            (hint,) = get_args(hint)  # noqa: PLW2901
        else:
            required.append(name)
        schema = _marked(hint, OrNull()) if name in unknown else schema_of(hint)
        properties[name] = ({"description": descriptions[name]} if name in descriptions else {}) | schema
    return {
        "description": inspect.cleandoc(kind.__doc__).replace("\n", " "),
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _field_docstrings(kind: type) -> dict[str, str]:
    """The text under each field of a class; Python itself does not keep it."""
    body = ast.parse(dedent(inspect.getsource(kind))).body[0]
    assert isinstance(body, ast.ClassDef)
    found = {}
    for before, node in zip(body.body, body.body[1:], strict=False):
        match before, node:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                found[name] = inspect.cleandoc(text).replace("\n", " ").replace("NaN", "null")
    return found
