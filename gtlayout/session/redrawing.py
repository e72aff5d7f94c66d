"""What of a drawing was there before: elements are known by their key frame and the annotator's id."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import shapely

from gtlayout.instances import Member
from gtlayout.prepared.canonical import Canonical, redrawn
from gtlayout.prepared.measurements import Prepared
from gtlayout.scene import Element, KeyFrame, Scene


@dataclass(frozen=True)
class Redrawing:
    """Another drawing of a solved scene, in its canonical form."""

    form: Canonical
    before: Scene
    scene: Scene
    """With the cameras that the planes were solved with."""
    was: Mapping[Member, Member]
    """Element now → the same element before, however it is drawn or labelled."""

    def element(self, member: Member) -> Element:
        """As it is drawn now."""
        return self.scene.key_frames[member[0]].elements[member[1]]

    def element_before(self, member: Member) -> Element:
        """As it was drawn."""
        return self.before.key_frames[member[0]].elements[member[1]]

    def same_surface(self, member: Member) -> bool:
        """Whether an element was there before with the same label."""
        return member in self.was and self.element(member).label == self.element_before(self.was[member]).label

    def same_outline(self, member: Member) -> bool:
        """Whether an element was there before with the same label and outline."""
        return self.same_surface(member) and bool(
            shapely.equals_exact(self.element(member).amodal, self.element_before(self.was[member]).amodal)
        )

    @property
    def members(self) -> list[Member]:
        """All elements as they are now, in order."""
        return [(k, e) for k, one in enumerate(self.scene.key_frames) for e in range(len(one.elements))]

    @property
    def key_frame_before(self) -> dict[int, int]:
        """Number of each key frame now → its number before, for those that were there."""
        numbers = {key_frame.frame: k for k, key_frame in enumerate(self.before.key_frames)}
        now = enumerate(self.scene.key_frames)
        return {k: numbers[key_frame.frame] for k, key_frame in now if key_frame.frame in numbers}


def compare(prepared: Prepared, key_frames: Sequence[KeyFrame]) -> Redrawing | None:
    """What of ``key_frames``, in order, was there in ``prepared``.

    None where they need a frame that it lacks, because its camera is that of another frame.
    """
    form = redrawn(prepared.form, replace(prepared.form.given, key_frames=tuple(key_frames)))
    if form is None:
        return None
    before = {
        (key_frame.frame, element.id): (k, e)
        for k, key_frame in enumerate(prepared.scene.key_frames)
        for e, element in enumerate(key_frame.elements)
    }
    was = {
        (k, e): before[key_frame.frame, element.id]
        for k, key_frame in enumerate(form.scene.key_frames)
        for e, element in enumerate(key_frame.elements)
        if (key_frame.frame, element.id) in before
    }
    scene = replace(prepared.scene, key_frames=form.scene.key_frames)
    return Redrawing(form, prepared.scene, scene, was)
