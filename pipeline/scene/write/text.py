"""Writers of USD text: lenses and cameras of importers, and a layer over a stage that describes a camera in schemas of
other renderers.
"""

import os
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Usd, Vt

from pipeline.camera.figures.first_order_figures import viewfinder
from pipeline.camera.parts.camera import Camera, PrintedCamera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.frames import mm_per_unit
from pipeline.optics.first_order import first_order
from pipeline.optics.printed import PrintedLens, PrintedSurface, prescription_of
from pipeline.scene.write.viewers import SHIFT, TENTHS, VIEW, pinhole

_DOC_WIDTH = 112
"""Longest line of documentation [characters]: with indentation it stays within the 120 of the project."""
_TYPES = ("PlenLens", "PlenMicrolensArray", "PlenSensor", "PlenSurface")
_KEPT = ("defaultPrim", "metersPerUnit", "upAxis", "timeCodesPerSecond", "startTimeCode", "endTimeCode")
"""Metadata that USD takes from the root layer alone: a layer over a stage has to repeat them."""
CHILD = "Pinhole"
"""Name of the camera at the centre of projection, below ours, whose origin is the centre of the aperture stop."""


def lens_text(lens: PrintedLens) -> str:
    """Text of a layer with a printed lens; PrescriptionError if it cannot be represented."""
    prescription_of(lens)  # raises
    name = identifier(lens.name)
    layer = _new_layer(name, _lens_documentation(lens), ("PlenLens", "PlenSurface"))
    prim = Sdf.PrimSpec(layer, name, Sdf.SpecifierDef, "PlenLens")
    prim.kind = "component"
    _write_lens(prim, lens)
    return text_of(layer)


def _write_lens(prim: Sdf.PrimSpec, lens: PrintedLens) -> None:
    """Write a lens and, below it, its surfaces."""
    names = ["Stop" if surface.is_stop else f"S{i}" for i, surface in enumerate(lens.surfaces, 1)]
    efl_mm = lens.nominal_efl_mm
    _author(
        prim,
        name=lens.name,
        nominalFocalLength=efl_mm if efl_mm is not None and efl_mm > 0 else None,
        surfaceOrder=names,
        wavelength=lens.wavelength_nm,
    )
    for child, surface in zip(names, lens.surfaces, strict=True):
        _write_surface(Sdf.PrimSpec(prim, child, Sdf.SpecifierDef, "PlenSurface"), surface)


def _lens_documentation(lens: PrintedLens) -> str:
    """Name, provenance and figures of a lens: those of its source, and ours."""
    figures_mm = first_order(prescription_of(lens))
    computed = (
        f"Computed at infinity with the indices below: EFL {figures_mm.efl_mm:.4f} mm, BFD {figures_mm.bfd_mm:.4f} mm,"
        f" f/{abs(figures_mm.f_number):.2f}."
    )
    of_source = (("EFL", lens.nominal_efl_mm), ("BFD", lens.nominal_bfd_mm))
    nominal = ", ".join(f"{name} {value:.8g} mm" for name, value in of_source if value is not None)
    nominal_figures = f"Nominal: {nominal}." if nominal else "The source states neither EFL nor BFD."
    return _filled([f"{lens.name}.", *lens.provenance, f"{nominal_figures} {computed}"])


def identifier(text: str) -> str:
    """A prim name derived from any text: capitalised words, other characters left out."""
    words = re.findall(r"[A-Za-z0-9]+", text)
    joined = "".join(word[:1].upper() + word[1:] for word in words)
    return joined if joined[:1].isalpha() else f"Lens{joined}"


def _filled(paragraphs: Iterable[str]) -> str:
    """Paragraphs, wrapped for the documentation of a layer."""
    lines = [textwrap.fill(text, _DOC_WIDTH, break_long_words=False, break_on_hyphens=False) for text in paragraphs]
    return "\n\n".join(lines)


