"""All that `pipeline fit` finds of a camera."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.fits.errors import FitError
from pipeline.fits.field import FieldRays, PupilCurve, field_rays, pupil_curve
from pipeline.fits.fitting import Fit, fitted, rms
from pipeline.fits.models import MODELS
from pipeline.fits.thin_plenoptic import ThinPlenopticFit, thin_plenoptic
from pipeline.results.ready_camera import ReadyCamera
from pipeline.spelling import did_you_mean

THIN_LENS = "thin-lens-plenoptic"
"""Name of the model of a whole plenoptic camera; all others stand for its main lens."""
ALL = "all"
"""Name for all models that can stand for a camera."""
_ALIKE = 1e-6
"""Relative difference of residuals that symmetry makes equal [1]: rays are right to about as much."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedCamera:
    """A camera with the models nearest to it.

    Attributes
    ----------
    name : str
    field : FieldRays
        Rays of its main lens over the image.
    fits : tuple of Fit
        Models of the main lens, in the order asked for.
    thin : ThinPlenopticFit or None
        None unless it is asked for.
    pupil : PupilCurve
    """

    name: str
    field: FieldRays
    fits: tuple[Fit, ...]
    thin: ThinPlenopticFit | None
    pupil: PupilCurve

    @property
    def best(self) -> Fit:
        """The fit with the smallest rms."""
        return min(self.fits, key=lambda fit: fit.rms_px)


def fit_camera(camera: ReadyCamera, names: Iterable[str]) -> FittedCamera:
    """Fit models to a camera.

    Parameters
    ----------
    names : iterable of str
        Keys of `MODELS`, `THIN_LENS` or `ALL`.

    Raises
    ------
    FitError
        There is no such model, or it cannot stand for the camera.
    """
    wanted = list(dict.fromkeys(names))
    if ALL in wanted:
        wanted = [*MODELS, *([THIN_LENS] if camera.is_plenoptic else [])]
    for name in wanted:
        if name != THIN_LENS:
            _require_known(name)
    field = field_rays(camera)
    return FittedCamera(
        name=camera.name,
        field=field,
        fits=tuple(fitted(field, name) for name in wanted if name != THIN_LENS),
        thin=thin_plenoptic(camera) if THIN_LENS in wanted else None,
        pupil=pupil_curve(field),
    )


def document(found: FittedCamera) -> dict[str, Any]:
    """The result as plain data."""
    field = found.field
    return {
        "camera": found.name,
        "size_px": list(field.size_px),
        "planes_mm": list(field.planes_mm),
        "rays": len(field.x_px),
        "lit_share": field.lit_share,
        "conventions": {
            "pixel": "(0, 0) is the centre of the top-left pixel, x right, y down",
            "frame": "vision frame: origin at the centre of the aperture stop, x right, y down, z forward, mm",
            "residual": "position by the model minus position, px",
        },
        "models": [_model(fit, field) for fit in found.fits],
        "thin_lens_plenoptic": None if found.thin is None else _thin(found.thin),
        "entrance_pupil": {
            "angle_deg": found.pupil.angle_deg.tolist(),
            "z_mm": found.pupil.z_mm.tolist(),
            "aside_mm": found.pupil.aside_mm.tolist(),
        },
    }


def worst(fit: Fit, field: FieldRays) -> tuple[float, float, float]:
    """Image position of the largest residual, and vision z of its plane; of corners that are alike the first."""
    length = np.linalg.norm(fit.residual_px, axis=-1).ravel()
    plane, row = divmod(int(np.argmax(length >= (1 - _ALIKE) * length.max())), len(field.x_px))
    x, y = field.x_px[row].tolist()
    return x, y, field.planes_mm[plane]


def by_distance(fit: Fit, field: FieldRays) -> list[tuple[float, float, float]]:
    """Vision z, rms and largest residual on planes at other distances: what no centre of projection explains."""
    found = [(z_mm, fit.at_distance(field, z_mm)) for z_mm in field.distances_mm]
    return [(z_mm, rms(off), float(np.hypot(*off.T).max())) for z_mm, off in found]


def _require_known(name: str) -> None:
    others = [*MODELS, THIN_LENS, ALL]
    if name not in MODELS:
        hint = did_you_mean(name, others) or f"models: {', '.join(others)}"
        raise FitError(f"there is no model {name!r}", hint=hint)


def _model(fit: Fit, field: FieldRays) -> dict[str, Any]:
    x, y, z_mm = worst(fit, field)
    rows = by_distance(fit, field)
    return {
        "name": fit.model.name,
        "consumer": fit.model.consumer,
        "parameters": fit.values,
        "rms_px": fit.rms_px,
        "max_px": fit.max_px,
        "max_at": {"x_px": x, "y_px": y, "z_mm": z_mm},
        "by_distance": [{"z_mm": z, "rms_px": mean, "max_px": most} for z, mean, most in rows],
        "field": {
            "x_px": field.x_px[:, 0].tolist(),
            "y_px": field.x_px[:, 1].tolist(),
            "near_px": fit.residual_px[0].tolist(),
            "far_px": fit.residual_px[1].tolist(),
        },
    }


def _thin(fit: ThinPlenopticFit) -> dict[str, Any]:
    return {
        "parameters": fit.values,
        "points": fit.points,
        "positions": len(fit.residual_px),
        "rms_px": fit.rms_px,
        "max_px": fit.max_px,
        "positions_in_penumbra": len(fit.dim_px),
        "rms_in_penumbra_px": fit.dim_rms_px,
    }
