"""Optical path of a few rays through a table of surfaces, by NumPy: index times distance, surface by surface.

An ideal thin lens has no thickness that a ray could travel. Its path is the one that makes the light of a point that of
the point's image: the phase whose slope is the bend of the rays. It is exact for light that comes from a point.
"""

from typing import NamedTuple

import numpy as np

from pipeline.frames import apply, inverse
from pipeline.optics.rays import traced
from pipeline.optics.table import INDEX_RATIO, POSE, TERMS, motion_of
from pipeline.records.shapes import Bool, Float64


class PathRays(NamedTuple):
    """Rays with the way that they have come.

    Attributes
    ----------
    position_mm, direction : (n, 3) float64
        A point of each ray and its unit direction; NaN where it missed a surface.
    passes : (n,) bool
        Whether it has passed all apertures; those that have not are carried along.
    path_mm : (n,) float64
        Optical path from the start to the point.
    medium : float
        Refractive index of the medium that the rays are in, relative to air.
    """

    position_mm: Float64[np.ndarray, "n 3"]
    direction: Float64[np.ndarray, "n 3"]
    passes: Bool[np.ndarray, "n"]
    path_mm: Float64[np.ndarray, "n"]
    medium: float = 1.0

    @property
    def slope(self) -> np.ndarray:
        """dx/dz and dy/dz, (n, 2)."""
        return self.direction[:, :2] / self.direction[:, 2:]


def with_path(table: Float64[np.ndarray, "surfaces columns"], rays: PathRays) -> PathRays:
    """Rays behind all surfaces of a table from `optics.table`, on the last one."""
    for row in table:
        position, direction, passes = traced(row[None], rays.position_mm, rays.direction)
        path = rays.path_mm + rays.medium * np.sum((position - rays.position_mm) * rays.direction, axis=1)
        bent = PathRays(position, direction, rays.passes & passes, path, rays.medium / row[INDEX_RATIO])
        if row[TERMS] < 0:
            bent = bent._replace(path_mm=path + _in_its_place(row, bent, rays.direction))
        rays = bent
    return rays


def _in_its_place(row: np.ndarray, bent: PathRays, before: np.ndarray) -> np.ndarray:
    """Path that an ideal thin lens adds, in the frame in which it stands in its place."""
    back = inverse(motion_of(row)) if row[POSE] else np.eye(4)
    offset = apply(back, bent.position_mm)[:, :2]
    slopes = (way @ back[:3, :3].T for way in (before, bent.direction))
    return bent.medium * ideal_path(offset, *(way[:, :2] / way[:, 2:] for way in slopes))


def ideal_path(
    offset_mm: Float64[np.ndarray, "n 2"], before: Float64[np.ndarray, "n 2"], behind: Float64[np.ndarray, "n 2"]
) -> np.ndarray:
    """Path that an ideal thin lens adds to rays that come from one point, 0 in its middle, (n,) [mm].

    With s the slope of a ray at the distance p from the middle and a that of the ray through the middle, which is not
    bent, light of a point has the path (a + s) p / (sqrt(1 + a^2) + sqrt(1 + s^2)) across the plane of the lens.

    Parameters
    ----------
    offset_mm : (n, 2) float64
        Points where the rays meet the lens, from its middle.
    before, behind : (n, 2) float64
        Their slopes.
    """
    known = np.isfinite(before).all(axis=1) & np.isfinite(offset_mm).all(axis=1)
    terms = np.column_stack([np.ones(len(offset_mm)), offset_mm])
    middle = np.linalg.lstsq(terms[known], before[known], rcond=None)[0][0]
    return _path_across(offset_mm, middle, behind) - _path_across(offset_mm, middle, before)


def _path_across(offset: np.ndarray, middle: np.ndarray, slope: np.ndarray) -> np.ndarray:
    roots = np.sqrt(1 + middle @ middle) + np.sqrt(1 + np.sum(slope**2, axis=1))
    return np.sum((middle + slope) * offset, axis=1) / roots
