"""Projection models of other programs, image positions of points seen from one centre in their own equations, and the
one nearest to exact rays: least squares of image positions on two planes, by SciPy.

Every model is analytic in its parameters, so that derivatives follow from complex steps, without cancelled digits. The
axes are those of the vision frame: no rotation is fitted, but the tilt of the image plane in a model that has one.

A narrow field does not tell the coefficients of high powers from each other: values of a million would cancel, and fall
apart in single precision or a pixel outside of the image. So each coefficient's effect in the image counts as a
residual, too, times `_HELD`. That moves what the rays determine by less than rounding, and keeps the rest near 0.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.camera.figures.equivalent_pinhole import IMAGINARY
from pipeline.fits.field import FieldRays, FitError
from pipeline.frames import distorted

CENTRE = ("centre_x_mm", "centre_y_mm", "centre_z_mm")
"""Parameters that all models begin with: the centre of projection, vision frame."""
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "taux", "tauy")
"""Coefficients of OpenCV's distortion, in its order."""
_RANGES = {"alpha": (0.0, 0.5, 1.0), "beta": (0.0, 1.0, math.inf), "xi": (-1.0, 0.0, 1.0)}
"""Coefficient of a model of spheres -> least, where fits begin, most. They begin at the projection of a sphere from its
surface; an alpha of 0 is a pinhole."""
_NEWTON_STEPS = 30
"""Most steps of the inverse of a polynomial: it converges quadratically from the radius without distortion."""
_INVERTED = 1e-15
"""Relative change of a step that ends them [1]: a few roundings."""


@dataclass(frozen=True, slots=True)
class Model:
    name: str
    consumer: str  # who has it, and under which name
    # Function of the model's own parameters (m,) and of points (n, 3), counted from the centre, that returns image
    # positions (n, 2), ours: (0, 0) is the centre of the top-left pixel. Analytic in both.
    project: Callable[[np.ndarray, np.ndarray], np.ndarray]
    coefficients: tuple[str, ...]  # parameters that stay at 0, or where `_RANGES` says, if rays do not determine them
    core: tuple[str, ...] = ("fx", "fy", "cx", "cy")  # those before them
    nearest: str | None = None  # a simpler model with the same parameters and fewer, from whose fit this one's starts

    @property
    def parameters(self) -> tuple[str, ...]:
        """`CENTRE` and the model's own; lengths are px, coefficients numbers, tau radians."""
        return (*CENTRE, *self.core, *self.coefficients)

    def positions(self, p: np.ndarray, points_mm: np.ndarray) -> np.ndarray:
        """Image positions of points of the vision frame, (n, 2); `p` holds all parameters."""
        return self.project(p[len(CENTRE) :], points_mm - p[: len(CENTRE)])

    def of_rows(self, p: np.ndarray, points: np.ndarray, _: np.ndarray) -> np.ndarray:
        """`project` as information asks for it: rows of a pinhole have no numbers of their own."""
        return self.project(p, points)


def _opencv(p: np.ndarray, points: np.ndarray) -> np.ndarray:
    """`projectPoints` of OpenCV."""
    fx, fy, cx, cy = p[:4]
    x, y = distorted(p[4:], points[:, 0] / points[:, 2], points[:, 1] / points[:, 2])
    return np.stack([fx * x + cx, fy * y + cy], axis=1)


def _angle(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle with the axis, and x and y of the unit vector away from it, (n,) each; analytic."""
    across = np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2)
    is_off = across != 0
    safe = np.where(is_off, across, 1.0)
    # arctan of complex numbers has its cut where |z| > 1 on the imaginary axis: never reached
    is_ahead = points[:, 2].real > 0
    from_axis = np.arctan(across / np.where(is_ahead, points[:, 2], 1.0))
    theta = np.where(is_ahead, from_axis, np.pi / 2 - np.arctan(np.where(is_ahead, 0.0, points[:, 2]) / safe))
    return theta, np.where(is_off, points[:, 0] / safe, 0.0), np.where(is_off, points[:, 1] / safe, 0.0)


def _fisheye(p: np.ndarray, points: np.ndarray) -> np.ndarray:
    """`cv2.fisheye`: theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), without skew."""
    fx, fy, cx, cy, k1, k2, k3, k4 = p
    theta, x, y = _angle(points)
    t2 = theta * theta
    radius = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    return np.stack([fx * radius * x + cx, fy * radius * y + cy], axis=1)


def _kannala_brandt(p: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The radius in px is k0 theta + k1 theta^3 + k2 theta^5 + k3 theta^7: Kannala and Brandt 2006, equation 6."""
    cx, cy, k0, k1, k2, k3 = p
    theta, x, y = _angle(points)
    t2 = theta * theta
    radius = theta * (k0 + t2 * (k1 + t2 * (k2 + t2 * k3)))
    return np.stack([radius * x + cx, radius * y + cy], axis=1)


