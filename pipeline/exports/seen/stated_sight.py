"""Rays of a camera as a format counts them: its axes, its unit, its pixels."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pipeline.exports.conventions import Convention, Rays
from pipeline.exports.errors import ExportError
from pipeline.exports.seen.ideal_map import IdealMap, Sight, ideal_map
from pipeline.exports.seen.pixels import ours, positions
from pipeline.exports.seen.ray_patches import rows_of_rays
from pipeline.results.answers import PixelRays
from pipeline.results.records import BuiltCamera

_AXES = {Rays.VISION: (1.0, 1.0, 1.0), Rays.USD: (1.0, -1.0, -1.0)}
"""Signs of our x, y and z in the axes of a format."""


@dataclass(frozen=True, kw_only=True)
class PixelBand:
    """Rays of the pixels of some rows, the top-left pixel first.

    Attributes
    ----------
    origin, direction : (rows, w, 3) float64
        NaN where no light leaves.
    microlenses : (rows, w, 2) int64 or None
        None for a conventional camera.
    """

    origin: np.ndarray
    direction: np.ndarray
    microlenses: np.ndarray | None


@dataclass(frozen=True, kw_only=True)
class StatedSight:
    """A camera made ready, for a format.

    Attributes
    ----------
    built : BuiltCamera
        The camera as the build says.
    sight : callable or None
        Makes it ready: its rays, in our conventions.
    scale : float
        A millimetre in the unit of the format.
    """

    built: BuiltCamera = field(repr=False)
    sight: Callable[[], Sight] | None = field(repr=False)
    convention: Convention
    scale: float

    def band(self, first: int, end: int) -> PixelBand:
        """Rays of rows of pixels, in the axes and the unit of the format."""
        found = self.lines(first, end)
        origin, direction = self.points(found.origin), self.vectors(found.direction)
        return replace(found, origin=origin, direction=direction)

    def lines(self, first: int, end: int) -> PixelBand:
        """Rays of rows of pixels, in our conventions: traced behind microlenses, else by patches."""
        width, _ = self.built.size_px
        if not self.built.is_plenoptic:
            near_mm, far_mm = map(float, self.built.record["near_far_mm"])
            origin, direction = rows_of_rays(self._sight, width, (first, end), (near_mm, far_mm))
            return PixelBand(origin=origin, direction=direction, microlenses=None)
        y, x = np.mgrid[first:end, 0:width].reshape(2, -1)
        found = self.traced(x, y)
        assert found.microlens is not None
        shape = (end - first, width, -1)
        return PixelBand(
            origin=found.origin_mm.reshape(shape),
            direction=found.direction.reshape(shape),
            microlenses=found.microlens.reshape(shape),
        )

    def traced(self, x_px: np.ndarray, y_px: np.ndarray) -> PixelRays:
        """Rays of positions (n,), all in our conventions."""
        return self._sight.rays(x_px.astype(float), y_px.astype(float))

    def points(self, ours_mm: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the vision frame in the axes and the unit of the format."""
        return self.vectors(ours_mm) * self.scale

    def vectors(self, ours_3d: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) of the vision frame in the axes of the format."""
        return np.asarray(ours_3d * np.array(_AXES[self.convention.rays]) + 0.0)

    @property
    def ends(self) -> np.ndarray:
        """Positions of the centres of the first and of the last pixel, (2, 2)."""
        last = np.array(self.built.size_px) - 1.0
        return np.stack([self.positions(place) for place in (np.zeros(2), last)])

    def positions(self, places_px: np.ndarray) -> np.ndarray:
        """Image positions (..., 2) of ours as the format counts them."""
        return positions(places_px, self.convention, self.built.size_px)

    def ours(self, stated: np.ndarray) -> np.ndarray:
        """Image positions (..., 2) of the format as ours."""
        return ours(stated, self.convention, self.built.size_px)

    @cached_property
    def ideal(self) -> IdealMap:
        """The map to the image of an ideal pinhole, in our pixels."""
        return ideal_map(self.built, self._sight)

    @cached_property
    def _sight(self) -> Sight:
        if self.sight is None:
            raise ExportError(f"{self.built.name} has no lens to trace")
        return self.sight()
