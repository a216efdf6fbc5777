"""A layer with the parts of a camera for viewers: lens elements, stop, sensor, microlenses and rays.

`dataset.usda` of a build names it as the payload of a prim below the Camera, with the purpose `guide`. Its prims are in
USD's frame of that camera and in the stage's unit. It is text, because binary layers differ from writing to writing.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from pxr import Gf, Usd, UsdGeom, Vt

from pipeline.frames import VISION_FROM_CAMERA, mm_per_unit
from pipeline.records.shapes import Float64
from pipeline.scene.usd.opening import PARTS

_RAY_MM = 0.05
"""Width of a ray [mm]: thin beside a lens, and still seen."""
_DIGITS = 4
"""Decimals of places [mm]: a tenth of a micrometre, less than a viewer can show."""
Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class PartMesh:
    """A mesh in the vision frame of its camera; `counts` are the corners of each face, `corners` their points."""

    name: str
    points_mm: Float64[np.ndarray, "n 3"]
    counts: tuple[int, ...]
    corners: tuple[int, ...]
    colour: Colour
    opacity: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PartRays:
    """Polylines in the vision frame of their camera [mm]."""

    name: str
    paths_mm: tuple[np.ndarray, ...]
    colour: Colour


@dataclass(frozen=True, slots=True, kw_only=True)
class PartCopies:
    """Copies of a mesh, by their origins in the vision frame."""

    name: str
    mesh: PartMesh
    origins_mm: Float64[np.ndarray, "n 3"]


Part = PartMesh | PartCopies | PartRays


def parts_text(parts: Iterable[Part], meters_per_unit: float, up_axis: str) -> str:
    """Text of the layer, in the unit and with the axis of the stage that names it: USD converts neither."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, meters_per_unit)
    UsdGeom.SetStageUpAxis(stage, up_axis)
    root = UsdGeom.Scope.Define(stage, f"/{PARTS}")
    stage.SetDefaultPrim(root.GetPrim())
    unit_mm = mm_per_unit(meters_per_unit)
    for part in parts:
        _write_part(stage, f"/{PARTS}/{part.name}", part, unit_mm)
    return str(stage.GetRootLayer().ExportToString()).rstrip("\n") + "\n"


def _write_part(stage: Usd.Stage, path: str, part: Part, unit_mm: float) -> None:
    """Define a part at a path: a mesh, curves, or instances of a mesh."""
    if isinstance(part, PartMesh):
        _write_mesh(UsdGeom.Mesh.Define(stage, path), part, unit_mm)
    elif isinstance(part, PartRays):
        _write_rays(UsdGeom.BasisCurves.Define(stage, path), part, unit_mm)
    else:
        copies = UsdGeom.PointInstancer.Define(stage, path)
        _write_mesh(UsdGeom.Mesh.Define(stage, f"{path}/{part.mesh.name}"), part.mesh, unit_mm)
        copies.CreatePrototypesRel().AddTarget(f"{path}/{part.mesh.name}")
        copies.CreatePositionsAttr(_points(part.origins_mm, unit_mm))
        copies.CreateProtoIndicesAttr(Vt.IntArray(len(part.origins_mm), 0))
        copies.CreateExtentAttr(copies.ComputeExtentAtTime(Usd.TimeCode.Default(), Usd.TimeCode.Default()))


def _write_mesh(shape: UsdGeom.Mesh, mesh: PartMesh, unit_mm: float) -> None:
    """Write the attributes of a mesh without subdivision."""
    points = _points(mesh.points_mm, unit_mm)
    shape.CreatePointsAttr(points)
    shape.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    shape.CreateFaceVertexCountsAttr(Vt.IntArray(mesh.counts))
    shape.CreateFaceVertexIndicesAttr(Vt.IntArray(mesh.corners))
    shape.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    shape.CreateDoubleSidedAttr(True)
    _colour(shape, mesh.colour, mesh.opacity)


def _write_rays(curves: UsdGeom.BasisCurves, rays: PartRays, unit_mm: float) -> None:
    """Write the attributes of polylines."""
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreatePointsAttr(_points(np.concatenate(rays.paths_mm), unit_mm))
    curves.CreateCurveVertexCountsAttr(Vt.IntArray([len(path) for path in rays.paths_mm]))
    curves.CreateWidthsAttr(Vt.FloatArray([_RAY_MM / unit_mm]))
    curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    curves.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(curves, Usd.TimeCode.Default()))
    _colour(curves, rays.colour, 1.0)


def _colour(shape: UsdGeom.Gprim, colour: Colour, opacity: float) -> None:
    """Write the colour of a shape, and its opacity unless it is opaque."""
    shape.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*colour)]))
    if opacity < 1:
        shape.CreateDisplayOpacityAttr(Vt.FloatArray([opacity]))


def _points(points_mm: np.ndarray, unit_mm: float) -> Vt.Vec3fArray:
    """Points of the vision frame in USD's frame of a camera, y up and looking along -z."""
    turned = np.round(points_mm @ VISION_FROM_CAMERA[:3, :3], _DIGITS) / unit_mm + 0.0
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(turned, np.float32))
