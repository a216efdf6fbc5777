"""Writing of cameras as USD text: a rig with its lens, sensor and microlenses."""

from typing import Any

from pxr import Gf, Sdf, Vt

from pipeline.camera.figures.viewfinder import viewfinder
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.imported_camera import PrintedCamera
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.printed import prescription_of
from pipeline.scene.write.flatten import pinhole
from pipeline.scene.write.text import filled, new_layer, text_of, write_lens

_TYPES = ("PlenLens", "PlenMicrolensArray", "PlenSensor", "PlenSurface")
_VIEW = ("focalLength", *(f"{side}Aperture{end}" for side in ("horizontal", "vertical") for end in ("", "Offset")))
"""Attributes of the pinhole with the field of view of the camera."""


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
    lengths: dict[str, float | None] = {
        "sensorDistance": camera.sensor_distance_mm,
        "near": printed.near_mm,
        "far": printed.far_mm,
    }
    if camera.microlenses:
        lengths["microlensDistance"] = camera.microlenses.distance_mm
    for name, value in lengths.items():
        if value is not None:
            _author(prim, f"plen:camera:{name}", Sdf.ValueTypeNames.Double, value)


def _write_sensor(prim: Sdf.PrimSpec, sensor: Sensor) -> None:
    _write_offset(prim, sensor.offset_x_mm, sensor.offset_y_mm)
    _author(prim, "plen:pixelPitch", Sdf.ValueTypeNames.Double, sensor.pitch_mm)
    resolution = _int(sensor.width_px, "pixels in a row"), _int(sensor.height_px, "rows of pixels")
    _author(prim, "plen:resolution", Sdf.ValueTypeNames.Int2, Gf.Vec2i(*resolution))


def _write_array(prim: Sdf.PrimSpec, array: MicrolensArray) -> None:
    for name, count in (("columns", array.columns), ("rows", array.rows)):
        if count is not None:
            _author(prim, f"plen:{name}", Sdf.ValueTypeNames.Int, _int(count, f"{name} of microlenses"))
    _author(prim, "plen:focalLengths", Sdf.ValueTypeNames.DoubleArray, Vt.DoubleArray(array.focal_lengths_mm))
    _author(prim, "plen:layout", Sdf.ValueTypeNames.Token, array.layout)
    _write_offset(prim, array.offset_x_mm, array.offset_y_mm)
    lengths = {
        "crossPitch": array.cross_pitch_mm,
        "height": array.height_mm,
        "pitch": array.pitch_mm,
        "width": array.width_mm,
    }
    for name, value in lengths.items():
        if value is not None:
            _author(prim, f"plen:{name}", Sdf.ValueTypeNames.Double, value)
    if array.rotation_deg:
        _author(prim, "plen:rotation", Sdf.ValueTypeNames.Double, array.rotation_deg)
    if array.is_tilted:
        _author(prim, "plen:tilt", Sdf.ValueTypeNames.Double2, Gf.Vec2d(array.tilt_x_deg, array.tilt_y_deg))
    if array.type_period is not None:
        _author(prim, "plen:typePeriod", Sdf.ValueTypeNames.Int2, Gf.Vec2i(*array.type_period))
        _author(prim, "plen:typeTable", Sdf.ValueTypeNames.IntArray, Vt.IntArray(array.type_table))


def _write_offset(prim: Sdf.PrimSpec, x_mm: float, y_mm: float) -> None:
    if x_mm or y_mm:
        _author(prim, "plen:offset", Sdf.ValueTypeNames.Double2, Gf.Vec2d(x_mm, y_mm))


def _int(count: int, what: str) -> int:
    if abs(count) >= 2**31:
        raise CameraError(f"{count} {what} are more than a stage can hold")
    return count


def _author(prim: Sdf.PrimSpec, name: str, type_name: Sdf.ValueTypeName, value: Any) -> None:
    Sdf.AttributeSpec(prim, name, type_name, Sdf.VariabilityUniform).default = value
