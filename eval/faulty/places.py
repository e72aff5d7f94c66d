"""Faults of where results go, and of who runs the program."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from faulty.case import Case, Spoil
from faulty.spoil import all_of, nothing, put

case = partial(Case, "Places")
SOLVE = ("solve", "SCENE", "--out", "HERE/out")
SOLVE_HERE = ("solve", "SCENE")


def everybodys(folder: Path) -> None:
    """Others may read the scene, and write into the folder that it lies in."""
    folder.parent.chmod(0o777)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)


def closed(name: str) -> Spoil:
    """Nobody else may read a file."""
    return lambda folder: (folder / name).chmod(0o600)


def link(name: str, target: str) -> Spoil:
    """A link in the folder that the scene lies in."""
    return lambda folder: (folder.parent / name).symlink_to(target)


CASES = (
    case(
        "disk full",
        "export to a full device",
        nothing,
        1,
        ("cannot write /dev/full: No space left on device",),
        ("export", "SCENE", "--to", "svg", "--out", "/dev/full"),
        "solved",
    ),
    case(
        "disk full",
        "solve, on a disk of 64 kB",
        nothing,
        1,
        ("cannot write", "No space left on device"),
        ("solve", "SCENE", "--out", "HERE/disk/out"),
        "room",
        way="full disk",
        slow=True,
    ),
    case(
        "disk full",
        "report, on a disk of 64 kB",
        nothing,
        1,
        ("cannot write", "No space left on device"),
        ("report", "SCENE", "--out", "HERE/disk/report.html"),
        "solved",
        way="full disk",
    ),
    case(
        "disk full",
        "synth, on a disk of 64 kB",
        nothing,
        1,
        ("cannot write", "No space left on device"),
        ("synth", "HERE/disk/room", "--frames", "24", "--width", "160", "--height", "120"),
        way="full disk",
        slow=True,
    ),
    case(
        "disk full",
        "import, on a disk of 64 kB",
        nothing,
        1,
        ("cannot write", "No space left on device"),
        ("import", "SCENE", "HERE/disk/copy"),
        "room",
        way="full disk",
        slow=True,
    ),
    case(
        "disk full",
        "solve, under a quota of 2 kB a file",
        nothing,
        1,
        ("cannot write", "File too large"),
        SOLVE,
        "room",
        way="small files",
    ),
    case(
        "disk full",
        "export, under a quota of 2 kB a file",
        nothing,
        1,
        ("cannot write", "File too large"),
        ("export", "SCENE", "--to", "pdf", "--out", "HERE/plan.pdf"),
        "solved",
        way="small files",
    ),
    case(
        "disk full",
        "synth, under a quota of 2 kB a file",
        nothing,
        1,
        ("cannot write", "File too large"),
        ("synth", "HERE/new", "--frames", "4", "--width", "320", "--height", "240"),
        way="small files",
        slow=True,
    ),
    case(
        "read-only",
        "the scene's folder",
        everybodys,
        1,
        ("cannot write", "Permission denied"),
        SOLVE_HERE,
        "room",
        way="nobody",
        slow=True,
    ),
    case(
        "another user",
        "solves another's scene into a folder of their own",
        everybodys,
        0,
        ("CHECK",),
        SOLVE,
        "room",
        way="nobody",
        slow=True,
    ),
    case(
        "another user",
        "solves anew where another's results lie",
        everybodys,
        1,
        ("cannot write", "Permission denied"),
        SOLVE_HERE,
        "solved",
        way="nobody",
        slow=True,
    ),
    case(
        "no permission",
        "to read the cameras",
        all_of(everybodys, closed("transforms.json")),
        1,
        ("transforms.json", "Permission denied"),
        ("check", "SCENE"),
        way="nobody",
    ),
    case(
        "no permission",
        "to read the annotations",
        all_of(everybodys, closed("annotations.json")),
        1,
        ("annotations.json", "Permission denied"),
        ("check", "SCENE"),
        way="nobody",
        slow=True,
    ),
    case(
        "no permission",
        "to read an image",
        all_of(everybodys, closed("images/000001.jpg")),
        3,
        ("000001.jpg",),
        ("check", "SCENE"),
        way="nobody",
    ),
    case(
        "no permission",
        "to look into the folder of images",
        all_of(everybodys, closed("images")),
        1,
        ("cannot read", "images", "Permission denied"),
        ("check", "SCENE"),
        way="nobody",
    ),
    case(
        "no permission",
        "to look into the scene",
        all_of(everybodys, closed(".")),
        1,
        ("scene", "Permission denied"),
        ("check", "SCENE"),
        way="nobody",
    ),
    case(
        "no permission",
        "to read the layout",
        all_of(everybodys, closed("gtlayout/layout.json")),
        1,
        ("layout.json", "Permission denied"),
        ("evaluate", "SCENE"),
        "solved",
        way="nobody",
        slow=True,
    ),
    case(
        "missing",
        "the folder that results are to lie in",
        nothing,
        1,
        ("cannot write", "is not there"),
        ("solve", "SCENE", "--out", "HERE/none/out"),
        slow=True,
    ),
    case("missing", "the scene's folder", nothing, 1, ("no scene folder",), ("check", "HERE/none")),
    case(
        "swapped",
        "a file in the place of the results",
        put("gtlayout", "a file"),
        1,
        ("gtlayout", "it is a file, not a folder"),
        SOLVE_HERE,
    ),
    case(
        "swapped",
        "an image for the scene",
        nothing,
        1,
        ("is a file, where a folder is wanted",),
        ("check", "SCENE/images/000000.jpg"),
    ),
    case(
        "swapped",
        "results go through a dangling link",
        link("out", "nowhere/at/all"),
        0,
        ("CHECK",),
        SOLVE,
        "room",
        slow=True,
    ),
    case(
        "swapped",
        "a link that leads to itself",
        link("out", "out"),
        1,
        ("cannot write", "it is a link that leads to itself"),
        SOLVE,
        "room",
    ),
    case(
        "swapped",
        "import into the scene itself",
        nothing,
        1,
        ("exists and is not an empty folder",),
        ("import", "SCENE", "SCENE"),
    ),
    case("two runs", "into one folder at the same time", nothing, 0, ("CHECK",), SOLVE, "room", way="two", slow=True),
    case(
        "two runs",
        "import into one folder at the same time",
        nothing,
        1,
        ("exists and is not an empty folder",),
        ("import", "SCENE", "HERE/out"),
        "room",
        way="two",
        slow=True,
    ),
    case(
        "interrupted",
        "by Ctrl-C",
        nothing,
        130,
        ("gtlayout: interrupted",),
        SOLVE,
        "room",
        way="interrupted",
        slow=True,
    ),
)
