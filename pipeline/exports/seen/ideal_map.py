"""The map between the image of a camera and that of an ideal pinhole, for programs that bend images.

Rays of a lens do not meet in one centre, so such a map holds at one distance: the points of the rays of positions on a
plane, seen from the centre of the equivalent pinhole with its principal distance. Between traced positions the map is
a spline; its error at other positions is measured and stated.
"""

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pipeline.exports.errors import ExportError
from pipeline.results.answers import PixelRays
from pipeline.results.records import BuiltCamera, BuiltPinhole

_COLUMNS, _ROWS = 49, 37
"""Traced positions along x and y: distortion of lenses is smooth over a cell."""
_MARGIN = 0.05
"""Part of the width and height that is traced beyond the image on each side [1]: corners of ideal images lie there."""
_DEGREE = 5
"""Degree of the splines along x and y: errors fall with the sixth power of the distance of positions."""
_JUDGED = 64
"""Positions between the traced ones at which the error is measured."""
_STEPS, _SETTLED_PX = 30, 1e-9
"""Most steps of Newton's method for the inverse, and the length of a step that ends it [px]."""
_FOUND_PX = 1e-6
"""Distance from the wanted position that a solution may have [px]."""


class Sight(Protocol):
    """A camera made ready, as `sight.ready_camera.ReadyCamera` is."""

    def rays(self, x_px: ArrayLike, y_px: ArrayLike) -> PixelRays:
        """Rays of image positions."""


@dataclass(frozen=True, kw_only=True)
class IdealMap:
    """Image positions of a camera and of an ideal pinhole, both with (0, 0) in the centre of the top-left pixel.

    Attributes
    ----------
    pinhole : BuiltPinhole
        Its distortion does not count.
    z_mm : float
        Vision z of the plane on which the map holds.
    error_px : float
        Largest difference from traced rays at positions between those that made the map.
    """

    pinhole: BuiltPinhole
    z_mm: float
    error_px: float
    _splines: tuple[Any, Any] = field(repr=False)
    _low: np.ndarray = field(repr=False)
    _high: np.ndarray = field(repr=False)

    def ideal(self, x_px: np.ndarray) -> np.ndarray:
        """Positions in the ideal image of positions (n, 2) of the camera; NaN outside of what was traced."""
        inside = np.all((x_px >= self._low) & (x_px <= self._high), axis=1, keepdims=True)
        return np.where(inside, x_px + self._shift(x_px), np.nan)

    def real(self, u_px: np.ndarray) -> np.ndarray:
        """Positions in the camera of positions (n, 2) of the ideal image; NaN where there is none."""
        x, rows = np.clip(u_px, self._low, self._high), np.arange(len(u_px))
        for _ in range(_STEPS):
            here = x[rows]
            miss = here + self._shift(here) - u_px[rows]
            slopes = np.stack([self._shift(here, dx=1), self._shift(here, dy=1)], axis=2) + np.eye(2)
            x[rows] = np.clip(here - np.linalg.solve(slopes, miss[:, :, None])[:, :, 0], self._low, self._high)
            rows = rows[np.abs(x[rows] - here).max(axis=1) > _SETTLED_PX]  # those at the edge stay there, too
            if not len(rows):
                break
        is_found = np.abs(x + self._shift(x) - u_px).max(axis=1) < _FOUND_PX
        return np.where(is_found[:, None], x, np.nan)

    def slopes(self, u_px: np.ndarray) -> np.ndarray:
        """Directions that positions (n, 2) of the ideal image see, x / z and y / z."""
        return np.asarray((u_px - self.pinhole.principal_point_px) / self.pinhole.principal_distance_px)

    def seen_at(self, slopes: np.ndarray) -> np.ndarray:
        """Positions in the ideal image of directions (n, 2), x / z and y / z."""
        return np.asarray(slopes * self.pinhole.principal_distance_px + self.pinhole.principal_point_px)

    def may_see(self, u_px: np.ndarray) -> np.ndarray:
        """Whether positions (n, 2) of the ideal image lie where the edge of the camera's image is, or inside."""
        edge = np.linspace(0, 1, _COLUMNS)
        sides = [(edge, 0 * edge), (edge, 0 * edge + 1), (0 * edge, edge), (0 * edge + 1, edge)]
        around = np.concatenate([np.stack(side, axis=1) for side in sides]) * (self._high - self._low) + self._low
        there = around + self._shift(around)
        return np.asarray(((u_px >= there.min(axis=0)) & (u_px <= there.max(axis=0))).all(axis=1))

    def _shift(self, x_px: np.ndarray, **derivative: int) -> np.ndarray:
        return np.stack([spline.ev(x_px[:, 0], x_px[:, 1], **derivative) for spline in self._splines], axis=1)


def ideal_map(camera: BuiltCamera, sight: Sight) -> IdealMap:
    """Trace rays over the image of a camera and make its map.

    Raises
    ------
    ExportError
        No pinhole fits, or light does not reach all of the image.
    """
    from scipy.interpolate import RectBivariateSpline

    model, z_mm = _model_and_plane(camera)
    size = np.array(camera.size_px, float)
    for margin in (_MARGIN, 0.0):
        low, high = -0.5 - margin * size, size - 0.5 + margin * size
        x, y = (np.linspace(low[axis], high[axis], count) for axis, count in enumerate((_COLUMNS, _ROWS)))
        places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        shift = _ideal(model, sight, z_mm, places) - places
        if np.isfinite(shift).all():
            break
    else:
        raise ExportError(f"light does not reach all of the image of {camera.name}, so it has no map to a pinhole's")
    splines = tuple(
        RectBivariateSpline(x, y, shift[:, axis].reshape(len(x), len(y)), kx=_DEGREE, ky=_DEGREE) for axis in range(2)
    )
    found = IdealMap(pinhole=model, z_mm=z_mm, error_px=0.0, _splines=(splines[0], splines[1]), _low=low, _high=high)
    random = np.random.default_rng(1).uniform(np.full(2, -0.5), size - 0.5, (_JUDGED, 2))
    apart = found.ideal(random) - _ideal(model, sight, z_mm, random)
    return IdealMap(
        pinhole=model,
        z_mm=z_mm,
        error_px=float(np.hypot(*apart.T).max()),
        _splines=found._splines,
        _low=low,
        _high=high,
    )


def _model_and_plane(camera: BuiltCamera) -> tuple[BuiltPinhole, float]:
    """The equivalent pinhole, and vision z of the plane at the harmonic mean of near and far."""
    model = camera.pinhole_with_distortion
    if model is None:
        raise ExportError(
            f"no pinhole fits {camera.name}, and this format bends its image into that of one",
            hint="choose other cameras with --only",
        )
    near_mm, far_mm = map(float, camera.record["near_far_mm"])
    return model, 2 / (1 / near_mm + 1 / far_mm)


def _ideal(model: BuiltPinhole, sight: Sight, z_mm: float, x_px: np.ndarray) -> np.ndarray:
    """Exact positions in the ideal image, (n, 2) [px]."""
    points = sight.rays(x_px[:, 0], x_px[:, 1]).at_distance(z_mm) - model.centre_mm
    return np.asarray(model.principal_distance_px * points[:, :2] / points[:, 2:] + model.principal_point_px)
