"""Image positions of points by the mean rays of a camera: x(p) is the position whose mean ray passes p.

A mean ray is a line, x(z) and y(z), whose four numbers change smoothly over the image, or over a micro-image. They are
interpolated by Chebyshev polynomials, fitted to mean rays at a few nodes, so that each pixel can ask. Newton's method
inverts them.
"""

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebvander

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes
from pipeline.records.shapes import Float64, Int64

_OF_IMAGE, _OF_MICRO_IMAGE = (9, 20), (3, 5)
"""Degree of polynomials, and nodes along each axis: with more, errors in full light do not fall below 1e-4 px."""
_WITHIN = 0.35
"""Half the edge of the square of nodes behind a microlens, over the reach of its light [1]: its corners are lit."""
_LIT = 0.7
"""Least part of the nodes of a cell that light reaches [1]: with fewer, positions there are unknown."""
_STEPS, SETTLED_PX = 6, 1e-4
"""Steps of Newton's method, and its last one [px]: lines are nearly linear in the position."""
_PLANES_MM = 500.0, 1000.0  # by which a line is known; any do


class SightLines:
    """Mean rays of the image, or of the micro-images of microlenses, by the rows of these; traced when asked for."""

    def __init__(self, rig: Rig) -> None:
        sensor, images = rig.tracer.camera.sensor, rig.images
        self._rig = rig
        self.size_px = sensor.size_px
        # Positions x = centre + half s: s is at most `_limit` in the maximum norm in the image, in the Euclidean norm
        # in a micro-image.
        size_px = np.array([[sensor.width_px, sensor.height_px]])
        self._centre_px = (size_px - 1) / 2
        self._half_px = size_px / 2
        self._limit, self._norm = 1.0, np.inf
        self._degree, count = _OF_IMAGE
        if images is not None:
            self._centre_px = rig.tracer.pixels_at(images.centre_mm)
            self._half_px = np.repeat(_WITHIN * images.reach_mm[:, None] / sensor.pitch_mm, 2, axis=1)
            self._limit, self._norm = 1 / _WITHIN, 2
            self._degree, count = _OF_MICRO_IMAGE
        node = np.cos((2 * np.arange(count) + 1) * np.pi / (2 * count))
        self._nodes = np.stack(np.meshgrid(node, node), axis=-1).reshape(-1, 2)
        self._fit, _ = self._basis(self._nodes)
        self._lines = np.full((len(self._centre_px), self._fit.shape[1], 4), np.nan)
        self._is_fitted = np.zeros(len(self._centre_px), bool)

    def _lines_of(self, cell: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Coefficients of the lines of cells, which are fitted at their first use."""
        cells = np.unique(cell)
        if len(new := cells[~self._is_fitted[cells]]):
            self._lines[new] = _fitted(self._fit, self._traced(new))
            self._is_fitted[new] = True
        return self._lines[cell]

    def _traced(self, cells: np.ndarray) -> np.ndarray:
        """x and y on z = 0 and slopes of the mean rays of nodes (c, nodes, 4); NaN where there is no light."""
        rig, nodes = self._rig, self._nodes
        x_px = self._centre_px[cells, None] + self._half_px[cells, None] * nodes
        planes = np.broadcast_to(parallel_planes(*_PLANES_MM), (x_px.size // 2, 2, 4, 3))
        bundles = Bundles(x_px.reshape(-1, 2), np.repeat(rig.microlens(cells), len(nodes)), planes)
        near, far = np.split(integrals(rig.tracer, bundles, 1).moments[:, :4].reshape(*x_px.shape[:2], 4), 2, axis=2)
        slope = (far - near) / (_PLANES_MM[1] - _PLANES_MM[0])
        return np.concatenate([near - _PLANES_MM[0] * slope, slope], axis=-1)

    def _basis(self, s: Float64[np.ndarray, "n 2"]) -> tuple[np.ndarray, list[np.ndarray]]:
        """Products of Chebyshev polynomials (n, powers) at s in [-1, 1]^2, and both of their derivatives."""
        degree = self._degree
        i, j = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]).T
        x, y = (chebvander(axis, degree) for axis in s.T)
        by_x, by_y = (chebvander(axis, degree - 1) @ chebder(np.eye(degree + 1)) for axis in s.T)
        return x[:, i] * y[:, j], [by_x[:, i] * y[:, j], x[:, i] * by_y[:, j]]

    def positions(
        self, points_mm: Float64[np.ndarray, "n 3"], cell: Int64[np.ndarray, "n"], start_px: Float64[np.ndarray, "n 2"]
    ) -> np.ndarray:
        """Image positions (n, 2) of points, vision frame; NaN: outside of the image, or of the micro-image.

        `cell`: row of the microlens through which each is seen, or NO_MICROLENS.
        """
        half, centre = self._half_px[cell], self._centre_px[cell]
        z_mm = points_mm[:, 2:]
        # x and y at the depth of each point, as functions of the position alone.
        rays = self._lines_of(cell)
        lines = rays[..., :2] + z_mm[..., None] * rays[..., 2:]
        s = (start_px - centre) / half
        step = np.full(half.shape, np.inf)
        for _ in range(_STEPS):
            value, slopes = self._basis(s)
            residual = points_mm[:, :2] - np.einsum("nk,nki->ni", value, lines)
            # Solve [[a, b], [c, d]] step = residual by Cramer's rule.
            (a, c), (b, d) = (np.einsum("nk,nki->in", slope, lines) for slope in slopes)
            step = np.stack([d * residual[:, 0] - b * residual[:, 1], a * residual[:, 1] - c * residual[:, 0]], axis=1)
            step /= (a * d - b * c)[:, None]
            s = np.clip(s + step, -2 * self._limit, 2 * self._limit)
        is_inside = (np.linalg.norm(s, self._norm, axis=1) <= self._limit) & (points_mm[:, 2] > 0)
        is_inside &= np.abs(step * half).max(axis=1) < SETTLED_PX
        return np.where(is_inside[:, None], centre + half * s, np.nan)


def _fitted(basis: Float64[np.ndarray, "n k"], lines: Float64[np.ndarray, "c n 4"]) -> np.ndarray:
    """Coefficients (c, k, 4) by least squares; NaN where too few nodes have light."""
    is_lit = ~np.isnan(lines[..., 0])
    result = np.full((len(lines), basis.shape[1], 4), np.nan)
    enough = is_lit.mean(axis=1) >= _LIT
    # Normal equations of each cell; nodes without light have the weight 0
    normal = np.einsum("nk,cn,nl->ckl", basis, is_lit[enough].astype(float), basis, optimize=True)
    result[enough] = np.linalg.solve(normal, np.einsum("nk,cni->cki", basis, np.nan_to_num(lines[enough])))
    return result
