"""Reference solutions: where on the sensor does the bundle of a target point lie? No grid, no filter, other rays.

For every target point p and every microlens that may see it, J(x) = p is solved by Newton's method, J(x) being the
mean hit on the target's own plane of tens of thousands of rays from x through that microlens. Candidates are all pairs
of point and microlens whose affine model of the micro-image puts the point in or near it.
Positions x are vision-frame millimetres on the sensor here, J is in millimetres of the target frame.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from pipeline.camera.micro_images.centres import MicroImages, micro_images
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.moments import FREE_WEIGHT, VARIANCE, WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import fine_from_image, image_from_fine

_PROBES = np.stack(np.meshgrid((-0.6, 0.0, 0.6), (-0.6, 0.0, 0.6)), axis=-1).reshape(-1, 2)
_PROBE_RAYS, _COARSE_RAYS, _BIAS_RAYS = 1024, 2048, 8192
_COARSE_STEPS, _FINE_STEPS = 6, 2
_MARGIN = 1.5
"""A candidate's affine prediction may lie so much farther from the centre than the micro-image reaches."""
_STREAM = 1 << 24
"""Added to the pixel numbers that random numbers depend on: no build ever sees these."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Solutions of one target in one frame that exist by the rule of correspondences, one row each.

    Attributes
    ----------
    point, cell : (n,) int64
    position_px : (n, 2) float64
    sigma_px : (n, 2) float64
        Standard error of the position from the spread of the replicas.
    bias_px : (n, 2) float64
        By how much the method `two-plane` misses this position even with perfect position images: the same rays'
        mean crossings of the near and far plane, joined by a line, against their mean hit.
    grid_px : (n, 2) float64
        By how much the local linear solve misses it on a grid K times finer than the image, again with the same rays.
    last_step_px : float
        Largest length of the last Newton step: convergence.
    """

    point: np.ndarray
    cell: np.ndarray
    position_px: np.ndarray
    sigma_px: np.ndarray
    bias_px: np.ndarray
    grid_px: np.ndarray
    last_step_px: float


