"""The dataset.usda of an output folder: a stage in one layer, which any USD viewer shows, without our plug-in, too.

Beside the composed stage it has fallback types for our prim types, the field of view of each Camera as a USD pinhole, a
mesh for each target, and what a build makes besides: pictures of targets and parts of cameras. They do not affect a
build. Values that follow from a lens or a target replace existing ones.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from pipeline.camera.figures.first_order_figures import Viewfinder, viewfinder
from pipeline.camera.focusing.focus_request import solved
from pipeline.errors import PipelineError
from pipeline.frames import mm_per_unit
from pipeline.scene.dataset import CameraEntry, Dataset, TargetEntry
from pipeline.scene.targets import PREVIEW
from pipeline.scene.usd.opening import PARTS
from pipeline.scene.usd.values import LENS_DISTORTION_NAMES
from pipeline.targets.preview import PreviewFaces, preview_faces
from pipeline.targets.target import Target

_TENTHS = 10.0
"""Factor for film backs and focal lengths of a Camera, which USD counts in tenths of the stage's unit."""
_FARTHEST_MM, _LEAST_MM = 1e6, 1.0
"""Clipping range [mm]: its far end, and its least near end, used if the stop is the first element of the lens."""
_LARGEST = 1e30
"""Largest value that is written: USD keeps these values in single precision."""

Attributes = dict[str, tuple[Sdf.ValueTypeName, Any]]
_PLACES = "st"
"""Name of the primvar that places points on a picture: the one that viewers look for."""


def flattened(stage: Usd.Stage) -> Sdf.Layer:
    """The composed stage in one layer.

    References are composed. Tables of other renderers are left out: they do not travel with a build, and flattening
    would write their paths on this machine. So are parts of cameras, which a build has made for viewers. Instances
    must have been written out (`write_out_instances`), because flattening would leave their prototypes beside the root.
    """
    layer = stage.Flatten(addSourceFileComment=False)  # warns of metadata that it does not know, and leaves them out
    _leave_out_tables(layer)
    for prim in stage.TraverseAll():
        if prim.IsA(UsdGeom.Camera) and (spec := layer.GetPrimAtPath(prim.GetPath())):
            _leave_out_parts(spec)
    return layer


def _leave_out_tables(layer: Sdf.Layer) -> None:
    """Remove attributes of schemas of other renderers that name files."""
    paths = list[Sdf.Path]()
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    for path in paths:
        if path.IsPropertyPath() and path.name.startswith(LENS_DISTORTION_NAMES):
            attribute = layer.GetAttributeAtPath(path)
            if attribute and attribute.typeName in (Sdf.ValueTypeNames.Asset, Sdf.ValueTypeNames.AssetArray):
                attribute.owner.RemoveProperty(attribute)


def text_for_viewers(
    layer: Sdf.Layer, cameras: Iterable[CameraEntry], targets: Iterable[TargetEntry], dataset: Dataset | None = None
) -> str:
    """Text of a flattened stage with what viewers need; completing it again changes nothing.

    Parameters
    ----------
    dataset : Dataset or None
        What a build makes of the stage: its cameras have parts and its targets pictures, beside the layer. Meshes that
        it reads (occluders) are not overwritten.
    """
    _add_fallback_types(layer)
    unit_mm = mm_per_unit(layer.pseudoRoot.GetInfo("metersPerUnit"))
    built, kept = set[str](), set[str]()
    if dataset:
        built = {camera.prim_path for camera in dataset.cameras} | {target.prim_path for target in dataset.targets}
        kept = {occluder.prim_path for occluder in dataset.occluders}
    for camera in cameras:
        prim = layer.GetPrimAtPath(camera.prim_path)
        _write_camera(prim, camera, unit_mm)
        if camera.prim_path in built:
            _name_parts(prim, camera.parts_file)
    for target in targets:
        if f"{target.prim_path}/{PREVIEW}" not in kept and isinstance(target.target, Target):
            picture = f"./{target.picture_file}" if target.prim_path in built else None
            prim = layer.GetPrimAtPath(target.prim_path)
            write_board(prim, PREVIEW, preview_faces(target.target), unit_mm, picture)
    return layer.ExportToString().rstrip("\n") + "\n"


def _add_fallback_types(layer: Sdf.Layer) -> None:
    """Add fallback types for all our prim types in a layer; existing entries stay."""
    paths = list[Sdf.Path]()
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    types = {layer.GetPrimAtPath(path).typeName for path in paths if path.IsPrimPath()}
    authored = layer.pseudoRoot.GetInfo("fallbackPrimTypes") or {}
    if wanted := {**fallback_types(types), **authored}:
        layer.pseudoRoot.SetInfo("fallbackPrimTypes", wanted)


def fallback_types(names: Iterable[str]) -> dict[str, Vt.TokenArray]:
    """Fallback types for our prim types, in the order of the names."""
    known = Usd.SchemaRegistry().GetFallbackPrimTypes()
    return {name: known[name] for name in sorted(names) if name in known}


