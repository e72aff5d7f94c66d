"""Fuzz every harness for so many seconds, two at a time: ``python tests/fuzz/fuzz_all.py [SECONDS] [NAME …]``.

Prints how many inputs each was given. An input that breaks a reader is printed, and the exit status is 1.
"""

from __future__ import annotations

import base64
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fuzz_harnesses import HARNESSES

SECONDS = 60
AT_ONCE = 2
LIMITS = ("-timeout=20", "-rss_limit_mb=3000", "-max_len=16384", "-seed=1")
"""Seconds and MB that one input may take, and its bytes. One seed: the same inputs in the same order."""
GRACE_S = 120.0
ENDINGS = {70: "took too long", 71: "took too much memory"}
"""By libFuzzer's exit status; 77 is an exception."""


def fuzz(name: str, seconds: int) -> tuple[str, bool]:
    """What to print of a harness, and whether nothing was found."""
    with tempfile.TemporaryDirectory(prefix=f"fuzz-{name}-") as folder:
        found = Path(folder) / "input"
        options = (f"-max_total_time={seconds}", f"-exact_artifact_path={found}", *LIMITS)
        command = [sys.executable, str(Path(__file__).with_name("fuzz_reader.py")), name, f"{folder}/corpus", *options]
        ended = subprocess.run(
            [*command, "-print_final_stats=1"],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=seconds + GRACE_S,
            check=False,
            env=_environment(folder),
        )
        content = found.read_bytes() if found.exists() else None
    count = re.search(r"number_of_executed_units: (\d+)", ended.stderr)
    line = f"{name}: {int(count[1]) if count else 0:,} inputs"
    if ended.returncode == 0 and count:
        return line, True
    lines = [line, f"{name}: {ENDINGS.get(ended.returncode, f'ended with status {ended.returncode}')}"]
    if content is not None:
        lines += [
            repr(content[:2000]),
            f"echo {base64.b64encode(content).decode()} | base64 -d > tests/fuzz/known/{name}/WHAT",
        ]
    said = [text for text in (ended.stdout + ended.stderr).splitlines() if not re.match(r"#\d|INFO|\s+NEW_FUNC", text)]
    return "\n".join([*lines, *said[-40:]]), False


def _environment(folder: str) -> dict[str, str]:
    return {**os.environ, "TMPDIR": folder, "OMP_NUM_THREADS": "1"}


def main() -> int:
    """The exit status."""
    seconds = int(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    names = sys.argv[2:] or list(HARNESSES)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        fine = True
        for text, good in pool.map(lambda name: fuzz(name, seconds), names):
            print(text, flush=True)
            fine &= good
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
