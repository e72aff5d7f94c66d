"""Stages 5 to 7: from solved planes to a layout and its verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gtlayout.config import Config
from gtlayout.dimensions.solved_room import SolvedRoom
from gtlayout.dimensions.take import take_dimensions
from gtlayout.edges import ContactEdge
from gtlayout.extent.extents import compute_extents
from gtlayout.geometry.depth import with_sigma_depth
from gtlayout.geometry.strip import StripFrame
from gtlayout.instances import Extent, Instance
from gtlayout.layout import Layout
from gtlayout.mesh import build_mesh
from gtlayout.observer import Stages
from gtlayout.planes.estimate import Estimate
from gtlayout.quality.assess import Quality, assess
from gtlayout.scene import Scene, shrunk


@dataclass(frozen=True)
class Found:
    """What these stages start from, in the given world."""

    instances: tuple[Instance, ...]
    edges: tuple[ContactEdge, ...]
    estimate: Estimate
    strips: Mapping[int, StripFrame]
    """Of the walls that are curved."""


def laid_out(
    scene: Scene,
    found: Found,
    config: Config,
    stage: Stages,
    known: Mapping[int, Extent] | None = None,
    drawn_before: Mapping[int, Extent] | None = None,
    shrink: float = 1.0,
) -> tuple[Layout, Quality]:
    """Extents, mesh, quality and dimensions of solved planes.

    Args:
        scene: As given, with the cameras that the planes were solved with.
        found: The planes.
        config: All settings.
        stage: Who hears of the stages.
        known: Extents that stay, by the index of their instance.
        drawn_before: Extents of which what is drawn stays.
        shrink: Quality is judged on images that are smaller by this factor.
    """
    instances = found.instances
    planes = with_sigma_depth(scene, instances, found.estimate.planes, found.strips)
    with stage("extents"):
        extents = compute_extents(
            scene,
            instances,
            planes,
            found.edges,
            config.extent,
            found.estimate.contact_offsets,
            known,
            drawn_before,
            found.strips,
            stage.observer.progress,
        )
    with stage("mesh"):
        mesh = build_mesh(instances, extents)
    with stage("quality"):
        quality = assess(shrunk(scene, shrink), instances, planes, extents, config.quality, stage.observer.progress)
        room = SolvedRoom(scene, instances, planes, extents)
        far = [i for i, one in enumerate(quality.instances) if one.reach > config.quality.max_reach]
        measured = take_dimensions(room, found.estimate.covariance, config.loa, far)
    layout = Layout(
        instances,
        planes,
        extents,
        mesh,
        scene.metric,
        measured.dimensions,
        accuracies=measured.accuracies,
        quantities=measured.quantities,
        next_measurement=measured.next_measurement,
    )
    return layout, quality
