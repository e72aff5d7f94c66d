"""Folders of images for ``import --colmap``: what is taken, what is left out and said."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from exif import write_tagged
from PIL import Image

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.importing.colmap_images import for_colmap
from gtlayout.importing.image_list import list_images
from gtlayout.importing.structure_from_motion import reconstruct
from gtlayout.io.pixels.images import decode, size_of_first
from gtlayout.io.scene_folder import load_scene
from gtlayout.scene import ImageArray

HEIF_START = b"\x00\x00\x00\x18ftypheic\x00\x00\x00\x00"


def picture(width: int = 32, height: int = 24) -> ImageArray:
    return np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)


def write(path: Path, width: int = 32, height: int = 24) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture(width, height)).save(path)


def test_every_kind_that_is_read_is_taken_in_natural_order(tmp_path: Path) -> None:
    names = ["a2.JPG", "a10.jpeg", "b.png", "c.tif", "d.TIFF", "e.webp", "f.bmp", "g.avif"]
    for name in reversed(names):
        write(tmp_path / name)
    assert list_images(tmp_path) == (tmp_path, tuple(names), ())
    (tmp_path / "images").mkdir()
    write(tmp_path / "images/z.webp")
    assert list_images(tmp_path) == (tmp_path / "images", ("z.webp",), ())


def test_what_is_left_out_is_named_with_its_reason(tmp_path: Path) -> None:
    for name in ("0.jpg", "1.jpg", "2.jpg", "thumbs/0.jpg", "thumbs/1.jpg", "cam1/deep/0.png"):
        write(tmp_path / name)
    write(tmp_path / "turned.jpg", 24, 32)
    for name in ("raw.DNG", "clip.MOV", "moving.gif", "notes.txt", "annotations.xml", ".hidden.jpg", "x.aae"):
        (tmp_path / name).write_bytes(b"something")
    (tmp_path / "damaged.jpg").write_bytes(b"something")
    (tmp_path / "empty.png").write_bytes(b"")
    write(tmp_path / "depth/0.png")
    write(tmp_path / "__MACOSX/0.jpg")
    folder, names, lines = list_images(tmp_path)
    assert (folder, names) == (tmp_path, ("0.jpg", "1.jpg", "2.jpg"))
    said = "\n".join(lines)
    assert len(lines) == 6
    assert "left out (raw images): raw.DNG" in said
    assert "left out (videos; import them on their own): clip.MOV" in said
    assert "left out (of a kind that is not read): moving.gif" in said
    assert "left out (damaged, or not an image): damaged.jpg, empty.png" in said
    assert "left out (in folders below the others): cam1/deep/ (1 images), thumbs/ (2 images)" in said
    assert "left out (24x32 px, but most have 32x24, and all must be of one camera): turned.jpg" in said
    assert not any(word in said for word in ("notes", "annotations", "hidden", "aae", "depth", "MACOSX"))


def test_images_in_folders_below_are_taken_where_there_are_no_others(tmp_path: Path) -> None:
    for name in ("cam0/0.jpg", "cam0/1.jpg", "cam1/0.jpg"):
        write(tmp_path / name)
    assert list_images(tmp_path) == (tmp_path, ("cam0/0.jpg", "cam0/1.jpg", "cam1/0.jpg"), ())


@pytest.mark.parametrize("names", [(), ("a.txt",), ("a.dng", "b.jpg")])
def test_a_folder_without_images_is_refused_with_the_reasons(names: tuple[str, ...], tmp_path: Path) -> None:
    for name in names:
        (tmp_path / name).write_bytes(b"nothing")
    with pytest.raises(GtlayoutError, match="holds no image that can be read") as error:
        list_images(tmp_path)
    assert ("a.dng" in str(error.value)) == ("a.dng" in names)
    assert ("b.jpg" in str(error.value)) == ("b.jpg" in names)


def test_colmap_reads_folders_as_they_are_where_it_can(tmp_path: Path) -> None:
    for name in ("a.jpg", "sub/b.tif", "c.png"):
        write(tmp_path / name)
    names = ("a.jpg", "sub/b.tif", "c.png")
    assert for_colmap(tmp_path, names, tmp_path / "work") == (tmp_path, names)
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize("name", ["with blank.jpg", "e.webp", "sub/f.avif"])
def test_colmap_gets_copies_of_what_it_cannot_read_or_name(name: str, tmp_path: Path) -> None:
    write(tmp_path / "a.jpg")
    write(tmp_path / name)
    folder, called = for_colmap(tmp_path, ("a.jpg", name), tmp_path / "work")
    assert folder == tmp_path / "work/for_colmap"
    assert called == ("000000.jpg", "000001.jpg" if name.endswith(".jpg") else "000001.png")
    assert (folder / "000000.jpg").read_bytes() == (tmp_path / "a.jpg").read_bytes()
    for_us, for_it = (decode(path, cv2.IMREAD_COLOR) for path in (tmp_path / name, folder / called[1]))
    assert np.array_equal(for_us, for_it)


@pytest.mark.parametrize("suffix", [".jpg", ".webp", ".tif"])
@pytest.mark.parametrize("orientation", [3, 6])
def test_colmap_and_we_see_the_same_pixels_of_tagged_images(suffix: str, orientation: int, tmp_path: Path) -> None:
    name = write_tagged(
        tmp_path / f"a{suffix}", np.kron(picture(6, 4), np.ones((16, 16, 1), np.uint8)), orientation
    ).name
    folder, (called,) = for_colmap(tmp_path, (name,), tmp_path / "work")
    bitmap = pycolmap.Bitmap.read(str(folder / called), True)
    assert bitmap is not None
    seen_by_colmap = bitmap.to_array()
    ours = decode(tmp_path / name, cv2.IMREAD_COLOR_RGB)
    assert seen_by_colmap.shape == ours.shape
    assert np.abs(seen_by_colmap.astype(int) - ours).mean() < 2


def test_cameras_of_images_with_blanks_and_of_other_kinds_come_back_under_their_names(
    room: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A folder of photos as people have it, EXIF-turned by a phone: stored sideways, shown upright."""
    frames = load_scene(room).frames[:20:2]
    for i, frame in enumerate(frames):
        suffix = (".jpg", ".webp", ".tif", ".png")[i % 4]
        shown = decode(frame.image_path, cv2.IMREAD_COLOR_RGB).astype(np.uint8)
        write_tagged(tmp_path / f"photos/IMG ({i}){suffix}", shown, 6)
    (tmp_path / "photos/IMG (20).DNG").write_bytes(b"raw")
    out = tmp_path / "out"
    assert main(["import", str(tmp_path / "photos"), str(out), "--colmap", "-v"]) == 0
    said = capfd.readouterr().out
    assert "10 of 10 frames registered" in said
    assert "left out (raw images): IMG (20).DNG" in said
    scene = load_scene(out, annotated=False)
    assert [Path(frame.name).name.split(".")[0] for frame in scene.frames] == [f"IMG ({i})" for i in range(10)]
    assert {(frame.camera.width > frame.camera.height) for frame in scene.frames} == {True}
    for path in (out / "images").iterdir():
        with Image.open(path) as image:
            assert image.getexif().get(0x112, 1) == 1
            assert image.width > image.height
    # Upright cameras: all have the world's vertical where the true ones have it, up to one rotation.
    true = [frame.camera.R_cam_from_world for frame in frames]
    found = [frame.camera.R_cam_from_world for frame in scene.frames]
    for a, b in ((0, 4), (2, 9)):
        angle = np.arccos(np.clip((np.trace(true[a] @ true[b].T) - 1) / 2, -1, 1))
        assert np.arccos(np.clip((np.trace(found[a] @ found[b].T) - 1) / 2, -1, 1)) == pytest.approx(angle, abs=0.02)
        axis_true, axis_found = (R[a] @ R[b].T - R[b] @ R[a].T for R in (true, found))
        assert np.sign(axis_true[0, 2]) == np.sign(axis_found[0, 2])


