"""The files of floor plans: loaded back from DXF, SVG and PDF; the same bytes, and no others, everywhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from box_room import made
from ezdxf.document import Drawing as Document
from ezdxf.entities import Dimension as DxfDimension
from ezdxf.entities import LWPolyline

import gtlayout
from gtlayout.errors import GtlayoutError
from gtlayout.export import export_layout
from gtlayout.export.font_cache import without_font_cache
from gtlayout.export.helvetica import text_width
from gtlayout.export.plan_shapes import STYLES
from gtlayout.layout import Layout
from gtlayout.scene import FloatArray, Scene

SPACE = {"s": "http://www.w3.org/2000/svg"}


@pytest.fixture
def room(tmp_path: Path) -> tuple[Scene, Layout]:
    """The box room with a door in the far wall and a window in the left one, somewhere in the world."""
    return made(tmp_path)


def test_dxf_holds_the_same_planes(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    """Each wall's segments, put back into the world, lie on its plane and on the floor's, and are as long as it."""
    scene, layout = room
    export_layout(tmp_path / "a.dxf", scene, layout, "dxf")
    doc = ezdxf.readfile(tmp_path / "a.dxf")
    audit = doc.audit()
    assert not audit.errors
    assert not audit.fixes
    origin, *axes = (_vector(doc, name) for name in ("plan_origin", "plan_x", "plan_y"))
    segments = [
        origin + np.array(line.get_points("xy")) @ np.array(axes)
        for line in doc.query('LWPOLYLINE[layer=="WALLS"]')
        if isinstance(line, LWPolyline)
    ]
    floor = layout.planes[0]
    lengths = {2: 3.5, 3: 5.0, 4: 3.0, 5: 4.0}
    found = dict.fromkeys(lengths, 0.0)
    for segment in segments:
        np.testing.assert_allclose(segment @ floor.normal + floor.d, 0, atol=1e-9)
        distances = {i: np.abs(segment @ layout.planes[i].normal + layout.planes[i].d).max() for i in lengths}
        wall = min(distances, key=lambda i: distances[i])
        assert distances[wall] < 1e-9
        found[wall] += float(np.linalg.norm(segment[1] - segment[0]))
    assert found == pytest.approx(lengths)
    # A gap with its jambs and a sill: no leaf, because its swing is not known.
    assert not doc.query("ARC")
    assert len(doc.query('LWPOLYLINE[layer=="DOORS"]')) == 3
    assert len(doc.query('LWPOLYLINE[layer=="WINDOWS"]')) == 4
    measured = {one.dxf.text: one.get_measurement() for one in doc.query("DIMENSION") if isinstance(one, DxfDimension)}
    assert measured == pytest.approx({"4.000 ± 0.012 m": 4.0, "5.00 ± 0.20 m": 5.0})
    assert doc.header["$INSUNITS"] == 6


WRITE = """
import sys
from pathlib import Path
from box_room import made
from gtlayout.export import export_layout
out = Path(sys.argv[1])
for to in ("svg", "pdf", "dxf"):
    export_layout(out / f"plan.{to}", *made(out), to)
