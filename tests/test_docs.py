"""The documentation site: built without a warning, complete, readable without a network; its examples are read."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from dataclasses import fields, is_dataclass
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args
from urllib.parse import unquote, urlsplit

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page as BrowserPage

from gtlayout.cli.app import app
from gtlayout.config import Config
from gtlayout.instances import EvidenceKind, Instance, Plane, Support
from gtlayout.io.image_names import NameIndex, NameMatch
from gtlayout.io.scene_folder import ANNOTATION_READERS, CAMERA_READERS
from gtlayout.processes import ONE_THREAD
from gtlayout.quality.causes import causes
from gtlayout.quality.config import QualityConfig

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "pages"
LOADED = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "link": "href",
    "object": "data",
    "embed": "src",
}
"""What a browser loads by itself."""
MAX_PICTURES_BYTES = 1_600_000
"""Of all pictures of the site."""


class Page(HTMLParser):
    """Of a page its anchors, its links, what it loads, and its text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.words: list[str] = []
        self.tags: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append(tag)
        self.ids.update(value for key in ("id", "name") if (value := given.get(key)))
        if tag == "a" and (href := given.get("href")):
            self.links.append(href)
        if (url := given.get(LOADED.get(tag, ""))) and not url.startswith("data:"):
            self.loaded.append(url)

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return "".join(self.words)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("docs") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-f", "docs/mkdocs.yml", "-d", str(out)]
    # A proxy where nobody listens: what would have to be downloaded could not be.
    nowhere = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9")
    environment = {**os.environ, **nowhere, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in sorted(site.rglob("*.html"))}


def test_every_link_and_anchor_resolves(site: Path, pages: dict[Path, Page]) -> None:
    broken = []
    for path, page in pages.items():
        if path.name == "404.html":  # served from anywhere, so that its links begin at the root
            continue
        for link in [*page.links, *page.loaded]:
            url = urlsplit(link)
            if url.scheme or url.netloc:
                continue
            target = (path.parent / unquote(url.path)).resolve() if url.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file() or (
                url.fragment and target.suffix == ".html" and unquote(url.fragment) not in pages[target].ids
            ):
                broken.append(f"{path.relative_to(site)}: {link}")
    assert not broken


def test_nothing_is_loaded_from_elsewhere(site: Path, pages: dict[Path, Page]) -> None:
    elsewhere = [url for page in pages.values() for url in page.loaded if urlsplit(url).netloc]
    styles = [*site.rglob("*.css")]
    imported = [
        url for path in styles for url in re.findall(r"(?:url\(|@import)\s*['\"]?(\w+:)?//[^)'\"]+", path.read_text())
    ]
    assert styles
    assert not elsewhere
    assert not imported


def test_pictures_are_small_shown_and_made_by_a_script(pages: dict[Path, Page], site: Path) -> None:
    pictures = sorted(path for end in ("jpg", "png") for path in PAGES.rglob(f"*.{end}"))
    shown = {(path.parent / unquote(url)).resolve() for path, page in pages.items() for url in page.loaded}
    scripts = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*_pictures.py"))
    made_by_hand = ["label_studio.png"]  # of another program, with its server
    assert len(pictures) > 15
    assert sum(path.stat().st_size for path in pictures) < MAX_PICTURES_BYTES
    assert [path for path in pictures if site / path.relative_to(PAGES) not in shown] == []
    assert [path.name for path in pictures if not re.search(rf"\b{path.stem}\b", scripts)] == made_by_hand


def test_make_pictures_runs_every_script() -> None:
    make = (ROOT / "Makefile").read_text(encoding="utf-8")
    [names] = re.findall(r"for script in ([\w ]+); do [^\n]*docs/\$\$\{script\}_pictures\.py", make)
    assert sorted(names.split()) == sorted(
        path.stem.removesuffix("_pictures") for path in (ROOT / "docs").glob("*_pictures.py")
    )


def test_search_works_from_files(site: Path, page: BrowserPage, problems: list[str]) -> None:
    page.goto((site / "inputs/cameras.html").as_uri())
    page.locator(".md-search__input").click()
    page.locator(".md-search__input").press_sequentially("occlusion edges")
    first = page.locator(".md-search-result__link").first
    first.wait_for(state="attached", timeout=60_000)
    assert "drawing.html" in " ".join(
        link.get_attribute("href") or "" for link in page.locator(".md-search-result__link").all()
    )
    assert problems == []


def test_equations_are_mathml(pages: dict[Path, Page], site: Path) -> None:
    page = pages[site / "method.html"]
    source = (PAGES / "method.md").read_text(encoding="utf-8")
    assert page.tags.count("math") == source.count("```math") + source.count("$`") > 50
    assert not re.search(r"\\[a-z]+|\$`", page.text)  # TeX that was not understood stays as it is