class Solver:
    """Solves J(x) = p for one camera, near and far planes settled, with `rays` rays per evaluation."""

    def __init__(self, tracer: Tracer, rays: int, min_hit_fraction: float, supersampling: int) -> None:
        self.tracer, self.rays, self.min_hit_fraction = tracer, rays, min_hit_fraction
        self.supersampling = supersampling
        self.images: MicroImages | None = micro_images(tracer) if tracer.camera.microlenses else None
        self.free_sr = None if self.images else tracer.reference_weight_sr
        self.pool = ThreadPoolExecutor(os.cpu_count() or 1)

    def solve(self, vision_from_target: np.ndarray, points_mm: np.ndarray, stream: int) -> Reference:
        """All solutions for the points (p, 3) of a flat target; `stream` picks the random numbers."""
        planes = np.stack([target_plane(vision_from_target), parallel_planes(1.0, 2.0)[0]])
        point, cell, x, inverse = self._candidates(planes, points_mm[:, :2])
        goal = points_mm[point, :2]
        numbers = np.stack([np.arange(len(x)), np.full(len(x), _STREAM + stream)], axis=1)
        x, inverse = self._coarse(planes, goal, cell, x, inverse, numbers)
        near = self._near(x, cell)
        point, cell, x, inverse, goal, numbers = (a[near] for a in (point, cell, x, inverse, goal, numbers))
        inverse = self._inverse_jacobian(planes, cell, x, numbers)
        for _ in range(_FINE_STEPS):
            rows = self._moments(x, cell, planes, self.rays, numbers)
            step = _times(inverse, goal - rows[:, :2])
            x = x + step
        kept = self._exists(x, cell, rows)
        pitch = self.tracer.camera.sensor.pitch_mm
        variance = np.einsum("nij,nj->ni", inverse**2, rows[:, VARIANCE : VARIANCE + 2])
        kept_positions = x[kept], cell[kept]
        exact = self._moments(*kept_positions, planes, _BIAS_RAYS, numbers[kept])[:, :2]
        bias = self._bias(vision_from_target, *kept_positions, inverse[kept], numbers[kept], exact)
        return Reference(
            point[kept],
            cell[kept],
            self.tracer.pixels_at(x[kept]),
            np.sqrt(variance[kept]) / pitch,
            bias / pitch,
            self._grid_error_px(planes, *kept_positions, numbers[kept], exact),
            float(np.hypot(*step[kept].T).max(initial=0.0)) / pitch,
        )

    def _candidates(self, planes: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, ...]:
        """Point, cell, predicted position and inverse Jacobian of all pairs that an affine model allows."""
        centre, cells, reach = self._fields()
        probes = centre[:, None] + _PROBES * reach
        each = np.repeat(cells, len(_PROBES))
        numbers = np.stack([np.arange(each.size), np.full(each.size, _STREAM - 1)], axis=1)
        probed = self._moments(probes.reshape(-1, 2), each, planes, _PROBE_RAYS, numbers)[:, :2].reshape(probes.shape)
        point, cell, position, inverse = [], [], [], []
        for number, (c, j, x) in enumerate(zip(cells, probed, probes, strict=True)):
            lit = ~np.isnan(j[:, 0])
            if lit.sum() < 4:
                continue
            model = np.linalg.lstsq(np.column_stack([j[lit], np.ones(lit.sum())]), x[lit], rcond=None)[0]
            predicted = np.column_stack([points, np.ones(len(points))]) @ model
            chosen = np.flatnonzero((np.abs(predicted - centre[number]) <= _MARGIN * reach).all(axis=1))
            point.append(chosen)
            cell.append(np.full(len(chosen), c))
            position.append(predicted[chosen])
            inverse.append(np.broadcast_to(model[:2].T, (len(chosen), 2, 2)))
        return np.concatenate(point), np.concatenate(cell), np.concatenate(position), np.concatenate(inverse)

    def _fields(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centre (n, 2), microlens (n,) and half size (2,) of every micro-image; the sensor if there are none."""
        sensor = self.tracer.camera.sensor
        size = np.array([sensor.width_px, sensor.height_px])
        if self.images is None:
            centre = self.tracer.positions_mm(*((size[:, None] - 1) / 2))
            return centre, np.array([NO_MICROLENS]), size * sensor.pitch_mm / 2
        reach = np.full(2, self.images.radius_mm)
        pixels = self.tracer.pixels_at(self.images.centre_mm)
        slack = reach / sensor.pitch_mm
        visible = ((pixels >= -slack) & (pixels <= size - 1 + slack)).all(axis=1)
        return self.images.centre_mm[visible], np.flatnonzero(visible), reach

    def _coarse(
        self,
        planes: np.ndarray,
        goal: np.ndarray,
        cell: np.ndarray,
        x: np.ndarray,
        inverse: np.ndarray,
        numbers: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """A few quasi-Newton steps with few rays; Broyden's update keeps the inverse Jacobian right."""
        j = self._moments(x, cell, planes, _COARSE_RAYS, numbers)[:, :2]
        for _ in range(_COARSE_STEPS):
            step = _times(inverse, goal - j)
            x = x + step
            change, j = -j, self._moments(x, cell, planes, _COARSE_RAYS, numbers)[:, :2]
            change = change + j
            moved = _times(inverse, change)
            scale = np.einsum("ni,ni->n", step, moved)
            row = np.einsum("ni,nij->nj", step, inverse)
            with np.errstate(divide="ignore", invalid="ignore"):  # converged rows stand still
                update = np.einsum("ni,nj->nij", step - moved, row) / scale[:, None, None]
            inverse = np.where(np.isfinite(update), inverse + update, inverse)
        return x, inverse

    def _inverse_jacobian(self, planes: np.ndarray, cell: np.ndarray, x: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Inverse derivative of J by central differences of half a pixel, same random numbers, (n, 2, 2)."""
        half = self.tracer.camera.sensor.pitch_mm / 4
        columns = []
        for axis in np.eye(2) * half:
            plus, minus = (self._moments(x + s * axis, cell, planes, _BIAS_RAYS, numbers)[:, :2] for s in (1, -1))
            columns.append((plus - minus) / (2 * half))
        jacobian = np.stack(columns, axis=-1)
        with np.errstate(invalid="ignore"):  # NaN where a bundle is empty
            usable = np.abs(np.linalg.det(jacobian)) > 0
        return np.linalg.inv(np.where(usable[:, None, None], jacobian, np.nan))

    def _near(self, x: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """Which coarse solutions may turn out to exist: half a pixel of grace."""
        grace = self.tracer.camera.sensor.pitch_mm / 2
        solved = ~np.isnan(x[:, 0])
        near = solved & self._in_image(np.where(solved[:, None], x, 0.0), 0.5)
        if self.images is not None:
            distance = np.hypot(*(x - self.images.centre_mm[cell]).T)
            near[near] &= distance[near] <= self.images.nearby.nearest(x[near])[0][:, 0] + grace
        return near

    def _exists(self, x: np.ndarray, cell: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """In the image, in its own cell, with enough light."""
        solved = ~np.isnan(x[:, 0])
        exists = solved & self._in_image(x, 0.0) & (self._hit_fraction(rows) >= self.min_hit_fraction)
        if self.images is not None:
            exists[exists] = self.images.owner(x[exists]) == cell[exists]
        return exists

    def _in_image(self, x: np.ndarray, grace_px: float) -> np.ndarray:
        sensor = self.tracer.camera.sensor
        size = np.array([sensor.width_px, sensor.height_px])
        return (np.abs(self.tracer.pixels_at(x) - (size - 1) / 2) <= size / 2 + grace_px).all(axis=1)

    def _hit_fraction(self, rows: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):  # 0 / 0 of a skipped row
            return rows[:, WEIGHT] / (rows[:, FREE_WEIGHT] if self.free_sr is None else self.free_sr)

    def _bias(
        self,
        vision_from_target: np.ndarray,
        x: np.ndarray,
        cell: np.ndarray,
        inverse: np.ndarray,
        numbers: np.ndarray,
        exact: np.ndarray,
    ) -> np.ndarray:
        """What two planes shift the solution by, (n, 2) [mm]; the same rays on both sides, so their noise cancels."""
        near_mm, far_mm = self.tracer.camera.near_mm, self.tracer.camera.far_mm
        assert near_mm is not None and far_mm is not None
        two = self._moments(x, cell, parallel_planes(near_mm, far_mm), _BIAS_RAYS, numbers)
        joined = on_target(two[:, 0:2], two[:, 2:4], near_mm, far_mm, vision_from_target)
        return -_times(inverse, joined - exact)

    def _grid_error_px(
        self, planes: np.ndarray, x: np.ndarray, cell: np.ndarray, numbers: np.ndarray, exact: np.ndarray
    ) -> np.ndarray:
        """What J, linear between the nearest position of the fine grid and its two neighbours, shifts by, (n, 2)."""
        fine = fine_from_image(self.tracer.pixels_at(x), self.supersampling)
        nearest = np.rint(fine)
        step = np.where(fine >= nearest, 1.0, -1.0)
        corners = []
        for offset in ((0, 0), (1, 0), (0, 1)):
            image = image_from_fine(nearest + step * offset, self.supersampling)
            corners.append(self._moments(self.tracer.positions_mm(*image.T), cell, planes, _BIAS_RAYS, numbers)[:, :2])
        sides = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=-1)
        share = np.linalg.solve(sides, (exact - corners[0])[..., None])[..., 0]
        return (nearest + share * step - fine) / self.supersampling

    def _moments(
        self, x: np.ndarray, cell: np.ndarray, planes: np.ndarray, rays: int, numbers: np.ndarray
    ) -> np.ndarray:
        """`Tracer.moments` on all cores; what each row yields depends on nothing but itself."""
        cell = np.where(np.isnan(x[:, 0]), SKIP, cell)
        chunks = np.array_split(np.arange(len(x)), max(1, min(len(x), 16)))
        _ = self.tracer.arrays  # made once, before the threads ask for it
        parts = self.pool.map(lambda i: self.tracer.moments(x[i], cell[i], planes, rays, numbers[i]), chunks)
        return np.concatenate(list(parts))


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Row by row product, (n, 2)."""
    return np.einsum("nij,nj->ni", matrices, vectors)
