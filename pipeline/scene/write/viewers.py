"""Aids for USD viewers without our plug-in, in the dataset.usda of a build.

The dataset.usda of an output folder is a stage in one layer. Beside the composed stage it has fallback types for our
prim types, the field of view of each Camera as a USD pinhole, a mesh for each target, and files of the build: pictures
of targets and parts of cameras. They do not affect a build. Values that follow from a lens or a target replace existing
ones.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from pipeline.camera.figures.first_order_figures import Viewfinder, viewfinder
from pipeline.camera.focusing.focus_request import solved
from pipeline.entry_points import offered
from pipeline.errors import PipelineError
from pipeline.frames import mm_per_unit
from pipeline.scene.dataset import CameraEntry, Dataset, Frame
from pipeline.scene.targets import PREVIEW
from pipeline.scene.usd.opening import PARTS
from pipeline.scene.usd.plug_in import scene_reader
from pipeline.targets.preview import PreviewFaces, preview_faces
from pipeline.targets.target import Target

TENTHS = 10.0
"""Factor for film backs and focal lengths of a Camera, which USD counts in tenths of the stage's unit."""
_FARTHEST_MM, _LEAST_MM = 1e6, 1.0
"""Clipping range [mm]: its far end, and its least near end, used if the stop is the first element of the lens."""
_LARGEST = 1e30
"""Largest value that is written: USD keeps these values in single precision."""

Attributes = dict[str, tuple[Sdf.ValueTypeName, Any]]
_TEXTURE_COORDINATES = "st"
"""Name of the primvar that places points on a picture: the one that viewers look for."""
VIEW = ("focalLength", "horizontalAperture", "verticalAperture")
SHIFT = ("horizontalApertureOffset", "verticalApertureOffset")
"""Attributes of the pinhole with the field of view of a camera; the latter where the axis is off the middle."""


def flattened(stage: Usd.Stage) -> Sdf.Layer:
    """The composed stage in one layer.

    Names of files that nothing reads, such as tables of other renderers, are left out: the files do not travel with a
    build, and flattening would write their paths on this machine. Parts of cameras, which a build makes for viewers,
    are left out, too, and operations of poses that a stronger order leaves out: in one layer they would be a mistake.
    Instances must have been written out (`write_out_instances`): flattening would leave their prototypes beside the
    root.
    """
    layer = stage.Flatten(addSourceFileComment=False)  # warns of metadata that it does not know, and leaves them out
    files = (Sdf.ValueTypeNames.Asset, Sdf.ValueTypeNames.AssetArray)
    named_by = scene_reader().named_by
    pictures = {attribute.GetPath() for prim in stage.TraverseAll() for attribute, _ in named_by(prim)}
    for prim in stage.TraverseAll():
        if not (spec := layer.GetPrimAtPath(prim.GetPath())):
            continue
        for attribute in list(spec.attributes):
            if attribute.typeName in files and attribute.path not in pictures:
                spec.RemoveProperty(attribute)
        if order := UsdGeom.Xformable(prim).GetXformOpOrderAttr().Get():
            named = {token.removeprefix("!invert!") for token in order}
            for attribute in list(spec.attributes):
                if attribute.name.startswith("xformOp:") and attribute.name not in named:
                    spec.RemoveProperty(attribute)
        if prim.IsA(UsdGeom.Camera):
            _leave_out_parts(spec)
    return layer


def text_for_viewers(layer: Sdf.Layer, cameras: Iterable[CameraEntry], dataset: Dataset | None = None) -> str:
    """Text of a flattened stage with what viewers need; completing it again changes nothing. A build makes pictures of
    the targets of a dataset and, by a plug-in, parts of its cameras, beside the layer; meshes that it reads are not
    overwritten.
    """
    paths = list[Sdf.Path]()
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    types = _fallback_types(layer.GetPrimAtPath(path).typeName for path in paths if path.IsPrimPath())
    if fallback_types := {**types, **(layer.pseudoRoot.GetInfo("fallbackPrimTypes") or {})}:
        layer.pseudoRoot.SetInfo("fallbackPrimTypes", fallback_types)
    unit_mm = mm_per_unit(layer.pseudoRoot.GetInfo("metersPerUnit"))
    occluder_paths = {occluder.prim_path for occluder in dataset.occluders} if dataset else set[str]()
    for camera in cameras:
        prim = layer.GetPrimAtPath(camera.prim_path)
        states = [entry for entry in dataset.cameras if entry.prim_path == camera.prim_path] if dataset else []
        _write_camera(prim, camera, unit_mm)
        if dataset and len(states) > 1:
            _write_states(prim, [(state, dataset.frames_of(state)) for state in states], unit_mm)
        if states and "parts" in offered("product"):  # a prim whose payload are the parts of the camera
            _leave_out_parts(prim)
            parts = Sdf.PrimSpec(prim, PARTS, Sdf.SpecifierDef, "Scope")
            parts.payloadList.Prepend(Sdf.Payload(f"./{states[0].parts_file}"))
            purpose = Sdf.AttributeSpec(parts, "purpose", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform)
            purpose.default = UsdGeom.Tokens.guide
    for target in dataset.targets if dataset else ():
        if f"{target.prim_path}/{PREVIEW}" not in occluder_paths and isinstance(target.target, Target):
            prim = layer.GetPrimAtPath(target.prim_path)
            _write_board(prim, preview_faces(target.target), unit_mm, f"./{target.picture_file}")
    return layer.ExportToString().rstrip("\n") + "\n"


