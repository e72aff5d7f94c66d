"""The grey images of stage 1, each decoded once."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import read_gray
from gtlayout.scene import ImageArray, Scene


class ImageCache:
    """Grey images by frame, decoded once, held while a key frame that they are in reach of is not done.

    Several threads may ask. A video gives one frame after another, so key frames of one are taken by one thread.
    """

    def __init__(self, scene: Scene, reach: int) -> None:
        self._scene = scene
        self._reach = reach
        self._images: dict[int, ImageArray | str] = {}
        self._to_do = {key_frame.frame for key_frame in scene.key_frames}
        self._lock = Lock()
        self._decoding: defaultdict[int, Lock] = defaultdict(Lock)

    @contextmanager
    def near(self, key: int) -> Iterator[Images]:
        """The images in reach of the key frame at frame ``key``. It is done when the block ends."""
        # A video is decoded forward only, so frames that tracking backward needs are read now.
        for frame in range(max(0, key - self._reach), key):
            if self._scene.frames[frame].video is not None:
                self.read(frame)
        try:
            yield Images(self)
        finally:
            with self._lock:
                self._to_do.discard(key)
                first = min(self._to_do, default=len(self._scene.frames) + self._reach) - self._reach
                self._images = {frame: image for frame, image in self._images.items() if frame >= first}

    def read(self, frame: int) -> ImageArray | str:
        """(H, W) of that frame, or why there is none."""
        with self._lock:
            decoding = self._decoding[frame]
        with decoding:
            if frame in self._images:
                return self._images[frame]
            found: ImageArray | str
            try:
                found = read_gray(self._scene.frames[frame])
            except GtlayoutError as error:
                found = str(error)
            with self._lock:
                self._images[frame] = found
            return found


class Images:
    """What one key frame asks for."""

    def __init__(self, cache: ImageCache) -> None:
        self._cache = cache
        self.errors: dict[int, str] = {}
        """Of the images that were asked for."""

    def __call__(self, frame: int) -> ImageArray | None:
        """(H, W) of that frame; None when it cannot be read."""
        image = self._cache.read(frame)
        if isinstance(image, str):
            self.errors[frame] = image
            return None
        return image
