"""IFC4: walls, slabs, coverings, doors and windows in their hosts, each with its σ (ISO 16739-1:2018).

A layout consists of surfaces, a building model of bodies. So each instance is its outline, extruded by a nominal
thickness *away* from the room. The face towards the room is measured; nothing behind it was seen. Walls therefore do
not close at the outer corners.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.guid
import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.colors import LABEL_COLORS
from gtlayout.export.facts import NOT_METRIC, Fact, facts, scene_facts
from gtlayout.export.upright import outline_in, turned, z_up_from_world
from gtlayout.instances import Extent, PlaneFrame
from gtlayout.io.files import printable, write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import OPENINGS, FloatArray, Label, Scene
from gtlayout.version import __version__

THICKNESS_M: dict[Label, float] = {"door": 0.04, "window": 0.04}
"""Nominal thickness of doors and windows."""
SHELL_THICKNESS_M = 0.1
"""Nominal thickness of all other instances."""
ROOM_M = 6.0
"""Assumed size of a scene that is not metric, by which its thicknesses are chosen."""
CLASSES: dict[Label, tuple[str, str]] = {
    "wall": ("IfcWall", "NOTDEFINED"),
    "floor": ("IfcSlab", "FLOOR"),
    "ceiling": ("IfcCovering", "CEILING"),
    "slanted": ("IfcSlab", "ROOF"),
    "door": ("IfcDoor", "DOOR"),
    "window": ("IfcWindow", "WINDOW"),
}
"""Class and PredefinedType of each label. What a wall is made of was not seen: NOTDEFINED."""
PROPERTIES = "gtlayout"
"""Name of the property sets; names that begin with Pset_ are reserved for buildingSMART's own."""
_LABEL_CHARACTERS = 255
"""The longest IfcLabel."""
_WORLD = PlaneFrame(np.zeros(3), np.eye(3)[:2])
_GAP = 1e-6
"""Points of an outline closer than this share of a metre are one."""


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write an IFC4 file: z up, the floor's normal turned to +z, nothing shifted. The same layout gives the same bytes.

    Unobservable instances have no place and are only named, in the properties of the space. For a scene that is not
    metric the project's description and each property set state so. GUIDs come from the names of scene folder and
    instance, so that they stay when a scene is solved again.

    Raises:
        GtlayoutError: the disk does not take the file.
    """
    write_atomic(path, _Model(scene, layout).text())


class _Model:
    """One file in the making."""

    def __init__(self, scene: Scene, layout: Layout) -> None:
        self._file: Any = ifcopenshell.file(schema="IFC4")
        self._scene, self._layout = scene, layout
        self._scene_name = scene.root.resolve().name
        rotation = z_up_from_world(scene, layout)
        self._extents = [turned(extent, rotation) for extent in layout.extents]
        self._scale = 1.0 if layout.metric else _size(self._extents) / ROOM_M
        self._header()
        self._project, self._context = self._units_and_context()
        self._storey = self._spaces()
        self._styles = {label: self._style(label) for label in dict.fromkeys(i.label for i in layout.instances)}
        self._products: dict[int, Any] = {}
        # Hosts first: what lies in them refers to their placement.
        openings = [i for i, instance in enumerate(layout.instances) if instance.label in OPENINGS]
        for i in [*(i for i in range(len(layout.instances)) if i not in openings), *openings]:
            if not self._extents[i].region.is_empty:
                self._products[i] = self._element(i)
        if self._products:
            self._relate(
                "IfcRelContainedInSpatialStructure",
                "contained",
                RelatedElements=list(self._products.values()),
                RelatingStructure=self._storey,
            )

    def text(self) -> str:
        """The file."""
        return str(self._file.to_string())

    def _header(self) -> None:
        header = self._file.header
        header.file_description.description = ("ViewDefinition [DesignTransferView_V1.0]",)
        header.file_name.name = "layout.ifc"
        # A time stamp would make the bytes differ.
        header.file_name.time_stamp = "1970-01-01T00:00:00"
        header.file_name.author = header.file_name.organization = ("",)
        header.file_name.originating_system = f"gtlayout {__version__}"
        header.file_name.authorization = ""

    def _units_and_context(self) -> tuple[Any, Any]:
        make = self._file.create_entity
        units = [
            make("IfcSIUnit", UnitType=kind, Name=name)
            for kind, name in (
                ("LENGTHUNIT", "METRE"),
                ("AREAUNIT", "SQUARE_METRE"),
                ("VOLUMEUNIT", "CUBIC_METRE"),
                ("PLANEANGLEUNIT", "RADIAN"),
            )
        ]
        context = make(
            "IfcGeometricRepresentationContext",
            ContextType="Model",
            CoordinateSpaceDimension=3,
            Precision=1e-5,
            WorldCoordinateSystem=self._axes(np.eye(4)),
        )
        body = make(
            "IfcGeometricRepresentationSubContext",
            ContextIdentifier="Body",
            ContextType="Model",
            ParentContext=context,
            TargetView="MODEL_VIEW",
        )
        project = self._root(
            "IfcProject",
            "project",
            Name=self._name(self._scene_name),
            Description=None if self._layout.metric else NOT_METRIC,
            RepresentationContexts=[context],
            UnitsInContext=make("IfcUnitAssignment", Units=units),
        )
        return project, body

    def _spaces(self) -> Any:
        """Project, site, building, storey and space, one in the other; the storey lies at the world's origin."""
        parent, placement = self._project, None
        for name in ("Site", "Building", "BuildingStorey", "Space"):
            placement = self._file.create_entity("IfcLocalPlacement", placement, self._axes(np.eye(4)))
            child = self._root(
                f"Ifc{name}", name, Name=name.lower(), ObjectPlacement=placement, CompositionType="ELEMENT"
            )
            self._relate("IfcRelAggregates", f"parts {name}", RelatingObject=parent, RelatedObjects=[child])
            storey, parent = parent, child
        self._properties(parent, "room", scene_facts(self._scene, self._layout))
        return storey

    def _element(self, i: int) -> Any:
        instance, plane, extent = self._layout.instances[i], self._layout.planes[i], self._extents[i]
        opening = None if instance.host not in self._products else self._opening(i, instance.host)
        if opening is None or instance.host is None:
            placement = self._placement(extent.frame, self._storey, _WORLD)
        else:
            placement = self._placement(extent.frame, opening, self._extents[instance.host].frame)
        thickness = THICKNESS_M.get(instance.label, SHELL_THICKNESS_M) * self._scale
        body = self._body(extent.region, 0.0, thickness)
        for solid in body.Representations[0].Items:
            self._file.create_entity("IfcStyledItem", Item=solid, Styles=[self._styles[instance.label]])
        kind, predefined = CLASSES[instance.label]
        product = self._root(
            kind,
            f"element {instance.name}",
            Name=self._name(instance.name),
            Description=self._name(plane.note) or None,
            ObjectPlacement=placement,
            Representation=body,
            PredefinedType=predefined,
            **(_overall(extent) if instance.label in OPENINGS else {}),
        )
        if opening is not None:
            self._relate(
                "IfcRelFillsElement",
                f"fills {instance.name}",
                RelatingOpeningElement=opening,
                RelatedBuildingElement=product,
            )
        known = facts(self._scene, self._layout, i)
        self._properties(product, instance.name, {**known, "nominal_thickness": thickness})
        return product

    def _opening(self, i: int, host_index: int) -> Any | None:
        """The hole in the host that a door or window fills, right through; None when its outline is a line there."""
        name, host = self._layout.instances[i].name, self._extents[host_index]
        outline = outline_in(host, self._extents[i])
        if outline.is_empty:
            return None
        through = SHELL_THICKNESS_M * self._scale
        opening = self._root(
            "IfcOpeningElement",
            f"opening {name}",
            Name=self._name(name),
            ObjectPlacement=self._placement(host.frame, self._products[host_index], host.frame),
            Representation=self._body(outline, 0.5 * through, 2 * through),
            PredefinedType="OPENING",
        )
        self._relate(
            "IfcRelVoidsElement",
            f"voids {name}",
            RelatingBuildingElement=self._products[host_index],
            RelatedOpeningElement=opening,
        )
        return opening

    def _body(self, region: MultiPolygon, front: float, depth: float) -> Any:
        """Each polygon from ``front`` before its plane (towards the room), ``depth`` deep."""
        make = self._file.create_entity
        down = self._direction([0.0, 0.0, -1.0])
        at = np.eye(4)
        at[2, 3] = front
        solids = []
        for polygon in shapely.remove_repeated_points(region, _GAP * self._scale).geoms:
            outer, *holes = (self._ring(ring) for ring in (polygon.exterior, *polygon.interiors))
            kind = "IfcArbitraryProfileDefWithVoids" if holes else "IfcArbitraryClosedProfileDef"
            profile = make(kind, ProfileType="AREA", OuterCurve=outer, **({"InnerCurves": holes} if holes else {}))
            solids.append(
                make("IfcExtrudedAreaSolid", profile, Position=self._axes(at), ExtrudedDirection=down, Depth=depth)
            )
        shape = make("IfcShapeRepresentation", self._context, "Body", "SweptSolid", solids)
        return make("IfcProductDefinitionShape", Representations=[shape])

    def _ring(self, ring: shapely.LinearRing) -> Any:
        points = [
            self._file.create_entity("IfcCartesianPoint", [float(u), float(v)])
            for u, v in shapely.get_coordinates(ring)[:-1]
        ]
        return self._file.create_entity("IfcPolyline", [*points, points[0]])

    def _placement(self, frame: PlaneFrame, parent: Any, within: PlaneFrame) -> Any:
        """A plane's frame, relative to that of another product, or of the storey, which is the world's."""
        relative = np.eye(4) if frame is within else np.linalg.inv(_matrix(within)) @ _matrix(frame)
        return self._file.create_entity("IfcLocalPlacement", parent.ObjectPlacement, self._axes(relative))

    def _axes(self, matrix: FloatArray) -> Any:
        return self._file.create_entity(
            "IfcAxis2Placement3D",
            self._file.create_entity("IfcCartesianPoint", matrix[:3, 3].tolist()),
            self._direction(matrix[:3, 2].tolist()),
            self._direction(matrix[:3, 0].tolist()),
        )

    def _direction(self, ratios: Sequence[float]) -> Any:
        return self._file.create_entity("IfcDirection", list(ratios))

    def _style(self, label: Label) -> Any:
        make = self._file.create_entity
        color = make("IfcColourRgb", None, *(channel / 255 for channel in LABEL_COLORS[label]))
        shading = make("IfcSurfaceStyleShading", SurfaceColour=color, Transparency=0.0)
        return make("IfcSurfaceStyle", Name=label, Side="BOTH", Styles=[shading])

    def _properties(self, product: Any, name: str, values: Mapping[str, Fact]) -> None:
        make = self._file.create_entity
        kinds = {bool: "IfcBoolean", float: "IfcReal", str: "IfcText"}
        properties = [
            make("IfcPropertySingleValue", Name=self._name(key), NominalValue=make(kinds[type(value)], value))
            for key, value in values.items()
        ]
        definition = self._root("IfcPropertySet", f"properties {name}", Name=PROPERTIES, HasProperties=properties)
        self._relate(
            "IfcRelDefinesByProperties",
            f"defines {name}",
            RelatedObjects=[product],
            RelatingPropertyDefinition=definition,
        )

    def _relate(self, kind: str, key: str, **attributes: Any) -> None:
        self._root(kind, key, **attributes)

    def _root(self, kind: str, key: str, **attributes: Any) -> Any:
        guid = hashlib.sha256(f"{self._scene_name}\n{kind}\n{key}".encode("utf-8", "replace")).hexdigest()[:32]
        return self._file.create_entity(kind, GlobalId=ifcopenshell.guid.compress(guid), **attributes)

    def _name(self, name: str) -> str:
        return printable(name)[:_LABEL_CHARACTERS]


def _matrix(frame: PlaneFrame) -> FloatArray:
    """(4, 4) from the plane's coordinates (u, v, along the normal) to the model's."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([*frame.axes, np.cross(*frame.axes)], axis=1)
    matrix[:3, 3] = frame.origin
    return matrix


def _overall(extent: Extent) -> dict[str, float]:
    """Height, as far upwards as the plane goes, and width of the rectangle about a door or window."""
    points = extent.frame.to_world(shapely.get_coordinates(extent.region))
    normal = np.cross(*extent.frame.axes)
    along = np.cross([0.0, 0.0, 1.0], normal)
    along = extent.frame.axes[0] if np.linalg.norm(along) < 1e-6 else along / np.linalg.norm(along)
    return {
        "OverallHeight": float(np.ptp(points @ np.cross(normal, along))),
        "OverallWidth": float(np.ptp(points @ along)),
    }


def _size(extents: Sequence[Extent]) -> float:
    """Length of the box's diagonal about everything; 1 for nothing."""
    points = [extent.frame.to_world(shapely.get_coordinates(extent.region)) for extent in extents]
    everything = np.concatenate(points) if points else np.empty((0, 3))
    return float(np.linalg.norm(np.ptp(everything, axis=0))) if len(everything) else 1.0
