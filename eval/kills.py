"""Kills at random moments: is every file old or new and whole, does the next run work, does anything stay for ever?"""

from __future__ import annotations

import random
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from common.command_line import exit_status, new_app
from common.metrics import Metric, write_tables
from gtlayout.annotate.entries import digest
from gtlayout.annotate.store import Store
from gtlayout.cli.app import main as gtlayout
from gtlayout.errors import GtlayoutError
from gtlayout.io.files import read_json, write_json_atomic
from gtlayout.io.scene_folder import load_scene
from gtlayout.results.names import FOLDER, TIMINGS_FILE
from gtlayout.synth import SynthConfig, synthesize
from simulated.kill_bench import Bench, Command, Found, alone

ROOM = SynthConfig(frames=12, width=160, height=120, oversample=1)

Positive = Annotated[int, Parameter(validator=Number(gte=1))]
app = new_app("kills", __doc__)


@app.default
def measure(*, out: Path, count: Positive = 100, seed: int = 0, command: Sequence[str] = ()) -> int:
    """Kill solve, import, export, report and the saving of a drawing, with SIGKILL and with SIGTERM.

    Half of the kills come at any moment, half after the command has begun to write. After every tenth the next run goes
    on to its end. Then two write into one folder at once, a tenth as often. Exit status 1 when a file was not whole,
    files of two runs were mixed, the next run did not work, or something was left after it.

    Parameters
    ----------
    out
        A new folder: rooms and tables.
    count
        Kills of each command by each signal.
    seed
        Of the moments.
    command
        Only these.
    """
    if out.exists():
        raise GtlayoutError(f"{out} exists: name a new folder")
    commands = commands_on(out / "room")
    if unknown := set(command) - set(commands):
        raise GtlayoutError(f"no such command: {', '.join(sorted(unknown))}; known are {', '.join(commands)}")
    alone(lambda: prepare(out / "room"), out / "prepare.log")
    rng = random.Random(seed)
    rows, wrong = {}, []
    for name in command or commands:
        bench = Bench(commands[name], out / name, rng)
        found = {f"{name}, {number.name}": bench.kill(count, number) for number in (signal.SIGKILL, signal.SIGTERM)}
        found[f"{name}, two at once"] = bench.pairs(max(1, count // 10))
        for label, seen in found.items():
            rows[label] = figures(seen)
            wrong += [f"{label}: {line}" for line in seen.wrong]
            print(label, *(f"{one.key} {one.value:g}" for one in rows[label]), sep=", ", file=sys.stderr)
    write_tables(out, "kills", rows, "what was killed")
    print((out / "kills.md").read_text(encoding="utf-8"))
    for line in wrong:
        print(line, file=sys.stderr)
    print(f"Results: {out}")
    return 1 if wrong else 0


def figures(found: Found) -> list[Metric]:
    """A row of the table."""
    return [
        Metric("runs", found.runs, "", None),
        Metric("writing", found.writing, "", None),
        Metric("new", found.new, "", None),
        Metric("incomplete", found.incomplete, "", None),
        Metric("remains", found.remains, "", None),
        Metric("wrong", len(found.wrong), "", False),
    ]


def prepare(room: Path) -> int:
    """A small room, solved in two ways; the exit status of gtlayout."""
    synthesize(room, ROOM)
    return max(solve(room, variant, to) for variant, to in solved(room).items())


def solved(room: Path) -> dict[str, Path]:
    """Variant → folder of its results."""
    return {"a": room / FOLDER, "b": room.parent / "solved-b"}


def solve(room: Path, variant: str, to: Path) -> int:
    """One closes the room, the other does not: all that is written of them differs."""
    return gtlayout(["solve", str(room), "--out", str(to), *{"a": [], "b": ["--close"]}[variant]])


def commands_on(room: Path) -> dict[str, Command]:
    """What is killed."""

    def export(variant: str, to: Path) -> int:
        layout = str(solved(room)[variant])
        return gtlayout(["export", str(room), "--to", "obj", "--layout", layout, "--out", str(to / "work.obj")])

    def report(variant: str, to: Path) -> int:
        layout = str(solved(room)[variant])
        return gtlayout(["report", str(room), "--layout", layout, "--out", str(to / "report.html")])

    def import_(_variant: str, to: Path) -> int:
        return gtlayout(["import", str(room), str(to / "room")])

    return {
        "solve": Command(lambda variant, to: solve(room, variant, to), frozenset({TIMINGS_FILE}), "layout.json"),
        "import": Command(import_, anew=True),
        "export": Command(export, last="work.obj"),
        "report": Command(report),
        "annotate's save": Command(lambda variant, to: save(room, variant, to)),
    }


def save(room: Path, variant: str, to: Path) -> int:
    """As the page does it: one frame of the room is drawn anew, with all its elements or all but the last."""
    path = to / "annotations.json"
    drawn = read_json(room / path.name)
    if not path.exists():
        write_json_atomic(path, drawn)
    frames = load_scene(room).frames
    entry = dict(drawn["frames"][0])
    entry["elements"] = entry["elements"][: None if variant == "a" else -1]
    number = next(number for number, frame in enumerate(frames) if frame.name == entry["image"])
    store = Store(to, frames)
    store.save(number, entry, digest(store.read().entry(number)))
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return exit_status(app, arguments)


if __name__ == "__main__":
    sys.exit(main())
