"""Records that kernels of cameras take: tuples of arrays, by name."""

import math
from typing import NamedTuple

import numpy as np


class Optics(NamedTuple):
    """Planes of a camera, and how its outlines lie.

    Attributes
    ----------
    sensor_z_mm, sampling_z_mm, rear_z_mm : float
        Vision z of the sensor, of the plane in which rays are aimed, and of the rear vertex of the main lens.
    step_mm, drift : float
        As in `camera.pupil.outlines.Outlines`.
    """

    sensor_z_mm: float
    sampling_z_mm: float
    rear_z_mm: float
    step_mm: float
    drift: float


class Mosaic(NamedTuple):
    """Pixels and microlenses, from `camera.tracing.microlens_tables`.

    Attributes
    ----------
    detail : (15,) float64
        Numbers common to all, at places that `camera.tracing.acceptance` and `camera.tracing.microlens_kernels`
        name.
    faces : (types, surfaces, columns) float64
        Surfaces of each type, as in `optics.table`.
    bends : (types, BENDS) float64
        Columns: see `camera.tracing.microlens_kernels`.
    rims : (types, n, 3) float64
        Points along the edge of each type's aperture, frame of the microlens [mm].
    """

    detail: np.ndarray
    faces: np.ndarray
    bends: np.ndarray
    rims: np.ndarray


class CameraArrays(NamedTuple):
    """A camera for the kernels, from `Tracer.arrays`; vision frame, mm.

    Attributes
    ----------
    optics : Optics
    table : (s, columns) float64
        Surfaces, from `optics.table.towards_scene`.
    outlines : (rows, columns, d, 2) float64
        Outlines from `camera.pupil.outlines`.
    lenses : (m, columns) float64
        Vertex x, y and focal length of every microlens, and more of those that are not plain:
        `camera.tracing.microlens_kernels`.
    aperture : (c, 2) float64
        Polygon around a microlens aperture about its vertex, counter-clockwise; of a cell it is the aperture itself.
    mosaic : Mosaic
    """

    optics: Optics
    table: np.ndarray
    outlines: np.ndarray
    lenses: np.ndarray
    aperture: np.ndarray
    mosaic: Mosaic


class Samples(NamedTuple):
    """Random numbers of rays.

    Attributes
    ----------
    bits : (DIMENSIONS, samples) uint32
        Numbers from `camera.tracing.sobol`; for bundles, the samples of one replica.
    seed : int
    edge_mm : float
        Edge of the square that rays start anywhere on; 0: from its centre alone.
    """

    bits: np.ndarray
    seed: int
    edge_mm: float


class Diffraction(NamedTuple):
    """Spread of the light of a point on the sensor by apertures: pictures of n x n cells, one for each aperture.

    Attributes
    ----------
    rows : (k, n) float64
        Light of each picture in all rows up to one, as a share.
    cells : (k, n, n) float64
        Light of each row in all cells up to one, as a share.
    edge_mm : (k,) float64
        Edges of the cells.
    node_mm : (2,) float64
        Without microlenses pictures belong to the nodes of a square grid about the axis: their distance along x and y.
    of_microlens : (m,) int64
        The picture of each microlens.
    """

    rows: np.ndarray
    cells: np.ndarray
    edge_mm: np.ndarray
    node_mm: np.ndarray
    of_microlens: np.ndarray

    @property
    def reach_mm(self) -> float:
        """Farthest that light is spread."""
        return float(math.sqrt(0.5) * self.rows.shape[1] * self.edge_mm.max(initial=0.0))


def no_diffraction() -> Diffraction:
    """Geometric optics: no pictures."""
    return Diffraction(np.zeros((0, 1)), np.zeros((0, 1, 1)), np.zeros(0), np.ones(2), np.zeros(0, np.int64))


class Starts(NamedTuple):
    """Sensor positions from which bundles start.

    Attributes
    ----------
    pixels : (n, 2) int64
        Pixels, on which random numbers depend besides the seed.
    anchors : (n, 2) float64
        Positions next to those below, for which the region is bound that rays go through, vision frame [mm].
    positions : (n, 2) float64
        Positions on the sensor.
    microlens : (n,) int64
        Microlens of each position, `NO_MICROLENS` or `SKIP`.
    """

    pixels: np.ndarray
    anchors: np.ndarray
    positions: np.ndarray
    microlens: np.ndarray

    def part(self, some: slice) -> "Starts":
        """Some of them."""
        return Starts(*(array[some] for array in self))


class SensorPoints(NamedTuple):
    """Points of the sensor at which the rays of a packet start, (PACKET,) each; vision frame, mm."""

    x: np.ndarray
    y: np.ndarray


class Squares(NamedTuple):
    """Squares of the sensor from which rays start.

    Attributes
    ----------
    pixels : (n, 2) int64
        Pixels, on which random numbers depend besides the seed.
    positions : (n, 2) float64
        Their centres, vision frame [mm].
    strata : (n, s) int64
        Microlenses that light may pass, or `NO_MICROLENS`; `SKIP` fills up.
    counts : (n, s) int64
        Rays through each, a power of two: so many of the samples.
    skipped : (n, s) int64
        Samples before these; 0: they are the first ones.
    """

    pixels: np.ndarray
    positions: np.ndarray
    strata: np.ndarray
    counts: np.ndarray
    skipped: np.ndarray


class Leaving(NamedTuple):
    """Rays that leave a camera, written by `kernels.image_rays`; room for all that start.

    Attributes
    ----------
    origin, direction : (n, 3) float64
        A point behind the front vertex and the unit direction, vision frame [mm].
    share : (n,) float64
        Share of the square's integral of cos(theta) d omega, or of area, times its acceptance [sr or mm^2].
    owner : (n,) int64
        s times the row of the square plus the place of the microlens among its strata.
    """

    origin: np.ndarray
    direction: np.ndarray
    share: np.ndarray
    owner: np.ndarray

    def first(self, count: int) -> "Leaving":
        """The first rays."""
        return Leaving(*(array[:count] for array in self))


def room_for(rays: int) -> Leaving:
    """Arrays for so many rays."""
    return Leaving(np.empty((rays, 3)), np.empty((rays, 3)), np.empty(rays), np.empty(rays, np.int64))
