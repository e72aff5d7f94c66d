"""Pages of reference, written from the code itself."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import is_dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest.mock import patch

import griffe

import gtlayout
from gtlayout.cli.app import app
from gtlayout.config import Config
from gtlayout.export import EXPORTERS

SCHEMA = Path(__file__).parent / "layout.schema.json"


def cli() -> str:
    """Every command of the command line, as its own help has it."""
    # cyclopts puts the program that runs, which is mkdocs, into the usage.
    with patch.object(sys, "argv", ["gtlayout"]):
        text = str(app.generate_docs(output_format="markdown"))
    # Without its heading and contents: the page has both.
    return text[text.index("## gtlayout ") :].strip()


def configuration() -> str:
    """``Config`` and every configuration in it: a heading with its path in ``Config``, and its fields as a table."""
    parts = []
    for path, kind in [("Config", Config), *_paths(Config(), "Config")]:
        name = kind.__name__
        described = _parsed(kind.__module__).classes[name]
        rows = [
            f"| `{field.name}` | `{field.value}` | {_cell(_doc(field))} |"
            for field in described.attributes.values()
            if not str(field.value).startswith("field(")  # a configuration within: it has a heading of its own
        ]
        parts.append(
            f"## {path}\n\n`{name}`. {_doc(described)}\n\n| setting | default | |\n|---|---|---|\n" + "\n".join(rows)
        )
    return "\n\n".join(parts)


def exports() -> str:
    """Every format that layouts are exported to, as a table."""
    rows = []
    for name, each in EXPORTERS.items():
        about, _, _ = _doc(_parsed(each.module)).partition("\n")
        needs = f"`pip install 'gtlayout[{each.needs}]'`" if each.needs else ""
        rows.append(f"| `{name}` | `{each.file_name}` | {_cell(about)} | {needs} |")
    return "\n".join(["| `--to` | writes | | needs |", "|---|---|---|---|", *rows])


def names() -> str:
    """What ``gtlayout`` offers by itself, in a line."""
    return ", ".join(f"`{name}`" for name in gtlayout.__all__) + "."


def schema() -> str:
    """Every key of layout.json: a table of the outermost ones, then one of each thing that has keys of its own."""
    data = json.loads(SCHEMA.read_text(encoding="utf-8"))
    parts = [_table((name, node) for name, node in data["properties"].items() if not _items(node))]
    for name, node in data["properties"].items():
        if inner := _items(node):
            about = inner.get("description", "") if node.get("type") == "array" else node.get("description", "")
            many = "[]" if node.get("type") == "array" else ""
            parts.append(f"## {name}{many}\n\n{about}\n\n{_table(_keys(inner, ''))}")
    return "\n\n".join(parts)


def _paths(value: Any, prefix: str) -> Iterator[tuple[str, type]]:
    """(dotted path, class) of each configuration within another."""
    for name, inner in vars(value).items():
        if is_dataclass(inner):
            yield f"{prefix}.{name}", type(inner)
            yield from _paths(inner, f"{prefix}.{name}")


def _parsed(module: str) -> griffe.Module:
    """The module as text: what it imports may not be installed."""
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    return griffe.visit(module, Path(spec.origin), Path(spec.origin).read_text(encoding="utf-8"))


def _doc(described: griffe.Object) -> str:
    return described.docstring.value if described.docstring else ""


def _cell(text: str) -> str:
    """On one line, and without ends of columns."""
    return " ".join(text.split()).replace("|", "\\|")


def _items(node: dict[str, Any]) -> dict[str, Any] | None:
    """Of an object, or of a list of objects, the one that has the keys."""
    inner = node.get("items", node)
    return inner if "properties" in inner else None


def _keys(node: dict[str, Any], prefix: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """(dotted path, what is said of it) of each key within."""
    for name, value in node["properties"].items():
        many = "[]" if value.get("type") == "array" else ""
        if inner := _items(value):
            yield from _keys(inner, f"{prefix}{name}{many}.")
        else:
            yield f"{prefix}{name}", value


def _table(rows: Iterable[tuple[str, dict[str, Any]]]) -> str:
    lines = [f"| `{path}` | `{_type(node)}` | {_cell(node.get('description', ''))} |" for path, node in rows]
    return "\n".join(["| key | type | |", "|---|---|---|", *lines])


def _type(node: dict[str, Any]) -> str:
    """In short: ``number or null``, ``number[4][4]``, ``"ok" or "weak"``."""
    if "const" in node or "enum" in node:
        return " or ".join(json.dumps(value) for value in node.get("enum", [node.get("const")]))
    if "anyOf" in node:
        return " or ".join(_type(each) for each in node["anyOf"])
    if node["type"] == "array":
        inner = _type(node["items"])
        length = node["minItems"] if node.get("minItems") == node.get("maxItems", object()) else ""
        return f"({inner})[{length}]" if " " in inner and "[" not in inner else f"{inner}[{length}]"
    return node["type"] if isinstance(node["type"], str) else " or ".join(node["type"])
