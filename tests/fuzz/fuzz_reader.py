"""Fuzz one harness with atheris: ``python tests/fuzz/fuzz_reader.py NAME FOLDER [libFuzzer's options]``.

``FOLDER`` gets the corpus. The run ends with the first input that raises anything but GtlayoutError, takes too long or
too much memory, or has something printed.
"""

from __future__ import annotations

import hashlib
import random
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["gtlayout"], enable_loader_override=False):
    from fuzz_harnesses import harness, known

BY_BYTES = 0.4
"""Share of changes that are libFuzzer's own."""


def main() -> None:
    """Fill the corpus with what is known, and fuzz."""
    name, corpus = sys.argv[1], Path(sys.argv[2])
    corpus.mkdir(parents=True, exist_ok=True)
    fuzzed = harness(name, Path(tempfile.mkdtemp()))
    for content in (*fuzzed.seeds, *known(name).values()):
        (corpus / hashlib.sha1(content).hexdigest()).write_bytes(content)

    def mutated(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        mutation = fuzzed.file(data).mutation
        if mutation is None or rng.random() < BY_BYTES:
            return atheris.Mutate(data, most)
        return (data[:1] + mutation(data[1:], rng, lambda part: atheris.Mutate(part, len(part) + 8)))[:most]

    atheris.Setup(
        [sys.argv[0], *sys.argv[3:], str(corpus)], lambda data: fuzzed.run(data) and None, custom_mutator=mutated
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main()
