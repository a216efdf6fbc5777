"""A batch of paths of light, from the camera to the lamps, as arrays; vision frame, mm."""

from typing import NamedTuple

import numpy as np

FACING, ALPHA, RATIO = 1, 2, 5
"""Fields of a paint, as columns of `Hits.paint`."""


class Paths(NamedTuple):
    """Paths of a batch, each with the ray (n, 3) on which it continues, away from the camera.

    A density of 0 is that of rays of the camera, also behind glass; an infinite one says that no lamp was asked for
    this light, and a negative one that it is behind glass, through which lamps were asked.
    """

    origin: np.ndarray
    direction: np.ndarray
    power: np.ndarray  # part of the light along this ray that reaches the camera
    # of the surface that it comes from: density with which the direction was chosen [1/sr], see below; unit normal for
    # shading (n, 3), outside of glass; and the number of points of lamps that were candidates there
    density: np.ndarray
    normal: np.ndarray
    candidates: np.ndarray
    absorption: np.ndarray  # coefficient of the medium it is in [1/mm]
    # (n,) uint32, (n,) int64, `draws.Names`
    key: np.ndarray
    rank: np.ndarray
    ray: np.ndarray  # (n,) int64, the ray of the camera that it belongs to


class Hits(NamedTuple):
    """Surfaces that paths meet."""

    distance: np.ndarray  # infinite where there is nothing
    triangle: np.ndarray
    point: np.ndarray
    # (n, 3), unit normals of the triangle and for shading, on the side that the ray comes from
    flat: np.ndarray
    normal: np.ndarray
    paint: np.ndarray  # (n, 6), fields of `reflection.Paint`
    emission: np.ndarray
    beyond: np.ndarray  # coefficient of the medium behind a face of glass [1/mm]

    @property
    def is_smooth_glass(self) -> np.ndarray:
        """Whether each path meets smooth glass and goes on as by a mirror, (n,) bool."""
        return np.isfinite(self.distance) & (self.paint[:, RATIO] > 0.0) & (self.paint[:, ALPHA] == 0.0)


class Shadows(NamedTuple):
    """Rays towards lamps."""

    origin: np.ndarray
    direction: np.ndarray
    end: np.ndarray  # path to the lamp
    light: np.ndarray  # light that arrives if nothing is in between
    straight: np.ndarray  # bool, whether it goes through bodies of glass, unbent
    ray: np.ndarray  # (n,) int64, the ray of the camera that it belongs to
