"""What an annotator would draw in a frame, from the solved layout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.extent.extents import extents_without
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent, Instance
from gtlayout.prediction.predict import Prediction, occlusion_edges, predict
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.edges import Surroundings, edges_of
from gtlayout.proposals.proposal import Proposal, ProposedElement
from gtlayout.scene import Camera, Element, ImageArray
from gtlayout.solution import Solution


def propose(
    solution: Solution, frame: int, config: ProposalConfig | None = None, *, image: ImageArray | None = None
) -> Proposal:
    """What would be drawn in one frame; in a key frame, as if that were not drawn.

    Args:
        solution: Of the key frames that are drawn.
        frame: Index into the scene's frames.
        config: Default when not given.
        image: (H, W, 3) uint8 BGR, undistorted: edges are moved to its lines, where such are near.
    """
    config = config or ProposalConfig()
    layout, camera = solution.layout, solution.scene.frames[frame].camera
    extents = known_extents(solution, frame)
    structure = predict(layout.planes, without_openings(layout.instances, extents), layout.instances, camera)
    everything = predict(layout.planes, extents, layout.instances, camera)
    seen = [
        drawable((structure if instance.host is None else everything).visible[i], camera, config)
        for i, instance in enumerate(layout.instances)
    ]
    outlines = {i: region for i, region in enumerate(seen) if not region.is_empty}
    around = Surroundings(layout.planes, layout.instances, solution.estimate.covariance, camera, outlines)
    hidden = occlusion_edges(
        as_prediction(outlines, layout.instances), layout.planes, layout.instances, camera, config.prediction
    )
    return Proposal(
        frame,
        tuple(_element(i, everything, around, config) for i in outlines),
        tuple(edge.points_px for edge in hidden),
        polygons(shapely.box(0, 0, camera.width, camera.height).difference(shapely.union_all(list(outlines.values())))),
    )


def known_extents(solution: Solution, frame: int) -> tuple[Extent, ...]:
    """The layout's extents; for a key frame, as all others see them."""
    scene, layout = solution.scene, solution.layout
    for k, key_frame in enumerate(scene.key_frames):
        if key_frame.frame == frame:
            (others,) = extents_without(scene, layout.instances, layout.planes, [k], solution.config.extent)
            return others
    return layout.extents


def without_openings(instances: Sequence[Instance], extents: Sequence[Extent]) -> list[Extent]:
    """The extents, empty for openings: their hosts are drawn through them."""
    nothing = MultiPolygon()
    return [
        extent if instance.host is None else replace(extent, region=nothing, unrefined=nothing)
        for instance, extent in zip(instances, extents, strict=True)
    ]


def as_prediction(outlines: Mapping[int, MultiPolygon], instances: Sequence[Instance]) -> Prediction:
    """The outlines of the structure, without openings, as what is seen."""
    seen = [
        outlines.get(i, MultiPolygon()) if instance.host is None else MultiPolygon()
        for i, instance in enumerate(instances)
    ]
    return Prediction(tuple(seen), tuple(seen))


def drawable(region: MultiPolygon, camera: Camera, config: ProposalConfig) -> MultiPolygon:
    """The region as a person would draw it: without threads and crumbs, and with few corners; it may be empty."""
    scale = camera.annotation_scale
    half, step = config.min_width_px * scale / 2, config.simplify_px * scale
    # Mitred, so that corners come back where they were.
    opened = region.buffer(-half, join_style="mitre").buffer(half, join_style="mitre").intersection(region)
    least = config.min_area * camera.width * camera.height
    kept = [part for part in polygons(shapely.simplify(polygons(opened), step)).geoms if part.area >= least]
    return MultiPolygon(kept)


def _element(instance: int, seen: Prediction, around: Surroundings, config: ProposalConfig) -> ProposedElement:
    named, outline = around.instances[instance], around.outlines[instance]
    edges = edges_of(instance, around, config)
    lengths = np.array([np.hypot(*(edge.end_px - edge.start_px)) for edge in edges])
    score = float(np.average([edge.confidence for edge in edges], weights=lengths))
    visible = polygons(outline.intersection(seen.visible[instance]))
    return ProposedElement(Element(named.name, named.label, outline, visible), instance, edges, score)
