"""Light that a white scene sends to each pixel, by quadrature: what random rays of a pixel only estimate.

Without microlenses it changes smoothly over the sensor. So it is integrated at a few positions, and a cubic through
four of them is its value in between.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.tracer import parallel_planes
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.records.shapes import Float64, Int64
from pipeline.render.pixel_rays import Band

_STEP_PX = 16
"""Most pixels between two positions."""
_STEPS = 40
"""Least number of steps along the longer edge, unless there are fewer pixels [1]: cubics are then right to 1e-4 rms, to
1.5e-3 where vignetting begins at the edge of the image, and to 1e-6 where there is none."""
_CUBIC = 4
"""Positions that a cubic passes."""
_LEVEL = 1
"""Level of quadrature, see `integrals`: right to 1e-6."""


def known_flux(band: Band) -> np.ndarray | None:
    """Integral of the weight of all rays that leave from each pixel of a band, (n,); None where it is not so smooth.

    That is behind microlenses, with diffraction, for images of less than four pixels along an edge, and where bundles
    are empty, in pieces or have holes.
    """
    sensor = band.rig.tracer.camera.sensor
    size_px = sensor.height_px, sensor.width_px
    if band.rig.images is not None or band.rig.diffraction_nm is not None or min(size_px) < _CUBIC:
        return None
    step_px = min(float(_STEP_PX), max(1.0, max(size_px) / _STEPS))
    wanted = np.arange(*band.rows), np.arange(size_px[1])
    rows, columns = (_Cubics.of(size, some, step_px) for size, some in zip(size_px, wanted, strict=True))
    y_px, x_px = np.meshgrid(rows.positions_px, columns.positions_px, indexing="ij")
    positions = np.stack([x_px.ravel(), y_px.ravel()], axis=1)
    planes = np.broadcast_to(parallel_planes(1.0, 2.0), (len(positions), 2, 4, 3))
    integral = integrals(band.rig.tracer, Bundles(positions, np.full(len(positions), NO_MICROLENS), planes), _LEVEL)
    flux = integral.moments[:, WEIGHT]
    if integral.is_random.any() or not (flux > 0).all():
        return None
    return _between(flux.reshape(y_px.shape), rows, columns).ravel()


@dataclass(frozen=True, slots=True)
class _Cubics:
    """Cubics through positions along an edge of an image.

    `positions_px`, (m,): all lie in the image; a pixel has the same four whichever others are asked for.
    `place`, `weight`, (n, 4): those of each pixel, and their weights in its value, by Lagrange.
    """

    positions_px: np.ndarray
    place: np.ndarray
    weight: np.ndarray

    @staticmethod
    def of(size_px: int, wanted_px: Int64[np.ndarray, "n"], step_px: float) -> "_Cubics":
        """Cubics that some pixels need, of an edge of so many, through positions at most a step apart."""
        count = max(_CUBIC, math.ceil((size_px - 1) / step_px) + 1)
        step = (size_px - 1) / (count - 1)
        first = np.clip((wanted_px / step).astype(int) - 1, 0, count - _CUBIC)
        place = first[:, None] + np.arange(_CUBIC)
        off, weight = wanted_px[:, None] / step - place, np.ones(place.shape)
        for node, other in itertools.permutations(range(_CUBIC), 2):
            weight[:, node] *= off[:, other] / (node - other)
        used = np.unique(place)
        return _Cubics(used * step, np.searchsorted(used, place), weight)


def _between(values: Float64[np.ndarray, "y x"], rows: _Cubics, columns: _Cubics) -> np.ndarray:
    """Values of all pixels, term by term: a product of matrices would round differently for other rows."""
    result = np.zeros((len(rows.place), len(columns.place)))
    for i, j in itertools.product(range(_CUBIC), repeat=2):
        weight = rows.weight[:, i, None] * columns.weight[None, :, j]
        result += weight * values[rows.place[:, i, None], columns.place[None, :, j]]
    return result
