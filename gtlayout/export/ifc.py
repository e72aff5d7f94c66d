"""IFC4: bodies behind walls, floors and ceilings, doors and windows in their openings, rooms, each with its accuracy.

A layout consists of surfaces, a building model of bodies (ISO 16739-1:2018). The face towards the room is measured;
nothing behind it was seen, so a body has a nominal thickness *away* from the room (``shell``). As in buildingSMART's
Reference View, shapes are swept solids and polyhedra, and openings are cut from them already.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gtlayout.colors import LABEL_COLORS
from gtlayout.export.building import Opening, Part, Room, openings, overall, parts, rooms, size_of
from gtlayout.export.facts import NOT_METRIC, Fact, facts, scene_facts
from gtlayout.export.ifc_facts import (
    ACCURACY,
    ACCURACY_IS,
    NOT_SEEN,
    accuracy_values,
    inferred_accuracy,
    room_facts,
    typed,
    verdicts,
)
from gtlayout.export.ifc_file import IfcFile
from gtlayout.export.upright import turned, z_up_from_world
from gtlayout.geometry.strip import strip_of
from gtlayout.io.files import write_atomic
from gtlayout.layout import Layout
from gtlayout.scene import OPENINGS, Label, Scene

THICKNESS_M: dict[Label, float] = {"door": 0.04, "window": 0.04}
"""Nominal thickness of doors and windows."""
SHELL_THICKNESS_M = 0.1
"""Nominal thickness of all other instances."""
ROOM_M = 6.0
"""Assumed size of a scene that is not metric, by which its thicknesses are chosen."""
CLASSES: dict[Label, tuple[str, str, str]] = {
    "wall": ("IfcWall", "NOTDEFINED", "Qto_WallBaseQuantities"),
    "floor": ("IfcSlab", "FLOOR", "Qto_SlabBaseQuantities"),
    "ceiling": ("IfcCovering", "CEILING", "Qto_CoveringBaseQuantities"),
    "slanted": ("IfcSlab", "ROOF", "Qto_SlabBaseQuantities"),
    "door": ("IfcDoor", "DOOR", "Qto_DoorBaseQuantities"),
    "window": ("IfcWindow", "WINDOW", "Qto_WindowBaseQuantities"),
}
"""Class, PredefinedType and quantity set of each label. What a wall is made of was not seen: NOTDEFINED."""
PROPERTIES = "gtlayout"
"""Name of the property sets; names that begin with Pset_ are reserved for buildingSMART's own."""
INFERRED, MEASURED = "inferred", "measured"
"""Names of the presentation layers; the first is a material's, too."""
INFERRED_TRANSPARENCY = 0.6
NO_NORTH = (
    "Position on earth, height above sea level and true north are unknown: neither the origin nor the direction of any "
    "axis but z means anything."
)
NO_FLOOR = "none: no floor is placed, so outline, area and height of the room are unknown"


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write an IFC4 file: z up, the floor's normal turned to +z, nothing shifted. The same layout gives the same bytes.

    Unobservable instances have no place and are only named, in the properties of the storey. For a scene that is not
    metric the project's description and each property set state so. GUIDs come from the names of scene folder and
    instance, so that they stay when a scene is solved again.

    Raises:
        GtlayoutError: the disk does not take the file.
    """
    write_atomic(path, _Model(scene, layout).text())


class _Model:
    """One file in the making."""

    def __init__(self, scene: Scene, layout: Layout) -> None:
        name = scene.root.resolve().name
        self._file = IfcFile(name)
        self._scene, self._layout = scene, layout
        rotation = z_up_from_world(scene, layout)
        self._extents = [turned(extent, rotation) for extent in layout.extents]
        inferred = [turned(extent, rotation) for extent in layout.inferred]
        self._scale = 1.0 if layout.metric else size_of(self._extents) / ROOM_M
        self._thickness = SHELL_THICKNESS_M * self._scale
        self._verdicts = verdicts(scene, layout)
        self._layers: dict[str, list[Any]] = {}
        self._styles: dict[tuple[Label, bool], Any] = {}
        above_floors = rooms(layout, self._extents, inferred, self._thickness)
        self._storey = self._spatial_structure(name, bool(above_floors))
        spaces = [self._space(*one) for one in enumerate(above_floors)]
        if spaces:
            self._aggregate(self._storey, "spaces", spaces)
        holes = openings(layout, self._extents)
        made = parts(layout, self._extents, inferred, list(holes.values()), self._thickness)
        products = [self._part(part) for part in made]
        hosts = {part.instance: product for part, product in zip(made, products, strict=True) if not part.inferred}
        fillings = [
            self._filling(i, holes.get(i), hosts[holes[i].host] if i in holes else None)
            for i, instance in enumerate(layout.instances)
            if instance.label in OPENINGS and not self._extents[i].region.is_empty
        ]
        self._gather(products + fillings, [one for part, one in zip(made, products, strict=True) if part.inferred])

    def text(self) -> str:
        """The file."""
        return self._file.text()

    def _spatial_structure(self, name: str, has_rooms: bool) -> Any:
        """Project, site, building and storey, one in the other; the storey lies at the world's origin."""
        parent = self._file.root(
            "IfcProject",
            "project",
            Name=self._file.label(name),
            Description=None if self._layout.metric else NOT_METRIC,
            RepresentationContexts=[self._file.context],
            UnitsInContext=self._file.units(),
        )
        above = None
        for kind in ("Site", "Building", "BuildingStorey"):
            child = self._file.root(
                f"Ifc{kind}",
                kind,
                Name=kind.lower(),
                Description=NO_NORTH if kind == "Site" else None,
                ObjectPlacement=self._file.placement(None, above, None),
                CompositionType="ELEMENT",
            )
            self._aggregate(parent, kind, [child])
            parent = above = child
        known = {**scene_facts(self._scene, self._layout), "nominal_thickness": self._thickness}
        if not has_rooms:
            known["rooms"] = NO_FLOOR
        self._file.properties(parent, "storey", PROPERTIES, typed(known))
        return parent

    def _aggregate(self, parent: Any, key: str, children: Sequence[Any]) -> None:
        self._file.root("IfcRelAggregates", f"parts {key}", RelatingObject=parent, RelatedObjects=children)

    def _space(self, number: int, room: Room) -> Any:
        name = self._layout.instances[room.floor].name
        curves = [self._file.outline(ring) for one in room.outline.geoms for ring in (one.exterior, *one.interiors)]
        outline = self._file.make("IfcGeometricCurveSet", curves)
        shapes = [self._file.shape("FootPrint", "GeometricCurveSet", [outline], "PLAN_VIEW")]
        if room.solids:
            shapes.append(self._file.shape("Body", "Tessellation", [self._file.faceted(one) for one in room.solids]))
        space = self._file.root(
            "IfcSpace",
            f"space {name}",
            Name=f"room_{number}",
            LongName=self._file.label(f"above {name}"),
            ObjectPlacement=self._file.placement(self._extents[room.floor].frame, self._storey, None),
            Representation=self._file.shapes(*shapes),
            CompositionType="ELEMENT",
            PredefinedType="INTERNAL",
        )
        height = dict.fromkeys(("Height", "FinishCeilingHeight"), room.height.length) if room.height else {}
        area = {"NetFloorArea": room.outline.area}
        self._file.quantities(space, f"space {name}", "Qto_SpaceBaseQuantities", height, area)
        known = room_facts(self._layout, room)
        self._file.properties(space, f"space {name}", PROPERTIES, typed(known))
        return space

    def _part(self, part: Part) -> Any:
        """A wall, floor, ceiling or slanted surface; what was inferred of it is a product of its own."""
        instance = self._layout.instances[part.instance]
        name = f"{instance.name} {INFERRED}" if part.inferred else instance.name
        placement = self._file.placement(part.extent.frame, self._storey, None)
        product = self._product(part.instance, name, self._bodies(part), placement)
        area = part.extent.region.area
        of = "SideArea" if instance.label == "wall" else "Area"
        areas = {f"Gross{of}": area, f"Net{of}": part.net_area} if instance.label not in OPENINGS else {of: area}
        self._file.quantities(product, name, CLASSES[instance.label][2], {}, areas)
        known: dict[str, Fact] = {"inferred": part.inferred, "nominal_thickness": self._thickness}
        if part.inferred:
            known |= {"area": area, "continues": instance.name, "metric": self._layout.metric}
        else:
            known |= facts(self._scene, self._layout, part.instance)
        self._file.properties(product, name, PROPERTIES, typed(known))
        self._accuracy(product, name, part.instance, inferred=part.inferred)
        return product

    def _bodies(self, part: Part) -> list[Any]:
        """The shapes of a part: polyhedra, or an arc swept upwards and the axis of its wall. None where a window leaves
        nothing of its wall.
        """
        label = self._layout.instances[part.instance].label
        if part.arc is not None:
            body = self._shape("SweptSolid", [self._file.swept(part.arc, part.extent.frame)], label, part.inferred)
            axis = self._file.arc(part.arc, part.extent.frame)
            return [self._file.shape("Axis", "Curve3D", [axis], "GRAPH_VIEW"), body]
        solids = [self._file.faceted(solid) for solid in part.solids]
        return [self._shape("Tessellation", solids, label, part.inferred)] if solids else []

    def _filling(self, i: int, hole: Opening | None, host: Any) -> Any:
        """A door or window, in the opening of its host where it has one."""
        instance, extent = self._layout.instances[i], self._extents[i]
        # The hole of a curved wall is cut from its body; a flat opening element would not be that.
        hole = None if hole is None or strip_of(self._extents[hole.host]) else hole
        opening = None if hole is None else self._opening(hole, host)
        within = None if hole is None else self._extents[hole.host].frame
        thickness = THICKNESS_M[instance.label] * self._scale
        shape = self._shape("SweptSolid", self._file.extruded(extent.region, thickness), instance.label, False)
        placement = self._file.placement(extent.frame, self._storey if opening is None else opening, within)
        height, width = overall(extent.frame, extent.region)
        product = self._product(i, instance.name, [shape], placement, OverallHeight=height, OverallWidth=width)
        if opening is not None:
            self._file.root(
                "IfcRelFillsElement",
                f"fills {instance.name}",
                RelatingOpeningElement=opening,
                RelatedBuildingElement=product,
            )
        lengths, area = {"Width": width, "Height": height}, {"Area": extent.region.area}
        self._file.quantities(product, instance.name, CLASSES[instance.label][2], lengths, area)
        known = {**facts(self._scene, self._layout, i), "inferred": False, "nominal_thickness": thickness}
        self._file.properties(product, instance.name, PROPERTIES, typed(known))
        self._accuracy(product, instance.name, i, inferred=False)
        return product

    def _opening(self, hole: Opening, host: Any) -> Any:
        """The hole that a door or window fills. Its host has it already, so its shape is a reference, not to be cut."""
        name, frame = self._layout.instances[hole.instance].name, self._extents[hole.host].frame
        solids = self._file.extruded(hole.outline, self._thickness)
        opening = self._file.root(
            "IfcOpeningElement",
            f"opening {name}",
            Name=self._file.label(name),
            ObjectPlacement=self._file.placement(frame, host, frame),
            Representation=self._file.shapes(self._file.shape("Reference", "SweptSolid", solids)),
            PredefinedType="OPENING",
        )
        self._file.root(
            "IfcRelVoidsElement",
            f"voids {name}",
            RelatingBuildingElement=host,
            RelatedOpeningElement=opening,
        )
        height, width = overall(frame, hole.outline)
        lengths = {"Width": width, "Height": height, "Depth": self._thickness}
        area = {"Area": hole.outline.area}
        self._file.quantities(opening, f"opening {name}", "Qto_OpeningElementBaseQuantities", lengths, area)
        return opening

    def _product(self, i: int, name: str, shapes: Sequence[Any], placement: Any, **attributes: Any) -> Any:
        label = self._layout.instances[i].label
        return self._file.root(
            CLASSES[label][0],
            f"element {name}",
            Name=self._file.label(name),
            Description=self._file.label(self._layout.planes[i].note) or None,
            ObjectPlacement=placement,
            Representation=self._file.shapes(*shapes) if shapes else None,
            PredefinedType=CLASSES[label][1],
            **attributes,
        )

    def _shape(self, kind: str, items: Sequence[Any], label: Label, inferred: bool) -> Any:
        """A body in its colour, on its layer."""
        if (label, inferred) not in self._styles:
            name, transparency = (f"{label} {INFERRED}", INFERRED_TRANSPARENCY) if inferred else (label, 0.0)
            self._styles[label, inferred] = self._file.style(name, LABEL_COLORS[label], transparency)
        for item in items:
            self._file.make("IfcStyledItem", Item=item, Styles=[self._styles[label, inferred]])
        shape = self._file.shape("Body", kind, items)
        self._layers.setdefault(INFERRED if inferred else MEASURED, []).append(shape)
        return shape

    def _accuracy(self, product: Any, name: str, i: int, *, inferred: bool) -> None:
        verdict = self._verdicts[i] if self._verdicts else None
        values = inferred_accuracy() if inferred else accuracy_values(self._layout, i, verdict)
        self._file.properties(product, name, ACCURACY, values, ACCURACY_IS)

    def _gather(self, products: Sequence[Any], inferred: Sequence[Any]) -> None:
        """What holds for many: the storey that all are in, layers, and the material of what was inferred."""
        if products:
            self._file.root(
                "IfcRelContainedInSpatialStructure",
                "contained",
                RelatedElements=products,
                RelatingStructure=self._storey,
            )
        for name, shapes in self._layers.items():
            self._file.make("IfcPresentationLayerAssignment", Name=name, AssignedItems=shapes)
        if inferred:
            material = self._file.make("IfcMaterial", Name=INFERRED, Description=NOT_SEEN)
            self._file.root("IfcRelAssociatesMaterial", INFERRED, RelatedObjects=inferred, RelatingMaterial=material)