def _new_layer(name: str, documentation: str, types: Iterable[str]) -> Sdf.Layer:
    """A new layer in millimetres with its default prim and fallback types for USD without our plug-in."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.defaultPrim = name
    layer.documentation = documentation
    layer.pseudoRoot.SetInfo("metersPerUnit", 0.001)
    layer.pseudoRoot.SetInfo("upAxis", "Y")
    layer.timeCodesPerSecond = 24
    fallback = Vt.TokenArray(["Scope"])
    layer.pseudoRoot.SetInfo("fallbackPrimTypes", dict.fromkeys(types, fallback))
    return layer


def text_of(layer: Sdf.Layer) -> str:
    """The layer as USD writes it."""
    return str(layer.ExportToString().rstrip("\n") + "\n")


def _write_surface(prim: Sdf.PrimSpec, surface: PrintedSurface) -> None:
    """Write the numbers of a surface that differ from the fallbacks, and the shape of its aperture."""
    _author(
        prim,
        abbe=surface.abbe,
        conic=surface.conic or None,
        cylindrical=surface.is_cylinder or None,
        decentre=surface.decentre_mm if any(surface.decentre_mm) else None,
        evenCoefficients=surface.coefficients(2) or None,
        oddCoefficients=surface.coefficients(3) or None,
        focalLength=surface.focal_length_mm,
        glass=surface.glass or None,
        index=surface.index,
        isStop=surface.is_stop or None,
        radius=surface.radius_mm,
        semiDiameter=surface.semi_diameter_mm,
        thickness=surface.thickness_mm,
        tilt=surface.tilt_deg if any(surface.tilt_deg) else None,
    )
    rotation_deg = surface.aperture_rotation_deg
    if surface.half_widths_mm is not None:
        half_widths_mm = surface.half_widths_mm
        _author(prim, apertureShape="rectangular", halfWidths=half_widths_mm, apertureRotation=rotation_deg or None)
    elif surface.inner_semi_diameter_mm:
        _author(prim, apertureShape="annular", innerSemiDiameter=surface.inner_semi_diameter_mm)
    elif surface.blades:
        _author(prim, apertureShape="polygonal", apertureRotation=rotation_deg, blades=_int(surface.blades, "blades"))


def camera_text(camera: PrintedCamera) -> str:
    """Text of a layer with one camera and the default prim Rig; PipelineError if the camera cannot be represented."""
    record = Camera(
        prescription=prescription_of(camera.lens),
        sensor=camera.sensor,
        sensor_distance_mm=camera.sensor_distance_mm,
        microlenses=camera.microlenses,
    )
    preview = (
        "The Camera's own focalLength and apertures are a pinhole preview: principal distance and size of the sensor."
    )
    layer = _new_layer("Rig", _filled([f"{camera.name}.", *camera.provenance, preview]), _TYPES)
    rig = Sdf.PrimSpec(layer, "Rig", Sdf.SpecifierDef, "Xform")
    rig.kind = "assembly"
    _write_camera(Sdf.PrimSpec(rig, "Camera", Sdf.SpecifierDef, "Camera"), camera, record)
    _write_lens(Sdf.PrimSpec(rig, "Lens", Sdf.SpecifierDef, "PlenLens"), camera.lens)
    sensor = camera.sensor
    _author(
        Sdf.PrimSpec(rig, "Sensor", Sdf.SpecifierDef, "PlenSensor"),
        offset=_offset(sensor.offset_x_mm, sensor.offset_y_mm),
        pixelPitch=sensor.pitch_mm,
        resolution=(_int(sensor.width_px, "pixels in a row"), _int(sensor.height_px, "rows of pixels")),
    )
    if camera.microlenses:
        array = Sdf.PrimSpec(rig, "Microlenses", Sdf.SpecifierDef, "PlenMicrolensArray")
        _write_array(array, camera.microlenses)
    return text_of(layer)


def _write_camera(prim: Sdf.PrimSpec, printed: PrintedCamera, camera: Camera) -> None:
    """Write the attributes and relationships of a camera, and the pinhole that viewers show."""
    schemas = Sdf.TokenListOp()
    schemas.prependedItems = ["PlenCameraAPI"]
    prim.SetInfo("apiSchemas", schemas)
    for name, (kind, value) in pinhole(viewfinder(camera), 1.0).items():
        if name in VIEW or (name in SHIFT and value):
            Sdf.AttributeSpec(prim, name, kind).default = value
    for name, part in (("lens", "Lens"), ("microlenses", "Microlenses"), ("sensor", "Sensor")):
        if name != "microlenses" or camera.microlenses:
            relationship = Sdf.RelationshipSpec(prim, f"plen:camera:{name}", custom=False)
            relationship.targetPathList.explicitItems = [Sdf.Path(f"/Rig/{part}")]
    lengths_mm = {
        "camera:sensorDistance": camera.sensor_distance_mm,
        "camera:near": printed.near_mm,
        "camera:far": printed.far_mm,
        "camera:microlensDistance": camera.microlenses.distance_mm if camera.microlenses else None,
    }
    _author(prim, **lengths_mm)


def _write_array(prim: Sdf.PrimSpec, array: MicrolensArray) -> None:
    """Write a microlens array."""
    _author(
        prim,
        columns=_int(array.columns, "columns of microlenses"),
        rows=_int(array.rows, "rows of microlenses"),
        focalLengths=array.focal_lengths_mm,
        layout=array.layout,
        offset=_offset(array.offset_x_mm, array.offset_y_mm),
        crossPitch=array.cross_pitch_mm,
        height=array.height_mm,
        pitch=array.pitch_mm,
        width=array.width_mm,
        rotation=array.rotation_deg or None,
        tilt=(array.tilt_x_deg, array.tilt_y_deg) if array.is_tilted else None,
        typePeriod=array.type_period,
        typeTable=array.type_table if array.type_period is not None else None,
    )


def _offset(x_mm: float, y_mm: float) -> tuple[float, float] | None:
    """An offset; None for the fallback, which is none."""
    return (x_mm, y_mm) if x_mm or y_mm else None


def _int(count: int | None, things: str) -> int | None:
    """A count; CameraError if it is more than USD's int holds."""
    if count is not None and abs(count) >= 2**31:
        raise CameraError(f"{count} {things} are more than a stage can hold")
    return count


