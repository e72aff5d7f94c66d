"""Errors in a scene before it is solved: of the annotator's hand and of the cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
import shapely
from cyclopts import Parameter
from cyclopts.validators import Number
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation
from shapely import LineString, MultiPolygon, Polygon

from gtlayout.errors import GtlayoutError
from gtlayout.scene import BoolArray, Camera, Element, FloatArray, IntArray, KeyFrame, Label
from gtlayout.synth.motion import drift

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

CONFUSED: dict[Label, tuple[Label, ...]] = {
    "floor": ("wall",),
    "ceiling": ("slanted", "wall"),
    "wall": ("slanted", "door"),
    "slanted": ("wall", "ceiling"),
    "door": ("wall", "window"),
    "window": ("door", "wall"),
}
"""The label that each label is mistaken for."""
ON_LINE_PX = 0.05
"""Edges of neighbours count as one edge when they are no further apart."""
ON_BORDER_PX = 1e-6
MIN_ANGLE_RCOND = 0.1
"""Edges that meet at less than about 11° have no useful intersection: their corner moves with their mean."""
MIN_AREA_PX2 = 1.0
DRIFT_FRAMES = 15
"""The smooth part of camera errors changes its direction about once in this many frames."""
WHITE_SHARE = 0.1
"""Share of the camera errors' variance that is independent from frame to frame; the rest is smooth."""

NotNegative = Number(gte=0)
Share = Number(gte=0, lte=1)


@dataclass(frozen=True)
class AnnotatorErrors:
    """Errors of the annotator's hand; zero is a perfect annotator. All errors are independent of one another."""

    corner_sigma_px: Annotated[float, Parameter(name="--corner-error-px", validator=NotNegative)] = 1.5
    """σ of a corner per axis; elements that share the corner stay together."""
    edge_sigma_px: Annotated[float, Parameter(name="--edge-error-px", validator=NotNegative)] = 0.0
    """σ of a whole edge along its normal, one draw per edge and key frame; both its neighbours move alike."""
    missing_share: Annotated[float, Parameter(name="--missing", validator=Share)] = 0.0
    """Share of the elements that are not drawn."""
    swapped_share: Annotated[float, Parameter(name="--swapped", validator=Share)] = 0.0
    """Share of the elements with the label of something similar (a wall for a door, a slanted ceiling for a wall …)."""
    missing_occlusion_share: Annotated[float, Parameter(name="--missing-occlusion", validator=Share)] = 0.0
    """Share of the occlusion edges that are not drawn."""
    no_visible_share: Annotated[float, Parameter(name="--missing-visible", validator=Share)] = 0.0
    """Share of the elements whose visible parts are not drawn."""

    def __post_init__(self) -> None:
        """Refuse what is no error."""
        check_amounts(self)


@dataclass(frozen=True)
class CameraErrors:
    """How the written cameras differ from those the images were taken with: mostly slow drift, as of an SfM."""

    rotation_sigma_deg: Annotated[float, Parameter(name="--camera-rotation-error-deg", validator=NotNegative)] = 0.0
    """σ of the rotation about each camera axis."""
    position_sigma_m: Annotated[float, Parameter(name="--camera-position-error-m", validator=NotNegative)] = 0.0
    """σ of the camera's centre along each axis."""
    focal_sigma_share: Annotated[float, Parameter(name="--focal-error", validator=Share)] = 0.0
    """σ of the focal length as a share of it; the same for all frames."""

    def __post_init__(self) -> None:
        """Refuse what is no error."""
        check_amounts(self)