"""


def test_plans_are_the_same_bytes_and_nothing_is_written_at_home(tmp_path: Path) -> None:
    """For every hash seed, in other processes; home, cache and configuration folders stay empty. (The order that ezdxf
    gives its classes differed between seeds 1 and 4.)
    """
    written = []
    for seed in ("1", "4"):
        home, out = tmp_path / f"home_{seed}", tmp_path / f"out_{seed}"
        home.mkdir()
        out.mkdir()
        kept = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}
        paths = os.pathsep.join([str(Path(__file__).parent), str(Path(gtlayout.__file__).parents[1])])
        variables = {**kept, "HOME": str(home), "PYTHONHASHSEED": seed, "PYTHONPATH": paths}
        done = subprocess.run(
            [sys.executable, "-c", WRITE, str(out)], env=variables, capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        assert list(home.rglob("*")) == []
        written.append({path.name: path.read_bytes() for path in sorted(out.glob("plan.*"))})
    assert list(written[0]) == ["plan.dxf", "plan.pdf", "plan.svg"]
    assert written[0] == written[1]


def test_the_font_list_is_a_folder_that_is_gone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for before in ("elsewhere", None):
        monkeypatch.setenv("XDG_CACHE_HOME", "elsewhere") if before else monkeypatch.delenv("XDG_CACHE_HOME")
        with without_font_cache():
            inside = Path(os.environ["XDG_CACHE_HOME"])
            assert (inside / "ezdxf/font_manager_cache.json").read_text() == '{"version": 2, "font-faces": []}'
        assert os.environ.get("XDG_CACHE_HOME") == before
        assert not inside.exists()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "absent"))
    with pytest.raises(GtlayoutError, match="cannot write a temporary file: No such file"), without_font_cache():
        pass


def test_dxf_leaves_the_options_of_its_library_as_they_were(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    export_layout(tmp_path / "a.dxf", *room, "dxf")
    assert not ezdxf.options.write_fixed_meta_data_for_testing


def test_dxf_without_metres_has_no_unit(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    export_layout(tmp_path / "a.dxf", room[0], replace(room[1], metric=False), "dxf")
    doc = ezdxf.readfile(tmp_path / "a.dxf")
    assert doc.header["$INSUNITS"] == 0
    assert any("not metric" in text.dxf.text for text in doc.query("TEXT"))
    assert all("units" in dimension.dxf.text for dimension in doc.query("DIMENSION"))


def test_svg_prints_to_scale(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    scene, layout = room
    hostile = replace(layout.instances[2], name="<script>alert(1)</script>")
    layout = replace(layout, instances=(*layout.instances[:2], hostile, *layout.instances[3:]))
    export_layout(tmp_path / "a.svg", scene, layout, "svg")
    root = ET.parse(tmp_path / "a.svg").getroot()
    assert not root.findall(".//s:script", SPACE)
    walls = [
        np.array([[float(x) for x in point.split(",")] for point in line.attrib["points"].split()])
        for line in root.findall("s:polyline[@class='walls']", SPACE)
    ]
    found = {text.text or "": text for text in root.findall(".//s:text", SPACE)}
    assert "Unit: metre, scale 1:50 on A4" in found
    assert sum(np.linalg.norm(line[1] - line[0]) for line in walls) == pytest.approx(1000 / 50 * 15.5, abs=0.05)
    assert {"4.000 ± 0.012 m", "5.00 ± 0.20 m", "height floor_0 – ceiling_1: 2.500 m ± unknown"} <= found.keys()
    # As wide as in Helvetica in any other face: labels that do not overlap here do not overlap there.
    label = found["wall_3 5.00 m"].attrib
    assert float(label["textLength"]) == pytest.approx(text_width("wall_3 5.00 m", 2.5), abs=1e-3)
    width, height = (float(root.attrib[name].removesuffix("mm")) for name in ("width", "height"))
    assert root.attrib["viewBox"] == f"0 0 {width:.2f} {height:.2f}"
    assert width <= 297
    assert height <= 210
    every = np.concatenate(walls)
    assert every.min() > 0
    assert (every.max(axis=0) < [width, height]).all()


def test_pdf_is_one_page_of_a4_to_scale(tmp_path: Path, room: tuple[Scene, Layout]) -> None:
    """Read back by hand: every object is where the table says it is, and walls are as long as at 1:50."""
    scene, layout = room
    hostile = replace(layout.instances[2], name="(wall\\) Tj 木")
    layout = replace(layout, instances=(*layout.instances[:2], hostile, *layout.instances[3:]))
    export_layout(tmp_path / "a.pdf", scene, layout, "pdf")
    content = (tmp_path / "a.pdf").read_bytes()
    assert content.startswith(b"%PDF-1.4\n")
    table = int(content.rsplit(b"startxref\n", 1)[1].split()[0])
    assert content[table:].startswith(b"xref\n0 7\n0000000000 65535 f \n")
    places = [int(place) for place in re.findall(rb"(\d{10}) 00000 n \n", content[table:])]
    assert len(places) == 6
    for number, place in enumerate(places, start=1):
        assert content[place:].startswith(b"%d 0 obj\n" % number)
    assert b"/MediaBox [0 0 841.890 595.276]" in content
    length = int(re.findall(rb"/Length (\d+)", content)[0])
    page = content.split(b"stream\n", 1)[1].split(b"\nendstream", 1)[0]
    assert len(page) == length
    color = " ".join(f"{int(STYLES['walls'].color[k : k + 2], 16) / 255:.3f}" for k in (1, 3, 5))
    lines = re.findall(rf"{color} RG 1.984 w \[\] 0 d\n(\S+) (\S+) m (\S+) (\S+) l S", page.decode())
    ends_mm = np.array(lines, dtype=float).reshape(-1, 2, 2) / 72 * 25.4
    lengths_mm = np.linalg.norm(ends_mm[:, 1] - ends_mm[:, 0], axis=1)
    # Those of the room, and the legend's sample.
    np.testing.assert_allclose(lengths_mm.sum(), 1000 / 50 * 15.5 + 9.0, atol=0.01)
    assert ends_mm.min() > 8
    assert (ends_mm.max(axis=(0, 1)) < [289, 202]).all()
    texts = [bytes.fromhex(text).decode("cp1252") for text in re.findall(r"<([0-9a-f]+)> Tj", page.decode())]
    assert {"4.000 ± 0.012 m", "20.00 m²", "(wall\\) Tj ? 5.00 m", "Unit: metre, scale 1:50 on A4"} <= set(texts)


def _vector(doc: Document, name: str) -> FloatArray:
    return np.array([float(number) for number in str(doc.header.custom_vars.get(name)).split()])
