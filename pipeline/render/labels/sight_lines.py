"""Image positions of points by the mean rays of a camera: x(p) is the position whose mean ray passes p.

A mean ray is a line, x and y over z, whose four numbers change smoothly over the image, or over a micro-image. They are
polynomials through a few nodes, integrated by quadrature, so that each pixel can ask.
"""

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes
from pipeline.records.shapes import Float64, Int64

_DEGREE, _NODES = (9, 3), (20, 5)
"""Degree of the polynomials along each axis, and nodes: of an image, and of a micro-image."""
_WITHIN = 0.35
"""Half the edge of the square of nodes behind a microlens, over the reach of its light [1]: its corners are lit."""
_LIT = 0.7
"""Least part of the nodes of a cell that light reaches [1]: with fewer, positions there are unknown."""
_LEVEL = 1
"""Level of quadrature: means are right to 1e-6."""
_STEPS = 6
"""Steps of Newton's method: lines are nearly linear in the position."""
_SETTLED_PX = 1e-4
"""Last step of Newton's method [px]."""
_PLANES_MM = 500.0, 1000.0
"""Two planes that a line is known by; any do."""


class SightLines:
    """Mean rays of a camera, of the image, or of the micro-images of some microlenses."""

    def __init__(self, rig: Rig, cells: Int64[np.ndarray, "c"]) -> None:
        sensor, self._images = rig.tracer.camera.sensor, rig.images
        self._behind = int(rig.images is not None)
        degree = _DEGREE[self._behind]
        self._powers = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)])
        if rig.images is None:
            self._centre_px = (np.array([[sensor.width_px, sensor.height_px]]) - 1) / 2
            self._half_px = np.array([[sensor.width_px, sensor.height_px]]) / 2
            self._reach = np.ones(1)
            self._place = np.zeros(1, int)
        else:
            self._centre_px = rig.tracer.pixels_at(rig.images.centre_mm[cells])
            half = _WITHIN * rig.images.reach_mm[cells] / sensor.pitch_mm
            self._half_px = np.stack([half, half], axis=1)
            self._reach = np.full(len(cells), 1 / _WITHIN)
            self._place = np.zeros(len(rig.images.centre_mm), int)
            self._place[cells] = np.arange(len(cells))
        node = -np.cos((2 * np.arange(_NODES[self._behind]) + 1) * np.pi / (2 * _NODES[self._behind]))
        nodes = np.stack(np.meshgrid(node, node), axis=-1).reshape(-1, 2)
        self._lines = self._fitted(rig, np.zeros(1, int) if rig.images is None else cells, nodes)

    def _fitted(self, rig: Rig, cells: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Coefficients (c, powers, 4) of x and y on z = 0 and of their slopes; NaN where too little light arrives."""
        x_px = self._centre_px[:, None] + self._half_px[:, None] * nodes
        near, far = _PLANES_MM
        count = len(cells) * len(nodes)
        planes = np.broadcast_to(parallel_planes(near, far), (count, 2, 4, 3))
        behind = np.repeat(rig.microlens(cells), len(nodes))
        moments = integrals(rig.tracer, Bundles(x_px.reshape(-1, 2), behind, planes), _LEVEL).moments
        crossings = moments[:, :4].reshape(len(cells), len(nodes), 4)
        slope = (crossings[..., 2:] - crossings[..., :2]) / (far - near)
        lines = np.concatenate([crossings[..., :2] - near * slope, slope], axis=-1)
        is_lit = ~np.isnan(lines[..., 0])
        basis = self._basis(nodes)[0]
        known = np.where(is_lit[..., None], lines, 0.0)
        normal = np.einsum("nk,cn,nl->ckl", basis, is_lit.astype(float), basis, optimize=True)
        result = np.full((len(cells), basis.shape[1], 4), np.nan)
        enough = is_lit.mean(axis=1) >= _LIT
        result[enough] = np.linalg.solve(normal[enough], np.einsum("nk,cni->cki", basis, known[enough]))
        return result

    def _basis(self, s: Float64[np.ndarray, "n 2"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Products of Chebyshev polynomials (n, powers) at places from -1 to 1, and both of their derivatives."""
        degree = _DEGREE[self._behind]
        value = [chebvander(s[:, axis], degree) for axis in range(2)]
        raising = np.polynomial.chebyshev.chebder(np.eye(degree + 1), axis=0)
        slope = [chebvander(s[:, axis], degree - 1) @ raising for axis in range(2)]
        i, j = self._powers.T
        return value[0][:, i] * value[1][:, j], slope[0][:, i] * value[1][:, j], value[0][:, i] * slope[1][:, j]

    def positions(
        self, points_mm: Float64[np.ndarray, "n 3"], cell: Int64[np.ndarray, "n"], start_px: Float64[np.ndarray, "n 2"]
    ) -> np.ndarray:
        """Image positions (n, 2) of points, vision frame; NaN: outside of the image, or of the micro-image.

        `cell`: row of the microlens through which each is seen, any number in a camera without.
        """
        place = self._place[cell] if self._behind else np.zeros(len(cell), int)
        half, centre, coefficients = self._half_px[place], self._centre_px[place], self._lines[place]
        s, step = (start_px - centre) / half, np.full((len(place), 2), np.inf)
        for _ in range(_STEPS):
            along, z = [np.einsum("nk,nki->ni", b, coefficients) for b in self._basis(s)], points_mm[:, 2:]
            off, by_x, by_y = (line[:, :2] + z * line[:, 2:] for line in along)
            off = points_mm[:, :2] - off
            area = by_x[:, 0] * by_y[:, 1] - by_x[:, 1] * by_y[:, 0]
            step = (
                np.stack(
                    [off[:, 0] * by_y[:, 1] - off[:, 1] * by_y[:, 0], by_x[:, 0] * off[:, 1] - by_x[:, 1] * off[:, 0]],
                    axis=1,
                )
                / area[:, None]
            )
            s = np.clip(s + step, -2.0 * self._reach[place, None], 2.0 * self._reach[place, None])
        away = np.hypot(*s.T) if self._behind else np.abs(s).max(axis=1)
        settled = (np.abs(step * half).max(axis=1) < _SETTLED_PX) & (away <= self._reach[place]) & (points_mm[:, 2] > 0)
        return np.where(settled[:, None], centre + half * s, np.nan)
