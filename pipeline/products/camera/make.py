"""Tasks of a camera: `camera`, `pinhole` and `first_order`.

`camera` hands on a camera as it was settled when the graph was made, once for all tasks that read it: as a parameter of
each it would be a part of every key's record, and planning would take twice the time. What no ray depends on is no part
of it (see `products.draft.settled`): names are written by `first_order`, so renaming a lens touches no ray.
"""

import dataclasses
from pathlib import Path

import numpy as np

from pipeline.camera.figures import equivalent_pinhole
from pipeline.camera.figures.equivalent_pinhole import Pinhole, Projection
from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.spectrum import Channel
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.jsonfile import Json, write_json
from pipeline.motion import Shutter
from pipeline.optics import first_order as paraxial
from pipeline.optics.windows import Windows
from pipeline.products.camera.params import CONVENTIONS, TIMES, CameraLabels, Nothing
from pipeline.products.cameras import FOCUSED, PINHOLE, Inputs, focused_camera, pinhole_of
from pipeline.records.plain import to_plain


def camera(params: Camera, inputs: Inputs, out: Path) -> None:
    """A settled camera: focused.json."""
    write_json(out / FOCUSED, to_plain(params))


def pinhole(params: Nothing, inputs: Inputs, out: Path) -> None:
    """The equivalent pinhole, for programs that know no other model: pinhole.json, null where none can be fitted."""
    write_json(out / PINHOLE, to_plain(equivalent_pinhole.pinhole(focused_camera(inputs))))


_HEAD_FIGURES = (
    "resolution",
    "pixel_pitch_mm",
    "pixel_acceptance",
    "sensor_mm",
    "sensor_distance_mm",
    "sensor_tilt_deg",
)


def document(labels: CameraLabels, camera: Camera, pinhole: Pinhole | None, alone: Camera | None = None) -> Json:
    """Content of camera.json: a focused camera, its pinhole, and `labels` besides; `alone` is the camera without the
    windows of the labels.
    """
    figures = report(camera)
    lens = {"name": labels.lens_name, "index_source": labels.index_source, **figures.pop("lens")}
    head = {name: figures.pop(name) for name in _HEAD_FIGURES if name in figures}
    light: Json = {
        "weight": labels.light.weight,
        "footprint": labels.light.footprint,
        "wavelengths_nm": [labels.light.wavelength_nm],
    }
    if labels.channels:
        light["channels"] = [_channel(alone or camera, channel, labels.windows) for channel in labels.channels]
    head["focus_request"] = to_plain(labels.focus_request)
    if shutter := labels.shutter:
        times = {"opens_s": shutter.opens_s, "line_offset_s": shutter.line_s, "exposure_s": shutter.exposure_s}
        head["shutter"] = {"scan_order": shutter.scan_order, **times}
    plain_pinhole = None if pinhole is None else _pinhole(pinhole, camera.sensor.pitch_mm)
    return {**head, "conventions": CONVENTIONS, **light, "lens": lens, "pinhole": plain_pinhole, **figures}


def _channel(camera: Camera, channel: Channel, windows: Windows | None) -> Json:
    """A channel: its wavelengths, and the focal length and focus of the lens at their mean."""
    in_channel = camera.in_light(channel)
    mean_nm = channel.middle.wavelength_nm
    lens = paraxial.first_order((in_channel.behind(windows, mean_nm) if windows else in_channel).prescription)
    return {
        "name": channel.name,
        "mean_wavelength_nm": mean_nm,
        "wavelengths_nm": [node.wavelength_nm for node in channel.nodes],
        "shares": [node.weight for node in channel.nodes],
        "focal_length_mm": lens.efl_mm,
        "rear_focus_mm": lens.rear_focus_mm,
    }


def _pinhole(pinhole: Pinhole, pitch_mm: float) -> Json:
    return {
        "centre_mm": list(pinhole.centre_mm),
        **_projection(pinhole.plain, pitch_mm),
        "with_distortion": {
            **_projection(pinhole.distorted, pitch_mm),
            "distortion": list(pinhole.distorted.distortion),
        },
        "fitted_at_mm": list(pinhole.planes_mm),
        "lit_share": pinhole.lit_share,
    }


def _projection(projection: Projection, pitch_mm: float) -> Json:
    return {
        "principal_distance_px": projection.principal_distance_px,
        "principal_distance_mm": projection.principal_distance_px * pitch_mm,
        "principal_point_px": list(projection.principal_point_px),
        "residual_px": {"rms": projection.rms_px, "max": projection.max_px},
    }


def first_order(params: CameraLabels, inputs: Inputs, out: Path) -> None:
    """The first-order report of a camera and its equivalent pinhole: camera.json; with a shutter also times.exr."""
    camera = dataclasses.replace(focused_camera(inputs), circle_of_confusion_px=params.circle_of_confusion_px)
    alone = focused_camera(inputs, "alone") if params.windows else None
    write_json(out / "camera.json", document(params, camera, pinhole_of(inputs), alone))
    if params.shutter:
        write_bands(out / TIMES, [_times(params.shutter, camera.sensor.size_px)])


def _times(shutter: Shutter, size_px: tuple[int, int]) -> BandedPart:
    """The part of times.exr with the middle of the exposure of each pixel, (h, w) [s]."""

    def rows(first: int, end: int) -> np.ndarray:
        y, x = np.mgrid[first:end, : size_px[0]].reshape(2, -1).astype(float)
        return shutter.middle_s(np.stack([x, y], axis=1), size_px).reshape(end - first, -1)

    content = "middle of the exposure of each pixel, after the time code of the frame [s]"
    return BandedPart(name="time", shape=size_px[::-1], channels=("Y",), rows=rows, attributes={"content": content})