def view_of(camera: CameraEntry) -> Viewfinder | None:
    """Field of view of a camera, for viewers; None of one that cannot be built, of which `check` reports why."""
    try:
        return viewfinder(solved(camera.camera))
    except PipelineError:
        return None


def pinhole(view: Viewfinder | None, unit_mm: float) -> Attributes:
    """USD attributes of the pinhole with the field of view of a camera; empty if single precision cannot hold them."""
    if view is None:
        return {}
    film = _TENTHS / unit_mm
    in_focus = math.isfinite(view.focus_mm)
    values = {
        "fStop": view.f_number if in_focus else 0.0,
        "focalLength": film * view.principal_mm,
        "focusDistance": view.focus_mm / unit_mm if in_focus else 0.0,
        "horizontalAperture": film * view.size_mm[0],
        "horizontalApertureOffset": film * view.offset_mm[0],
        "verticalAperture": film * view.size_mm[1],
        "verticalApertureOffset": film * view.offset_mm[1],
    }
    if not (view.principal_mm > 0 and all(abs(value) < _LARGEST for value in values.values())):
        return {}
    return {name: (Sdf.ValueTypeNames.Float, value) for name, value in values.items()}


def _write_camera(prim: Sdf.PrimSpec, camera: CameraEntry, unit_mm: float) -> None:
    view = view_of(camera)
    attributes = pinhole(view, unit_mm)
    if view and "clippingRange" not in prim.attributes:
        ends = Gf.Vec2f(max(view.nearest_mm, _LEAST_MM) / unit_mm, _FARTHEST_MM / unit_mm)
        attributes["clippingRange"] = Sdf.ValueTypeNames.Float2, ends
    for name, (kind, value) in attributes.items():
        if name in prim.properties:
            del prim.properties[name]
        Sdf.AttributeSpec(prim, name, kind).default = value


def _name_parts(prim: Sdf.PrimSpec, file: str) -> None:
    """Write a prim whose payload are the parts of a camera, in the place of an older one."""
    _leave_out_parts(prim)
    parts = Sdf.PrimSpec(prim, PARTS, Sdf.SpecifierDef, "Scope")
    parts.payloadList.Prepend(Sdf.Payload(f"./{file}"))
    Sdf.AttributeSpec(parts, "purpose", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform).default = UsdGeom.Tokens.guide


def _leave_out_parts(camera: Sdf.PrimSpec) -> None:
    """Remove the parts of a camera that an earlier build named."""
    if PARTS in camera.nameChildren:
        del camera.nameChildren[PARTS]


def write_board(prim: Sdf.PrimSpec, name: str, faces: PreviewFaces, unit_mm: float, picture: str | None) -> None:
    """Write the preview below the prim of a target, replacing an older mesh; any other prim of that name stays.

    Parameters
    ----------
    picture : str or None
        PNG of its linear reflectance, relative to the layer.
    """
    if not np.abs(faces.points_mm / unit_mm).max() < _LARGEST:
        return
    if name in prim.nameChildren:
        if prim.nameChildren[name].typeName != "Mesh":
            return
        del prim.nameChildren[name]
    alone = Usd.Stage.CreateInMemory()
    mesh = _mesh(alone, Sdf.Path.absoluteRootPath.AppendChild(name), faces, unit_mm)
    if picture is not None:
        _paint(alone, mesh, faces, picture)
    Sdf.CreatePrimInLayer(prim.layer, prim.path.AppendChild(name))
    Sdf.CopySpec(alone.GetRootLayer(), mesh.GetPath(), prim.layer, prim.path.AppendChild(name))


def _mesh(stage: Usd.Stage, path: Sdf.Path, faces: PreviewFaces, unit_mm: float) -> UsdGeom.Mesh:
    mesh, points = UsdGeom.Mesh.Define(stage, path), (faces.points_mm / unit_mm).astype(np.float32)
    mesh.CreateExtentAttr(_vectors(np.stack([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([4] * len(faces.faces)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray(faces.faces.ravel().tolist()))
    mesh.CreatePointsAttr(_vectors(points))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    grey = np.repeat(np.clip(faces.radiance, 0, 1)[:, None], 3, axis=1)
    mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.uniform).Set(_vectors(grey))
    return mesh


def _paint(stage: Usd.Stage, mesh: UsdGeom.Mesh, faces: PreviewFaces, picture: str) -> None:
    """Bind the mesh to a matt surface with its picture."""
    kind, vertex = Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
    places = Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(faces.sheet, np.float32))
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(_PLACES, kind, vertex).Set(places)
    board = _matt(stage, mesh.GetPath().AppendChild("Sheet"), picture)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(board)


def _matt(stage: Usd.Stage, path: Sdf.Path, picture: str) -> UsdShade.Material:
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


def _vectors(rows: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows + 0.0, np.float32))
