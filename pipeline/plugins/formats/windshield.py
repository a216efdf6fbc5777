"""NCore's bivariate windshield: a lens without its windows, and polynomials of angles that bend rays as these do.

A ray to a point counts by phi = asin x and theta = asin y of its unit direction from the centre of projection. The
forward polynomials lead from those before the windows to those behind them, where the model of the lens begins; the
inverse ones lead back. Windows also shift rays: the centre is the point nearest to the rays before them.
"""

from collections.abc import Iterable
from dataclasses import asdict, replace

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.exports.central import central_model, field_of
from pipeline.exports.material import CentralModel, ExportCamera
from pipeline.fits.field import FieldRays
from pipeline.fits.fitting import MODELS, rms
from pipeline.formats import ExportError
from pipeline.optics.windows import parted
from pipeline.plugins.formats.ncore import ModelBehindWindows, Windshield
from pipeline.results.ready_camera import ReadyCamera

_ORDER = 5
"""Order of the polynomials [1]: the highest that renderers of NCore's models take."""
_MOST_PX = 1.0
"""Largest residual [px]: a model that is a pixel off would spoil what is fitted to it."""


def windshield_model(camera: ExportCamera, alternatives: Iterable[str]) -> ModelBehindWindows:
    """The central model of a camera without the windows before it, and the windshield that stands for them.

    `alternatives`: as in `central_model`. The centre is that of rays before the windows, residuals are of both.
    Raises ExportError: no model fits the lens, or the windows shift rays too much.
    """
    field = field_of(camera)
    inner = _without_windows(camera.rays.sight)
    lens = central_model(replace(camera, pinhole=None, rays=replace(camera.rays, ready=lambda: inner)), alternatives)
    centre_mm = field.rays.nearest_point_mm
    outside = _angles(field, centre_mm)
    inside = _angles(replace(field, rays=inner.rays(*field.x_px.T)), lens.centre_mm)
    forward = _polynomials(outside, inside)
    inverse = _polynomials(inside, outside)
    # Errors in the image of points on the planes, of the same through both polynomials, and of points far away
    errors, back, beyond = (
        _positions(lens, _powers(angles) @ forward) - np.tile(field.x_px, (len(angles) // len(field.x_px), 1))
        for angles in (outside, _powers(inside) @ inverse, np.arcsin(field.rays.direction[:, :2]))
    )
    most_px, back_px, beyond_px = (float(np.hypot(*error.T).max()) for error in (errors, back, beyond))
    if not most_px <= _MOST_PX:
        message = f"NCore's windshield misses rays through the windows before {camera.name} by {most_px:.3g} px"
        raise ExportError(f"{message}; {_MOST_PX:g} px is most", hint="export rays, which hold any camera")
    names = ("horizontal_poly", "vertical_poly", "horizontal_poly_inverse", "vertical_poly_inverse")
    windshield = Windshield(
        polynomials=dict(zip(names, np.concatenate([forward, inverse], axis=1).T, strict=True)),
        planes_mm=field.planes_mm,
        lens_rms_px=lens.rms_px,
        inverse_max_px=back_px,
        infinity_max_px=beyond_px,
    )
    both = {"centre_mm": centre_mm, "rms_px": rms(errors), "max_px": most_px}
    return ModelBehindWindows(**{**asdict(lens), **both}, windshield=windshield)


def _without_windows(ready: ReadyCamera) -> ReadyCamera:
    """The camera with the lens behind the windows alone."""
    windows, lens = parted(ready.camera.prescription)
    first = windows[-1].members.stop
    spectrum = tuple(
        replace(node, indices=node.indices[first:], index_in_front=node.indices[first - 1])
        for node in ready.camera.spectrum
    )
    camera = replace(ready.camera, prescription=lens, spectrum=spectrum)
    return replace(ready, rig=Rig.of(Tracer(camera, ready.rig.tracer.seed), ready.rig.square_px))


def _angles(field: FieldRays, centre_mm: np.ndarray) -> np.ndarray:
    """phi and theta of points of the rays on both planes, from a centre, (2 n, 2) [rad]."""
    towards = np.concatenate([field.points(z_mm) for z_mm in field.planes_mm]) - centre_mm
    return np.arcsin(towards[:, :2] / np.linalg.norm(towards, axis=1, keepdims=True))


def _powers(angles: np.ndarray) -> np.ndarray:
    """Terms of the polynomials, (n, 21): powers of phi, those below the highest times theta, and so on."""
    phi, theta = angles.T
    return np.stack([phi**i * theta**j for j in range(_ORDER + 1) for i in range(_ORDER + 1 - j)], axis=1)


def _polynomials(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Coefficients of phi and theta of some angles, as polynomials of others, (21, 2)."""
    return np.asarray(np.linalg.lstsq(_powers(before), after, rcond=None)[0])


def _positions(lens: CentralModel, angles: np.ndarray) -> np.ndarray:
    """Image positions of rays at angles behind the windows, (n, 2)."""
    x, y = np.sin(angles).T
    towards = np.stack([x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0))], axis=1)
    parameters = np.concatenate([lens.focal_px, lens.principal_point_px, lens.coefficients])
    return MODELS[lens.name].project(parameters, towards)
