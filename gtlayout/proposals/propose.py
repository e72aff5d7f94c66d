"""What an annotator would draw in a frame, from the solved layout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.polygons import polygons
from gtlayout.instances import Extent
from gtlayout.prediction.predict import Prediction, occlusion_edges, outline, predict
from gtlayout.proposals.config import ProposalConfig
from gtlayout.proposals.cover import cover
from gtlayout.proposals.edges import Surroundings, edges_of, with_snapped
from gtlayout.proposals.fill import filled
from gtlayout.proposals.outlines import GRID_PX, on_grid
from gtlayout.proposals.proposal import Proposal, ProposedEdge, ProposedElement
from gtlayout.proposals.seen import SeenInstance, nearby_extents, seen_instances, weights_in
from gtlayout.proposals.snapping import image_lines, snap
from gtlayout.scene import Camera, Element, FloatArray, ImageArray
from gtlayout.solution import Solution


def propose(
    solution: Solution, frame: int, config: ProposalConfig | None = None, *, image: ImageArray | None = None
) -> Proposal:
    """What would be drawn in one frame; in a key frame, as if that were not drawn. ``Proposer`` does several quicker.

    Args:
        solution: Of the key frames that are drawn.
        frame: Index into the scene's frames.
        config: The default when not given.
        image: (H, W, 3) uint8 BGR, undistorted: edges are moved to its lines, where such are near.
    """
    return Proposer(solution, config or ProposalConfig()).propose(frame, image)


@dataclass(frozen=True)
class Proposer:
    """Proposes any frame of one solution."""

    solution: Solution
    config: ProposalConfig

    @cached_property
    def seen(self) -> tuple[SeenInstance | None, ...]:
        """What the key frames say of each instance."""
        return seen_instances(self.solution, self.config.fill)

    def propose(self, frame: int, image: ImageArray | None = None) -> Proposal:
        """See ``propose``."""
        scene, layout, config = self.solution.scene, self.solution.layout, self.config
        camera = scene.frames[frame].camera
        weights = weights_in(self.solution, frame, config)
        extents = nearby_extents(self.solution, self.seen, weights)
        grown = filled(self.solution, self.seen, extents, np.nonzero(weights)[0].tolist(), config.fill)
        known = self._seen_by(camera, extents)
        outlines = self._outlines(camera, known, self._seen_by(camera, grown))
        around = Surroundings(
            layout.planes,
            layout.instances,
            self.solution.estimate.covariance,
            camera,
            outlines,
            known,
            self._nearest(weights),
        )
        edges = {i: edges_of(i, around, config) for i in outlines}
        if image is not None:
            outlines = snap(outlines, camera, image_lines(image), config.snap)
            edges = {i: with_snapped(edges[i], outlines[i]) for i in outlines}
        structure = [
            outlines.get(i, MultiPolygon()) if one.host is None else MultiPolygon()
            for i, one in enumerate(layout.instances)
        ]
        hidden = occlusion_edges(
            Prediction(tuple(structure), tuple(structure)), layout.planes, layout.instances, camera, config.prediction
        )
        image_area = shapely.box(0, 0, camera.width, camera.height)
        return Proposal(
            frame,
            tuple(self._element(i, outlines, edges[i], weights, camera) for i in outlines),
            tuple(edge.points_px for edge in hidden),
            polygons(image_area.difference(shapely.union_all(structure))),
        )

    def _seen_by(self, camera: Camera, extents: Sequence[Extent]) -> tuple[MultiPolygon, ...]:
        """What is seen of each extent; of hosts through their openings, through which they are drawn."""
        planes, instances = self.solution.planes, self.solution.instances
        walls = [
            extent if instance.host is None else replace(extent, region=MultiPolygon())
            for instance, extent in zip(instances, extents, strict=True)
        ]
        structure, everything = (predict(planes, e, instances, camera).visible for e in (walls, extents))
        return tuple(
            both if instance.host is not None else wall
            for instance, wall, both in zip(instances, structure, everything, strict=True)
        )

    def _outlines(
        self, camera: Camera, known: Sequence[MultiPolygon], more: Sequence[MultiPolygon]
    ) -> dict[int, MultiPolygon]:
        """The outlines as they would be drawn, by instance: what is known wins, what is filled takes the rest.

        The structure covers the image without overlaps. Openings lie above their hosts.
        """
        config, scale, instances = self.config, camera.annotation_scale, self.solution.instances
        image = shapely.box(0, 0, camera.width, camera.height)
        hosts = [i for i, instance in enumerate(instances) if instance.host is None]
        rest = image.difference(shapely.union_all([known[i] for i in hosts]))
        structure = {
            i: _without_crumbs(polygons(shapely.union(known[i], more[i].intersection(rest))), camera, config)
            for i in hosts
        }
        structure = {i: region for i, region in structure.items() if not region.is_empty}
        inverse = {i: inverse_depth(self.solution.planes[i], camera) for i in structure}
        if structure:
            structure = cover(structure, image, inverse, config.gap_px * scale, config.simplify_px * scale)
        openings = {
            i: on_grid(
                shapely.simplify(
                    _without_crumbs(polygons(more[i].intersection(structure[instance.host])), camera, config),
                    config.simplify_opening_px * scale,
                )
            )
            for i, instance in enumerate(instances)
            if instance.host in structure
        }
        both = structure | openings
        return {i: both[i] for i in sorted(both) if not both[i].is_empty}

    def _element(
        self,
        index: int,
        outlines: Mapping[int, MultiPolygon],
        edges: tuple[ProposedEdge, ...],
        weights: FloatArray,
        camera: Camera,
    ) -> ProposedElement:
        """What is seen of it are the visible parts as the key frames show them, without openings.

        None, where no drawing has any: whole elements are tracked then, and those with visible parts would take over.
        """
        instances, seen = self.solution.instances, self.seen[index]
        visible = MultiPolygon()
        drawn = any(not one.visible.is_empty for key in self.solution.scene.key_frames for one in key.elements)
        if seen is not None and drawn:
            region = seen.visible(weights)
            visible = outline(Extent(seen.frame, region, region), camera)
            visible = polygons(shapely.simplify(visible, self.config.simplify_px * camera.annotation_scale))
        openings = shapely.union_all([region for i, region in outlines.items() if instances[i].host == index])
        free = shapely.difference(outlines[index], openings, grid_size=GRID_PX)
        visible = on_grid(_without_crumbs(polygons(visible.intersection(free)), camera, self.config))
        lengths = [float(np.hypot(*(edge.end_px - edge.start_px))) for edge in edges]
        score = float(np.average([edge.confidence for edge in edges], weights=lengths))
        element = Element(instances[index].name, instances[index].label, outlines[index], visible)
        return ProposedElement(element, index, edges, score)

    def _nearest(self, weights: FloatArray) -> dict[int, Camera]:
        nearest = {}
        for i, instance in enumerate(self.solution.instances):
            shown = [k for k, _ in instance.members if weights[k] > 0]
            if shown:
                nearest[i] = self.solution.scene.frame_of(max(shown, key=lambda k: weights[k])).camera
        return nearest


def _without_crumbs(region: MultiPolygon, camera: Camera, config: ProposalConfig) -> MultiPolygon:
    """The region without threads and small pieces, which nobody would draw; it may be empty."""
    half = config.min_width_px * camera.annotation_scale / 2
    # Mitred, so that corners come back where they were.
    with np.errstate(divide="ignore", invalid="ignore"):  # GEOS, where corners all but coincide
        opened = region.buffer(-half, join_style="mitre").buffer(half, join_style="mitre").intersection(region)
    least = config.min_area * camera.width * camera.height
    return MultiPolygon([part for part in polygons(opened).geoms if part.area >= least])
