"""Looks an image up in a solved scene by the name that a tool has for it, and proposes its drawing."""

from __future__ import annotations

import hashlib
import logging
from dataclasses import dataclass
from pathlib import Path

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.frame_names import FrameFinder
from gtlayout.io.annotations.outlines import View
from gtlayout.io.image_names import NameIndex
from gtlayout.io.pixels.images import read_bgr
from gtlayout.io.sources import RawAnnotations, RawKeyFrame
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.proposal import Proposal
from gtlayout.proposals.propose import Proposer
from gtlayout.scene import Scene
from gtlayout.solution import Solution
from gtlayout.version import __version__

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Found:
    """The frame that an image of a tool is."""

    frame: int
    """Index into the scene's frames."""
    view: View
    """The frame as the tool shows it."""
    is_drawn: bool
    """Whether it is a key frame."""


class SolvedRoom:
    """Proposes drawings for the frames of a solved scene."""

    def __init__(self, solution: Solution) -> None:
        self.scene = solution.scene
        self.version = version_of(solution.scene)
        self._proposer = Proposer(solution, ProposalConfig())
        # Without key frames to go by, each image is matched by its name alone.
        self._find = FrameFinder(RawAnnotations(Path(), ()), self.scene.frames, ())
        # Label Studio asks for all tasks at once and gives up after some time: what was done by then is done.
        self._proposals: dict[int, Proposal] = {}
        self._drawn = frozenset(key_frame.frame for key_frame in self.scene.key_frames)

    def find(self, image: str, size: tuple[int, int] | None = None) -> Found | str:
        """The frame that a tool calls ``image`` and shows with (width, height) px, in its own size when None.

        Else why there is none, in words that follow its name. A name that agrees in nothing but its number is logged.
        """
        match = self._find(RawKeyFrame(image, (), size))
        if isinstance(match, str):
            return match
        frame = self.scene.frames[match.index]
        view = View.of(image, frame, size, on_video=match.on_video)
        if view.has_other_shape:
            (width, height), (own_width, own_height) = view.annotated_size, view.drawn_size
            return f"is shown with {width}x{height} px, and its camera is of {own_width}x{own_height}"
        if not match.on_video and NameIndex((frame.name,)).find(image) is None:
            LOG.warning("%s is taken to be %s, by its number alone", image, frame.name)
        return Found(match.index, view, match.index in self._drawn)

    def propose(self, found: Found) -> Proposal:
        """What to draw in a frame, moved to lines of its image where that can be read; else that is logged."""
        if found.frame not in self._proposals:
            self._proposals[found.frame] = self._proposal(found.frame)
        return self._proposals[found.frame]

    def _proposal(self, index: int) -> Proposal:
        frame = self.scene.frames[index]
        try:
            image = read_bgr(frame)
        except GtlayoutError as error:
            LOG.warning("%s: proposed without its pixels: %s", frame.name, error)
            image = None
        return self._proposer.propose(index, image)


def version_of(scene: Scene) -> str:
    """What proposals are made from: another version for other drawings, the same for the same."""
    digest = hashlib.sha256()
    for key_frame in scene.key_frames:
        digest.update(repr((scene.frames[key_frame.frame].name, len(key_frame.occlusion_edges))).encode())
        for element in key_frame.elements:
            digest.update(repr((element.id, element.label, element.amodal.wkt, element.visible.wkt)).encode())
        for line in key_frame.occlusion_edges:
            digest.update(line.tobytes())
    drawn = len(scene.key_frames)
    return f"gtlayout {__version__}, {drawn} frame{'' if drawn == 1 else 's'} drawn, {digest.hexdigest()[:8]}"
