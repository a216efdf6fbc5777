"""Position images for all points of a target: each point on its own tangent plane, points with a common plane
together.

A point whose front faces away from the centre of the aperture stop has no row. Obstacles in front of a point, other
targets or parts of the same one, are ignored here: see `truth.visibility`.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.frames import apply
from pipeline.records.shapes import Float64
from pipeline.targets.points import TangentPlane, TargetPoints
from pipeline.truth.grid.correspond import best_of, sightings, with_light
from pipeline.truth.grid.ray_grid import AnyRayGrid, RayGrid
from pipeline.truth.rows import Correspondences, existing
from pipeline.truth.settings import TruthSettings

REACH_PX, REACH_STEPS = 2, 4
"""Range around a row in which the search reads values: two pixels, and four steps of the fine grid."""
_WINDOW_STEPS = 16
"""Half the size of a window around a single point, in steps of the fine grid on the target. At f/2, 45 degrees and
20 mm of defocus the mean ray misses the mean of the hits by one step.
"""
_PADDING_PX = 4
"""Margin around a window [px]: values that the search may read around a row at K = 1, `REACH_STEPS`."""
_BAND_POSITIONS = 1 << 20
"""Fine positions in a band, about 400 bytes each. Results do not depend on it."""


ImageOf = Callable[[int, np.ndarray, RayGrid], np.ndarray]
"""Function of the plane's index, vision_from_plane and the rays of a window that returns J there, in the frame of
the plane.
"""


def correspond_points(
    points: TargetPoints,
    rays: AnyRayGrid,
    vision_from_target: Float64[np.ndarray, "4 4"],
    settings: TruthSettings,
    image_of: ImageOf,
) -> Correspondences | None:
    """All rows of a target that exist, with `solutions.point` indexing its points; None if all points face away.

    The image is searched band by band, so that memory does not grow with it.
    """
    planes = [_Plane(n, plane, vision_from_target @ plane.target_from_plane) for n, plane in enumerate(points.planes())]
    planes = [plane for plane in planes if plane.pose[:3, 2] @ plane.pose[:3, 3] < 0]
    if not planes:
        return None
    seen: dict[int, list[tuple[Correspondences, np.ndarray]]] = {plane.number: [] for plane in planes}
    for rows_px, rows in _bands(rays):
        band = _Band(rays.window(rows, slice(0, rays.size_px[0])), rows_px, settings)
        for plane in planes:
            seen[plane.number].append(band.rows_of(plane, image_of))
    parts = [_best(plane, seen[plane.number], rays, settings) for plane in planes]
    counts = {name: sum(part.counts[name] for part in parts) for name in parts[0].counts}
    joined = functools.reduce(Correspondences.joined, parts)
    return replace(joined, counts=counts).sorted_by(rays.axial)


@dataclass(frozen=True, slots=True)
class _Plane:
    number: int
    plane: TangentPlane
    pose: np.ndarray


def _bands(rays: AnyRayGrid) -> Iterator[tuple[slice, slice]]:
    """Bands of rows of the image, each also with the surrounding rows that a search reads."""
    width, height = rays.size_px
    rows = max(1, _BAND_POSITIONS // (width * rays.supersampling**2))
    room = REACH_PX + math.ceil(REACH_STEPS / rays.supersampling)
    for first in range(0, height, rows):
        end = min(first + rows, height)
        yield slice(first, end), slice(max(first - room, 0), min(end + room, height))


@dataclass(frozen=True, slots=True)
class _Band:
    """A band of whole rows; `searched` holds the rows of the image to search."""

    rays: RayGrid
    searched: slice
    settings: TruthSettings

    def rows_of(self, plane: _Plane, image_of: ImageOf) -> tuple[Correspondences, np.ndarray]:
        """Rows of the points of a plane, with positions in the whole image, and the distance of the nearest value."""
        k, (width, height) = self.rays.supersampling, self.rays.size_px
        rows, columns = slice(0, height), slice(0, width)
        if len(plane.plane.members) == 1 and self.settings.method != "image":
            rows, columns = _window(self.rays, apply(plane.pose, plane.plane.points_mm)[0])
        window = self.rays.window(rows, columns)
        image = image_of(plane.number, plane.pose, window)
        low, high = ((row - window.first_px[1]) * k for row in (self.searched.start, self.searched.stop))
        searched = slice(max(low, 0), max(min(high, len(image)), 0))
        seen = sightings(image, plane.plane.points_mm, window, self.settings, searched)
        lit = with_light(seen.solutions, self.rays, plane.pose, self.settings)
        return replace(lit, counts=seen.counts), seen.nearest_mm


def _best(
    plane: _Plane, seen: list[tuple[Correspondences, np.ndarray]], rays: AnyRayGrid, settings: TruthSettings
) -> Correspondences:
    parts = [part for part, _ in seen]
    counts = {name: sum(part.counts[name] for part in parts) for name in parts[0].counts}
    rows = functools.reduce(Correspondences.joined, parts)
    best, ambiguous = best_of(rows.solutions, np.concatenate([nearest for _, nearest in seen]), settings)
    chosen = replace(rows.only(best), counts={**counts, "ambiguous": ambiguous})
    kept = existing(chosen, rays, settings.min_hit_fraction)
    return replace(kept, solutions=replace(kept.solutions, point=plane.plane.members[kept.solutions.point]))


def _window(grid: RayGrid, point_mm: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of the image around all pixels whose mean ray passes near a point of the vision frame."""
    share = (point_mm[2] - grid.near_mm) / (grid.far_mm - grid.near_mm)
    crossing = grid.near + share * (grid.far - grid.near)
    steps = [np.abs(np.diff(crossing, axis=axis)).max(axis=-1) for axis in (0, 1)]
    reach = _WINDOW_STEPS * max(float(np.nanmedian(step)) for step in steps)
    near = np.abs(crossing - point_mm[:2]).max(axis=-1) < reach
    slices = []
    for axis, size in ((1, grid.size_px[1]), (0, grid.size_px[0])):
        hit = np.flatnonzero(near.any(axis=axis)) // grid.supersampling
        low, high = (hit[0], hit[-1]) if len(hit) else (0, 0)
        slices.append(slice(max(0, int(low) - _PADDING_PX), min(size, int(high) + _PADDING_PX + 1)))
    return slices[0], slices[1]


def largest_sag_mm(rows: Correspondences, points: TargetPoints) -> float:
    """Largest distance of the surface from its tangent plane within the blur of a row; 0 for flat targets.

    Curvature / 2 times the square of two standard deviations, along the widest axis of the bundle on the plane.
    """
    bend = points.curvature_per_mm[rows.solutions.point]
    if not bend.any():
        return 0.0
    jacobian = rows.solutions.jacobian
    on_plane = jacobian @ rows.blur_px2 @ jacobian.transpose(0, 2, 1)
    known = ~np.isnan(on_plane).any(axis=(1, 2))
    if not known.any():
        return 0.0
    return float(np.max(2 * bend[known] * np.linalg.eigvalsh(on_plane[known])[:, -1]))
