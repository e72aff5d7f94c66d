"""Solve scenes one after the other, as a loop of one's own does, and print the seconds that it took as JSON.

    python plain_loop.py OUT SCENE [SCENE ...]

What is done for a scene is what ``gtlayout batch`` does, in one process of one thread. Imports are not timed.
"""

import json
import sys
import time
from contextlib import suppress
from pathlib import Path

import cv2

import gtlayout
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.evaluate import depth_error
from gtlayout.io.files import write_all_atomic
from gtlayout.report import solved_page, thumbnail

if __name__ == "__main__":
    cv2.setNumThreads(1)
    start = time.perf_counter()
    for number, scene in enumerate(sys.argv[2:]):
        out = Path(sys.argv[1], str(number))
        solution = gtlayout.solve(gtlayout.load(scene))
        gtlayout.save(solution, out)
        picture = thumbnail(solution.scene, solution.layout, solution.quality)
        page = solved_page(solution, "../plotly.min.js")
        write_all_atomic({out / "report.html": page, out / "thumbnail.jpg": picture})
        with suppress(GtlayoutError):
            depth_error(solution.scene, solution.layout)
    print(json.dumps({"seconds": time.perf_counter() - start}))
