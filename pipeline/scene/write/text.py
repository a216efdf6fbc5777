"""Writing of lenses and cameras as USD text, in the form that USD itself would write; used by every importer."""

import re
import textwrap
from collections.abc import Iterable
from typing import Any

from pxr import Sdf, Usd, Vt

from pipeline.camera.figures.first_order_figures import viewfinder
from pipeline.camera.parts.camera import Camera, PrintedCamera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.first_order import first_order
from pipeline.optics.printed import PrintedLens, PrintedSurface, prescription_of
from pipeline.scene.write.flatten import pinhole

_DOC_WIDTH = 112
"""Longest line of documentation [characters]: with indentation it stays within the 120 of the project."""
_TYPES = ("PlenLens", "PlenMicrolensArray", "PlenSensor", "PlenSurface")
_VIEW = ("focalLength", *(f"{side}Aperture{end}" for side in ("horizontal", "vertical") for end in ("", "Offset")))
"""Attributes of the pinhole with the field of view of the camera."""


def lens_text(lens: PrintedLens, prim_name: str | None = None) -> str:
    """Text of a layer with a printed lens.

    Parameters
    ----------
    lens : PrintedLens
    prim_name : str, optional
        Name of the root prim; by default derived from the name of the lens.

    Raises
    ------
    PrescriptionError
        The lens cannot be represented.
    """
    prescription_of(lens)  # raises
    name = prim_name or identifier(lens.name)
    layer = new_layer(name, lens_documentation(lens), ("PlenLens", "PlenSurface"))
    prim = Sdf.PrimSpec(layer, name, Sdf.SpecifierDef, "PlenLens")
    prim.kind = "component"
    write_lens(prim, lens)
    return text_of(layer)


def write_lens(prim: Sdf.PrimSpec, lens: PrintedLens) -> None:
    """Write the attributes and surfaces of a PlenLens."""
    names, efl_mm = surface_names(lens), lens.nominal_efl_mm
    _author(
        prim,
        name=lens.name,
        nominalFocalLength=efl_mm if efl_mm is not None and efl_mm > 0 else None,
        surfaceOrder=names,
        wavelength=lens.wavelength_nm,
    )
    for child, surface in zip(names, lens.surfaces, strict=True):
        _write_surface(Sdf.PrimSpec(prim, child, Sdf.SpecifierDef, "PlenSurface"), surface)


def lens_documentation(lens: PrintedLens) -> str:
    """Documentation of a lens: name, provenance, nominal and computed figures."""
    figures_mm = first_order(prescription_of(lens))
    computed = (
        f"Computed at infinity with the indices below: EFL {figures_mm.efl_mm:.4f} mm, BFD {figures_mm.bfd_mm:.4f} mm,"
        f" f/{abs(figures_mm.f_number):.2f}."
    )
    figures = f"{_nominal(lens)} {computed}"
    return filled([f"{lens.name}.", *lens.provenance, figures])


def surface_names(lens: PrintedLens) -> list[str]:
    """Names of the prims of the surfaces: S1, S2 and so on, and Stop."""
    return ["Stop" if surface.is_stop else f"S{i}" for i, surface in enumerate(lens.surfaces, 1)]


def identifier(text: str) -> str:
    """A prim name derived from any text: capitalised words, other characters left out."""
    words = re.findall(r"[A-Za-z0-9]+", text)
    joined = "".join(word[:1].upper() + word[1:] for word in words)
    return joined if joined[:1].isalpha() else f"Lens{joined}"


def _nominal(lens: PrintedLens) -> str:
    known = [
        f"{name} {value:.8g} mm"
        for name, value in (("EFL", lens.nominal_efl_mm), ("BFD", lens.nominal_bfd_mm))
        if value is not None
    ]
    return f"Nominal: {', '.join(known)}." if known else "The source states neither EFL nor BFD."


def filled(paragraphs: Iterable[str]) -> str:
    """Paragraphs, wrapped for the documentation of a layer."""
    lines = [textwrap.fill(text, _DOC_WIDTH, break_long_words=False, break_on_hyphens=False) for text in paragraphs]
    return "\n\n".join(lines)


def new_layer(name: str, documentation: str, types: Iterable[str]) -> Sdf.Layer:
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
    """Text of a layer as USD itself would write it."""
    return str(layer.ExportToString().rstrip("\n") + "\n")


