"""What an IFC file's property sets say about rooms and about accuracy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely

from gtlayout.accuracy import Status
from gtlayout.export.building import Room
from gtlayout.export.facts import Fact
from gtlayout.export.ifc_file import Typed
from gtlayout.geometry.strip import sigma_along_normal, strip_of
from gtlayout.io.files import printable
from gtlayout.layout import Layout
from gtlayout.quality.assess import assess
from gtlayout.quality.config import QualityConfig
from gtlayout.scene import Scene

ACCURACY = "GTLayout_Accuracy"
"""Name of the property set."""
ACCURACY_IS = (
    "Represented accuracy of the face towards the room; its thickness is nominal. One σ, the largest over the face. "
    "LevelOfAccuracy: USIBD Level of Accuracy 3.0, at 95 % confidence."
)
NOT_SEEN = "Not seen: it closes the room where nobody looked."
_INFERRED: Status = "inferred"
_TYPES = {bool: "IfcBoolean", float: "IfcReal", str: "IfcText"}


def accuracy_values(layout: Layout, i: int, verdict: str | None) -> dict[str, Typed]:
    """How well one instance is known. Lengths in the world's unit; the error at 95 % is known in metres only.

    What is not known is left out; level, status and error are known where ``Layout.accuracies`` has them.
    """
    plane, extent = layout.planes[i], layout.extents[i]
    values: dict[str, Typed] = {}
    along = sigma_along_normal(plane, extent, extent.frame.to_world(shapely.get_coordinates(extent.region)))
    if np.isfinite(along).all():
        # The variance is convex over the plane: it is largest at a corner.
        values["SigmaAlongNormal"] = ("IfcLengthMeasure", float(along.max()))
    strip = strip_of(extent)
    sigma_normal_deg = plane.sigma_normal_deg if strip is None else strip.cylinder.sigma_normal_deg
    if np.isfinite(sigma_normal_deg):
        values["SigmaOfNormalDegrees"] = ("IfcReal", sigma_normal_deg)
    if layout.accuracies:
        accuracy = layout.accuracies[i]
        if np.isfinite(accuracy.error_95_m):
            values["ErrorAt95Percent"] = ("IfcLengthMeasure", accuracy.error_95_m)
        values["LevelOfAccuracy"] = ("IfcLabel", f"LOA{accuracy.level}" if accuracy.level else "none")
        values["Status"] = ("IfcLabel", accuracy.status)
    if verdict is not None:
        values["Verdict"] = ("IfcLabel", verdict)
    return values


def inferred_accuracy() -> dict[str, Typed]:
    """Of what was not seen."""
    return {"LevelOfAccuracy": ("IfcLabel", "none"), "Status": ("IfcLabel", _INFERRED)}


def room_facts(layout: Layout, room: Room) -> dict[str, Fact]:
    """What is known of a room; lengths and areas in the world's unit."""
    names = [instance.name for instance in layout.instances]
    known: dict[str, Fact] = {
        "floor": printable(names[room.floor]),
        "floor_area_measured": room.outline.area - room.inferred_area,
        "floor_area_inferred": room.inferred_area,
        "metric": layout.metric,
    }
    if room.height is not None:
        known["ceiling"] = printable(names[room.height.second])
        known["height"] = room.height.length
        if np.isfinite(room.height.sigma):
            known["sigma_height"] = room.height.sigma
    if room.left_out:
        known["not_bounding_the_body"] = printable(", ".join(names[i] for i in room.left_out))
    return known


def typed(values: Mapping[str, Fact]) -> dict[str, Typed]:
    """Facts with their IFC types."""
    return {key: (_TYPES[type(value)], value) for key, value in values.items()}


def verdicts(scene: Scene, layout: Layout) -> list[str]:
    """Of each instance, with the default settings; none where nothing is drawn to judge it by."""
    if not any(key_frame.elements for key_frame in scene.key_frames):
        return []
    quality = assess(scene, layout.instances, layout.planes, layout.extents, QualityConfig())
    return [one.verdict for one in quality.instances]
