"""Records that kernels of cameras take: tuples of arrays, by name."""

from typing import Any, NamedTuple

import numpy as np


class CameraArrays(NamedTuple):
    """A camera for the kernels, from `Tracer.arrays`; vision frame, mm.

    Attributes
    ----------
    optics : (5,) float64
        See `camera.tracing.sampling_bounds`.
    table : (s, columns) float64
        Surfaces, from `optics.table.towards_scene`.
    outlines : (rows, columns, d, 2) float64
        From `camera.pupil.outlines`.
    lenses : (m, columns) float64
        Vertex x, y and focal length of every microlens, and more of those that are not plain:
        `camera.tracing.microlens_kernels`.
    aperture : (c, 2) float64
        Polygon around a microlens aperture about its vertex, counter-clockwise; of a cell it is the aperture itself.
    mosaic : tuple
        From `camera.tracing.microlens_tables`.
    """

    optics: np.ndarray
    table: np.ndarray
    outlines: np.ndarray
    lenses: np.ndarray
    aperture: np.ndarray
    mosaic: tuple[Any, ...]


class Samples(NamedTuple):
    """Random numbers of rays.

    Attributes
    ----------
    bits : (DIMENSIONS, samples) uint32
        From `camera.tracing.sobol`; of bundles, samples of one replica.
    seed : int
    edge_mm : float
        Edge of the square that rays start anywhere on; 0: from its centre alone.
    """

    bits: np.ndarray
    seed: int
    edge_mm: float


class Starts(NamedTuple):
    """Sensor positions from which bundles start.

    Attributes
    ----------
    pixels : (n, 2) int64
        What random numbers depend on besides the seed.
    anchors : (n, 2) float64
        Positions next to those below, for which the region is bound that rays go through, vision frame [mm].
    positions : (n, 2) float64
        On the sensor.
    lens : (n,) int64
        Microlens of each position.
    """

    pixels: np.ndarray
    anchors: np.ndarray
    positions: np.ndarray
    lens: np.ndarray

    def part(self, some: slice) -> "Starts":
        """Some of them."""
        return Starts(*(array[some] for array in self))


class Squares(NamedTuple):
    """Squares of the sensor from which rays start.

    Attributes
    ----------
    pixels : (n, 2) int64
        What random numbers depend on besides the seed.
    positions : (n, 2) float64
        Their centres, vision frame [mm].
    strata : (n, s) int64
        Microlenses that light may pass, or `NO_MICROLENS`; `SKIP` fills up.
    counts : (n, s) int64
        Rays through each, a power of two: so many of the samples, the first ones.
    """

    pixels: np.ndarray
    positions: np.ndarray
    strata: np.ndarray
    counts: np.ndarray


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
