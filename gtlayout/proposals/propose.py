"""What an annotator would draw in a frame, from the solved layout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.extent.extents import extents_without
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent, Instance, Plane
from gtlayout.prediction.predict import Prediction, occlusion_edges, predict
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.cover import cover
from gtlayout.proposals.edges import Surroundings, edges_of
from gtlayout.proposals.fill import filled
from gtlayout.proposals.seen import nearby_extents, seen_instances, weights_for
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
    scene, layout, camera = solution.scene, solution.layout, solution.scene.frames[frame].camera
    says = [k for k, key_frame in enumerate(scene.key_frames) if key_frame.frame != frame]
    weights = weights_for(solution, frame, config)
    extents = nearby_extents(solution, seen_instances(solution), weights) if config.mode else known_extents(solution, frame)
    grown = filled(scene, layout.instances, layout.planes, extents, says, config, solution.config.extent)
    everything = predict(layout.planes, extents, layout.instances, camera)
    outlines = composed(layout.planes, layout.instances, extents, grown, camera, config)
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


def composed(
    planes: Sequence[Plane],
    instances: Sequence[Instance],
    extents: Sequence[Extent],
    grown: Sequence[Extent],
    camera: Camera,
    config: ProposalConfig,
) -> dict[int, MultiPolygon]:
    """The outlines as they would be drawn, by instance: drawn extents win, what is filled takes the rest.

    The structure covers the image without overlaps, and is drawn through its openings, which lie above it.
    """
    known, more = (predict(planes, without_openings(instances, e), instances, camera).visible for e in (extents, grown))
    image, scale = shapely.box(0, 0, camera.width, camera.height), camera.annotation_scale
    rest = image.difference(shapely.union_all(known))
    structure = {
        i: without_crumbs(polygons(shapely.union(known[i], more[i].intersection(rest))), camera, config)
        for i, instance in enumerate(instances)
        if instance.host is None
    }
    structure = {i: region for i, region in structure.items() if not region.is_empty}
    inverse = {i: inverse_depth(planes[i], camera) for i in structure}
    outlines = cover(structure, image, inverse, config.gap_px * scale, config.simplify_px * scale) if structure else {}
    openings = predict(planes, grown, instances, camera).visible
    for i, instance in enumerate(instances):
        if instance.host is not None and instance.host in outlines:
            opening = without_crumbs(polygons(openings[i].intersection(outlines[instance.host])), camera, config)
            outlines[i] = polygons(shapely.simplify(opening, config.simplify_px * scale))
    return {i: outlines[i] for i in sorted(outlines) if not outlines[i].is_empty}


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


def without_crumbs(region: MultiPolygon, camera: Camera, config: ProposalConfig) -> MultiPolygon:
    """The region without threads and small pieces, which nobody would draw; it may be empty."""
    half = config.min_width_px * camera.annotation_scale / 2
    # Mitred, so that corners come back where they were.
    opened = region.buffer(-half, join_style="mitre").buffer(half, join_style="mitre").intersection(region)
    least = config.min_area * camera.width * camera.height
    return MultiPolygon([part for part in polygons(opened).geoms if part.area >= least])


def _element(instance: int, seen: Prediction, around: Surroundings, config: ProposalConfig) -> ProposedElement:
    named, outline = around.instances[instance], around.outlines[instance]
    edges = edges_of(instance, around, config)
    lengths = np.array([np.hypot(*(edge.end_px - edge.start_px)) for edge in edges])
    score = float(np.average([edge.confidence for edge in edges], weights=lengths))
    visible = polygons(outline.intersection(seen.visible[instance]))
    return ProposedElement(Element(named.name, named.label, outline, visible), instance, edges, score)
