"""The content of layout.json: the types of its parts, and their JSON schema.

``python -m gtlayout.results.layout_format > docs/layout.schema.json`` writes the schema that the documentation shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, NotRequired, TypedDict

from gtlayout.accuracy import Status
from gtlayout.instances import DimensionKind, QuantityKind, Support
from gtlayout.io.files import json_text
from gtlayout.io.json_schema import OrNull, Schema, Shape, schema_of
from gtlayout.measurement import MeasuredKind
from gtlayout.quality.headline import Word
from gtlayout.quality.measures import Prediction, Verdict
from gtlayout.scene import FloatArray, IntArray, Label

Format = Literal["gtlayout-layout/6"]
FORMAT: Format = "gtlayout-layout/6"
BEFORE_CURVED = "gtlayout-layout/5"
"""The same without curved walls; it is read, too."""

_NUMBER_OR_NULL = {"type": ["number", "null"]}
NumberOrNull = Annotated[float, OrNull()]
Points = Annotated[FloatArray, Shape((None, 3))]


class Member(TypedDict):
    """One element, drawn in a key frame, that shows the instance."""

    image: str
    """File name of the key frame's image."""
    element: str
    """The annotator's id in that key frame."""


class PlaneRow(TypedDict):
    """normal · X + d = 0 in the world frame of the cameras."""

    normal: Annotated[FloatArray, Shape((3,), _NUMBER_OR_NULL)]
    """Unit normal, towards the cameras; nulls when the plane is not placed."""
    d: NumberOrNull
    """World unit."""
    covariance: Annotated[FloatArray, Shape((4, 4), _NUMBER_OR_NULL)]
    """Of (normal, normal · anchor + d) in the world frame; rank 3; nulls when the plane is not placed."""
    anchor: Annotated[FloatArray, Shape((3,))]
    """The world's origin, or, where that is so far away that (normal, d) loses digits, a point amid the cameras."""
    observable: bool
    """False when nothing but priors determines the plane: its numbers then mean nothing."""
    note: str
    """Why it is not observable; empty when it is."""
    support: Annotated[dict[str, Any], Support]
    """What it is solved from."""
    sigma_normal_deg: NumberOrNull
    """σ of the normal's direction, degrees: the larger of its two principal axes."""
    sigma_depth: NumberOrNull
    """σ of the depth at the centroid of the largest element, world unit."""


class AccuracyRow(TypedDict):
    """How accurate it is represented, against the level of accuracy that was asked for."""

    error_95_m: NumberOrNull
    """It is off by at most so much with a probability of 95 %, metres; null where that is not known."""
    level: int
    """The finest level (USIBD LOA) that it reaches: 40, 30, 20 or 10; 0 when it reaches none."""
    status: Status
    """As accurate as asked, less, not known, or never seen."""
    wanted: int
    """The level that was asked for."""


class FlatnessRow(TypedDict):
    """How far a surface bends, and whether DIN 18202, table 3, permits it."""

    deviation: NumberOrNull
    """Amid the measuring distance, from the straight line between its ends, world unit; positive where it bulges into
    the room; null where too few tracks cover it."""
    sigma: NumberOrNull
    """World unit."""
    distance: NumberOrNull
    """The measuring distance: as far as tracks cover the surface, world unit."""
    limit_m: NumberOrNull
    """What is permitted over that distance, metres; null without a unit."""
    line: int
    """Of the table: 3 for floors, 6 for walls and ceilings."""
    status: Status
    """Less than permitted, more, or not known."""


class NextMeasurementRow(TypedDict):
    """The dimension to measure by hand next."""

    dimension: int
    """Its place in the list of dimensions, from 0 on."""
    within: int
    """Dimensions that are as accurate as asked now."""
    reached: int
    """And would be then. Both are 0 where the scene has no unit yet, which the measurement gives it."""
    of: int
    """Dimensions in all."""


class CylinderRow(TypedDict):
    """The upright cylinder that a curved wall is part of, in the world frame of the cameras."""

    axis_point: Annotated[FloatArray, Shape((3,))]
    """A point of its axis."""
    axis: Annotated[FloatArray, Shape((3,))]
    """Unit vector along the axis, upwards."""
    radius: float
    """World unit."""
    sigma_radius: float
    """σ of the radius, world unit."""
    angles: Annotated[FloatArray, Shape((2,))]
    """From where to where about the axis the wall goes, radians: counter-clockwise from above, from the first of
    ``axes`` on."""
    concave: bool
    """Whether cameras see it from within, as that of a bay."""
    origin: Annotated[FloatArray, Shape((3,))]
    """A point amid the wall, to which the values refer."""
    axes: Annotated[FloatArray, Shape((3, 3))]
    """Unit vectors, rows: two level ones, and upwards."""
    values: Annotated[FloatArray, Shape((5,))]
    """Where the axis passes through the level of ``origin``, along both level axes; the radius; and how far the axis
    leans along them per unit of height."""
    covariance: Annotated[FloatArray, Shape((5, 5))]
    """Of the values."""
    middle: float
    """The angle at which the extent's own frame touches the cylinder, radians."""
    facet: float
    """Width of the mesh's facets along the arc, world unit."""


class ExtentRow(TypedDict):
    """The finite part of the plane, or of the cylinder, that the instance covers."""

    area: float
    """Square world units."""
    origin: Annotated[FloatArray, Shape((3,), _NUMBER_OR_NULL)]
    """Of the plane's own 2D frame, in the world; of a curved wall that of the plane that touches it in its middle."""
    axes: Annotated[FloatArray, Shape((2, 3), _NUMBER_OR_NULL)]
    """Unit vectors u and v of that frame, in the world; u × v is the normal."""
    polygons: list[list[Points]]
    """Polygons, each an outer ring and its holes, each ring 3D points without the repeated last one; of a curved wall
    with a point at each border of a facet."""
    unrefined: list[list[Points]]
    """The same before refinement: what the key frames' unprojected elements agree on, by vote."""
    unknown_area: float
    """Area that is drawn where the depth is not known, and is left out; square world units."""
    inferred: list[list[Points]] | None
    """What closes the room where nobody looked, beside ``polygons``; null where nobody asked for it."""


