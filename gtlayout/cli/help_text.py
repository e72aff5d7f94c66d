"""What commands that are loaded late say of themselves, without loading them."""

from __future__ import annotations

import ast
from pathlib import Path


def help_text(module: str) -> str:
    """Of the function called like its module in this package: its docstring up to the parameters.

    The file is read, not imported: what it imports takes up to a second, which ``gtlayout --help`` must not wait for.
    """
    source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    functions = (node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef) and node.name == module)
    return (ast.get_docstring(next(functions)) or "").partition("\n\nParameters\n")[0]