def _write_surface(prim: Sdf.PrimSpec, surface: PrintedSurface) -> None:
    _author(
        prim,
        abbe=surface.abbe,
        conic=surface.conic or None,
        evenCoefficients=surface.coefficients(2) or None,
        oddCoefficients=surface.coefficients(3) or None,
        focalLength=surface.focal_length_mm,
        glass=surface.glass or None,
        index=surface.index,
        isStop=surface.is_stop or None,
        radius=surface.radius_mm,
        semiDiameter=surface.semi_diameter_mm,
        thickness=surface.thickness_mm,
    )
    rotation_deg = surface.aperture_rotation_deg
    if surface.half_widths_mm is not None:
        turned = rotation_deg or None
        _author(prim, apertureShape="rectangular", halfWidths=surface.half_widths_mm, apertureRotation=turned)
    elif surface.inner_semi_diameter_mm:
        _author(prim, apertureShape="annular", innerSemiDiameter=surface.inner_semi_diameter_mm)
    elif surface.blades:
        _author(prim, apertureShape="polygonal", apertureRotation=rotation_deg, blades=surface.blades)


def camera_text(camera: PrintedCamera) -> str:
    """Text of a layer with one camera and the default prim Rig.

    Raises
    ------
    PipelineError
        The camera cannot be represented.
    """
    record = Camera(
        prescription=prescription_of(camera.lens),
        sensor=camera.sensor,
        sensor_distance_mm=camera.sensor_distance_mm,
        microlenses=camera.microlenses,
    )
    preview = (
        "The Camera's own focalLength and apertures are a pinhole preview: principal distance and size of the sensor."
    )
    layer = new_layer("Rig", filled([f"{camera.name}.", *camera.provenance, preview]), _TYPES)
    rig = Sdf.PrimSpec(layer, "Rig", Sdf.SpecifierDef, "Xform")
    rig.kind = "assembly"
    _write_camera(Sdf.PrimSpec(rig, "Camera", Sdf.SpecifierDef, "Camera"), camera, record)
    write_lens(Sdf.PrimSpec(rig, "Lens", Sdf.SpecifierDef, "PlenLens"), camera.lens)
    _write_sensor(Sdf.PrimSpec(rig, "Sensor", Sdf.SpecifierDef, "PlenSensor"), camera.sensor)
    if camera.microlenses:
        array = Sdf.PrimSpec(rig, "Microlenses", Sdf.SpecifierDef, "PlenMicrolensArray")
        _write_array(array, camera.microlenses)
    return text_of(layer)


def _write_camera(prim: Sdf.PrimSpec, printed: PrintedCamera, camera: Camera) -> None:
    schemas = Sdf.TokenListOp()
    schemas.prependedItems = ["PlenCameraAPI"]
    prim.SetInfo("apiSchemas", schemas)
    for name, (kind, value) in pinhole(viewfinder(camera), 1.0).items():
        if name in _VIEW and (value or not name.endswith("Offset")):
            Sdf.AttributeSpec(prim, name, kind).default = value
    for name, wanted in (("lens", "Lens"), ("microlenses", "Microlenses"), ("sensor", "Sensor")):
        if name != "microlenses" or camera.microlenses:
            relationship = Sdf.RelationshipSpec(prim, f"plen:camera:{name}", custom=False)
            relationship.targetPathList.explicitItems = [Sdf.Path(f"/Rig/{wanted}")]
    lengths_mm = {
        "camera:sensorDistance": camera.sensor_distance_mm,
        "camera:near": printed.near_mm,
        "camera:far": printed.far_mm,
        "camera:microlensDistance": camera.microlenses.distance_mm if camera.microlenses else None,
    }
    _author(prim, **lengths_mm)


def _write_sensor(prim: Sdf.PrimSpec, sensor: Sensor) -> None:
    _author(
        prim,
        offset=_offset(sensor.offset_x_mm, sensor.offset_y_mm),
        pixelPitch=sensor.pitch_mm,
        resolution=(_int(sensor.width_px, "pixels in a row"), _int(sensor.height_px, "rows of pixels")),
    )


def _write_array(prim: Sdf.PrimSpec, array: MicrolensArray) -> None:
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
    return (x_mm, y_mm) if x_mm or y_mm else None


def _int(count: int | None, what: str) -> int | None:
    if count is not None and abs(count) >= 2**31:
        raise CameraError(f"{count} {what} are more than a stage can hold")
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
