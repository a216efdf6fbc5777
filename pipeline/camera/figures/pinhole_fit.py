"""A pinhole fitted to sightings: points in space and the image positions that see them, by least squares.

In the equations of OpenCV with C the centre, u = (X - C_x, Y - C_y) / (Z - C_z), r = |u|:

    x = f (u (1 + k1 r^2 + k2 r^4 + k3 r^6) + tangential(p1, p2; u)) + c

The image plane is parallel to the sensor, so a pinhole has the axes of the vision frame.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.records.shapes import Float64, Num, Shaped

STEPS = 40
"""Steps of a fit at most: a fit that settles needs few, and one that does not has to end."""
SETTLED = 1e-12
"""Change of the image by the last step over the norm of all image positions [1]: thousands of roundings of a double."""
F, CENTRE, POINT, RADIAL, TANGENTIAL = 0, (1, 2, 3), (4, 5), (6, 7, 8), (9, 10)
"""Places of the parameters: f, C, c, (k1, k2, k3), (p1, p2)."""
NOTHING_LEFT_PX = 1e-6
"""Residual below which no coefficient is added [px]: a thousandth of the accuracy that tables claim by default."""
WORTH_IT = 0.9
"""Residual that a further radial coefficient may leave, over the one before [1]: with less gain than a tenth it would
stand for nothing in the lens."""
IMAGINARY = 1e-30
"""Length of a complex step, in the unit of the parameter: its square vanishes beside 1, and no difference is taken, so
derivatives have neither truncation errors nor cancelled digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Projection:
    """A pinhole's image of directions, and how far the rays of the real camera differ from it."""

    principal_distance_px: float
    principal_point_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]  # k1, k2, p1, p2, k3 as OpenCV orders and defines them
    # Lengths of the differences to what it was fitted to
    rms_px: float
    max_px: float


@dataclass(frozen=True, slots=True)
class Sightings:
    """Image positions (n, 2) and the points of the vision frame that they see, (n, 3)."""

    x_px: Float64[np.ndarray, "n 2"]
    places_mm: Num[np.ndarray, "n 3"]

    def residuals(self, p: Shaped[np.ndarray, "11"]) -> np.ndarray:
        """Differences of a pinhole's images of the points from their positions, (n, 2) [px]; analytic in `p`."""
        (k1, k2, k3), (p1, p2) = p[list(RADIAL)], p[list(TANGENTIAL)]
        ahead = self.places_mm - p[list(CENTRE)]
        u, v = (ahead[:, :2] / ahead[:, 2:]).T
        square = u * u + v * v
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        x = u * radial + 2 * p1 * u * v + p2 * (square + 2 * u * u)
        y = v * radial + p1 * (square + 2 * v * v) + 2 * p2 * u * v
        return np.asarray(p[F] * np.stack([x, y], axis=1) + p[list(POINT)] - self.x_px)

    def slopes(self, p: Float64[np.ndarray, "11"], free: tuple[int, ...]) -> np.ndarray:
        """Derivatives of the residuals by the parameters in `free`, (2 n, free), by complex steps."""
        tilted = p + IMAGINARY * 1j * np.eye(len(p))[list(free)]
        with np.errstate(over="ignore", invalid="ignore"):  # a fit that runs away ends as NaN
            derivatives = np.array([self.residuals(row).imag.ravel() for row in tilted]) / IMAGINARY
        return derivatives.reshape(len(free), self.x_px.size).T

    def fitted(self, start: Float64[np.ndarray, "11"], free: tuple[int, ...]) -> np.ndarray:
        """The parameters with those in `free` at least squares: Gauss and Newton."""
        p = start.copy()
        for _ in range(STEPS):
            slopes = self.slopes(p, free)
            with np.errstate(over="ignore", invalid="ignore"):
                scale = np.linalg.norm(slopes, axis=0)
            if not (np.isfinite(scale).all() and scale.all()):
                return np.full_like(p, math.nan)
            step = np.linalg.lstsq(slopes / scale, -self.residuals(p).ravel(), rcond=None)[0]
            p[list(free)] += step / scale
            if np.linalg.norm(step) < SETTLED * np.linalg.norm(self.x_px):
                break
        return p

    def with_radial(self, p: Float64[np.ndarray, "11"], free: tuple[int, ...]) -> np.ndarray:
        """Parameters fitted again with those radial coefficients that are worth it."""
        for count in range(1, len(RADIAL) + 1):
            if self.rms_px(p) < NOTHING_LEFT_PX:
                break
            finer = self.fitted(p, (*free, *RADIAL[:count]))
            if self.rms_px(finer) < WORTH_IT * self.rms_px(p):
                p = finer
        return p

    def rms_px(self, p: Float64[np.ndarray, "11"]) -> float:
        """Root mean square of the lengths of the residuals."""
        return float(np.sqrt(np.mean(np.sum(self.residuals(p) ** 2, axis=1))))

    def projection(self, p: Float64[np.ndarray, "11"]) -> Projection:
        """The part of the parameters that makes the image."""
        k1, k2, k3, p1, p2 = p[[*RADIAL, *TANGENTIAL]].tolist()
        x, y = p[list(POINT)].tolist()
        return Projection(
            principal_distance_px=float(p[F]),
            principal_point_px=(x, y),
            distortion=(k1, k2, p1, p2, k3),
            rms_px=self.rms_px(p),
            max_px=float(np.hypot(*self.residuals(p).T).max()),
        )