class InstanceRow(TypedDict):
    """One wall, floor, ceiling, slanted surface, door or window."""

    name: str
    """Label and a running number, unique in the file."""
    label: Label
    host: str | None
    """For doors and windows: name of the instance whose plane they lie in; null when they have none."""
    members: list[Member]
    """The elements that show it, at most one per key frame."""
    plane: PlaneRow
    """Of a curved wall the plane that fits it best, which it is not."""
    cylinder: CylinderRow | None
    """What a curved wall is; null of all others."""
    extent: ExtentRow
    accuracy: AccuracyRow | None
    """Of its surface, over the whole extent; null where nobody asked."""
    flatness: NotRequired[FlatnessRow | None]
    """Null for doors and windows, and where nobody asked. Absent from files of earlier versions."""
    iou: NumberOrNull
    """Mean reprojection IoU over the key frames that show it."""
    verdict: Verdict
    reason: str
    """Why the verdict is not ok; empty when it is."""
    causes: Sequence[str]
    """What makes it uncertain, the most important first."""


class DimensionRow(TypedDict):
    """A length in the room: of two instances that face each other, or of a door or window."""

    kind: DimensionKind
    """Floor to ceiling, wall to wall, of a door or window, or of a window's lower edge over the floor."""
    between: Annotated[list[str], Shape((2,), {"type": "string"})]
    """Names of both instances, of a height or sill the floor first; a door or window twice for its own width or
    height."""
    length: float
    """World unit."""
    sigma: NumberOrNull
    """σ of the length, world unit; from the joint covariance of all planes, and what drawing leaves."""
    ends: Annotated[FloatArray, Shape((2, 3))]
    """Where it is measured: a point on each."""
    accuracy: AccuracyRow | None
    """Null where nobody asked."""


class QuantityRow(TypedDict):
    """An area or a volume, of what was seen."""

    kind: QuantityKind
    """Wall area is without doors and windows; volume is floor area times the height to the ceiling."""
    of: list[str]
    """Names of the floors or walls; of a volume the floor and its ceiling."""
    amount: float
    """World units, squared or cubed."""
    sigma: NumberOrNull
    """In the same unit."""
    closed: bool
    """Whether its outline ends at other surfaces all around; if not, the room has at least so much."""


class ScaleRow(TypedDict):
    """Metres in a unit of the given cameras, by what was measured. The file is in metres."""

    factor: float
    sigma_share: float
    """σ of the factor, as a share of it."""
    gave_unit: bool
    """Whether the scene had no unit without it. Its depth maps and true planes are in the units of its files."""


class MeasurementRow(TypedDict):
    """What was measured by hand, beside what everything else says. Lengths in metres, angles in degrees."""

    kind: MeasuredKind
    of: list[str]
    """Names of the instances, when it was measured."""
    value: float
    sigma: float
    assumed: bool
    """Taken for granted and not measured."""
    predicted: NumberOrNull
    """By the video and all other measurements."""
    predicted_sigma: NumberOrNull
    used: bool
    """False when it contradicts them."""


class MeshRow(TypedDict):
    """Triangles that share their vertices where instances touch."""

    vertices: Points
    """World."""
    vertex_sigma: Annotated[FloatArray, Shape((None,), _NUMBER_OR_NULL)]
    """σ along the normal at each vertex, the largest of the instances that share it, world unit."""
    faces: Annotated[IntArray, Shape((None, 3), {"type": "integer", "minimum": 0})]
    """Indices of vertices, counter-clockwise seen from the cameras."""
    face_instance: list[str]
    """Name of the instance that each face belongs to."""


class HeadlineRow(TypedDict):
    """The verdict on the scene in a word, with its reasons."""

    word: Word
    """Use it as it is; look at what is named first; not usable without new elements or cameras."""
    reasons: Sequence[str]
    """Sentences that name a frame, an element or an instance, and a number; the most important first."""


class LayoutFile(TypedDict):
    """A solved room: planes with their uncertainty, extents, dimensions, mesh and verdicts. Null = not known."""

    format: Format
    version: str
    """Of gtlayout."""
    seed: int
    metric: bool
    """True when the world unit is the metre."""
    unit: Literal["m", "scene unit"]
    """Of all lengths."""
    convention: str
    """Signs, frames and the meaning of σ, in words."""
    headline: HeadlineRow
    """What to do with the scene, in a word, and why."""
    accepted: bool
    """Whether the reprojection IoU is at least 0.8."""
    predicted: Prediction
    """Whether the covariances show that the depth is known."""
    sigma_depth_share: float
    """Predicted σ of depth as a share of the depth: mean over all drawn pixels, 1 where nothing is known."""
    instances: list[InstanceRow]
    dimensions: list[DimensionRow]
    """Heights and widths of the room, and what doors and windows measure."""
    quantities: list[QuantityRow]
    """Areas and volumes."""
    scale: ScaleRow | None
    """Null where nothing was measured and nobody doubts the scale."""
    measurements: list[MeasurementRow]
    """What was measured by hand."""
    next_measurement: NextMeasurementRow | None
    """Null when all dimensions are as accurate as asked."""
    mesh: MeshRow


def layout_schema() -> Schema:
    """The JSON schema of layout.json."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": FORMAT}
    return head | schema_of(LayoutFile)


if __name__ == "__main__":
    print(json_text(layout_schema()), end="")