def test_heic_without_its_reader_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    (tmp_path / "a.HEIC").write_bytes(HEIF_START)
    (tmp_path / "b.jpg").write_bytes(HEIF_START)  # phones' exports are often called so
    for name in ("a.HEIC", "b.jpg"):
        with pytest.raises(GtlayoutError, match=rf"{name}: HEIC needs pillow-heif \(pip install 'gtlayout\[heic\]'\)"):
            decode(tmp_path / name, cv2.IMREAD_COLOR)


@pytest.fixture
def heic(tmp_path: Path) -> Callable[[str, int], ImageArray]:
    library = pytest.importorskip("pillow_heif", reason="pillow-heif, the extra 'heic', is not installed")

    def make(name: str, orientation: int) -> ImageArray:
        blocks = np.kron(np.random.default_rng(1).integers(60, 200, (6, 8, 3)), np.ones((16, 16, 1))).astype(np.uint8)
        exif = Image.Exif()
        exif[0x112] = orientation
        stored = library.from_pillow(Image.fromarray(blocks))
        stored.save(tmp_path / name, quality=95, exif=exif.tobytes())
        return blocks

    return make


@pytest.mark.parametrize("name", ["a.heic", "a.HEIC", "a.jpg"])
def test_heic_is_read(heic: Callable[[str, int], ImageArray], name: str, tmp_path: Path) -> None:
    blocks = heic("x.heic", 1)
    (tmp_path / "x.heic").rename(tmp_path / name)
    for mode in (cv2.IMREAD_COLOR, cv2.IMREAD_COLOR_RGB, cv2.IMREAD_GRAYSCALE):
        pixels = decode(tmp_path / name, mode)
        expected = {
            cv2.IMREAD_COLOR: blocks[:, :, ::-1],
            cv2.IMREAD_COLOR_RGB: blocks,
            cv2.IMREAD_GRAYSCALE: cv2.cvtColor(blocks, cv2.COLOR_RGB2GRAY),
        }[mode]
        assert np.abs(pixels.astype(int) - expected).mean() < 8
    assert size_of_first([tmp_path / name]) == (128, 96)
    assert list_images(tmp_path) == (tmp_path, (name,), ())


def test_damaged_heic_is_named(heic: Callable[[str, int], ImageArray], tmp_path: Path) -> None:
    heic("a.heic", 1)
    (tmp_path / "a.heic").write_bytes((tmp_path / "a.heic").read_bytes()[:200])
    with pytest.raises(GtlayoutError, match=r"cannot read image .*a\.heic: damaged"):
        decode(tmp_path / "a.heic", cv2.IMREAD_COLOR)


def test_cameras_of_heic_images_are_found(room: Path, tmp_path: Path) -> None:
    library = pytest.importorskip("pillow_heif", reason="pillow-heif, the extra 'heic', is not installed")
    for frame in load_scene(room).frames[:20:4]:
        rgb = decode(frame.image_path, cv2.IMREAD_COLOR_RGB)
        (tmp_path / "p").mkdir(exist_ok=True)
        library.from_pillow(Image.fromarray(rgb)).save(tmp_path / f"p/{frame.name[:-4]}.HEIC")
    folder, names, lines = list_images(tmp_path / "p")
    assert lines == ()
    (tmp_path / "work").mkdir()
    found = reconstruct(folder, names, tmp_path / "work")
    assert found.registered == names
    assert all(name.endswith(".HEIC") for name in names)
