"""TeX in Markdown → MathML, in the two forms that GitHub shows as well: a fence ``math`` and ``$`x`$`` in a line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor

_BEFORE_CODE = 195
"""Priority: Markdown's own pattern for `code` has 190."""


class MathExtension(Extension):  # type: ignore[misc]
    """``$`x`$`` in a line of text."""

    def extendMarkdown(self, md: Markdown) -> None:
        """See ``markdown.Extension``."""
        md.inlinePatterns.register(_InlineMath(r"\$`([^`]+)`\$", md), "math", _BEFORE_CODE)


class _InlineMath(InlineProcessor):  # type: ignore[misc]
    def handleMatch(self, m: Any, data: str) -> tuple[Element | str, int, int]:
        assert self.md is not None
        return self.md.htmlStash.store(convert(m[1])), m.start(0), m.end(0)


def fenced_math(source: str, language: str, css_class: str, options: Mapping[str, Any], md: Markdown, **_: Any) -> str:
    """A fence ``math`` for pymdownx.superfences: one equation on lines of its own."""
    return f'<div class="{css_class}">{convert(" ".join(source.split()), display="block")}</div>'
