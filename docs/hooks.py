"""What the site takes from the code and the repository when it is built, so that it cannot go stale.

A page asks for it by a line of its own:

* ``<!-- cli -->``: every command with its options;
* ``<!-- configuration -->``: every setting with its default;
* ``<!-- exports -->``: every format that layouts are exported to;
* ``<!-- names -->``: what ``gtlayout`` offers to Python by itself;
* ``<!-- schema -->``: every key of layout.json;
* ``<!-- CHANGELOG.md -->``: a file whole.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the gtlayout of this checkout, whatever is installed

from formulas import MathExtension, fenced_math  # noqa: E402
from generated import SCHEMA, cli, configuration, exports, names, schema  # noqa: E402

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

_INSERT = re.compile(r"^<!-- (?:(\w+)|([A-Z]+\.md)) -->$", re.MULTILINE)
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!\w+://|#)([^)]+)\)")
"""A link to a file of the repository."""
_IMAGE = re.compile(r"^!\[[^\]]*\]\([^)]*\)\n", re.MULTILINE)
_FOLDER = "docs/pages/"
_PAGES = {"CHANGELOG.md": "changelog.md"}
"""Files of the repository that are pages of the site, as are those in docs/pages; others are only named there."""
_GENERATORS: dict[str, Callable[[], str]] = {
    each.__name__: each for each in (cli, configuration, exports, names, schema)
}


def on_config(config: MkDocsConfig) -> None:
    """Equations become MathML when the site is built: nothing has to be loaded to show them."""
    extensions: list[object] = config.markdown_extensions  # type: ignore[assignment]
    extensions.append(MathExtension())
    config.mdx_configs["pymdownx.superfences"] = {
        "custom_fences": [{"name": "math", "class": "math", "format": fenced_math}]
    }


def on_files(files: Files, config: MkDocsConfig) -> None:
    """The schema of layout.json is a file of the site, beside the page about it."""
    files.append(File.generated(config, f"reference/{SCHEMA.name}", abs_src_path=str(SCHEMA)))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put in what a page asks for."""
    depth = page.file.src_uri.count("/")
    return _INSERT.sub(lambda match: _inserted(match, "../" * depth), markdown)


def _inserted(match: re.Match[str], to_root: str) -> str:
    generator, file = match.groups()
    if generator:
        return _GENERATORS[generator]()
    return repository_text((ROOT / file).read_text(encoding="utf-8").partition("\n")[2], to_root)


def repository_text(text: str, to_root: str) -> str:
    """Markdown of the repository for a page: links to files that are no pages become their names, images go.

    ``to_root``: the way from the page to the site's first page, ``../`` for each folder.
    """

    def link(match: re.Match[str]) -> str:
        path, mark, anchor = match[2].partition("#")
        page = _PAGES.get(path, path.removeprefix(_FOLDER) if path.startswith(_FOLDER) else None)
        return f"[{match[1]}]({to_root}{page}{mark}{anchor})" if page else f"`{match[2]}`"

    return _LINK.sub(link, _IMAGE.sub("", text))
