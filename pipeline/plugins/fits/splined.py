"""mrcal's splined models: a stereographic projection whose image plane two B-splines bend. A name says all of one, as
LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=12_Ny=9_fov_x_deg=60 does.

A point at the angle theta from the axis is at u = 2 tan(theta / 2) away from it on the plane, and in the image at
f (u + S(u)) + c. Control points of S are parameters; f and c are held, as mrcal holds them: splines can do the same.
mrcal's documentation, "Splined stereographic lens model".
"""

import re
from dataclasses import dataclass
from typing import Self

import numpy as np

from pipeline.fits.field import FitError
from pipeline.plugins.fits.information import derivatives
from pipeline.records.shapes import Float64

EXAMPLE = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=12_Ny=9_fov_x_deg=60"
_NAME = re.compile(r"LENSMODEL_SPLINED_STEREOGRAPHIC_order=([23])_Nx=(\d+)_Ny=(\d+)_fov_x_deg=(\d+)")
_LEAST = 4
"""Fewest control points along x or y: those of one cubic segment."""
_LEAST_SHARE = 1e-6
"""Share of the largest singular value below which positions do not tell a direction of control points [1]."""


@dataclass(frozen=True, slots=True)
class Splined:
    """A splined model; `core` has fx, fy, cx and cy [px]."""

    order: int
    columns: int
    rows: int
    fov_x_deg: int
    core: Float64[np.ndarray, "4"]

    @classmethod
    def named(cls, name: str, core: Float64[np.ndarray, "4"]) -> Self | None:
        """The model of a name of mrcal's, None of another one. Raises FitError: it has no such grid."""
        if (match := _NAME.fullmatch(name)) is None:
            return None
        order, columns, rows, fov_x_deg = map(int, match.groups())
        if min(columns, rows) < _LEAST or not 0 < fov_x_deg < 360:
            raise FitError(
                f"{name} has no spline", hint=f"at least {_LEAST} control points along x and y, below 360 deg"
            )
        return cls(order, columns, rows, fov_x_deg, core)

    @property
    def name(self) -> str:
        """Name of the model in mrcal."""
        grid = f"order={self.order}_Nx={self.columns}_Ny={self.rows}_fov_x_deg={self.fov_x_deg}"
        return f"LENSMODEL_SPLINED_STEREOGRAPHIC_{grid}"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Control points in mrcal's order, row by row: those of x and of y [1], by column and row."""
        return tuple(f"s{axis}[{i},{j}]" for j in range(self.rows) for i in range(self.columns) for axis in "xy")

    def project(self, p: np.ndarray, points: np.ndarray, _: np.ndarray) -> np.ndarray:
        """Image positions (n, 2) of points (n, 3) [mm] by control points (m,); analytic in both."""
        depth = np.sqrt((points * points).sum(axis=1)) + points[:, 2]
        u = 2 * points[:, :2] / depth[:, None]
        across = 4 * np.tan(np.deg2rad(self.fov_x_deg / 4))
        per_u = (self.columns - self.order) / across  # a spline of order k needs (k - 1) / 2 intervals beyond an edge
        column, weight_x = self._weights(u[:, 0] * per_u + (self.columns - 1) / 2, self.columns)
        row, weight_y = self._weights(u[:, 1] * per_u + (self.rows - 1) / 2, self.rows)
        control = p.reshape(self.rows, self.columns, 2)[row[:, :, None], column[:, None, :]]
        bent = np.einsum("nj,ni,njix->nx", weight_y, weight_x, control)
        return (u + bent) * self.core[:2] + self.core[2:]

    def nearest(self, points: Float64[np.ndarray, "n 3"], x_px: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Control points with which points are projected to image positions best; 0 where they do not tell them."""
        flat, row_numbers = np.zeros(len(self.parameters)), np.zeros((len(points), 0))
        by_control, _ = derivatives(self.project, flat, points, row_numbers)
        residual_px = x_px - self.project(flat, points, row_numbers)
        columns = by_control.reshape(residual_px.size, -1)
        return np.linalg.lstsq(columns, residual_px.ravel(), rcond=_LEAST_SHARE)[0]

    def _weights(self, position: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Control points that bend positions counted in these, and their weights, (n, order + 1) each: those of a
        uniform quadratic or cubic B-spline. Beyond the grid the last segment goes on.
        """
        if self.order == 2:
            first = np.clip(np.floor(position.real + 0.5), 1, count - 2).astype(int) - 1
            x = position - first - 1
            weights = [(1 - 2 * x) ** 2 / 8, 3 / 4 - x * x, (1 + 2 * x) ** 2 / 8]
        else:
            first = np.clip(np.floor(position.real), 1, count - 3).astype(int) - 1
            x = position - first - 1
            y = 1 - x
            weights = [y**3 / 6, 2 / 3 - x * x * (1 + y) / 2, 2 / 3 - y * y * (1 + x) / 2, x**3 / 6]
        return first[:, None] + np.arange(self.order + 1), np.stack(weights, axis=1)
