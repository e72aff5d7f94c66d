"""What tracks and drawings say of a synthetic room, without a video: true depths with noise, and real drawings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag
from synth_views import SEED, the_room, views

from gtlayout.curved.config import CurvedConfig
from gtlayout.curved.find import curved_walls
from gtlayout.cylinder import CurvedWall
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.dimensions.take import take_dimensions
from gtlayout.edges import EdgeConfig, contact_edges
from gtlayout.extent.config import ExtentConfig
from gtlayout.extent.extents import compute_extents
from gtlayout.geometry.raster import spread_points
from gtlayout.geometry.strip import StripFrame
from gtlayout.instances import Instance, Plane
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.scene import Camera, FloatArray, Frame, IntArray, KeyFrame, Label, Scene
from gtlayout.synth.annotate import annotate
from gtlayout.synth.render import cast
from gtlayout.synth.room import Room, RoomKind
from gtlayout.synth.surfaces import Surface
from gtlayout.tracking.tracks import Tracks
from gtlayout.tracking.triangulation import TriangulatedTracks

VIEWS = 4
TRACKS_PER_ELEMENT = 60
TOLERANCE_M = 0.002
DEPTH_SIGMA = 0.003
"""As a share of the depth."""


@dataclass(frozen=True)
class Measured:
    scene: Scene
    instances: tuple[Instance, ...]
    planes: tuple[Plane, ...]
    tracks: Tracks
    rays: TriangulatedTracks
    track_instance: IntArray

    def found(self, config: CurvedConfig | None = None, drawn: tuple[int, ...] = ()) -> tuple[CurvedWall, ...]:
        return curved_walls(
            self.scene,
            self.instances,
            self.planes,
            self.tracks,
            self.rays,
            self.track_instance,
            EdgeConfig(),
            config or CurvedConfig(),
            drawn,
        )

    def index(self, name: str) -> int:
        return next(i for i, instance in enumerate(self.instances) if instance.name == name)


def measured(kind: RoomKind) -> Measured:
    """With floors, ceilings and flat walls known to a millimetre."""
    room, rng = the_room(kind), np.random.default_rng(SEED)
    cameras = views(kind)[:VIEWS]
    drawn = [annotate(room, c, cast(room.surfaces, c), k, np.random.default_rng(k)) for k, c in enumerate(cameras)]
    members: dict[str, list[tuple[int, int]]] = {}
    for k, (key_frame, names) in enumerate(drawn):
        for e, element in enumerate(key_frame.elements):
            members.setdefault(names[element.id], []).append((k, e))
    by_name = {surface.name: surface for surface in room.structure}
    order = sorted(members)
    hosts = dict.fromkeys(order)
    instances = tuple(Instance(name, _label(by_name[name]), tuple(members[name]), hosts[name]) for name in order)
    planes = tuple(_plane(by_name[name].normal, by_name[name].d) for name in order)
    frames = tuple(Frame(f"{k}.jpg", Path(f"{k}.jpg"), camera) for k, camera in enumerate(cameras))
    scene = Scene(Path("room"), frames, tuple(key_frame for key_frame, _ in drawn), True)
    return Measured(scene, instances, planes, *_tracked(room, cameras, [k for k, _ in drawn], instances, rng))


@cache
def laid_out(kind: RoomKind, *, curved: bool = True) -> tuple[Scene, Layout]:
    """The layout of a measured room; its round walls are planes where not ``curved``."""
    room = measured(kind)
    strips = {wall.instance: StripFrame.on(wall, TOLERANCE_M) for wall in room.found()} if curved else {}
    edges = contact_edges(room.scene, room.instances, EdgeConfig())
    extents = compute_extents(room.scene, room.instances, room.planes, edges, ExtentConfig(), strips=strips)
    mesh = build_mesh(room.instances, extents)
    covariance = block_diag(*(plane.covariance for plane in room.planes))
    taken = take_dimensions(SolvedRoom(room.scene, room.instances, room.planes, extents), covariance, 20)
    layout = Layout(
        room.instances,
        room.planes,
        extents,
        mesh,
        True,
        taken.dimensions,
        taken.accuracies,
        quantities=taken.quantities,
        next_measurement=taken.next_measurement,
    )
    return room.scene, layout


def round_wall(layout: Layout) -> int:
    """Index of the only curved wall."""
    (index,) = layout.curved
    return index


def _label(surface: Surface) -> Label:
    assert surface.label is not None
    return surface.label


def _plane(normal: FloatArray, d: float) -> Plane:
    across = np.eye(3) - np.outer(normal, normal)
    covariance = 1e-6 * np.block([[across, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    return Plane(normal, d, covariance, True)


def _tracked(
    room: Room,
    cameras: Sequence[Camera],
    key_frames: list[KeyFrame],
    instances: tuple[Instance, ...],
    rng: np.random.Generator,
) -> tuple[Tracks, TriangulatedTracks, IntArray]:
    owner = {member: i for i, instance in enumerate(instances) for member in instance.members}
    parts = []
    for k, key_frame in enumerate(key_frames):
        depth = cast(room.surfaces, cameras[k]).depth
        for e, element in enumerate(key_frame.elements):
            if element.visible.is_empty:
                continue
            px = np.floor(spread_points(element.visible, TRACKS_PER_ELEMENT)) + 0.5
            z = depth[px[:, 1].astype(int), px[:, 0].astype(int)]
            rho = 1 / z * (1 + DEPTH_SIGMA * rng.normal(size=len(z)))
            ones = np.ones(len(px), dtype=np.int64)
            center = np.broadcast_to(cameras[k].center_world, (len(px), 3))
            parts.append((k * ones, e * ones, owner[k, e] * ones, center, cameras[k].rays_world(px), px, rho))
    key_frame_of, element_of, track_instance, center, ray, px, rho = (
        np.concatenate(columns) for columns in zip(*parts, strict=True)
    )
    number = np.arange(len(px))
    tried = tuple(np.full(len(key_frame.elements), TRACKS_PER_ELEMENT) for key_frame in key_frames)
    tracks = Tracks(key_frame_of, element_of, number, key_frame_of, px, np.ones(len(px)), tried)
    rays = TriangulatedTracks(center, ray, px, rho, DEPTH_SIGMA * rho, np.full(len(rho), 10.0))
    return tracks, rays, track_instance
