"""All cases, and the page of the documentation that is made of them."""

from __future__ import annotations

from itertools import groupby

from faulty import cameras, drawings, geometry, images, places, results, side_files
from faulty.case import HERE, SCENE, Case

ALL: tuple[Case, ...] = tuple(
    case for part in (cameras, images, drawings, side_files, geometry, results, places) for case in part.CASES
)
_BEGINNING = """# Faults

What may be wrong with a scene, with its results or with the place they go to, and what you then see. This page is
made from the list of cases that the tests run (`eval/faulty`, written by `python eval/faults.py --page`), so each line
of it was seen. In all of them:

- what is wrong is said without a Python traceback, and the exit status is the one in the table: 0 done, 1 not done,
  3 something suspicious, 130 interrupted;
- where it is 1, standard error has one line that begins with `gtlayout:`, and nothing is written: no file, no folder,
  no temporary file;
- where it is 0, results are whole and can be read;
- what was in the scene's folder is there as it was, byte for byte.

The words in the last column stand in the message, in this order; `…` is what differs from scene to scene. What to do
about a message is in [troubleshooting](troubleshooting.md).
"""
_HEADER = "| fault | what is wrong | command | exit | you see |\n|---|---|---|---|---|\n"


def page() -> str:
    """The page, Markdown."""
    parts = []
    for part, found in groupby(sorted(ALL, key=lambda case: _PARTS.index(case.part)), key=lambda case: case.part):
        parts.append(f"\n## {part}\n\n{_HEADER}{''.join(map(_row, found))}")
    return _BEGINNING + "".join(parts)


def _row(case: Case) -> str:
    command = " ".join(case.command).replace(f"{SCENE}/", "").replace(f"{HERE}/", "").replace(SCENE, "DIR")
    says = " … ".join(f"*{words}*" for words in case.says)
    return (
        f"| {case.fault} | {case.what} | `{command.replace(HERE, '.')}` | {case.status} | {says.replace('|', '/')} |\n"
    )


_PARTS = list(dict.fromkeys(case.part for case in ALL))