def _fallback_types(names: Iterable[str]) -> dict[str, Vt.TokenArray]:
    """Fallback types for our prim types, in the order of the names."""
    fallbacks = Usd.SchemaRegistry().GetFallbackPrimTypes()
    return {name: fallbacks[name] for name in sorted(set(names)) if name in fallbacks}


def _view_of(camera: CameraEntry) -> Viewfinder | None:
    """Field of view of a camera, for viewers; None of one that cannot be built, of which `check` reports why."""
    try:
        return viewfinder(solved(camera.camera))
    except PipelineError:
        return None


def pinhole(view: Viewfinder | None, unit_mm: float) -> Attributes:
    """USD attributes of the pinhole with the field of view of a camera; empty if single precision cannot hold them."""
    if view is None:
        return {}
    film = TENTHS / unit_mm
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
    """Write the pinhole of a camera in place of what the prim says, and a clipping range if it has none."""
    view = _view_of(camera)
    attributes = pinhole(view, unit_mm)
    if view and "clippingRange" not in prim.attributes:
        ends = Gf.Vec2f(max(view.nearest_mm, _LEAST_MM) / unit_mm, _FARTHEST_MM / unit_mm)
        attributes["clippingRange"] = Sdf.ValueTypeNames.Float2, ends
    for name, (kind, value) in attributes.items():
        if name in prim.properties:
            del prim.properties[name]
        Sdf.AttributeSpec(prim, name, kind).default = value


def _write_states(prim: Sdf.PrimSpec, states: Sequence[tuple[CameraEntry, Sequence[Frame]]], unit_mm: float) -> None:
    """Fields of view of a camera whose lens changes, by frame."""
    for state, frames in states:
        for name, (_, value) in pinhole(_view_of(state), unit_mm).items():
            for frame in frames:
                prim.layer.SetTimeSample(prim.path.AppendProperty(name), frame.number, float(value))


def _leave_out_parts(camera: Sdf.PrimSpec) -> None:
    """Remove the parts of a camera that an earlier build named."""
    if PARTS in camera.nameChildren:
        del camera.nameChildren[PARTS]


def _write_board(prim: Sdf.PrimSpec, faces: PreviewFaces, unit_mm: float, picture: str) -> None:
    """Write the preview below a target in place of an older mesh; the picture is a PNG of its linear reflectance."""
    if not np.abs(faces.points_mm / unit_mm).max() < _LARGEST:
        return
    if PREVIEW in prim.nameChildren:
        if prim.nameChildren[PREVIEW].typeName != "Mesh":
            return
        del prim.nameChildren[PREVIEW]
    preview_stage = Usd.Stage.CreateInMemory()
    mesh = _define_mesh(preview_stage, faces, unit_mm)
    _paint(preview_stage, mesh, faces, picture)
    Sdf.CreatePrimInLayer(prim.layer, prim.path.AppendChild(PREVIEW))
    Sdf.CopySpec(preview_stage.GetRootLayer(), mesh.GetPath(), prim.layer, prim.path.AppendChild(PREVIEW))


def _define_mesh(stage: Usd.Stage, faces: PreviewFaces, unit_mm: float) -> UsdGeom.Mesh:
    """The faces of a preview as a mesh of a stage."""
    mesh = UsdGeom.Mesh.Define(stage, f"/{PREVIEW}")
    points = (faces.points_mm / unit_mm).astype(np.float32)
    mesh.CreateExtentAttr(_vec3f(np.stack([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([4] * len(faces.faces)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray(faces.faces.ravel().tolist()))
    mesh.CreatePointsAttr(_vec3f(points))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    return mesh


def _paint(stage: Usd.Stage, mesh: UsdGeom.Mesh, faces: PreviewFaces, picture: str) -> None:
    """Bind the mesh to a matt UsdPreviewSurface with its picture."""
    coordinates_type, vertex = Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
    st = Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(faces.sheet, np.float32))
    UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(_TEXTURE_COORDINATES, coordinates_type, vertex).Set(st)
    path = mesh.GetPath().AppendChild("Sheet")
    material = UsdShade.Material.Define(stage, path)
    reader = UsdShade.Shader.Define(stage, path.AppendChild("Places"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(_TEXTURE_COORDINATES)
    texture = UsdShade.Shader.Define(stage, path.AppendChild("Picture"))
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(picture))
    coordinates = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")  # reflectances are linear
    for axis in "ST":
        texture.CreateInput(f"wrap{axis}", Sdf.ValueTypeNames.Token).Set("clamp")
    surface = UsdShade.Shader.Define(stage, path.AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    colour = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(colour)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def _vec3f(rows: np.ndarray) -> Vt.Vec3fArray:
    """Rows of three numbers, (n, 3), as USD keeps them; adding 0.0 turns -0.0 to 0.0."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows + 0.0, np.float32))
