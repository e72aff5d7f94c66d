"""The results of stages 1 to 3: everything that planes are solved from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from gtlayout.camera_errors.camera_response import CameraResponse
from gtlayout.camera_errors.findings import CameraDoubt
from gtlayout.cylinder import CurvedWall
from gtlayout.edges import ContactEdge
from gtlayout.instances import Instance, Members
from gtlayout.prepared.canonical import Canonical
from gtlayout.scene import IntArray, Scene
from gtlayout.tracking.bundle_adjustment import CameraReport
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks


@dataclass(frozen=True)
class Measurements:
    """Tracks, the instances they belong to, and contact edges, in one world."""

    scene: Scene
    tracks: Tracks
    rays: TriangulatedTracks
    instances: tuple[Instance, ...]
    track_instance: IntArray
    """(N,) instance of each track, -1 = none."""
    edges: tuple[ContactEdge, ...]
    camera_response: CameraResponse | None = field(default=None, kw_only=True)
    """What the cameras may be wrong by, and what that does to the tracks; None = they are exact."""

    def restarted(self, share: float, seed: int) -> Self:
        """With a random share of the tracks; the others belong to no instance."""
        left_out = np.random.default_rng(seed).random(len(self.track_instance)) >= share
        return replace(self, track_instance=np.where(left_out, -1, self.track_instance))


@dataclass(frozen=True)
class Prepared(Measurements):
    """The results of stages 1 to 3 in the canonical form of a scene, and the way back to the given scene."""

    form: Canonical
    camera_doubt: CameraDoubt = field(default_factory=CameraDoubt)
    """Errors that all given cameras share; those that it corrects are corrected in ``scene``. What stays has a σ that
    no track or plane shows: ``camera_doubt.changed`` moves the cameras of ``scene`` by it.
    """
    cameras: CameraReport | None = None
    """The result of refining the cameras, in the given unit; None without ``refine_cameras``."""
    warnings: tuple[str, ...] = ()
    """What was skipped, joined, split or left out, one line each."""
    left_out: Members = ()
    """Elements that take no part in the solve, because they contradict the other key frames."""
    curved: tuple[CurvedWall, ...] = ()
    """The walls that are cylinders, by their index among the instances."""

    @property
    def flat(self) -> Self:
        """What planes are solved from: where a curved wall is met says nothing about any plane."""
        if not self.curved:
            return self
        curved = {wall.instance for wall in self.curved}
        return replace(self, edges=tuple(edge for edge in self.edges if not curved & set(edge.instances)))

    @property
    def given_scene(self) -> Scene:
        """The scene as given, with the cameras that the planes are solved with."""
        refined = self.cameras is not None and self.cameras.refined
        return self.form.given_cameras(self.scene) if refined or self.camera_doubt.corrected else self.form.given

    @property
    def given_tracks(self) -> Tracks:
        """The tracks by the frame and element indices of the given scene."""
        return self.form.given_tracks(self.tracks)

    @property
    def given_instances(self) -> tuple[Instance, ...]:
        """The instances by the element indices of the given scene."""
        return self.form.given_instances(self.instances)
