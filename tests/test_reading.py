"""The script that times reading, run on small files: what it reads is what it wrote."""

from __future__ import annotations

from pathlib import Path

import reading
from common.metrics import read_rows


def test_small_files_and_a_short_video(tmp_path: Path) -> None:
    arguments = ["--out", str(tmp_path), "--images", "5", "--video-frames", "40", "--shrink", "6"]
    assert reading.main(arguments) == 0
    rows = read_rows(tmp_path / "annotations.json")
    assert list(rows) == list(reading.FORMATS)
    for row in rows.values():
        values = {metric.key: metric.value for metric in row}
        assert (values["images"], values["elements"]) == (5, 50)
        assert min(values["read"], values["key_frames"], values["size"]) > 0
    ((name, row),) = read_rows(tmp_path / "video.json").items()
    assert name == "40 frames"
    values = {metric.key: metric.value for metric in row}
    assert (values["width"], values["height"]) == (320, 180)
    assert values["key_frames"] >= 3
    assert 50 < values["peak_memory"] < 1500
