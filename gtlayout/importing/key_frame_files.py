"""The frames to annotate, for a person: a list with reasons, and a contact sheet."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gtlayout.importing.key_frame_choice import MIN_OVERLAP, Choice
from gtlayout.io.files import printable, write_all_atomic
from gtlayout.io.pixels.images import read_rgb
from gtlayout.scene import Frame, Scene

LIST, SHEET = "key_frames.txt", "key_frames.jpg"
COLUMNS, THUMBNAIL_PX, CAPTION_PX, GAP_PX = 4, 360, 30, 8
FONT_PX, SMALLEST_FONT_PX = 18, 9
JPEG_QUALITY = 90
HEAD = """\
# Frames to annotate: sharp, overlapping, along the whole path of the camera; the second shows much of the first.
# Any others will do as well, as long as each shows what a neighbour shows. Pictures of them: key_frames.jpg
"""


def write_key_frame_files(folder: Path, scene: Scene, chosen: Sequence[Choice], names: Sequence[str]) -> None:
    """Write ``key_frames.txt`` and ``key_frames.jpg`` to ``folder``; ``names``: of the scene's frames in ``images/``.

    Raises GtlayoutError when an image cannot be read, or the disk does not take the files.
    """
    lines = []
    for number, each in enumerate(chosen, start=1):
        lines += [f"# {number}. {_reason(each, scene.frames[each.frame])}", names[each.frame]]
    sheet = contact_sheet([(scene.frames[each.frame], names[each.frame]) for each in chosen])
    write_all_atomic({folder / LIST: HEAD + "".join(f"{line}\n" for line in lines), folder / SHEET: sheet})


def contact_sheet(frames: Sequence[tuple[Frame, str]]) -> bytes:
    """A JPEG of small images with their names below, row by row."""
    font = ImageFont.load_default(FONT_PX)
    pictures = [Image.fromarray(read_rgb(frame)) for frame, _ in frames]
    for picture in pictures:
        picture.thumbnail((THUMBNAIL_PX, THUMBNAIL_PX))
    columns = min(COLUMNS, len(pictures))
    rows = -(-len(pictures) // columns)
    cell = THUMBNAIL_PX + GAP_PX, max(picture.height for picture in pictures) + CAPTION_PX + GAP_PX
    sheet = Image.new("RGB", (columns * cell[0] + GAP_PX, rows * cell[1] + GAP_PX), "white")
    draw = ImageDraw.Draw(sheet)
    for index, (picture, (_, name)) in enumerate(zip(pictures, frames, strict=True)):
        x, y = GAP_PX + index % columns * cell[0], GAP_PX + index // columns * cell[1]
        sheet.paste(picture, (x, y))
        text = f"{index + 1}  {printable(name)}"
        size = FONT_PX
        while size > SMALLEST_FONT_PX and font.getlength(text) * size / FONT_PX > THUMBNAIL_PX:
            size -= 1
        draw.text((x, y + picture.height + 4), text, fill="black", font=ImageFont.load_default(size))
    coded = io.BytesIO()
    sheet.save(coded, "JPEG", quality=JPEG_QUALITY)
    return coded.getvalue()


def _reason(choice: Choice, frame: Frame) -> str:
    parts = ["start of the path"] if choice.shared is None else []
    if choice.shared is not None:
        few = "" if choice.shared >= MIN_OVERLAP else " only: annotate one between them, too, if there is one"
        parts.append(f"{choice.shared:.0%} of what it shows is in the one before{few}")
    if choice.sharpest_of > 1:
        parts.append(f"sharpest of {choice.sharpest_of} frames here")
    if frame.origin is not None:
        parts.append(
            f"frame {frame.origin.number} of {printable(frame.origin.video_name)}, {frame.origin.time_s:.3f} s"
        )
    return "; ".join(parts)
