"""Micro-images: the position of the image behind each microlens on the sensor, and the pixels that it may light."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.chief_ray import chief_slopes
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing import microlens_kernels as column
from pipeline.camera.tracing.microlens_kernels import aims_for, rays_before
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, SKIP, outlines_around
from pipeline.jit.decorators import kernel
from pipeline.optics.first_order import exit_pupil
from pipeline.records.shapes import Float64, Int64

NOBODY = -1
"""Row of no point."""
_TIES = 8
"""Further points to compare where several lie at one distance: a lattice has six neighbours."""
_STEPS = 12
"""Most steps to a chief ray: each leaves a small part of the miss, and a microlens that needs more is an error."""
_TOLERANCE = 1e-12
"""Miss in slope at which the search has converged [1]: thousands of roundings of a slope."""
_ROUNDING_MM = 1e-9
"""Margin beyond the reach of a micro-image [mm], so that rounding excludes no light."""
_SLACK_PX = math.sqrt(0.5)
"""Circumradius of a pixel."""


@dataclass(frozen=True)
class Nearby:
    """Nearest-neighbour search among points (n, 2), n > 0."""

    points: Float64[np.ndarray, "n 2"]

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import KDTree

        return KDTree(self.points)

    def nearest(self, positions: Float64[np.ndarray, "n 2"], count: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Distances and rows of the `count` points nearest to each position, nearest first, (m, count) each.

        Among points at one distance the lowest row comes first. Infinite and NOBODY where there are no more.
        """
        finite = np.isfinite(positions).all(axis=1)
        rows = self._tree.query(np.where(finite[:, None], positions, 0.0), np.arange(1, count + _TIES + 1))[1]
        rows[~finite] = len(self.points)
        # Sort by distances of our own: the tree's might be rounded otherwise on another processor.
        offset = np.append(self.points, [[np.inf, np.inf]], axis=0)[rows] - positions[:, None]
        distance = np.where(rows < len(self.points), np.sqrt((offset**2).sum(axis=2)), np.inf)
        order = np.lexsort((rows, distance))[:, :count]
        distance, rows = (np.take_along_axis(values, order, axis=1) for values in (distance, rows))
        return distance, np.where(rows < len(self.points), rows, NOBODY)

    def within(self, positions: Float64[np.ndarray, "n 2"], radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Distances and rows of all points within a radius of each position, as `nearest`: as many columns as the
        position with most points needs.
        """
        counts = self._tree.query_ball_point(positions, radius * (1 + 1e-9), return_length=True)
        distance, rows = self.nearest(positions, int(np.max(counts, initial=0)))
        is_inside = distance <= radius
        columns = int(is_inside.sum(axis=1).max(initial=0))
        return np.where(is_inside, distance, np.inf)[:, :columns], np.where(is_inside, rows, NOBODY)[:, :columns]


@dataclass(frozen=True, slots=True)
class MicroImages:
    """Centres of all micro-images, in the order of `camera.parts.lattice`."""

    # Sensor hit of the real ray through the stop centre and the microlens vertex, vision frame
    centre_mm: Float64[np.ndarray, "n 2"]
    radius_mm: float  # exit-pupil radius * B / P, the contour of half illumination
    reach_mm: Float64[np.ndarray, "n"]  # distance from the centre beyond which no light of the microlens arrives
    nearby: Nearby  # finds the nearest centres

    def owner(self, positions_mm: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Row of the microlens whose micro-image centre is nearest to each position of the sensor, (n,)."""
        return self.nearby.nearest(positions_mm)[1][:, 0]


def micro_images(tracer: Tracer) -> MicroImages:
    """Micro-images of a plenoptic camera.

    The chief ray is traced backwards from the microlens vertex, so its slope in front of the array is exact; a plain
    thin lens passes it undeviated. For any other microlens, the chief ray through the vertex of its aperture's face is
    found by iteration.
    """
    array, grid = tracer.camera.microlenses, tracer.lattice
    if array is None or grid is None:
        raise CameraError("a conventional camera has no micro-images")
    vertex = tracer.vertices_mm
    if array.is_plain:
        slope = chief_slopes(tracer.table, tracer.stop_row, tracer.on_film(vertex))
        centre = vertex - slope * array.distance_mm
    else:
        centre = _centres(tracer)
    pupil = exit_pupil(tracer.camera.prescription)
    behind, ahead = array.principal_mm[0]
    radius = pupil.diameter_mm / 2 * behind / (pupil.z_mm - tracer.sensor_z_mm - ahead)
    return MicroImages(centre, float(radius), _reach(tracer, centre), Nearby(centre))


def _centres(tracer: Tracer) -> np.ndarray:
    """Sensor hits of the rays through the vertices of aperture faces that are chief rays before the array, (n, 2)."""
    rows = tracer.arrays.microlenses
    microlens = np.arange(len(rows))
    count = len(rows)
    centre = rows[:, :2].copy()
    position = np.empty((count, 3))
    direction = np.empty((count, 3))
    passes = np.empty(count)
    for _ in range(_STEPS):
        # Move the hit by the difference of slopes, as if the microlens were not there: a fixed-point iteration.
        aims = vertex_aims(tracer, microlens, centre)
        rays_before(tracer.arrays, microlens, centre, aims, position, direction, passes)
        slope = direction[:, :2] / direction[:, 2:]
        miss = slope - chief_slopes(tracer.table, tracer.stop_row, position)
        centre += rows[:, [column.AIM]] * miss
        if np.abs(miss).max() < _TOLERANCE:
            return centre
    raise CameraError("no chief ray was found through some microlens", hint="is a microlens too strong for its slope?")


def vertex_aims(
    tracer: Tracer, microlens: Int64[np.ndarray, "n"], positions_mm: Float64[np.ndarray, "n 2"]
) -> np.ndarray:
    """Aims of rays from sensor positions (n, 2) through the vertex of the aperture's face of microlenses (n,)."""
    array = tracer.camera.microlenses
    assert array is not None and tracer.lattice is not None
    point = np.zeros((len(microlens), 3))
    aims = np.empty((len(microlens), 2))
    heights = [faces.thickness_mm * faces.aperture_is_in_front for faces in array.faces]
    point[:, 2] = np.array(heights)[tracer.lattice.type[microlens]] if heights else 0.0
    aims_for(tracer.arrays, microlens, positions_mm, point, aims)
    return aims


def _reach(tracer: Tracer, centre: np.ndarray) -> np.ndarray:
    """Distance from its centre beyond which a microlens has no region, by inverting the sampling bounds, (n,) [mm]."""
    rows = tracer.arrays.microlenses
    aperture = tracer.arrays.aperture
    polygons = outlines_around(tracer.arrays, rows[:, [column.OUTLINE_X, column.OUTLINE_Y]])
    by_start = rows[:, column.BY_START]
    base = rows[:, None, [column.BASE_X, column.BASE_Y]]
    edge = (polygons - base) / by_start[:, None, None] - (centre - rows[:, :2])[:, None]
    corner = np.hypot(*aperture.T).max() * (1 + rows[0, column.INFLATION])
    slack = corner * np.abs(rows[:, column.BY_AIM]) + rows[:, column.MARGIN]
    return np.hypot(*edge.T).max(axis=0) + slack / np.abs(by_start) + _ROUNDING_MM


class _Discs(NamedTuple):
    """Discs on the sensor: centres [mm], and [px] relative to the requested rows; reach [mm]."""

    centre_mm: np.ndarray
    centre_px: np.ndarray
    reach_mm: np.ndarray
    farthest_mm: float
    farthest_px: float


def pixel_strata(
    tracer: Tracer,
    images: MicroImages | None,
    rows: tuple[int, int],
    spread_mm: float = 0.0,
    columns: tuple[int, int] | None = None,
) -> np.ndarray:
    """Microlenses whose light may reach each pixel of a band of rows and columns, nearest first, (n, s) int64.

    `spread_mm`: distance by which diffraction spreads light.
    """
    first, end = columns or (0, tracer.camera.sensor.width_px)
    width = end - first
    count = (rows[1] - rows[0]) * width
    if images is None:
        return np.full((count, 1), NO_MICROLENS)
    slack_mm = tracer.camera.sensor.pitch_mm * _SLACK_PX + spread_mm
    farthest_mm = float(images.reach_mm.max()) + slack_mm
    centre_px = tracer.pixels_at(images.centre_mm) - [first, rows[0]]
    farthest_px = farthest_mm / tracer.camera.sensor.pitch_mm + 1e-6
    discs = _Discs(images.centre_mm, centre_px, images.reach_mm + slack_mm, farthest_mm, farthest_px)
    positions = positions_of(tracer, rows, columns)
    # Count the discs that reach each pixel, then sort them into as many slots.
    filled = np.zeros(count, np.int64)
    _sort_discs(discs, positions, width, np.zeros((count, 0)), np.zeros((count, 0), np.int64), filled)
    slots = max(1, int(filled.max()))
    strata = np.full((count, slots), SKIP)
    distance = np.zeros((count, slots))
    filled[:] = 0
    _sort_discs(discs, positions, width, distance, strata, filled)
    return strata


def positions_of(tracer: Tracer, rows: tuple[int, int], columns: tuple[int, int] | None = None) -> np.ndarray:
    """Centres of the pixels of a band of rows and columns, row by row, vision frame (n, 2) [mm]."""
    y_px, x_px = np.mgrid[slice(*rows), slice(*(columns or (0, tracer.camera.sensor.width_px)))]
    return tracer.positions_mm(x_px.ravel(), y_px.ravel())


@kernel
def _sort_discs(discs, positions, width, distance, strata, filled):
    """Sort discs into the pixels that they reach, nearest first; arrays without columns only have them counted.

    `distance`, `strata`, `filled`: distances and microlenses by pixel and slot, and number of used slots.
    """
    # A disc beyond its own reach keeps its slot as `SKIP`: the first slot is that of the pixel's own cell.
    height = positions.shape[0] // width
    for microlens in range(discs.centre_mm.shape[0]):
        x, y = discs.centre_px[microlens, 0], discs.centre_px[microlens, 1]
        far = discs.farthest_px
        if not (x > -far - 1.0 and x < width + far and y > -far - 1.0 and y < height + far):
            continue
        for j in range(max(0, math.ceil(y - far)), min(height - 1, math.floor(y + far)) + 1):
            for i in range(max(0, math.ceil(x - far)), min(width - 1, math.floor(x + far)) + 1):
                n = j * width + i
                across = positions[n, 0] - discs.centre_mm[microlens, 0]
                up = positions[n, 1] - discs.centre_mm[microlens, 1]
                from_centre = math.sqrt(across * across + up * up)
                if from_centre > discs.farthest_mm:
                    continue
                slot = filled[n]
                filled[n] += 1
                if distance.shape[1] == 0:
                    continue
                # Insertion sort: move farther discs one slot on.
                while slot > 0 and distance[n, slot - 1] > from_centre:
                    distance[n, slot], strata[n, slot] = distance[n, slot - 1], strata[n, slot - 1]
                    slot -= 1
                distance[n, slot] = from_centre
                strata[n, slot] = microlens if from_centre <= discs.reach_mm[microlens] else SKIP
