"""What is fuzzed, without the fuzzer: seeds are read, what once broke a reader no longer does, and faults are found."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

FUZZ = Path(__file__).parent / "fuzz"
sys.path.insert(0, str(FUZZ))

from fuzz_harnesses import HARNESSES, Harness, Readable, harness, known  # noqa: E402

from gtlayout.errors import GtlayoutError  # noqa: E402

MUTATED = 40
"""Inputs a harness: enough that a mutation or a reader that always fails is seen."""
STILL_READ = ("pincam-centre-at-the-corner",)
"""Of the known inputs; the others are refused."""


def changed(content: bytes, rng: random.Random) -> bytes:
    """A little of what libFuzzer does."""
    if not content:
        return b"\xff"
    at = rng.randrange(len(content))
    return content[:at] + rng.choice((b"", b"\xff", b"\0\0\0\0", content[at : at + 8])) + content[at + 1 :]


@pytest.fixture(scope="module", params=HARNESSES)
def fuzzed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Harness]:
    return request.param, harness(request.param, tmp_path_factory.mktemp(request.param))


def test_what_is_right_is_read(fuzzed: tuple[str, Harness]) -> None:
    _, readers = fuzzed
    assert [readers.file(seed).path.name for seed in readers.seeds if not readers.run(seed)] == []


def test_what_once_broke_a_reader(fuzzed: tuple[str, Harness]) -> None:
    name, readers = fuzzed
    for what, content in known(name).items():
        assert readers.run(content) == (what in STILL_READ), what


def test_mutations(fuzzed: tuple[str, Harness]) -> None:
    """They leave forms whole: some of what they make is read, some is refused."""
    _, readers = fuzzed
    rng = random.Random(0)
    outcomes = set()
    for _ in range(MUTATED):
        seed = rng.choice(readers.seeds)
        mutation = readers.file(seed).mutation
        change = partial(changed, rng=rng)
        outcomes.add(readers.run(seed[:1] + (mutation(seed[1:], rng, change) if mutation else change(seed[1:]))))
    assert outcomes == {True, False}


def _raise(error: Exception) -> None:
    raise error


@pytest.mark.parametrize(
    ("use", "error"),
    [
        (lambda: _raise(KeyError("x")), KeyError),
        (lambda: os.write(2, b"libpng error: x\n"), AssertionError),
        (lambda: __import__("numpy").float64(1e308) * 10, RuntimeWarning),
    ],
)
def test_what_a_harness_takes_for_a_fault(use: object, error: type[Exception], tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("{}")
    assert callable(use)
    with pytest.raises(error):
        Harness([Readable(path, use)]).run(b"\0{}")
    assert not Harness([Readable(path, lambda: _raise(GtlayoutError("no")))]).run(b"\0{}")


def test_a_fault_ends_the_run_and_is_printed(tmp_path: Path) -> None:
    """For real: a reader of measurements that trusts them."""
    pytest.importorskip("atheris", reason="there are no wheels of atheris for this machine")
    (tmp_path / "sitecustomize.py").write_text(
        "import json, gtlayout.io.measurements as m\n"
        "m.read_measurements = lambda path, frames: [one['metres'] for one in json.loads(path.read_bytes())]\n"
    )
    paths = [str(tmp_path), str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    ended = subprocess.run(
        [sys.executable, str(FUZZ / "fuzz_all.py"), "20", "small-json"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 1
    assert "small-json: ended with status 77" in ended.stdout
    assert "base64 -d > tests/fuzz/known/small-json/" in ended.stdout