def disturb(key_frame: KeyFrame, camera: Camera, errors: AnnotatorErrors, rng: np.random.Generator) -> KeyFrame:
    """An exact annotation with the errors of a hand.

    Corners on the image border slide along it. Polygons stay valid and within the image; one that the errors would
    wipe out is left as it was. Ids are kept, so that the truth about an element, by its id, stays valid. Visible parts
    are drawn inside an element's border and are not moved.
    """
    corner, edge, swap, visible, missing, occlusion = rng.spawn(6)
    elements, lines = _moved(key_frame, camera, errors, corner, edge)
    share = missing.random(len(elements)), swap.random(len(elements)), visible.random(len(elements))
    kept = []
    for element, is_missing, is_swapped, is_unseen in zip(elements, *share, strict=True):
        wrong = CONFUSED[element.label][int(swap.integers(len(CONFUSED[element.label])))]
        drawn = replace(
            element,
            label=wrong if is_swapped < errors.swapped_share else element.label,
            visible=MultiPolygon() if is_unseen < errors.no_visible_share else element.visible,
        )
        if is_missing >= errors.missing_share:
            kept.append(drawn)
    drawn_lines = occlusion.random(len(lines)) >= errors.missing_occlusion_share
    return replace(
        key_frame,
        elements=tuple(kept),
        occlusion_edges=tuple(
            piece for line, drawn in zip(lines, drawn_lines, strict=True) if drawn for piece in _cut(line, camera)
        ),
    )


def disturb_cameras(cameras: tuple[Camera, ...], errors: CameraErrors, rng: np.random.Generator) -> tuple[Camera, ...]:
    """The cameras a reconstruction would report for these."""
    smooth_rng, white_rng, focal_rng = rng.spawn(3)
    smooth = drift(len(cameras), 6, DRIFT_FRAMES, smooth_rng)
    noise = np.sqrt(1 - WHITE_SHARE) * smooth + np.sqrt(WHITE_SHARE) * white_rng.standard_normal(smooth.shape)
    turns = Rotation.from_rotvec(np.deg2rad(errors.rotation_sigma_deg) * noise[:, :3]).as_matrix()
    focal = 1 + errors.focal_sigma_share * float(focal_rng.standard_normal())
    reported = []
    for camera, turn, shift in zip(cameras, turns, errors.position_sigma_m * noise[:, 3:], strict=True):
        R_cam_from_world = turn @ camera.R_cam_from_world
        t_cam_from_world = -R_cam_from_world @ (camera.center_world + shift)
        K = camera.K * np.array([[focal, 1, 1], [1, focal, 1], [1, 1, 1]])
        reported.append(replace(camera, K=K, R_cam_from_world=R_cam_from_world, t_cam_from_world=t_cam_from_world))
    return tuple(reported)


def check_amounts(amounts: DataclassInstance) -> None:
    """Raise GtlayoutError when a field of a parameter class is negative, or a share more than 1."""
    for field in fields(amounts):
        value = getattr(amounts, field.name)
        if not 0 <= value < np.inf:
            raise GtlayoutError(f"synthetic scene: {field.name} must not be negative")
        if field.name.endswith("_share") and value > 1:
            raise GtlayoutError(f"synthetic scene: {field.name} must be at most 1")


def _moved(
    key_frame: KeyFrame,
    camera: Camera,
    errors: AnnotatorErrors,
    corner_rng: np.random.Generator,
    edge_rng: np.random.Generator,
) -> tuple[list[Element], list[FloatArray]]:
    """The elements with their amodal polygons moved, and the occlusion edges, not yet cut at the image border."""
    rings = [
        [[np.array(ring.coords)[:-1] for ring in (part.exterior, *part.interiors)] for part in element.amodal.geoms]
        for element in key_frame.elements
    ]
    outlines = [_Outline(ring, closed=True) for parts in rings for part in parts for ring in part]
    outlines += [_Outline(line, closed=False) for line in key_frame.occlusion_edges]
    moved = iter(_by_hand(outlines, camera, errors, corner_rng, edge_rng))
    image = shapely.box(0, 0, camera.width, camera.height)
    elements = []
    for element, parts in zip(key_frame.elements, rings, strict=True):
        drawn = []
        for part, before in zip(parts, element.amodal.geoms, strict=True):
            shell, *holes = [next(moved) for _ in part]
            after = shapely.make_valid(Polygon(shell, holes), method="structure", keep_collapsed=False)
            pieces = _polygons(after & image)
            drawn += pieces or [before]
        # Parts that moved into each other become one.
        elements.append(replace(element, amodal=MultiPolygon(_polygons(shapely.union_all(drawn)))))
    return elements, list(moved)


