"""The grey images of stage 1, each decoded once."""

from __future__ import annotations

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import read_gray
from gtlayout.scene import ImageArray, Scene


class ImageCache:
    """Grey images by frame, decoded once while they are in reach of a key frame; None where unreadable."""

    def __init__(self, scene: Scene, reach: int) -> None:
        self._scene = scene
        self._reach = reach
        self._images: dict[int, ImageArray | str] = {}
        self.errors: dict[int, str] = {}
        """Of the images that were asked for."""

    def move_to(self, key: int) -> None:
        """Hold only the frames in reach of frame ``key``. Key frames come in order, so the others are not needed again.

        A video is decoded forward only, so frames that tracking backward needs are read now.
        """
        first = key - self._reach
        self._images = {frame: image for frame, image in self._images.items() if frame >= first}
        for frame in range(max(0, first), key):
            if self._scene.frames[frame].video is not None:
                self._read(frame)

    def __call__(self, frame: int) -> ImageArray | None:
        """(H, W) of that frame; None when it cannot be read."""
        image = self._read(frame)
        if isinstance(image, str):
            self.errors[frame] = image
            return None
        return image

    def _read(self, frame: int) -> ImageArray | str:
        """The image, or why there is none."""
        if frame not in self._images:
            try:
                self._images[frame] = read_gray(self._scene.frames[frame])
            except GtlayoutError as error:
                self._images[frame] = str(error)
        return self._images[frame]