def test_every_command_and_option_is_described(pages: dict[Path, Page], site: Path) -> None:
    text = pages[site / "reference/cli.html"].text
    commands = [name for name in app if not name.startswith("-")]
    assert {"solve", "import"} <= set(commands)
    for name in commands:
        assert f"gtlayout {name}" in text
        arguments = [argument for argument in app[name].assemble_argument_collection() if argument.show]
        options = {flag for argument in arguments for flag in argument.names}
        assert [flag for flag in options if flag.startswith("--") and flag not in text] == []


def test_every_setting_is_described(pages: dict[Path, Page], site: Path) -> None:
    page = pages[site / "reference/configuration.html"]
    headings = {"config", *(name for name in page.ids if name.startswith("config"))}

    def check(value: Any, heading: str) -> None:
        assert heading in headings
        for each in fields(value):
            inner = getattr(value, each.name)
            if is_dataclass(inner):
                check(inner, f"{heading}{each.name}")
            else:
                assert each.name in page.words

    check(Config(), "config")


def test_every_key_of_layout_json_is_described(pages: dict[Path, Page], site: Path) -> None:
    words = set(re.findall(r"\w+", pages[site / "reference/layout.html"].text))

    def check(node: Any) -> None:
        if isinstance(node, dict):
            assert set(node.get("properties", {})) <= words
            for inner in node.values():
                check(inner)

    check(json.loads((site / "reference/layout.schema.json").read_text(encoding="utf-8")))


def test_python_example_runs(room: Path, tmp_path: Path) -> None:
    (tmp_path / "scene").symlink_to(room)
    [code] = re.findall(
        r"^```python\n(.*?)^```$", (PAGES / "reference/api.md").read_text(encoding="utf-8"), re.M | re.S
    )
    run = code.replace('"scene/gtlayout"', '"out"')
    assert run != code
    subprocess.run([sys.executable, "-c", run], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True)
    assert (tmp_path / "out" / "layout.json").is_file()


def test_slurm_script_asks_for_jobs_of_one_core_and_one_thread() -> None:
    """Without SLURM: the job script that the page's script would submit."""
    text = (PAGES / "batch.md").read_text(encoding="utf-8")
    [code] = re.findall(r'^```python title="slurm_cluster.py"\n(.*?)^```$', text, re.M | re.S)
    page: dict[str, Any] = {"__name__": "slurm_cluster"}
    exec(code, page)
    with page["slurm_cluster"]() as cluster:
        script = cluster.job_script()
        address = cluster.scheduler_address
    lines = script.splitlines()
    directives = {line.removeprefix("#SBATCH ") for line in lines if line.startswith("#SBATCH ")}
    assert {"-p cpu", "-A my_project", "-n 1", "--cpus-per-task=1", "--mem=3G", "-t 04:00:00"} <= directives
    [worker] = [line for line in lines if "distributed.cli.dask_worker" in line]
    assert f" {address} " in worker
    for option in ("--nthreads 1", "--memory-limit 3.00GiB", "--lifetime 225m", "--death-timeout 300"):
        assert option in worker
    assert "--nworkers" not in worker
    threads = next(line for line in lines if line.startswith("export "))
    assert lines.index(threads) < lines.index(worker)
    assert set(threads.split()[1:]) == {f"{name}={number}" for name, number in ONE_THREAD.items()}


def test_messages_in_troubleshooting_are_the_programs_own() -> None:
    """So that search finds them. Pairs of words stand in the program, but one in four: a word may be filled in."""
    sources = "\n".join(strings_of(path) for path in (ROOT / "gtlayout").rglob("*.py"))
    said = "\n".join([sources, *causes_of_weakness()]).casefold()
    text = (PAGES / "troubleshooting.md").read_text(encoding="utf-8").casefold()
    quoted = re.findall(r"(?<![*\w])\*([^*\n]+)\*(?!\*)", text)
    assert len(quoted) > 80
    assert not unsaid(quoted, said)


def unsaid(quoted: list[str], said: str) -> list[str]:
    """What the program cannot have printed."""
    unknown = []
    for quote in quoted:
        pieces = [re.sub(r"^\W+|\W+$", "", piece).split() for piece in re.split(r"…|[\d.]+", quote)]
        pairs = [" ".join(pair) for words in pieces for pair in pairwise(words)]
        if sum(pair not in said for pair in pairs) > len(pairs) // 4:
            unknown.append(quote)
    return unknown