@dataclass(frozen=True)
class _Outline:
    """A ring (without its closing point) or a polyline, (N, 2) px."""

    points: FloatArray
    closed: bool

    @property
    def edges(self) -> FloatArray:
        """(N, 2, 2) start and end of each edge, the n-th from point n on; (N - 1, 2, 2) when open."""
        edges = np.stack([self.points, np.roll(self.points, -1, axis=0)], axis=1)
        return edges if self.closed else edges[:-1]


def _by_hand(
    outlines: Sequence[_Outline],
    camera: Camera,
    errors: AnnotatorErrors,
    corner_rng: np.random.Generator,
    edge_rng: np.random.Generator,
) -> list[FloatArray]:
    """The outlines' points where the hand puts them, px; they may lie off the image."""
    size = np.array([camera.width, camera.height], np.float64)
    edges_of = [outline.edges for outline in outlines]
    edges = np.concatenate([np.empty((0, 2, 2)), *edges_of])
    group, normals = _lines(edges)
    offsets_px = errors.edge_sigma_px * edge_rng.standard_normal(group.max(initial=-1) + 1)[group]
    # An edge from the left border to the right one is no piece of the border.
    along_border: BoolArray = _on_border(edges, size).all(axis=1) & (np.ptp(edges, axis=1) < ON_BORDER_PX)
    offsets_px[along_border.any(axis=1)] = 0
    corner_shifts: dict[tuple[int, int], FloatArray] = {}
    moved = []
    first = 0
    for outline, own in zip(outlines, edges_of, strict=True):
        count = len(own)
        shifts = np.zeros_like(outline.points)
        for at, point in enumerate(outline.points):
            meeting = [first + edge % count for edge in (at - 1, at) if outline.closed or 0 <= edge < count]
            key = round(point[0] * 100), round(point[1] * 100)
            if key not in corner_shifts:
                corner_shifts[key] = corner_rng.normal(0, errors.corner_sigma_px, 2)
            to_both_edges = np.linalg.lstsq(normals[meeting], offsets_px[meeting], MIN_ANGLE_RCOND)[0]
            shifts[at] = to_both_edges + corner_shifts[key]
        # Where an edge leaves the image the hand slides along the border.
        moved.append(outline.points + np.where(_on_border(outline.points, size), 0, shifts))
        first += count
    return moved


def _on_border(points: FloatArray, size: FloatArray) -> BoolArray:
    """(…, 2): which coordinates of (…, 2) px lie on the image's border."""
    return (points < ON_BORDER_PX) | (points > size - ON_BORDER_PX)


def _lines(edges: FloatArray) -> tuple[IntArray, FloatArray]:
    """Which (N, 2, 2) edges are pieces of one edge: (N,) its number, and (N, 2) its unit normal.

    Neighbours share an edge wherever they lie on one line and overlap or touch, though one may have more corners on
    it than the other.
    """
    along = edges[:, 1] - edges[:, 0]
    lengths = np.linalg.norm(along, axis=1)
    along = along / np.maximum(lengths, 1e-12)[:, None]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    from_start = edges[None] - edges[:, None, :1]  # of edge i to both ends of edge j
    off = np.abs(np.einsum("ijek,ik->ije", from_start, normals)).max(axis=2)
    at = np.einsum("ijek,ik->ije", from_start, along)
    apart = np.maximum(at.min(axis=2) - lengths[:, None], -at.max(axis=2))
    one = (off < ON_LINE_PX) & (apart < ON_LINE_PX) & (lengths[:, None] >= lengths[None])
    _, group = connected_components(csr_array(one), directed=False)
    # The longest piece knows the direction best.
    order = np.argsort(-lengths, kind="stable")
    _, longest = np.unique(group[order], return_index=True)
    return group.astype(np.int64), normals[order[longest]][group]


def _cut(line: FloatArray, camera: Camera) -> list[FloatArray]:
    """The parts of a polyline within the image."""
    inside = LineString(line) & shapely.box(0, 0, camera.width, camera.height)
    return [np.array(part.coords) for part in shapely.get_parts(inside) if isinstance(part, LineString) and part.length]


def _polygons(geometry: shapely.Geometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon) and part.area >= MIN_AREA_PX2]
