"""All that `pipeline fit` finds of a camera, as data and as lines for a terminal."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.fits.field import FieldRays, FitError, field_rays
from pipeline.fits.fitting import MODELS, Fit, fitted, rms
from pipeline.plugins.fits.pupil import PupilCurve, pupil_curve
from pipeline.plugins.fits.thin_plenoptic import ThinPlenopticFit, thin_plenoptic
from pipeline.records.plain import Json
from pipeline.results.ready_camera import ReadyCamera
from pipeline.spelling import did_you_mean

THIN_LENS = "thin-lens-plenoptic"
"""Name of the model of a whole plenoptic camera; all others stand for its main lens."""
ALL = "all"
"""Name for all models that can stand for a camera."""
_ROWS = 5
"""Lines about the entrance pupil: from the middle of the field to its edge."""
_NOTHING = 1e-11
"""Size below which a parameter prints as 0 [its unit]: rounding of what symmetry makes 0."""
_ALIKE = 1e-6
"""Relative difference of residuals that symmetry makes equal [1]: rays are right to about as much."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedCamera:
    """A camera with the models nearest to it."""

    name: str
    field: FieldRays  # rays of its main lens over the image
    fits: tuple[Fit, ...]  # models of the main lens, in the order asked for
    thin: ThinPlenopticFit | None  # None unless it is asked for
    pupil: PupilCurve

    @property
    def best(self) -> Fit:
        """The fit with the smallest rms."""
        return min(self.fits, key=lambda fit: fit.rms_px)


def fit_camera(camera: ReadyCamera, names: Iterable[str]) -> FittedCamera:
    """Fit models to a camera.

    `names`: keys of `MODELS`, `THIN_LENS` or `ALL`.
    Raises FitError: there is no such model, or it cannot stand for the camera.
    """
    models = list(dict.fromkeys(names))
    if is_all := ALL in models:
        models = [*MODELS, *([THIN_LENS] if camera.is_plenoptic else [])]
    for name in models:
        if name not in (*MODELS, THIN_LENS):
            names_of_models = [*MODELS, THIN_LENS, ALL]
            hint = did_you_mean(name, names_of_models) or f"models: {', '.join(names_of_models)}"
            raise FitError(f"there is no model {name!r}", hint=hint)
    field, fits = field_rays(camera), list[Fit]()
    for name in models:
        try:
            fits += [] if name == THIN_LENS else [fitted(field, name)]
        except FitError:
            if not is_all:
                raise
    return FittedCamera(
        name=camera.name,
        field=field,
        fits=tuple(fits),
        thin=thin_plenoptic(camera) if THIN_LENS in models else None,
        pupil=pupil_curve(field),
    )


def document(camera: FittedCamera) -> Json:
    """The result as plain data."""
    field = camera.field
    return {
        "camera": camera.name,
        "size_px": list(field.size_px),
        "planes_mm": list(field.planes_mm),
        "rays": len(field.x_px),
        "lit_share": field.lit_share,
        "conventions": {
            "pixel": "(0, 0) is the centre of the top-left pixel, x right, y down",
            "frame": "vision frame: origin at the centre of the aperture stop, x right, y down, z forward, mm",
            "residual": "position by the model minus position, px",
        },
        "models": [_model(fit, field) for fit in camera.fits],
        "thin_lens_plenoptic": None if camera.thin is None else _thin(camera.thin),
        "entrance_pupil": {
            "angle_deg": camera.pupil.angle_deg.tolist(),
            "z_mm": camera.pupil.z_mm.tolist(),
            "aside_mm": camera.pupil.aside_mm.tolist(),
        },
    }


def worst(fit: Fit, field: FieldRays) -> dict[str, float]:
    """Image position of the largest residual, and vision z of its plane; of corners that are alike the first."""
    length = np.linalg.norm(fit.residual_px, axis=-1).ravel()
    plane, row = divmod(int(np.argmax(length >= (1 - _ALIKE) * length.max())), len(field.x_px))
    x, y = field.x_px[row].tolist()
    return {"x_px": x, "y_px": y, "z_mm": field.planes_mm[plane]}


