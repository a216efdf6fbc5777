"""Fits as applied schemas of Omniverse, for a layer that another USD renderer opens.

Names of schemas and attributes: NVIDIA's omni.usd.schema.omni_lens_distortion. Its values have single precision.
Pixels are counted from the corner of the image, as in newton-physics/newton, its camera rays. Kannala-Brandt gives the
radius in px by the angle; f-theta the angle by the radius, as the schema's default of 0.00245 rad per px says.
"""

import math
from typing import Any

import numpy as np

from pipeline.fits.field import FitError
from pipeline.fits.fitting import Fit
from pipeline.formats import Convention, Origin
from pipeline.plugins.fits.result import FittedCamera
from pipeline.scene.write.text import AppliedSchema, SeenCamera

_PIXELS = Convention(origin=Origin.HALF)
"""Meaning of pixels in its attributes."""
_PREFIX = "omni:lensdistortion"
_NAMES = {
    "pinhole": ("OpenCvPinhole", "opencvPinhole"),
    "brown": ("OpenCvPinhole", "opencvPinhole"),
    "rational": ("OpenCvPinhole", "opencvPinhole"),
    "thin-prism": ("OpenCvPinhole", "opencvPinhole"),
    "fisheye": ("OpenCvFisheye", "opencvFisheye"),
    "kannala-brandt": ("KannalaBrandtK3", "kannalaBrandtK3"),
    "ftheta": ("Ftheta", "ftheta"),
}
"""Model -> the middle of the schema's name, and the word in the names of its attributes."""
_PINHOLE = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4")
"""Coefficients of the schema of OpenCV's pinhole: it has defaults, so all are written."""
_BEYOND = 1.05
"""Field that the schema is told over that of the rays [1]: renderers leave out what lies beyond."""
_FULL_DEG = 360.0
"""A whole turn [degrees]."""
_DECIMALS = 9
"""Decimals of the centre of projection [mm]: what symmetry makes 0 is written as 0."""


def seen_by_omniverse(camera: FittedCamera, prim_path: str, pitch_mm: float) -> SeenCamera:
    """The camera as schemas of Omniverse state it; what counts is the model with the smallest rms.

    Raises FitError: no schema has any of the fitted models.
    """
    by_schema: dict[str, Fit] = {}
    for fit in sorted(camera.fits, key=lambda fit: -fit.rms_px):  # of several in one schema the best stays
        if fit.model.name in _NAMES:
            by_schema[_NAMES[fit.model.name][1]] = fit
    if not by_schema:
        raise FitError(
            "no schema of Omniverse has these models", hint=f"it has {', '.join(_NAMES)}; choose with --model"
        )
    best = min(by_schema.values(), key=lambda fit: fit.rms_px)
    x, y, z = (np.round(best.parameters[:3], _DECIMALS) + 0.0).tolist()
    width, height = camera.field.size_px
    return SeenCamera(
        prim_path=prim_path,
        schemas=tuple(_schema(fit, camera) for fit in by_schema.values()),
        model=_NAMES[best.model.name][1],
        centre_mm=(x, y, z),
        principal_mm=float(camera.field.start[0]) * pitch_mm,
        size_mm=(width * pitch_mm, height * pitch_mm),
        about=_about(best, camera),
    )


def _schema(fit: Fit, camera: FittedCamera) -> AppliedSchema:
    """The schema of a fit, with its coefficients, size of the image and centre."""
    middle, word = _NAMES[fit.model.name]
    values = fit.values
    width, height = camera.field.size_px
    cx, cy = _PIXELS.positions(np.array([values["cx"], values["cy"]]), (width, height)).tolist()
    attributes: list[tuple[str, str, Any]]
    if word.startswith("opencv"):
        names = _PINHOLE if word == "opencvPinhole" else ("k1", "k2", "k3", "k4")
        numbers = {"fx": values["fx"], "fy": values["fy"], "cx": cx, "cy": cy}
        numbers |= {name: values.get(name, 0.0) for name in names}
        attributes = [(name, "float", number) for name, number in numbers.items()]
        attributes.append(("imageSize", "int2", (width, height)))
    else:
        numbers = {name: values.get(name, 0.0) for name in ("k0", "k1", "k2", "k3")}
        if word == "ftheta":
            numbers["k4"] = values["k4"]
        # Of a cone about the axis that holds all rays, and somewhat more.
        widest = float(camera.pupil.angle_deg.max(initial=math.degrees(math.atan(1e-3))))
        numbers |= {
            "maxFov": min(2 * widest * _BEYOND, _FULL_DEG),
            "nominalWidth": float(width),
            "nominalHeight": float(height),
        }
        attributes = [(name, "float", number) for name, number in numbers.items()]
        attributes.append(("opticalCenter", "float2", (cx, cy)))
    return AppliedSchema(
        name=f"OmniLensDistortion{middle}API",
        model=word,
        attributes=tuple((f"{_PREFIX}:{word}:{name}", kind, value) for name, kind, value in sorted(attributes)),
    )


def _about(best: Fit, camera: FittedCamera) -> tuple[str, ...]:
    near, far = camera.field.planes_mm
    x, y, z = (np.round(best.parameters[:3], _DECIMALS) + 0.0).tolist()
    return (
        f"{camera.name} for renderers that know no lenses, by `pipeline fit`. The nearest {best.model.consumer} leaves"
        f" {best.rms_px:.3g} px rms of the exact rays, {best.max_px:.3g} px at most, on the planes {near:.6g} and"
        f" {far:.6g} mm before the stop. Pixels count from the corner of the image: its first pixel has the centre"
        " (0.5, 0.5).",
        f"The centre of projection lies at ({x:g}, {y:g}, {z:g}) mm of the vision frame, not in the origin of the"
        " camera, which is the centre of the aperture stop. Render through the camera below it: that one stands there.",
    )