def _ftheta(p: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The angle in radians is k1 r + k2 r^2 + k3 r^3 + k4 r^4, r in px: solved for r by Newton's method."""
    cx, cy, k1, k2, k3, k4 = p
    theta, x, y = _angle(points)
    radius = theta / k1
    for _ in range(_NEWTON_STEPS):
        value = radius * (k1 + radius * (k2 + radius * (k3 + radius * k4)))
        slope = k1 + radius * (2 * k2 + radius * (3 * k3 + radius * 4 * k4))
        step = (theta - value) / slope
        radius = radius + step
        if not (np.abs(step) > _INVERTED * np.abs(radius)).any():
            break
    return np.stack([radius * x + cx, radius * y + cy], axis=1)


def _eucm(p: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Khomutenko, Garcia and Martinet 2016, equation 6: the plane behind an ellipsoid, without skew."""
    alpha, beta = p[4:]
    across, z = points[:, 0] ** 2 + points[:, 1] ** 2, points[:, 2]
    return _over(alpha * np.sqrt(beta * across + z * z) + (1 - alpha) * z, p, points)


def _double_sphere(p: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Usenko, Demmel and Cremers 2018, equations 40 to 42."""
    xi, alpha = p[4:]
    across, z = points[:, 0] ** 2 + points[:, 1] ** 2, points[:, 2]
    shifted = xi * np.sqrt(across + z * z) + z
    return _over(alpha * np.sqrt(across + shifted * shifted) + (1 - alpha) * shifted, p, points)


def _over(depth: np.ndarray, p: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Image positions of points whose x and y count over this depth."""
    fx, fy, cx, cy = p[:4]
    return np.stack([fx * points[:, 0] / depth + cx, fy * points[:, 1] / depth + cy], axis=1)


_ALL = (
    Model("pinhole", "a pinhole without distortion", _opencv, ()),
    Model("brown", "OpenCV, 5 coefficients: Brown", _opencv, _COEFFICIENTS[:5], nearest="pinhole"),
    Model("rational", "OpenCV, 8 coefficients: CALIB_RATIONAL_MODEL", _opencv, _COEFFICIENTS[:8], nearest="brown"),
    Model(
        "thin-prism", "OpenCV, 12 coefficients: CALIB_THIN_PRISM_MODEL", _opencv, _COEFFICIENTS[:12], nearest="rational"
    ),
    Model("tilted", "OpenCV, 14 coefficients: CALIB_TILTED_MODEL", _opencv, _COEFFICIENTS, nearest="thin-prism"),
    Model("fisheye", "cv2.fisheye", _fisheye, ("k1", "k2", "k3", "k4")),
    Model(
        "kannala-brandt",
        "Kannala and Brandt 2006, four radial terms; kannalaBrandtK3 of Omniverse",
        _kannala_brandt,
        ("k1", "k2", "k3"),
        core=("cx", "cy", "k0"),
    ),
    Model("ftheta", "ftheta of Omniverse", _ftheta, ("k2", "k3", "k4"), core=("cx", "cy", "k1")),
    Model("eucm", "eucm of Kalibr and Basalt: Khomutenko 2016", _eucm, ("alpha", "beta")),
    Model("double-sphere", "ds of Kalibr and Basalt: Usenko 2018", _double_sphere, ("xi", "alpha")),
)
MODELS = {model.name: model for model in _ALL}
"""Name -> model, in the order of `pipeline fit --list`."""


_SETTLED = 1e-15
"""Relative change of parameters or of the sum of squares that ends a fit [1]: a few roundings."""
_WIDE = "choose a model for wide fields: --model fisheye, kannala-brandt, ftheta, eucm or double-sphere"
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
        is_behind = model.project is _opencv and (field.rays.direction[:, 2] <= 0).any()
        if is_behind or not np.isfinite(off(start)).all():
            raise FitError(f"no {name} model fits: rays lie behind its centre", hint=_WIDE)
        free = (-math.inf, math.nan, math.inf)
        held = dict.fromkeys(model.coefficients, (-math.inf, 0.0, math.inf)) | _RANGES
        parameters = least(off, start, np.array([held.get(name, free) for name in model.parameters]))
    residual = off(parameters)
    if not np.isfinite(residual).all():
        raise FitError(f"the fit of {name} does not settle")
    return Fit(model=model, parameters=parameters, residual_px=residual.reshape(2, -1, 2))


def least(off: Callable[[np.ndarray], np.ndarray], start: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Parameters with the least sum of squares of `off`, an analytic function of them.

    `ranges`: (m, 3), the least and the most that each may be, and between them where it stays if residuals do not
    determine it; NaN of free ones.
    """
    from scipy.optimize import least_squares

    def slopes(p: np.ndarray) -> np.ndarray:
        tilted = p + IMAGINARY * 1j * np.eye(len(p))
        return np.stack([off(row).imag for row in tilted], axis=1) / IMAGINARY

    low, rest, high = ranges.T
    held = np.isfinite(rest)
    bare = np.where(held, rest, start)
    effect = np.diag(_HELD * np.abs(slopes(bare)).max(axis=0))[held]
    tolerances = {"ftol": _SETTLED, "xtol": _SETTLED, "gtol": _SETTLED}
    solution = least_squares(
        lambda p: np.concatenate([off(p), effect @ (p - bare)]),
        start,
        lambda p: np.concatenate([slopes(p), effect]),
        method="trf" if np.isfinite([low, high]).any() else "lm",
        bounds=(low, high),
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
    values |= {name: rest for name, (_, rest, _) in _RANGES.items()}
    values |= {"kannala-brandt": {"k0": f}, "ftheta": {"k1": 1 / f}}.get(model.name, {})
    return np.array([values.get(name, 0.0) for name in model.parameters])
