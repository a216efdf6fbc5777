"""Records that kernels of cameras take: named tuples of arrays."""

import math
from typing import NamedTuple, Self

import numpy as np


class Optics(NamedTuple):
    """Planes of a camera, and the grid of its outlines."""

    # Vision z of the sensor, of the plane in which rays are aimed, and of the rear vertex of the main lens
    sensor_z_mm: float
    sampling_z_mm: float
    rear_z_mm: float
    # As in `camera.pupil.outlines.Outlines`
    step_mm: float
    drift: float


class Acceptance(NamedTuple):
    """Response of a pixel by the angle of a ray with the axis."""

    power: float  # exponent of a cosine, or 0
    # Angles of a cone [rad]; the first is 0 where there is none
    half_angle: float
    roll_off: float
    by_area: bool  # whether rays weigh area of the sampling plane, not irradiance


class Elements(NamedTuple):
    """Surfaces and apertures of microlenses, by their types."""

    model: int  # `PLAIN`, `THIN`, `TWO_PLANE` or `REFRACTIVE` of `camera.tracing.microlens_kernels`
    disc_mm: float  # radius of discs; 0: apertures are cells
    turn: np.ndarray  # (3, 3) float64, frame of the array from the vision frame
    faces: np.ndarray  # (types, surfaces, columns) float64, surfaces of each type, as in `optics.table`
    bends: np.ndarray  # (types, BENDS) float64, columns: see `camera.tracing.microlens_kernels`
    # (types, n, 3) float64, points along the edge of each type's aperture, frame of the microlens [mm]
    rims: np.ndarray


class CameraArrays(NamedTuple):
    """A camera for the kernels, from `Tracer.arrays`; vision frame, mm."""

    optics: Optics
    acceptance: Acceptance
    table: np.ndarray  # (s, columns) float64, surfaces, from `optics.table.towards_scene`
    outlines: np.ndarray  # (rows, columns, d, 2) float64, outlines from `camera.pupil.outlines`
    microlenses: np.ndarray  # (m, COLUMNS) float64, columns: see `camera.tracing.microlens_kernels`
    # (c, 2) float64, polygon around a microlens aperture about its vertex, counter-clockwise; of a cell it is the
    # aperture itself
    aperture: np.ndarray
    elements: Elements


class Samples(NamedTuple):
    """Random numbers of rays."""

    # (DIMENSIONS, samples) uint32, numbers from `camera.tracing.sobol`; for bundles, the samples of one replica
    bits: np.ndarray
    seed: int
    edge_mm: float  # edge of the square from which rays start; 0: from its centre alone


class Diffraction(NamedTuple):
    """Spread of a point's light on the sensor by apertures: pictures of n x n cells, one for each aperture."""

    rows: np.ndarray  # (k, n) float64, cumulative light of the rows of each picture, normalised
    cells: np.ndarray  # (k, n, n) float64, cumulative light of the cells of each row, normalised
    edge_mm: np.ndarray  # (k,) float64, edges of the cells
    # (2,) float64, without microlenses pictures belong to the nodes of a square grid about the axis: their distance
    # along x and y
    node_mm: np.ndarray
    of_microlens: np.ndarray  # (m,) int64, the picture of each microlens

    @property
    def reach_mm(self) -> float:
        """Farthest distance of spread light."""
        return float(math.sqrt(0.5) * self.rows.shape[1] * self.edge_mm.max(initial=0.0))


def no_diffraction() -> Diffraction:
    """Geometric optics: no pictures."""
    return Diffraction(np.zeros((0, 1)), np.zeros((0, 1, 1)), np.zeros(0), np.ones(2), np.zeros(0, np.int64))


class Starts(NamedTuple):
    """Sensor positions from which bundles start."""

    pixels: np.ndarray  # (n, 2) int64, pixels, on which random numbers depend besides the seed
    # (n, 2) float64, positions next to those below, for which the sampling region is bound, vision frame [mm]
    anchors: np.ndarray
    positions: np.ndarray  # (n, 2) float64, positions on the sensor
    microlens: np.ndarray  # (n,) int64, microlens of each position, `NO_MICROLENS` or `SKIP`

    def part(self, rows: slice) -> "Starts":
        """Some of the positions."""
        return Starts(*(array[rows] for array in self))


class SensorPoints(NamedTuple):
    """Starts of the rays of a packet on the sensor, (PACKET,) each; vision frame, mm."""

    x: np.ndarray
    y: np.ndarray


class Squares(NamedTuple):
    """Squares of the sensor from which rays start."""

    pixels: np.ndarray  # (n, 2) int64, pixels, on which random numbers depend besides the seed
    positions: np.ndarray  # (n, 2) float64, their centres, vision frame [mm]
    strata: np.ndarray  # (n, s) int64, microlenses that light may pass, or `NO_MICROLENS`; padded with `SKIP`
    counts: np.ndarray  # (n, s) int64, rays through each, a power of two
    skipped: np.ndarray  # (n, s) int64, number of the first sample


class Leaving(NamedTuple):
    """Rays that leave a camera, written by `kernels.image_rays`, in arrays long enough for all that start."""

    # (n, 3) float64, a point behind the front vertex and the unit direction, vision frame [mm]
    origin: np.ndarray
    direction: np.ndarray
    # (n,) float64, part of the square's integral of cos(theta) d omega, or of area, times its acceptance [sr or mm^2]
    share: np.ndarray
    owner: np.ndarray  # (n,) int64, s times the row of the square plus the number of the microlens among its strata

    @classmethod
    def empty(cls, count: int) -> Self:
        """Arrays for `count` rays, not filled."""
        return cls(np.empty((count, 3)), np.empty((count, 3)), np.empty(count), np.empty(count, np.int64))

    def first(self, count: int) -> "Leaving":
        """The first rays."""
        return Leaving(*(array[:count] for array in self))
