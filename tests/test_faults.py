"""The fault table: scenes, results and places broken in every way, and what the user then sees of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from faulty.case import Case, Room
from faulty.folders import make_room
from faulty.run import CannotRunError, judge
from faulty.table import ALL, page

PAGES = Path(__file__).parents[1] / "docs/pages"
Rooms = Callable[[Room], Path]


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Rooms:
    @cache
    def room(kind: Room) -> Path:
        return make_room(kind, tmp_path_factory.mktemp("faults") / kind)

    return room


@pytest.mark.parametrize("case", [case for case in ALL if not case.slow], ids=lambda case: case.name)
def test_what_is_promised_holds(case: Case, rooms: Rooms, tmp_path: Path) -> None:
    try:
        judged = judge(case, rooms(case.room), tmp_path / "here")
    except CannotRunError as error:
        pytest.skip(str(error))
    assert not judged.broken, judged.seen


def test_the_page_is_made_of_the_cases() -> None:
    """``python eval/faults.py --page`` writes it."""
    assert (PAGES / "faults.md").read_text(encoding="utf-8") == page()


def test_every_case_has_its_own_name_and_says_something() -> None:
    assert [name for name, n in Counter(case.name for case in ALL).items() if n > 1] == []
    assert [case.name for case in ALL if not all(case.says) or not case.says] == []
