"""Whatever a CVAT file holds: annotations, or one GtlayoutError of one line that names the file."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.cvat.reader import read_cvat
from gtlayout.io.annotations.key_frames import build_key_frames
from gtlayout.scene import Camera, Frame

GOOD = """<?xml version="1.0" encoding="utf-8"?>
<annotations>
  <version>1.1</version>
  <meta><task><size>5</size><start_frame>0</start_frame><frame_filter>step=2</frame_filter>
    <original_size><width>64</width><height>48</height></original_size></task></meta>
  <image id="0" name="001.png" width="64" height="48">
    <polygon label="wall" points="0.00,0.00;60.00,0.00;60.00,40.00" z_order="2" group_id="1">
      <attribute name="id">a</attribute>
    </polygon>
    <box label="door" xtl="1.00" ytl="2.00" xbr="20.00" ybr="30.00" rotation="10.00"/>
    <mask label="visible" rle="5, 2, 2, 2, 5" left="3" top="4" width="4" height="4"/>
    <polyline label="occlusion_edge" points="0.00,0.00;60.00,40.00"/>
  </image>
  <track id="1" label="floor" group_id="2">
    <polygon frame="2" keyframe="1" outside="0" points="0.00,0.00;60.00,0.00;60.00,40.00" z_order="0"/>
  </track>
</annotations>
"""
FRAMES = [
    Frame(name, Path(name), Camera(np.eye(3), np.eye(3), np.zeros(3), 64, 48))
    for name in ("001.png", "frame_000002.png")
]
VALUES = (
    "",
    "-1",
    "0",
    "1e400",
    "nan",
    "1e18",
    "999999",
    "99999999999999999999",
    "9" * 5000,
    "1,2;3",
    ";;;",
    ",",
    "x\x85y",
)
PLACES = [match.span() for match in re.finditer(r'(?<=[a-z]=")[^"]*|(?<=>)[^<>\s]+(?=<)', GOOD)]
"""Every value of an attribute and every text."""
SETTINGS = settings(derandomize=True, deadline=None, max_examples=150)


def _survives(content: bytes) -> str | None:
    """What the one error says; None without one."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "annotations.xml"
        path.write_bytes(content)
        try:
            raw = read_cvat(path.parent, path)
        except GtlayoutError as error:
            assert str(path) in str(error)
            assert len(str(error).splitlines()) == 1
            return str(error)
        assert all(len(line.splitlines()) == 1 for line in raw.warnings)
        try:
            build_key_frames(raw, FRAMES, (), {})
        except GtlayoutError as error:
            assert len(str(error).splitlines()) == 1
            return str(error)
        return None


def test_the_file_to_be_spoilt_is_good() -> None:
    assert _survives(GOOD.encode()) is None


@SETTINGS
@given(st.integers(0, len(GOOD.encode()) - 1))
def test_truncated(length: int) -> None:
    if length < len(GOOD.rstrip()):
        assert "not valid XML" in str(_survives(GOOD.encode()[:length]))


@SETTINGS
@given(st.binary(max_size=200), st.integers(0, len(GOOD)), st.booleans())
def test_random_bytes(content: bytes, at: int, alone: bool) -> None:
    _survives(content if alone else GOOD.encode()[:at] + content + GOOD.encode()[at:])


@SETTINGS
@given(st.data())
def test_wrong_values(data: st.DataObject) -> None:
    text = GOOD
    for start, end in sorted(data.draw(st.sets(st.sampled_from(PLACES), min_size=1, max_size=3)), reverse=True):
        text = text[:start] + data.draw(st.sampled_from(VALUES)) + text[end:]
    _survives(text.encode())


@pytest.mark.parametrize(
    "declared",
    [
        "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10 if i else "lol"}">' for i in range(10)),
        '<!ENTITY l9 SYSTEM "file:///etc/hostname">',
        '<!ENTITY % d SYSTEM "http://127.0.0.1:9/evil.dtd"> %d;',
        '<!ENTITY l9 "wall">',
    ],
)
def test_entities_are_never_expanded(declared: str) -> None:
    bomb = f"<!DOCTYPE annotations [{declared}]>{GOOD[GOOD.index('<annotations>') :].replace('wall', '&l9;')}"
    assert "declares a document type or entities" in str(_survives(bomb.encode()))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_other_encodings(encoding: str) -> None:
    assert _survives(GOOD.replace('encoding="utf-8"', "").encode(encoding)) is None


def test_deep_and_wide_files() -> None:
    depth = 100_000
    assert _survives(GOOD.replace("</version>", "</version>" + "<a>" * depth + "</a>" * depth).encode()) is None
    wide = "".join(f"<kind{i}/>" for i in range(2000))
    assert _survives(GOOD.replace("<polyline", wide + "<polyline").encode()) is None


def test_names_that_break_lines() -> None:
    evil = (
        GOOD.replace("001.png", "&#10;&#x2028;../../etc/passwd")
        .replace("wall", "a&#13;b")
        .replace(">a<", ">&#10;\n c<")
    )
    _survives(evil.encode())


def test_a_folder_and_nothing(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "absent.xml"):
        with pytest.raises(GtlayoutError, match="cannot read"):
            read_cvat(tmp_path, path)
