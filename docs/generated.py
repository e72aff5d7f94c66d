"""Pages of reference, written from the code itself."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import griffe

from gtlayout.cli import app
from gtlayout.config import Config


def cli() -> str:
    """Every command of the command line, as its own help has it."""
    # cyclopts puts the program that runs, which is mkdocs, into the usage.
    with patch.object(sys, "argv", ["gtlayout"]):
        text = str(app.generate_docs(output_format="markdown"))
    # Without its heading and contents: the page has both.
    return text[text.index("## gtlayout ") :].strip()


def configuration() -> str:
    """Every dataclass of gtlayout/config.py: a heading with its path in ``Config``, and its fields as a table."""
    module = griffe.load(Config.__module__, search_paths=[str(Path(__file__).parents[1])])
    parts = []
    for path, name in [("Config", Config.__name__), *_paths(Config(), "Config")]:
        described = module.classes[name]
        rows = [
            f"| `{field.name}` | `{field.value}` | {_cell(_doc(field))} |"
            for field in described.attributes.values()
            if not str(field.value).startswith("field(")  # a configuration within: it has a heading of its own
        ]
        parts.append(
            f"## {path}\n\n`{name}`. {_doc(described)}\n\n| setting | default | |\n|---|---|---|\n" + "\n".join(rows)
        )
    return "\n\n".join(parts)


def schema(file: Path) -> str:
    """Every key that a JSON schema describes, as a table; nothing while there is no such file."""
    if not file.exists():
        return ""
    data = json.loads(file.read_text(encoding="utf-8"))
    rows = [
        f"| `{path}` | {_type(node)} | {_cell(node.get('description', ''))} |" for path, node in _keys(data, data, "")
    ]
    return "\n".join(["## Schema", "", "| key | type | |", "|---|---|---|", *rows])


def _paths(value: Any, prefix: str) -> Iterator[tuple[str, str]]:
    """(dotted path, name of its class) of each configuration within another."""
    for name, inner in vars(value).items():
        if type(inner).__module__ == Config.__module__:
            yield f"{prefix}.{name}", type(inner).__name__
            yield from _paths(inner, f"{prefix}.{name}")


def _doc(described: griffe.Object) -> str:
    return described.docstring.value if described.docstring else ""


def _cell(text: str) -> str:
    """On one line, and without ends of columns."""
    return " ".join(text.split()).replace("|", "\\|")


def _keys(node: dict[str, Any], whole: dict[str, Any], path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, value in _resolved(node, whole).get("properties", {}).items():
        inner, at = _resolved(value, whole), f"{path}{name}"
        yield at, {**inner, **{key: value[key] for key in ("description",) if key in value}}
        while isinstance(inner.get("items"), dict):
            inner, at = _resolved(inner["items"], whole), f"{at}[]"
        yield from _keys(inner, whole, f"{at}.")


def _resolved(node: dict[str, Any], whole: dict[str, Any]) -> dict[str, Any]:
    """The node itself, what its ``$ref`` within the file names, or of several the one that is no null."""
    choices = [each for each in node.get("anyOf", ()) if each.get("type") != "null"]
    if len(choices) == 1:
        return _resolved(choices[0], whole)
    if found := re.fullmatch(r"#/\$defs/(\w+)", node.get("$ref", "")):
        return _resolved(whole["$defs"][found[1]], whole)
    return node


def _type(node: dict[str, Any]) -> str:
    said = node.get("enum") or node.get("type") or ""
    return _cell(" or ".join(map(str, said)) if isinstance(said, list) else str(said))
