"""A layer over a built stage with what a viewer lacks: lens elements, stop, sensor, microlenses and rays as guides.

Its prims lie below the cameras, in their frame and in the stage's unit, with the purpose `guide`; boards get a material
of USD's own. The layer has the built stage as its sublayer and changes nothing of it.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from pipeline.frames import VISION_FROM_CAMERA
from pipeline.records.shapes import Float64
from pipeline.scene.write.for_viewers import PREVIEW
from pipeline.units import mm_per_unit

_PARTS = "PreviewParts"
"""Name of the prim below a camera that holds its guides."""
_LOOKS = "PreviewLooks"
"""Name of the prim below the root that holds materials."""
_PLACES = "st"
"""Name of the primvar that places points on a picture: the one that viewers look for."""
_RAY_MM = 0.05
"""Width of a ray [mm]: thin beside a lens, and still seen."""
Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class GuideMesh:
    """A mesh in the vision frame of its camera; `counts` are the corners of each face, `corners` their points."""

    name: str
    points_mm: Float64[np.ndarray, "n 3"]
    counts: tuple[int, ...]
    corners: tuple[int, ...]
    colour: Colour
    opacity: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GuideRays:
    """Polylines in the vision frame of their camera [mm]."""

    name: str
    paths_mm: tuple[np.ndarray, ...]
    colour: Colour


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """The picture of a target, whose prim has this path.

    Attributes
    ----------
    picture : str
        PNG of its linear reflectance, relative to the layer.
    places : (n, 2) float64
        Places of the points of its preview on the picture, from 0 at its lower left to 1 at its upper right.
    """

    prim_path: str
    picture: str
    places: Float64[np.ndarray, "n 2"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraGuides:
    """Guides of a camera, whose prim has this path."""

    prim_path: str
    meshes: tuple[GuideMesh, ...]
    rays: tuple[GuideRays, ...]


def write_guides(place: Path, built: Path, cameras: Iterable[CameraGuides], sheets: Iterable[Sheet]) -> None:
    """Write the layer, over an older one.

    Parameters
    ----------
    place : Path
        The new layer, text or binary by its name.
    built : Path
        `dataset.usda` of an output folder.
    """
    aside = place.with_name(f"new.{place.name}")
    aside.unlink(missing_ok=True)
    layer = Sdf.Layer.CreateNew(str(aside))
    below = Sdf.Layer.FindOrOpen(str(built))
    for key in set(below.pseudoRoot.ListInfoKeys()) - {"subLayers", "subLayerOffsets", "documentation", "comment"}:
        layer.pseudoRoot.SetInfo(key, below.pseudoRoot.GetInfo(key))
    layer.subLayerPaths.append(os.path.relpath(built, place.parent).replace(os.sep, "/"))
    stage = Usd.Stage.Open(layer)
    unit_mm = mm_per_unit(UsdGeom.GetStageMetersPerUnit(stage))
    for camera in cameras:
        _write_camera(stage, camera, unit_mm)
    _write_materials(stage, sheets)
    layer.Save()
    aside.replace(place)


def _write_camera(stage: Usd.Stage, camera: CameraGuides, unit_mm: float) -> None:
    parts = UsdGeom.Scope.Define(stage, f"{camera.prim_path}/{_PARTS}")
    parts.CreatePurposeAttr(UsdGeom.Tokens.guide)
    for mesh in camera.meshes:
        shape = UsdGeom.Mesh.Define(stage, f"{parts.GetPath()}/{mesh.name}")
        points = _points(mesh.points_mm, unit_mm)
        shape.CreatePointsAttr(points)
        shape.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
        shape.CreateFaceVertexCountsAttr(Vt.IntArray(mesh.counts))
        shape.CreateFaceVertexIndicesAttr(Vt.IntArray(mesh.corners))
        shape.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        shape.CreateDoubleSidedAttr(True)
        _colour(shape, mesh.colour, mesh.opacity)
    for rays in camera.rays:
        curves = UsdGeom.BasisCurves.Define(stage, f"{parts.GetPath()}/{rays.name}")
        points = _points(np.concatenate(rays.paths_mm), unit_mm)
        curves.CreateTypeAttr(UsdGeom.Tokens.linear)
        curves.CreatePointsAttr(points)
        curves.CreateCurveVertexCountsAttr(Vt.IntArray([len(path) for path in rays.paths_mm]))
        curves.CreateWidthsAttr(Vt.FloatArray([_RAY_MM / unit_mm]))
        curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
        curves.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(curves, Usd.TimeCode.Default()))
        _colour(curves, rays.colour, 1.0)


def _colour(shape: UsdGeom.Gprim, colour: Colour, opacity: float) -> None:
    shape.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*colour)]))
    if opacity < 1:
        shape.CreateDisplayOpacityAttr(Vt.FloatArray([opacity]))


def _points(points_mm: np.ndarray, unit_mm: float) -> Vt.Vec3fArray:
    """Points of the vision frame in USD's frame of a camera, y up and looking along -z."""
    turned = points_mm @ VISION_FROM_CAMERA[:3, :3] / unit_mm + 0.0
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(turned, np.float32))


def _write_materials(stage: Usd.Stage, sheets: Iterable[Sheet]) -> None:
    """Bind the previews of targets to matt surfaces with their pictures."""
    root = stage.GetDefaultPrim()
    if not root:
        return
    looks = root.GetPath().AppendChild(_LOOKS)
    for number, sheet in enumerate(sheets, 1):
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"{sheet.prim_path}/{PREVIEW}"))
        if not mesh or len(mesh.GetPointsAttr().Get() or ()) != len(sheet.places):
            continue  # a preview of the user's own
        UsdGeom.Scope.Define(stage, looks)
        places = Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(sheet.places, np.float32))
        kind, vertex = Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(_PLACES, kind, vertex).Set(places)
        board = _board(stage, looks.AppendChild(f"Board{number}"), sheet.picture)
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(board)


def _board(stage: Usd.Stage, path: Sdf.Path, picture: str) -> UsdShade.Material:
    """A matt UsdPreviewSurface with a picture."""
    board = UsdShade.Material.Define(stage, path)
    reader = UsdShade.Shader.Define(stage, path.AppendChild("Places"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(_PLACES)
    texture = UsdShade.Shader.Define(stage, path.AppendChild("Picture"))
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(picture))
    places = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(places)
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")  # reflectances are linear
    for axis in "ST":
        texture.CreateInput(f"wrap{axis}", Sdf.ValueTypeNames.Token).Set("clamp")
    surface = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    colour = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(colour)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    board.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return board