def _author(prim: Sdf.PrimSpec, **values: Any) -> None:
    """Write attributes of ours, by their names without the namespace, in the types of the schemas; None is left out."""
    registry = Usd.SchemaRegistry()
    schemas = registry.FindConcretePrimDefinition(prim.typeName), registry.FindAppliedAPIPrimDefinition("PlenCameraAPI")
    definition = schemas[prim.typeName == "Camera"]
    for name, value in values.items():
        if value is not None:
            kind = definition.GetAttributeDefinition(f"plen:{name}").GetTypeName()
            attribute = Sdf.AttributeSpec(prim, f"plen:{name}", kind, Sdf.VariabilityUniform)
            attribute.default = type(kind.defaultValue)(value)


@dataclass(frozen=True, slots=True, kw_only=True)
class AppliedSchema:
    """An applied schema with name, type and value of its attributes, and the model with which it counts."""

    name: str
    model: str
    attributes: tuple[tuple[str, str, Any], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenCamera:
    """A camera in the terms of other renderers.

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


def lay_over(stage: Path, layer: Sdf.Layer, out: Path, about: Iterable[str]) -> None:
    """Change a layer that will lie at `out` in place: let it stand on a stage, and say in paragraphs what it is."""
    below = Sdf.Layer.FindOrOpen(str(stage))
    below_out = os.path.relpath(stage.resolve(), out.resolve().parent).replace(os.sep, "/")
    layer.subLayerPaths = [below_out if below_out.startswith(".") else f"./{below_out}"]
    layer.documentation = _filled(about)
    for name in _KEPT:
        if below.pseudoRoot.HasInfo(name):
            layer.pseudoRoot.SetInfo(name, below.pseudoRoot.GetInfo(name))


def distortion_layer(stage: Path, out: Path, view: SeenCamera) -> str:
    """Text of a layer, to be written to `out`, that describes a camera of a stage to other renderers.

    The layer lies over the stage and writes two cameras. Ours, whose origin is the centre of the aperture stop, gets
    all schemas, for programs that choose among them. A new one below it stands at the centre of projection and is the
    one to render through: it gets the schema that counts, and the film of a plain pinhole.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    lay_over(stage, layer, out, view.about)
    # Apply all schemas to our camera, and the one that counts to the camera at the centre of projection.
    camera = Sdf.CreatePrimInLayer(layer, view.prim_path)
    _apply(camera, view.schemas, view.model)
    child = Sdf.PrimSpec(camera, CHILD, Sdf.SpecifierDef, "Camera")
    _apply(child, [schema for schema in view.schemas if schema.model == view.model], view.model)
    unit_mm = mm_per_unit(layer.pseudoRoot.GetInfo("metersPerUnit"))
    # Move the child to the centre of projection, in units of the stage. USD's cameras have y up and look along -z; the
    # vision frame has y down and z forward. `0 - y` keeps a zero without a sign, which `-y` would write as -0.
    x, y, z = (length / unit_mm for length in view.centre_mm)
    _write(child, "xformOp:translate", Sdf.ValueTypeNames.Double3, Gf.Vec3d(x, 0 - y, 0 - z))
    order = Sdf.AttributeSpec(child, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
    order.default = ["xformOp:translate"]
    # Give it the film of a plain pinhole, which USD measures in tenths of the unit of the stage.
    tenths_per_mm = TENTHS / unit_mm
    plain_mm = {
        "focalLength": view.principal_mm,
        "horizontalAperture": view.size_mm[0],
        "verticalAperture": view.size_mm[1],
    }
    for name, length_mm in plain_mm.items():
        _write(child, name, Sdf.ValueTypeNames.Float, tenths_per_mm * length_mm)
    return text_of(layer)


def _apply(prim: Sdf.PrimSpec, schemas: Sequence[AppliedSchema], model: str) -> None:
    """Apply schemas to a camera and write their attributes; `model` names the one that counts."""
    names = Sdf.TokenListOp()
    names.prependedItems = [schema.name for schema in schemas]
    prim.SetInfo("apiSchemas", names)
    _write(prim, "omni:lensdistortion:model", Sdf.ValueTypeNames.Token, model, is_custom=True)
    for schema in schemas:
        for name, kind, value in schema.attributes:
            usd_type = Sdf.ValueTypeNames.Find(kind)
            _write(prim, name, usd_type, type(usd_type.defaultValue)(value), is_custom=True)


def _write(prim: Sdf.PrimSpec, name: str, type_name: Sdf.ValueTypeName, value: Any, *, is_custom: bool = False) -> None:
    """Write an attribute; a custom one where USD itself has no schema of that name."""
    Sdf.AttributeSpec(prim, name, type_name, Sdf.VariabilityVarying, is_custom).default = value
