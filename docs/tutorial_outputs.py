"""Writes what the commands of the page *From a video to a plan* print into the page: python docs/tutorial_outputs.py

It makes the video of a synthetic room, and draws the frames that ``import`` names with the errors of a hand. Takes some
minutes, most of them COLMAP's.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import numpy as np
import numpy.typing as npt
from av.video.stream import VideoStream

from gtlayout.io.files import read_json, write_atomic, write_json_atomic
from pictures import PAGES, run

PAGE = PAGES / "own_video.md"
BLOCK = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FRAMES, RATE_HZ = 181, 30
SYNTH = f"--seed 1 --frames {FRAMES} --width 640 --height 480 --key-every 1 --oversample 1 --blur .3".split()


def main() -> None:
    """Rewrite the page."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        run("synth", folder / "truth", *SYNTH)
        film(sorted((folder / "truth/images").iterdir()), folder / "film.mp4")
        text = BLOCK.sub(lambda block: f"```console\n{printed(block[1], folder)}```", PAGE.read_text(encoding="utf-8"))
    write_atomic(PAGE, text.encode())


def film(images: list[Path], path: Path) -> None:
    """A video of images."""
    pictures = [read_pixels(image) for image in images]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE_HZ, options={"crf": "20"})
        assert isinstance(stream, VideoStream)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode(None))


def read_pixels(path: Path) -> npt.NDArray[np.uint8]:
    """(H, W, 3) BGR."""
    pixels = cv2.imread(str(path))
    assert pixels is not None
    return pixels.astype(np.uint8)


def printed(block: str, folder: Path) -> str:
    """The commands of a block, each with what it prints now."""
    lines = []
    for command in commands_of(block):
        words = shlex.split(command)[1:]
        done = subprocess.run(
            [sys.executable, "-m", "gtlayout", *words], cwd=folder, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise SystemExit(f"{command} failed: {done.stdout}{done.stderr}")
        if words[0] == "import":
            draw(folder / "truth", folder / "room")
        lines += [f"$ {command}", *(line.rstrip() for line in done.stdout.splitlines())]
    return "".join(f"{line}\n" for line in lines)


def commands_of(block: str) -> list[str]:
    """The lines that are typed."""
    return [line.removeprefix("$ ") for line in block.splitlines() if line.startswith("$ ")]


def draw(truth: Path, room: Path) -> None:
    """The frames that ``key_frames.txt`` names get the drawings of the room that was filmed."""
    numbers = {frame["image"]: frame["number"] for frame in read_json(room / "video_frames.json")["frames"]}
    names = [line for line in (room / "key_frames.txt").read_text().splitlines() if not line.startswith("#")]
    drawings = read_json(truth / "annotations.json")
    by_number = {int(Path(frame["image"]).stem): frame for frame in drawings["frames"]}
    drawings["frames"] = [by_number[numbers[name]] | {"image": name} for name in names]
    write_json_atomic(room / "annotations.json", drawings)


if __name__ == "__main__":
    main()
