"""The central model of a camera's whole image, for programs that take intrinsics and see more than targets.

It is the equivalent pinhole of camera.json, which has the coefficients of Brown. A wide lens bends more than these
follow, or has no such pinhole; then others are fitted to the rays of its image.
"""

import math
from collections.abc import Iterable
from contextlib import suppress

import numpy as np

from pipeline.camera.figures.equivalent_pinhole import is_absurd
from pipeline.channel_names import body_and_channel
from pipeline.exports.material import CentralModel, ExportCamera
from pipeline.fits.field import FieldRays, FitError, lit_field, positions_px
from pipeline.fits.fitting import Fit, fitted
from pipeline.formats import ExportError

_ENOUGH_PX = 1e-3
"""Residual of the pinhole up to which nothing else is tried, rms [px]: what rows of a table claim by default."""
_WORTH_IT = 0.9
"""Residual that a further model may leave, over that of the one before [1]: it is worth a gain of a tenth."""


def central_model(camera: ExportCamera, alternatives: Iterable[str]) -> CentralModel:
    """The central model of a conventional camera: the equivalent pinhole if it is good enough, else a fit to rays.

    Vision frame [mm], and image positions in our conventions [px].

    `alternatives`: names of models of `pipeline fit` that may replace the pinhole, the simplest first.
    Raises ExportError: none fits.
    """
    # Each of these models is better than those before it; the last one is the result.
    models = [] if camera.pinhole is None else [_of_pinhole(camera)]
    # An ideal lens has no distortion but what its stage states. What its pinhole leaves comes from mean rays of a wide
    # aperture, which do not meet in one point: a further model would take that for distortion.
    if models and camera.built.record["lens"].get("is_ideal"):
        return models[0]
    # camera.json has one pinhole, at the camera's own wavelength: a channel starts again from its own rays.
    if models and body_and_channel(camera.name)[1]:
        models = []
        alternatives = ("brown", *alternatives)
    field = None
    for name in alternatives:
        # Stop if Brown's model, the pinhole's or fitted as the first alternative, is good enough.
        if models and models[0].name == "brown" and models[0].rms_px <= _ENOUGH_PX:
            break
        # Fit the alternative to the rays of the image, traced once. Keep it if it is better by a tenth than the last.
        field = field or field_of(camera)
        with suppress(FitError):
            fit = _of_fit(fitted(field, name), field)
            is_better = not models or fit.rms_px < _WORTH_IT * models[-1].rms_px
            if is_better and not is_absurd(fit.max_px, camera.size_px):
                models.append(fit)
    if not models:
        raise ExportError(f"no pinhole fits {camera.name}, and none of {', '.join(alternatives)}")
    return models[-1]


def _of_pinhole(camera: ExportCamera) -> CentralModel:
    """The equivalent pinhole with distortion, as a central model."""
    pinhole = camera.model
    return CentralModel(
        name="brown",
        centre_mm=pinhole.centre_mm,
        focal_px=np.full(2, pinhole.principal_distance_px),
        principal_point_px=pinhole.principal_point_px,
        coefficients=np.array(camera.brown),
        rms_px=pinhole.rms_px,
        max_px=pinhole.max_px,
    )


def _of_fit(fit: Fit, field: FieldRays) -> CentralModel:
    """A model with the parameters of OpenCV's: centre, fx, fy, cx, cy, coefficients."""
    centre_mm, focal_px, principal_point_px, coefficients = np.split(fit.parameters, [3, 5, 7])
    return CentralModel(
        name=fit.model.name,
        centre_mm=centre_mm,
        focal_px=focal_px,
        principal_point_px=principal_point_px,
        coefficients=coefficients,
        rms_px=fit.rms_px,
        max_px=fit.max_px,
        widest_deg=float(np.degrees(np.arccos(field.rays.direction[:, 2].min()))),
    )


def field_of(camera: ExportCamera) -> FieldRays:
    """The rays of a camera over its image; ExportError: its lens is telecentric."""
    record = camera.built.record
    if not math.isfinite(float(record["principal_distance_px"])):
        message = f"the lens of {camera.name} is telecentric, and a central model has one centre of projection"
        raise ExportError(message, hint="export rays, which hold any camera")
    near_mm, far_mm = map(float, record["near_far_mm"])
    pupil_mm = record["lens"]["entrance_pupil"]["z_mm"]
    start = np.array([record["principal_distance_px"], *record["optical_axis_px"], pupil_mm])
    rays = camera.rays.sight.rays(*positions_px(camera.size_px).T)
    return lit_field(camera.name, rays, (near_mm, far_mm), camera.size_px, start)
