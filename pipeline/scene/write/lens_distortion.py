"""A layer over a stage that says in schemas of other renderers what a camera is to them; nothing of ours changes."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf

from pipeline.frames import mm_per_unit
from pipeline.scene.write.text import filled, text_of

_KEPT = ("defaultPrim", "metersPerUnit", "upAxis", "timeCodesPerSecond", "startTimeCode", "endTimeCode")
"""Metadata that USD takes from the root layer alone, so that a layer on top of a stage has to repeat them."""
CHILD = "Pinhole"
"""Name of the camera at the centre of projection, below ours, whose origin is the centre of the aperture stop."""
_TENTHS = 10.0
"""Factor for film backs and focal lengths of a Camera, which USD counts in tenths of the stage's unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AppliedSchema:
    """An applied schema, as `OmniLensDistortionOpenCvPinholeAPI`, with name, type and value of its attributes; `model`
    is the value of `omni:lensdistortion:model` with which it counts.
    """

    name: str
    model: str
    attributes: tuple[tuple[str, str, Any], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenCamera:
    """A camera as other renderers see it.

    `model` is the value of `omni:lensdistortion:model`: the schema that counts. `centre_mm` is the centre of projection
    in the vision frame; `principal_mm` and `size_mm` are distance and size of the film of a plain pinhole, for programs
    without the schemas. `about` has the paragraphs of the documentation of the layer.
    """

    prim_path: str
    schemas: Sequence[AppliedSchema]
    model: str
    centre_mm: tuple[float, float, float]
    principal_mm: float
    size_mm: tuple[float, float]
    about: tuple[str, ...]


def distortion_layer(stage: Path, out: Path, seen: SeenCamera) -> str:
    """Text of a layer `out` that stands on a stage and applies schemas to one of its cameras."""
    below = Sdf.Layer.FindOrOpen(str(stage))
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.subLayerPaths = [_relative(stage, out)]
    layer.documentation = filled(seen.about)
    for name in _KEPT:
        if below.pseudoRoot.HasInfo(name):
            layer.pseudoRoot.SetInfo(name, below.pseudoRoot.GetInfo(name))
    camera = Sdf.CreatePrimInLayer(layer, seen.prim_path)
    _apply(camera, seen.schemas, seen.model)
    child = Sdf.PrimSpec(camera, CHILD, Sdf.SpecifierDef, "Camera")
    _apply(child, [schema for schema in seen.schemas if schema.model == seen.model], seen.model)
    unit_mm = mm_per_unit(below.pseudoRoot.GetInfo("metersPerUnit"))
    x, y, z = (length / unit_mm for length in seen.centre_mm)
    _author(child, "xformOp:translate", Sdf.ValueTypeNames.Double3, Gf.Vec3d(x, 0 - y, 0 - z))  # it looks along -z
    order = Sdf.AttributeSpec(child, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
    order.default = ["xformOp:translate"]
    film = _TENTHS / unit_mm
    plain = {
        "focalLength": seen.principal_mm,
        "horizontalAperture": seen.size_mm[0],
        "verticalAperture": seen.size_mm[1],
    }
    for name, length_mm in plain.items():
        _author(child, name, Sdf.ValueTypeNames.Float, film * length_mm)
    return text_of(layer)


def _relative(stage: Path, out: Path) -> str:
    path = os.path.relpath(stage.resolve(), out.resolve().parent).replace(os.sep, "/")
    return path if path.startswith(".") else f"./{path}"


def _apply(prim: Sdf.PrimSpec, schemas: Sequence[AppliedSchema], model: str) -> None:
    names = Sdf.TokenListOp()
    names.prependedItems = [schema.name for schema in schemas]
    prim.SetInfo("apiSchemas", names)
    _author(prim, "omni:lensdistortion:model", Sdf.ValueTypeNames.Token, model, is_custom=True)
    for schema in schemas:
        for name, kind, value in schema.attributes:
            usd_type = Sdf.ValueTypeNames.Find(kind)
            _author(prim, name, usd_type, type(usd_type.defaultValue)(value), is_custom=True)


def _author(
    prim: Sdf.PrimSpec, name: str, type_name: Sdf.ValueTypeName, value: Any, *, is_custom: bool = False
) -> None:
    """Write an attribute; a custom one where USD has no schema of that name: others read it all the same."""
    Sdf.AttributeSpec(prim, name, type_name, Sdf.VariabilityVarying, is_custom).default = value
