"""The dataset.usda of an output folder: a stage in one layer, which any USD viewer shows, without our plug-in, too.

Beside the composed stage it has fallback types for our prim types, the field of view of each Camera as a USD pinhole, a
mesh for each target, and what a build makes besides: pictures of targets and parts of cameras. They do not affect a
build. Values that follow from a lens or a target replace existing ones.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from pipeline.camera.figures.first_order_figures import Viewfinder, viewfinder
from pipeline.camera.focusing.focus_request import solved
from pipeline.errors import PipelineError
from pipeline.frames import mm_per_unit
from pipeline.scene.dataset import CameraEntry, Dataset, TargetEntry
from pipeline.scene.targets import PREVIEW
from pipeline.scene.usd.opening import PARTS
from pipeline.scene.write.boards import write_board
from pipeline.scene.write.lens_distortion import LENS_DISTORTION_NAMES
from pipeline.targets.preview import preview_faces
from pipeline.targets.target import Target

_TENTHS = 10.0
"""Factor for film backs and focal lengths of a Camera, which USD counts in tenths of the stage's unit."""
_FARTHEST_MM, _LEAST_MM = 1e6, 1.0
"""Clipping range [mm]: its far end, and its least near end, used if the stop is the first element of the lens."""
_LARGEST = 1e30
"""Largest value that is written: USD keeps these values in single precision."""

Attributes = dict[str, tuple[Sdf.ValueTypeName, Any]]


def flattened(stage: Usd.Stage) -> Sdf.Layer:
    """The composed stage in one layer.

    References are composed. Tables of other renderers are left out: they do not travel with a build, and flattening
    would write their paths on this machine. So are parts of cameras, which a build has made for viewers. Instances
    must have been written out (`instances`), because flattening would leave their prototypes beside the root.
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


def name_pictures(layer: Sdf.Layer, files: Mapping[Sdf.Path, str]) -> None:
    """Let attributes of a flattened stage name pictures beside it, in place of files of this machine.

    Parameters
    ----------
    files : mapping
        Paths from the folder of the flattened stage, by paths of attributes.
    """
    for path, file in files.items():
        if attribute := layer.GetAttributeAtPath(path):
            attribute.default = Sdf.AssetPath(f"./{file}")


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


def pinhole(found: Viewfinder | None, unit_mm: float) -> Attributes:
    """USD attributes of the pinhole with the field of view of a camera; empty if single precision cannot hold them."""
    if found is None:
        return {}
    film = _TENTHS / unit_mm
    in_focus = math.isfinite(found.focus_mm)
    values = {
        "fStop": found.f_number if in_focus else 0.0,
        "focalLength": film * found.principal_mm,
        "focusDistance": found.focus_mm / unit_mm if in_focus else 0.0,
        "horizontalAperture": film * found.size_mm[0],
        "horizontalApertureOffset": film * found.offset_mm[0],
        "verticalAperture": film * found.size_mm[1],
        "verticalApertureOffset": film * found.offset_mm[1],
    }
    if not (found.principal_mm > 0 and all(abs(value) < _LARGEST for value in values.values())):
        return {}
    return {name: (Sdf.ValueTypeNames.Float, value) for name, value in values.items()}


def _write_camera(prim: Sdf.PrimSpec, camera: CameraEntry, unit_mm: float) -> None:
    found = view_of(camera)
    attributes = pinhole(found, unit_mm)
    if found and "clippingRange" not in prim.attributes:
        ends = Gf.Vec2f(max(found.nearest_mm, _LEAST_MM) / unit_mm, _FARTHEST_MM / unit_mm)
        attributes["clippingRange"] = Sdf.ValueTypeNames.Float2, ends
    _write(prim, attributes)


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


def _write(prim: Sdf.PrimSpec, attributes: Attributes) -> None:
    """Set attributes, replacing old values. (In the text, properties are sorted by name.)"""
    for name, (kind, value) in attributes.items():
        if name in prim.properties:
            del prim.properties[name]
        Sdf.AttributeSpec(prim, name, kind).default = value
