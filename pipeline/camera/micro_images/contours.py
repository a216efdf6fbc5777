"""Contours of all light of a microlens on the sensor.

Along a direction the light of a microlens ends where the last point of its aperture goes dark, and that is a point of
the rim: just inside of it light passes a thin sliver of the aperture. Rays through points of the rim find it: first
coarse points all around, then finer ones about those that go dark last.
"""

from typing import NamedTuple

import numpy as np

from pipeline.camera.boundary import halved, widened
from pipeline.camera.integrating.edge_search import PASSES
from pipeline.camera.micro_images.pupil_images import Pencils, Rays, probe_points
from pipeline.camera.tracing.records import CameraArrays
from pipeline.records.shapes import Float64

RIM = 384
"""Points around an aperture, about one per degree: a multiple of 4 and 6, so that corners of a cell are among them."""
_COARSE, _FINE = 24, 9
"""Points that are tried: first all around, then between the neighbours of the one that goes dark last."""
_STRIDE = RIM // _COARSE
"""Points of the rim from one coarse point to the next."""
_FINE_STRIDE = 2 * _STRIDE // (_FINE - 1)
"""Points of the rim from one fine point to the next: the fine ones span two coarse strides."""
_COARSE_STEPS, _FINE_STEPS = 7, 8
"""Bisections by coarse points, to 1/128 of a step, and then by fine ones, to 1/256 of what these leave."""
_CONTOUR_WIDENINGS = 20
"""Most steps inwards or outwards to where light and dark meet: a step is nearly a third of the pupil's image or of the
penumbra, whichever is smaller, and the search begins near the boundary."""


class _Points(NamedTuple):
    """Rim points to try: the first one of each direction (n, d), their number, and their stride."""

    first: np.ndarray
    number: int
    stride: int


class Contours:
    """Outer boundaries of light along directions (d, 2) from origins (n, 2).

    `rims`: microlenses, and rings * RIM points around the aperture of each type. Several rings are for rims that are
    dark because another face cuts the light.
    """

    def __init__(
        self,
        camera: CameraArrays,
        rims: Pencils,
        origins: Float64[np.ndarray, "n 2"],
        directions: Float64[np.ndarray, "m 2"],
    ) -> None:
        self._camera = camera
        self._rims = rims
        self._origins = origins
        self._directions = directions

    def distances(self, outside: Float64[np.ndarray, "n d"], step: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Distances (n, d) on the sensor from the origins to where the light ends [mm]; NaN where none was found.

        A position is lit if a ray from it through any of the rim points that are tried passes the camera.

        `outside`: distance beyond which it is dark, approximately. The search runs inwards from there, because near the
        middle a small pupil may be visible through the inside of the aperture only, and no rim point is lit.
        `step`: shorter than the distance over which the rim stays lit once light has reached it.
        """
        # Step outwards until all coarse rim points are dark.
        coarse = _Points(np.zeros(outside.shape, np.int64), _COARSE, _STRIDE)
        step = np.broadcast_to(step[:, None], outside.shape)
        _, high = self._darkened(outside, outside, step, coarse)
        # Step inwards, as far as the origin, until one of them is lit: then the light ends between low and high.
        low = high - step
        lit_point = np.full(high.shape, -1)
        for _ in range(_CONTOUR_WIDENINGS):
            lit_point = np.where(lit_point < 0, self._lit(low, coarse), lit_point)
            is_dark = (lit_point < 0) & (low > 0)
            if not is_dark.any():
                break
            low, high = np.where(is_dark, low - step, low), np.where(is_dark, low, high)
        # Bisect to where the last coarse point goes dark.
        low, high, lit_point = self._bisected(low, high, lit_point, coarse, _COARSE_STEPS)
        # Between that point and its neighbours the rim may be lit farther out: step outwards again, by fine points, and
        # bisect.
        fine = _Points(lit_point - _STRIDE, _FINE, _FINE_STRIDE)
        low, high = self._darkened(low, high, high - low, fine)
        low, high, _ = self._bisected(low, high, lit_point, fine, _FINE_STEPS)
        return np.where(lit_point >= 0, (low + high) / 2, np.nan)

    def _darkened(
        self, low: np.ndarray, high: np.ndarray, step: np.ndarray, tried: _Points
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outer bounds moved outwards by steps until they are dark; inner ones follow."""

        def passes(distance: np.ndarray) -> np.ndarray:
            return self._lit(distance, tried) >= 0

        return widened(passes, low, high, lambda distance: distance + step, _CONTOUR_WIDENINGS)

    def _bisected(
        self, low: np.ndarray, high: np.ndarray, lit_point: np.ndarray, tried: _Points, steps: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Narrowed brackets between light and dark, and the rim point that was lit last."""

        def passes(distance: np.ndarray) -> np.ndarray:
            """Whether light passes at these distances; notes the rim points."""
            nonlocal lit_point
            point = self._lit(distance, tried)
            lit_point = np.where(point >= 0, point, lit_point)
            return point >= 0

        low, high = halved(passes, low, high, steps)
        return low, high, lit_point

    def _lit(self, distance: np.ndarray, tried: _Points) -> np.ndarray:
        """The middle one of the lit rim points, (n, d); -1: all are dark."""
        # Trace a ray from each position through each point, on every ring.
        first, count, stride = tried
        n, d = distance.shape
        point = (first[..., None] + stride * np.arange(count)) % RIM
        starts = self._origins[:, None] + distance[..., None] * self._directions
        rings = self._rims.points.shape[1] // RIM
        points = point[..., None] + RIM * np.arange(rings)
        per_position = count * rings
        owner = np.repeat(np.arange(n), d * per_position)
        rays = Rays(owner, points.ravel(), np.repeat(starts.reshape(-1, 2), per_position, axis=0))
        passes = (probe_points(self._camera, self._rims, rays) == PASSES).reshape(n, d, count, rings).any(axis=3)
        # Take the middle of the first run: far from each other two parts of the rim may be lit.
        begins = np.argmax(passes & ~np.roll(passes, 1, axis=2), axis=2)[..., None]
        run = np.take_along_axis(passes, (begins + np.arange(count)) % count, axis=2)
        length = np.where(run.all(axis=2), count, np.argmin(run, axis=2))
        middle = first + stride * begins[..., 0] + stride * (length - 1) // 2
        return np.where(length > 0, middle % RIM, -1)
