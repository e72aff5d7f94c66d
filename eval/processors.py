"""Run a command as if on an older processor, as far as the libraries let one choose what they use of it.

    python processors.py avx2|sse COMMAND [ARGUMENT ...]

``avx2``: without AVX-512, as most processors since 2013. ``sse``: without AVX, AVX2 and FMA, as those before 2011.
Where this processor has nothing to leave out, a line says so and nothing is run.

NumPy, OpenBLAS, OpenCV and the C library choose their code when they are loaded, and are told by environment variables
what not to use; GTSAM and GEOS have one code for all. Left alone are what reads images and videos, and COLMAP.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import numpy as np

LIBRARIES = ("numpy", "openblas", "opencv", "libc")
KINDS = ("avx2", "sse")
"""Of processors, each older than the one before."""
_LATER = {"avx2": ("X86_V4", "AVX512"), "sse": ("X86_V4", "AVX512", "X86_V3", "AVX", "F16C", "FMA", "XOP")}
"""How NumPy's names of the features begin that the kind lacks."""
_OTHERS = {
    "avx2": {"openblas": "Haswell", "opencv": "AVX512-SKX", "ipp": "avx2", "libc": "-AVX512F"},
    "sse": {
        "openblas": "Nehalem",
        "opencv": "AVX512-SKX,AVX2,FMA3,AVX,FP16",
        "ipp": "sse42",
        "libc": "-AVX512F,-AVX2,-AVX2_Usable,-AVX,-FMA,-FMA_Usable",
    },
}
"""What the other libraries call them; the C library has a name of its own for each version."""


def later_features(kind: str) -> list[str]:
    """NumPy's names of what this processor has and ``kind`` lacks; empty where that is nothing, or it is no x86-64."""
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    return [name for name in found if name.startswith(_LATER[kind])]


def imitation(kind: str, libraries: Sequence[str] = LIBRARIES) -> dict[str, str] | None:
    """The environment variables under which ``libraries`` run as on a processor of ``kind``.

    They hold for processes started with them, not for this one. None where this processor has no more than that kind.
    """
    later = later_features(kind)
    if not later:
        return None
    others = _OTHERS[kind]
    variables = {
        "numpy": {"NPY_DISABLE_CPU_FEATURES": " ".join(later)},
        "openblas": {"OPENBLAS_CORETYPE": others["openblas"]},
        "opencv": {"OPENCV_CPU_DISABLE": others["opencv"], "OPENCV_IPP": others["ipp"]},
        "libc": {"GLIBC_TUNABLES": f"glibc.cpu.hwcaps={others['libc']}"},
    }
    return {name: value for library in libraries for name, value in variables[library].items()}


if __name__ == "__main__":
    kind, *command = sys.argv[1:] or [""]
    if kind not in KINDS or not command:
        sys.exit(f"usage: processors.py {'|'.join(KINDS)} COMMAND [ARGUMENT ...]")
    variables = imitation(kind)
    if variables is None:
        print(f"nothing is run as on an older processor ({kind}): this one has nothing to leave out")
        sys.exit()
    print(
        f"as on an older processor ({kind}):", *(f"{name}={value!r}" for name, value in variables.items()), flush=True
    )
    os.execvpe(command[0], command, os.environ | variables)
