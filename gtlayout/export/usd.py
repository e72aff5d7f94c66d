"""USD as text (.usda): one mesh per instance under /Room, z up, with its σ as a primvar and as attributes.

Names are as in OpenUSD's documentation of UsdGeomMesh, UsdGeomPrimvar and the stage metadata upAxis and metersPerUnit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, Vt

from gtlayout.colors import LABEL_COLORS
from gtlayout.export.facts import NOT_METRIC, Fact, facts, scene_facts
from gtlayout.export.inferred import INFERRED, INFERRED_COLOR, INFERRED_OPACITY, inferred_parts
from gtlayout.export.upright import z_up_from_world
from gtlayout.io.files import printable, write_atomic
from gtlayout.layout import Layout
from gtlayout.mesh import vertex_sigma
from gtlayout.scene import FloatArray, IntArray, Scene

ROOM = "/Room"
NAMESPACE = "gtlayout"
_TYPES = {bool: Sdf.ValueTypeNames.Bool, float: Sdf.ValueTypeNames.Double, str: Sdf.ValueTypeNames.String}


def write(path: Path, scene: Scene, layout: Layout) -> None:
    """Write a .usda file: the floor's normal turned to +z, nothing shifted. The same layout gives the same bytes.

    Instances without triangles are left out. A stage must name its unit. For a scene that is not metric it is the
    metre, too, and the stage's comment and each prim state that the scene is not metric.

    Raises:
        GtlayoutError: the disk does not take the file.
    """
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.LinearUnits.meters)
    if not layout.metric:
        stage.SetMetadata("comment", NOT_METRIC)
    room = UsdGeom.Xform.Define(stage, ROOM)
    Usd.ModelAPI(room).SetKind("component")
    stage.SetDefaultPrim(room.GetPrim())
    _attach(room.GetPrim(), scene_facts(scene, layout))
    points = layout.triangles.vertices @ z_up_from_world(scene, layout).T
    sigma = vertex_sigma(layout.triangles, layout.planes, layout.extents)
    for i, instance in enumerate(layout.instances):
        faces = layout.triangles.faces[layout.triangles.face_instance == i]
        if len(faces):
            # A name may contain characters that no path has. Two names may then become one.
            name = Tf.MakeValidIdentifier(printable(instance.name))
            taken = stage.GetPrimAtPath(f"{ROOM}/{name}").IsValid()
            mesh = UsdGeom.Mesh.Define(stage, f"{ROOM}/{name}_{i}" if taken else f"{ROOM}/{name}")
            _shape(mesh, points, faces, sigma)
            color = Vt.Vec3fArray([Gf.Vec3f(*(channel / 255 for channel in LABEL_COLORS[instance.label]))])
            mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set(color)
            _attach(mesh.GetPrim(), facts(scene, layout, i))
    for i, (name, vertices, faces) in enumerate(inferred_parts(layout)):
        prim = Tf.MakeValidIdentifier(printable(name))
        taken = stage.GetPrimAtPath(f"{ROOM}/{prim}").IsValid()
        mesh = UsdGeom.Mesh.Define(stage, f"{ROOM}/{prim}_{i}" if taken else f"{ROOM}/{prim}")
        _shape(mesh, vertices @ z_up_from_world(scene, layout).T, faces, np.full(len(vertices), np.nan))
        grey = Vt.Vec3fArray([Gf.Vec3f(*(channel / 255 for channel in INFERRED_COLOR))])
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set(grey)
        mesh.CreateDisplayOpacityPrimvar(UsdGeom.Tokens.constant).Set(Vt.FloatArray([INFERRED_OPACITY / 255]))
        _attach(mesh.GetPrim(), {"name": printable(name), INFERRED: True, "metric": layout.metric})
    write_atomic(path, str(stage.GetRootLayer().ExportToString()))


def _shape(mesh: UsdGeom.Mesh, points: FloatArray, faces: IntArray, sigma: FloatArray) -> None:
    """Points that the faces use, the faces, and ``primvars:sigma``: σ of the plane along its normal at each point."""
    used, renumbered = np.unique(faces, return_inverse=True)
    own = Vt.Vec3fArray.FromNumpy(points[used].astype(np.float32))
    mesh.CreatePointsAttr(own)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(own))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([3] * len(faces)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(renumbered.reshape(-1).astype(np.int32)))
    # Flat faces, seen from both sides; the default would be smoothed to a blob.
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    if np.isfinite(sigma[used]).all():
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("sigma", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        primvar.Set(Vt.FloatArray.FromNumpy(sigma[used].astype(np.float32)))


def _attach(prim: Any, values: dict[str, Fact]) -> None:
    """Custom attributes ``gtlayout:NAME``."""
    for name, value in values.items():
        key = f"{NAMESPACE}:{Tf.MakeValidIdentifier(name)}"
        prim.CreateAttribute(key, _TYPES[type(value)], custom=True).Set(value)
