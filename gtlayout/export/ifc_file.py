"""The entities of an IFC4 file that ``ifc`` is built from (ISO 16739-1:2018). The same calls give the same bytes."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from typing import Any

import ifcopenshell
import ifcopenshell.guid
import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.export.round_wall import ArcBody
from gtlayout.export.solid import Solid
from gtlayout.instances import PlaneFrame
from gtlayout.io.files import printable
from gtlayout.scene import FloatArray
from gtlayout.version import __version__

VIEW = "ViewDefinition [ReferenceView_V1.2]"
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "gtlayout")
_LABEL_CHARACTERS = 255
"""The longest IfcLabel."""
_GAP = 1e-7
"""Points of an outline closer than this, in the world's unit, are one."""
Typed = tuple[str, bool | float | str]
"""A value with the name of its IFC type."""


class IfcFile:
    """One file in the making. ``scene_name`` is part of all GUIDs."""

    def __init__(self, scene_name: str) -> None:
        self._file: Any = ifcopenshell.file(schema="IFC4")
        self._scene_name = scene_name
        header = self._file.header
        header.file_description.description = (VIEW,)
        header.file_name.name = "layout.ifc"
        # A time stamp would make the bytes differ.
        header.file_name.time_stamp = "1970-01-01T00:00:00"
        header.file_name.author = header.file_name.organization = ("",)
        header.file_name.originating_system = f"gtlayout {__version__}"
        header.file_name.authorization = ""
        self.context = self.make(
            "IfcGeometricRepresentationContext",
            ContextType="Model",
            CoordinateSpaceDimension=3,
            Precision=1e-5,
            WorldCoordinateSystem=self.axes(np.eye(4)),
        )
        self._contexts: dict[str, Any] = {}

    def text(self) -> str:
        """The file."""
        return str(self._file.to_string())

    def make(self, kind: str, *values: Any, **attributes: Any) -> Any:
        """Any entity."""
        return self._file.create_entity(kind, *values, **attributes)

    def root(self, kind: str, key: str, **attributes: Any) -> Any:
        """An entity with a GUID, which comes from the names of scene, kind and ``key``."""
        name = f"{self._scene_name}\n{kind}\n{key}".encode("utf-8", "backslashreplace").decode()
        guid = ifcopenshell.guid.compress(uuid.uuid5(_NAMESPACE, name).hex)
        return self._file.create_entity(kind, GlobalId=guid, **attributes)

    def units(self) -> Any:
        """Metres and radians."""
        kinds = {"LENGTH": "METRE", "AREA": "SQUARE_METRE", "VOLUME": "CUBIC_METRE", "PLANEANGLE": "RADIAN"}
        units = [self.make("IfcSIUnit", UnitType=f"{kind}UNIT", Name=name) for kind, name in kinds.items()]
        return self.make("IfcUnitAssignment", Units=units)

    def axes(self, matrix: FloatArray) -> Any:
        """The placement that a (4, 4) matrix describes."""
        return self.make(
            "IfcAxis2Placement3D",
            self.make("IfcCartesianPoint", matrix[:3, 3].tolist()),
            self.make("IfcDirection", matrix[:3, 2].tolist()),
            self.make("IfcDirection", matrix[:3, 0].tolist()),
        )

    def placement(self, frame: PlaneFrame | None, parent: Any | None, within: PlaneFrame | None) -> Any:
        """A frame, relative to that of the product ``parent``; None is the world's."""
        relative = np.eye(4) if frame is within else np.linalg.inv(_matrix(within)) @ _matrix(frame)
        return self.make("IfcLocalPlacement", parent and parent.ObjectPlacement, self.axes(relative))

    def extruded(self, region: MultiPolygon, depth: float) -> list[Any]:
        """Each polygon, ``depth`` deep against the normal."""
        down = self.make("IfcDirection", [0.0, 0.0, -1.0])
        solids = []
        for polygon in shapely.remove_repeated_points(region, _GAP).geoms:
            outer, *holes = (self.outline(ring) for ring in (polygon.exterior, *polygon.interiors))
            kind = "IfcArbitraryProfileDefWithVoids" if holes else "IfcArbitraryClosedProfileDef"
            profile = self.make(kind, ProfileType="AREA", OuterCurve=outer, **({"InnerCurves": holes} if holes else {}))
            position = self.axes(np.eye(4))
            solids.append(
                self.make("IfcExtrudedAreaSolid", profile, Position=position, ExtrudedDirection=down, Depth=depth)
            )
        return solids

    def swept(self, body: ArcBody, within: PlaneFrame) -> Any:
        """A ring's sector, swept upwards, in the frame ``within``."""
        half = (body.from_rad + body.to_rad) / 2
        turns = np.array([body.from_rad, half, body.to_rad])
        arc = np.column_stack([np.cos(turns), np.sin(turns)])
        corners = np.concatenate([body.inner * arc, body.outer * arc[::-1]])
        points = self.make("IfcCartesianPointList2D", corners.tolist())
        segments = [
            self.make("IfcArcIndex", [1, 2, 3]),
            self.make("IfcLineIndex", [3, 4]),
            self.make("IfcArcIndex", [4, 5, 6]),
            self.make("IfcLineIndex", [6, 1]),
        ]
        curve = self.make("IfcIndexedPolyCurve", Points=points, Segments=segments, SelfIntersect=False)
        profile = self.make("IfcArbitraryClosedProfileDef", ProfileType="AREA", OuterCurve=curve)
        return self.make(
            "IfcExtrudedAreaSolid",
            profile,
            Position=self.axes(np.linalg.inv(_matrix(within)) @ _matrix(body.frame)),
            ExtrudedDirection=self.make("IfcDirection", [0.0, 0.0, 1.0]),
            Depth=body.height,
        )

    def arc(self, body: ArcBody, within: PlaneFrame) -> Any:
        """The axis of a curved wall: the arc of its measured side at its foot, in the frame ``within``."""
        place = self.axes(np.linalg.inv(_matrix(within)) @ _matrix(body.frame))
        return self.make(
            "IfcTrimmedCurve",
            BasisCurve=self.make("IfcCircle", place, body.measured),
            Trim1=[self.make("IfcParameterValue", body.from_rad)],
            Trim2=[self.make("IfcParameterValue", body.to_rad)],
            SenseAgreement=True,
            MasterRepresentation="PARAMETER",
        )

    def outline(self, ring: shapely.LinearRing) -> Any:
        """A closed line in two dimensions."""
        points = [self.make("IfcCartesianPoint", point.tolist()) for point in shapely.get_coordinates(ring)[:-1]]
        return self.make("IfcPolyline", [*points, points[0]])

    def faceted(self, solid: Solid) -> Any:
        """A closed polyhedron."""
        points = self.make("IfcCartesianPointList3D", [point.tolist() for point in solid.points])
        faces = []
        for outer, *holes in solid.faces:
            rings = [[i + 1 for i in ring] for ring in (outer, *holes)]
            kind = "IfcIndexedPolygonalFaceWithVoids" if holes else "IfcIndexedPolygonalFace"
            faces.append(self.make(kind, rings[0], *([rings[1:]] if holes else [])))
        return self.make("IfcPolygonalFaceSet", points, Closed=True, Faces=faces)

    def shape(self, identifier: str, kind: str, items: Sequence[Any], view: str = "MODEL_VIEW") -> Any:
        """A representation of a product."""
        if identifier not in self._contexts:
            self._contexts[identifier] = self.make(
                "IfcGeometricRepresentationSubContext",
                ContextIdentifier=identifier,
                ContextType="Model",
                ParentContext=self.context,
                TargetView=view,
            )
        return self.make("IfcShapeRepresentation", self._contexts[identifier], identifier, kind, items)

    def shapes(self, *representations: Any) -> Any:
        """All representations of a product."""
        return self.make("IfcProductDefinitionShape", Representations=representations)

    def style(self, name: str, color: Sequence[int], transparency: float) -> Any:
        """A surface style; 0 to 255 a channel."""
        rgb = self.make("IfcColourRgb", None, *(channel / 255 for channel in color))
        shading = self.make("IfcSurfaceStyleShading", SurfaceColour=rgb, Transparency=transparency)
        return self.make("IfcSurfaceStyle", Name=name, Side="BOTH", Styles=[shading])

    def properties(
        self, product: Any, owner: str, name: str, values: Mapping[str, Typed], about: str | None = None
    ) -> None:
        """A property set of a product. ``owner`` is its name in GUIDs."""
        singles = [
            self.make("IfcPropertySingleValue", Name=self.label(key), NominalValue=self.make(kind, value))
            for key, (kind, value) in values.items()
        ]
        if singles:
            self._define(product, owner, "IfcPropertySet", name, HasProperties=singles, Description=about)

    def quantities(
        self, product: Any, owner: str, name: str, lengths: Mapping[str, float], areas: Mapping[str, float]
    ) -> None:
        """A quantity set of a product."""
        found = [self.make("IfcQuantityLength", Name=key, LengthValue=value) for key, value in lengths.items()]
        found += [self.make("IfcQuantityArea", Name=key, AreaValue=value) for key, value in areas.items()]
        if found:
            self._define(product, owner, "IfcElementQuantity", name, Quantities=found)

    def _define(self, product: Any, owner: str, kind: str, name: str, **attributes: Any) -> None:
        definition = self.root(kind, f"{name} {owner}", Name=name, **attributes)
        self.root(
            "IfcRelDefinesByProperties",
            f"{name} {owner}",
            RelatedObjects=[product],
            RelatingPropertyDefinition=definition,
        )

    @staticmethod
    def label(text: str) -> str:
        """A text as an IfcLabel holds it."""
        return printable(text)[:_LABEL_CHARACTERS]


def _matrix(frame: PlaneFrame | None) -> FloatArray:
    """(4, 4) from the plane's coordinates (u, v, along the normal) to the model's."""
    matrix = np.eye(4)
    if frame is not None:
        matrix[:3, :3] = np.stack([*frame.axes, np.cross(*frame.axes)], axis=1)
        matrix[:3, 3] = frame.origin
    return matrix
