"""Contours of the light of microlenses on the sensor: edges of all that passes any point of the aperture.

Along a direction the light of a microlens ends where the last point of its aperture goes dark, and that is a point of
the rim: just inside of it light passes a thin sliver of the aperture. Rays through points of the rim say where that is:
a few points all around, then finer ones about those that go dark last.
"""

from typing import NamedTuple

import numpy as np

from pipeline.camera.boundary import halved, widened
from pipeline.camera.integrating.label_kernels import PASSES
from pipeline.camera.micro_images.pinhole_kernels import Pencils, Rays, look
from pipeline.camera.tracing.records import CameraArrays
from pipeline.records.shapes import Float64

RIM = 384
"""Points around an aperture, about one per degree: a multiple of 4 and 6, so that corners of a cell are among them."""
_COARSE, _FINE = 24, 9
"""Points that are tried: first all around, then from the neighbour before the one that goes dark last to the neighbour
behind it."""
_STRIDE = RIM // _COARSE
"""Points of the rim from one coarse point to the next."""
_FINE_STRIDE = 2 * _STRIDE // (_FINE - 1)
"""Points of the rim from one fine point to the next: the fine ones span two coarse strides."""
_COARSE_STEPS, _FINE_STEPS = 7, 8
"""Bisections by coarse points, to 1/128 of a step, and then by fine ones, to 1/256 of what these leave."""
_WIDENINGS = 20
"""Steps inwards or outwards at most to where light and dark meet: a step is nearly a third of the pupil's image or of
the penumbra, the smaller of both, and the search begins near the edge."""


class _Points(NamedTuple):
    """Points of a rim that are tried: the first one of each way (n, d), their number, and how far apart they are."""

    first: np.ndarray
    number: int
    stride: int


class Contours:
    """Outer edges of light along directions from origins.

    `rims`: microlenses, and rings * RIM points around the aperture of each type: rings where the rim itself may be
        dark, because another face cuts the light there.
    `origins`, `directions`: (n, 2), (d, 2) float64.
    """

    def __init__(
        self,
        camera: CameraArrays,
        rims: Pencils,
        origins: Float64[np.ndarray, "n 2"],
        directions: Float64[np.ndarray, "m 2"],
    ) -> None:
        self._camera, self._rims = camera, rims
        self._origins, self._directions = origins, directions

    def distances(self, outside: Float64[np.ndarray, "n d"], step: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Distances (n, d) from the origins; NaN where no light was found.

        `outside`: (n, d) float64, about where it is dark. From there inwards, because near the middle a small pupil may
            be seen through the inside of the aperture only.
        `step`: (n,) float64, shorter than the way on which the rim stays lit once light has reached it.
        """
        tried = _Points(np.zeros(outside.shape, np.int64), _COARSE, _STRIDE)
        step = np.broadcast_to(step[:, None], outside.shape)
        _, high = self._darkened(outside, outside, step, tried)
        low, where = high - step, np.full(high.shape, -1)
        for _ in range(_WIDENINGS):
            here = self._lit(low, tried)
            where = np.where(where < 0, here, where)
            inward = (where < 0) & (low > 0)
            if not inward.any():
                break
            low, high = np.where(inward, low - step, low), np.where(inward, low, high)
        low, high, where = self._bisected(low, high, where, tried, _COARSE_STEPS)
        tried = _Points(where - _STRIDE, _FINE, _FINE_STRIDE)
        low, high = self._darkened(low, high, high - low, tried)
        low, high, _ = self._bisected(low, high, where, tried, _FINE_STEPS)
        return np.where(where >= 0, (low + high) / 2, np.nan)

    def _darkened(
        self, low: np.ndarray, high: np.ndarray, step: np.ndarray, tried: _Points
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outer bounds moved outwards by steps until they are dark, inner ones along."""
        return widened(lambda far: self._lit(far, tried) >= 0, low, high, lambda far: far + step, _WIDENINGS)

    def _bisected(
        self, low: np.ndarray, high: np.ndarray, where: np.ndarray, tried: _Points, steps: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Narrowed bounds between light and dark, and the rim point that was lit last."""

        def passes(distance: np.ndarray) -> np.ndarray:
            nonlocal where
            here = self._lit(distance, tried)
            where = np.where(here >= 0, here, where)
            return here >= 0

        low, high = halved(passes, low, high, steps)
        return low, high, where

    def _lit(self, distance: np.ndarray, tried: _Points) -> np.ndarray:
        """The middle one of the rim points that light passes, (n, d); -1: all are dark."""
        first, count, stride = tried
        n, d = distance.shape
        which = (first[..., None] + stride * np.arange(count)) % RIM
        starts = self._origins[:, None] + distance[..., None] * self._directions
        rings = self._rims.points.shape[1] // RIM
        points = which[..., None] + RIM * np.arange(rings)
        each = count * rings
        rays = Rays(np.repeat(np.arange(n), d * each), points.ravel(), np.repeat(starts.reshape(-1, 2), each, axis=0))
        passes = (look(self._camera, self._rims, rays) == PASSES).reshape(n, d, count, rings).any(axis=3)
        # The middle of the first run: far from each other two parts of the rim may be lit.
        begins = np.argmax(passes & ~np.roll(passes, 1, axis=2), axis=2)[..., None]
        run = np.take_along_axis(passes, (begins + np.arange(count)) % count, axis=2)
        length = np.where(run.all(axis=2), count, np.argmin(run, axis=2))
        middle = first + stride * begins[..., 0] + stride * (length - 1) // 2
        return np.where(length > 0, middle % RIM, -1)