def by_distance(fit: Fit, field: FieldRays) -> list[dict[str, float]]:
    """Vision z, rms and largest residual on planes at other distances: what no centre of projection explains."""
    rows = []
    for z_mm in field.distances_mm:
        residual_px = fit.at_distance(field, z_mm)
        rows.append({"z_mm": z_mm, "rms_px": rms(residual_px), "max_px": float(np.hypot(*residual_px.T).max())})
    return rows


def _model(fit: Fit, field: FieldRays) -> Json:
    return {
        "name": fit.model.name,
        "consumer": fit.model.consumer,
        "parameters": fit.values,
        "rms_px": fit.rms_px,
        "max_px": fit.max_px,
        "max_at": worst(fit, field),
        "by_distance": by_distance(fit, field),
        "field": {
            "x_px": field.x_px[:, 0].tolist(),
            "y_px": field.x_px[:, 1].tolist(),
            "near_px": fit.residual_px[0].tolist(),
            "far_px": fit.residual_px[1].tolist(),
        },
    }


def _thin(fit: ThinPlenopticFit) -> Json:
    return {
        "parameters": fit.values,
        "points": fit.points,
        "positions": len(fit.residual_px),
        "rms_px": fit.rms_px,
        "max_px": fit.max_px,
        "positions_in_penumbra": len(fit.dim_px),
        "rms_in_penumbra_px": fit.dim_rms_px,
    }


def page(camera: FittedCamera) -> Iterator[str]:
    """Lines for a terminal: models with residuals, residuals by distance, the entrance pupil over the field."""
    field = camera.field
    width, height = field.size_px
    near, far = field.planes_mm
    yield f"{camera.name}: {len(field.x_px)} rays over {width} x {height} px, on planes {near:.4g} and {far:.4g} mm"
    yield "before the stop; residuals are lengths in px"
    yield ""
    if camera.fits:
        yield "model             rms        largest    where"
    for fit in camera.fits:
        largest = worst(fit, field)
        position = f"at ({largest['x_px']:g}, {largest['y_px']:g}) px, {largest['z_mm']:.4g} mm"
        yield f"{fit.model.name:16}  {fit.rms_px:.3e}  {fit.max_px:.3e}  {position}"
    for fit in camera.fits:
        yield ""
        yield f"{fit.model.name}: {fit.model.consumer}"
        yield from _parameters(fit.values)
    if camera.fits:
        yield ""
        yield f"{camera.best.model.name} at other distances, not fitted again: rays of a lens do not meet in one centre"
        yield "vision z      rms        largest"
        for row in by_distance(camera.best, field):
            yield f"{row['z_mm']:9.1f} mm  {row['rms_px']:.3e}  {row['max_px']:.3e}"
    if camera.thin is not None:
        yield ""
        yield from _thin_lines(camera.thin)
    yield ""
    yield "entrance pupil: where rays pass the axis"
    yield "angle      vision z"
    count = len(camera.pupil.angle_deg)
    for i in sorted({round((count - 1) * step / (_ROWS - 1)) for step in range(_ROWS)} if count else ()):
        yield f"{camera.pupil.angle_deg[i]:6.2f}°   {camera.pupil.z_mm[i]:10.4f} mm"


def _parameters(values: dict[str, float]) -> Iterator[str]:
    items = [f"{name} {0 if abs(value) < _NOTHING else value:.8g}" for name, value in values.items()]
    for first in range(0, len(items), 4):
        yield "  " + "  ".join(f"{item:26}" for item in items[first : first + 4]).rstrip()


def _thin_lines(fit: ThinPlenopticFit) -> Iterator[str]:
    yield f"thin lens before pinholes: {len(fit.residual_px)} positions of {fit.points} points in full light,"
    line = f"rms {fit.rms_px:.3e}, largest {fit.max_px:.3e}"
    if fit.dim_rms_px is not None:
        line += f"; {len(fit.dim_px)} more in the penumbra, rms {fit.dim_rms_px:.3e}"
    yield line
    yield from _parameters(fit.values)
