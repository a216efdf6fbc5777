"""The model nearest to exact rays: least squares of image positions on two planes, by SciPy.

A narrow field does not tell the coefficients of high powers from each other: values of a million would cancel, and fall
apart in single precision or a pixel outside of the image. So each coefficient's effect in the image counts as a
residual, too, times `_HELD`. That moves what the rays determine by less than rounding, and keeps the rest near 0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.fits.field import FieldRays, FitError
from pipeline.fits.models import MODELS, Model

_IMAGINARY = 1e-30
"""Length of a complex step, in the unit of the parameter: its square vanishes beside 1, and no difference is taken."""
_SETTLED = 1e-15
"""Relative change of parameters or of the sum of squares that ends a fit [1]: a few roundings."""
_EVALUATIONS = 400
"""Most evaluations: fits that settle need some tens."""
_HELD = 1e-5
"""Weight of the effect of a coefficient [1]: a pixel of it is worth 1e-5 px of misfit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A model fitted to the rays of a camera."""

    model: Model
    parameters: np.ndarray  # (m,), in the order of the model
    # (2, n, 2), position by the model minus position, of points of each ray on the near and on the far plane
    residual_px: np.ndarray

    @property
    def values(self) -> dict[str, float]:
        """Parameters by name."""
        return dict(zip(self.model.parameters, self.parameters.tolist(), strict=True))

    @property
    def rms_px(self) -> float:
        """Root mean square of the lengths of the residuals."""
        return rms(self.residual_px)

    @property
    def max_px(self) -> float:
        """Length of the largest residual."""
        return float(np.linalg.norm(self.residual_px, axis=-1).max())

    def at_distance(self, field: FieldRays, z_mm: float) -> np.ndarray:
        """Residuals of points of the rays on another plane, (n, 2) [px]: the model is not fitted again."""
        return self.model.positions(self.parameters, field.points(z_mm)) - field.x_px


def rms(residual_px: np.ndarray) -> float:
    """Root mean square of the lengths of residuals (..., 2)."""
    return float(np.sqrt(np.mean(np.sum(residual_px**2, axis=-1))))


def fitted(field: FieldRays, name: str) -> Fit:
    """Fit a model, from the paraxial pinhole or from the fit of the simpler model that it extends.

    Raises FitError: the fit does not settle.
    """
    model = MODELS[name]
    start = _start(field, model)
    points = np.concatenate([field.points(z_mm) for z_mm in field.planes_mm])
    wanted = np.tile(field.x_px, (2, 1))

    def off(p: np.ndarray) -> np.ndarray:
        return (model.positions(p, points) - wanted).ravel()

    with np.errstate(all="ignore"):  # a fit that runs away ends as NaN
        if not np.isfinite(off(start)).all():
            raise FitError(f"no {name} model fits: rays lie behind its centre", hint="choose a model for wide fields")
        parameters = least(off, start, [name in model.coefficients for name in model.parameters])
    residual = off(parameters)
    if not np.isfinite(residual).all():
        raise FitError(f"the fit of {name} does not settle")
    return Fit(model=model, parameters=parameters, residual_px=residual.reshape(2, -1, 2))


def least(off: Callable[[np.ndarray], np.ndarray], start: np.ndarray, held: Sequence[bool]) -> np.ndarray:
    """Parameters with the least sum of squares of `off`, an analytic function of them.

    `held`: parameters that stay near 0 where residuals do not determine them.
    """
    from scipy.optimize import least_squares

    def slopes(p: np.ndarray) -> np.ndarray:
        tilted = p + _IMAGINARY * 1j * np.eye(len(p))
        return np.stack([off(row).imag for row in tilted], axis=1) / _IMAGINARY

    bare = np.where(held, 0.0, start)
    effect = np.diag(_HELD * np.abs(slopes(bare)).max(axis=0))[np.asarray(held)]
    tolerances = {"ftol": _SETTLED, "xtol": _SETTLED, "gtol": _SETTLED}
    solution = least_squares(
        lambda p: np.concatenate([off(p), effect @ p]),
        start,
        lambda p: np.concatenate([slopes(p), effect]),
        method="lm",
        x_scale="jac",
        max_nfev=_EVALUATIONS,
        **tolerances,
    )
    return np.asarray(solution.x)


def _start(field: FieldRays, model: Model) -> np.ndarray:
    """Values to start from; what the simpler model does not have starts at 0."""
    f, x, y, z_mm = field.start.tolist()
    values = {"centre_z_mm": z_mm, "fx": f, "fy": f, "cx": x, "cy": y}
    if model.nearest is not None:
        values = fitted(field, model.nearest).values
    values |= {"kannala-brandt": {"k0": f}, "ftheta": {"k1": 1 / f}}.get(model.name, {})
    return np.array([values.get(name, 0.0) for name in model.parameters])