def test_tutorial_shows_commands_that_are_understood_and_what_the_program_prints(tmp_path: Path) -> None:
    """Written by docs/tutorial_outputs.py, which takes minutes: here only whether it could still be printed."""
    blocks = re.findall(r"^```console\n(.*?)^```$", (PAGES / "own_video.md").read_text(encoding="utf-8"), re.M | re.S)
    lines = [line for block in blocks for line in block.splitlines()]
    typed = [line.removeprefix("$ gtlayout ").split() for line in lines if line.startswith("$ ")]
    printed = [line.casefold() for line in lines if not line.startswith(("$ ", "──"))]
    assert {words[0] for words in typed} == {"import", "check", "solve", "measure", "report", "export"}
    for words in typed:
        app.parse_args(words, exit_on_error=False, print_error=False)
    assert len(printed) > 50
    said = "\n".join(strings_of(path) for path in (ROOT / "gtlayout").rglob("*.py")).casefold()
    # Names of files and instances are filled in.
    texts = [re.sub(r"\b\w+_\d+\b|\S*\w[/.]\w\S*|loa\d+", "…", line) for line in printed]
    words = {word for line in texts for word in re.findall(r"[a-zσ]{2,}", line)}
    assert {"registered", "suspicious", "verdict", "trustworthy"} <= words
    assert sorted(words - set(re.findall(r"[a-zσ]{2,}", said))) == []
    sentences = [line for line in texts if line.count(" ") > 4 and "±" not in line and "  " not in line]
    assert len(sentences) > 5
    assert not unsaid(sentences, said)


def causes_of_weakness() -> list[str]:
    """Those that are put together of several words."""
    instance = Instance("wall_0", "wall", ())
    supports = [Support(tracks, dominant_evidence=kind) for tracks in (0, 7) for kind in get_args(EvidenceKind)]
    planes = [Plane(np.zeros(3), 0.0, np.eye(4), True, support=support) for support in supports]
    return [cause for plane in planes for cause in causes(instance, plane, QualityConfig())]


def strings_of(path: Path) -> str:
    """All that a Python file could print; what is filled in is left out."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.JoinedStr):
            found.append("\n".join(str(part.value) if isinstance(part, ast.Constant) else "" for part in node.values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append(node.value)
    return "\n".join(found)


def examples(page: str) -> dict[str, dict[str, str]]:
    """Heading → file name → content of the examples under it."""
    found = {}
    for part in (PAGES / "inputs" / page).read_text(encoding="utf-8").split("\n## ")[1:]:
        blocks = re.findall(r'^```\w+ title="([^"]+)"\n(.*?)^```$', part, re.MULTILINE | re.DOTALL)
        if blocks:
            found[part.partition("\n")[0]] = dict(blocks)
    return found


IMAGES = {
    "COLMAP": ("images/000000.jpg", "images/000010.jpg"),
    "nerfstudio": ("images/000000.jpg",),
    "RealEstate10k": ("images/0.jpg", "images/33333.jpg"),
    "CAD-Estate": ("images/abc_0.jpg",),
    "ScanNet": ("color/0.jpg",),
    "7-Scenes and 3DMatch": ("frame-000000.color.jpg",),
    "ARKitScenes": ("lowres_wide/41000000_100.000.png",),
    "Polycam": ("keyframes/corrected_images/100.jpg",),
}
"""Beside each example of cameras."""
SIZES = {"ARKitScenes": (256, 192), "Polycam": (256, 192)}


def write(folder: Path, files: dict[str, str]) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content, encoding="utf-8")


@pytest.mark.parametrize("heading", examples("cameras.md"))
def test_camera_examples_are_read(heading: str, tmp_path: Path) -> None:
    write(tmp_path, examples("cameras.md")[heading])
    width, height = SIZES.get(heading, (640, 480))
    for name in IMAGES[heading]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(tmp_path / name), np.zeros((height, width, 3), dtype=np.uint8))
    [(reader, path)] = [(reader, path) for reader in CAMERA_READERS for path in reader.detect(tmp_path)]
    read = reader.read(tmp_path, path)
    assert sorted(image.image_path for image in read.images) == sorted(tmp_path / name for name in IMAGES[heading])
    assert all(image.is_there and (image.camera.width, image.camera.height) == (width, height) for image in read.images)
    assert not read.warnings


@pytest.mark.parametrize("heading", examples("annotations.md"))
def test_annotation_examples_are_read(heading: str, tmp_path: Path) -> None:
    write(tmp_path, examples("annotations.md")[heading])
    [(reader, path)] = [(reader, path) for reader in ANNOTATION_READERS for path in reader.detect(tmp_path)]
    read = reader.read(tmp_path, path)
    [key_frame] = read.key_frames
    walls = [shape for shape in key_frame.shapes if shape.label == "wall"]
    assert NameIndex(["000030.jpg"]).find(key_frame.image) == NameMatch((0,), exact=True, other_folder=False)
    assert len(walls) == 1
    corners = np.array([[0, 0], [320, 0], [320, 410], [0, 470]])
    np.testing.assert_allclose(walls[0].polygons[0][:4], corners, atol=0.1)
    assert all("occlusion edges" in warning for warning in read.warnings)
