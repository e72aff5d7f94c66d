"""The curved walls of solved planes, as the strips that their extents lie on, in the given world."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from gtlayout.curved.config import CurvedConfig
from gtlayout.curved.find import curved_walls, unit_of_length
from gtlayout.cylinder import CurvedWall
from gtlayout.edges import EdgeConfig
from gtlayout.geometry.similarity import Similarity
from gtlayout.geometry.strip import StripFrame
from gtlayout.instances import Instance, Plane
from gtlayout.prepared.measurements import Prepared
from gtlayout.scene import Scene

_MM = 1e-3


def find_curved(
    prepared: Prepared,
    planes: Sequence[Plane],
    edges: EdgeConfig,
    config: CurvedConfig,
    only: Collection[int] | None = None,
) -> tuple[CurvedWall, ...]:
    """The walls that are curved, in the canonical world, where ``planes`` are; of some instances where ``only`` names
    them.
    """
    return curved_walls(
        prepared.scene,
        prepared.instances,
        planes,
        prepared.tracks,
        prepared.rays,
        prepared.track_instance,
        edges,
        config,
        drawn_curved(prepared.scene, prepared.instances),
        only,
    )


def strips_of(prepared: Prepared, planes: Sequence[Plane], config: CurvedConfig) -> dict[int, StripFrame]:
    """The strips of the curved walls in the given world, by the index of their instance; ``planes`` are canonical."""
    if not prepared.curved:
        return {}
    local = prepared.form.similarity
    metre = local.scale if prepared.form.given.metric else unit_of_length(prepared.scene, prepared.instances, planes)
    tolerance = config.facet_tolerance_mm * _MM * metre / local.scale
    return {wall.instance: StripFrame.on(_in_given_world(wall, local), tolerance) for wall in prepared.curved}


def drawn_curved(scene: Scene, instances: Sequence[Instance]) -> set[int]:
    """The instances that some annotator says are curved."""
    return {
        i
        for i, instance in enumerate(instances)
        if any(scene.key_frames[k].elements[e].curved for k, e in instance.members)
    }


def _in_given_world(wall: CurvedWall, local: Similarity) -> CurvedWall:
    scaled = wall.scaled(1 / local.scale)
    return replace(scaled, cylinder=scaled.cylinder.turned(local.R.T).moved(local.origin))
