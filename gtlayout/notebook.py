"""How notebooks show the plain data: a line, and a table below it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def html_table(line: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """The HTML of a line of text and a table; whatever it says is text, never markup."""
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    return f"<p>{escape(line)}</p><table><tr>{head}</tr>{body}</table>"
