"""Position images of all points of a target: each on its own tangent plane, those that share one together.

A point whose front faces away from the centre of the aperture stop has no row. What stands in front of a point, another
target or a part of the same one, is not looked for here: see `truth.visibility`.
"""

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.frames import apply
from pipeline.target.points import TangentPlane, TargetPoints
from pipeline.truth.correspond import Correspondences, completed, find
from pipeline.truth.grid import RayGrid
from pipeline.truth.settings import TruthSettings

_REACH_STEPS = 16
"""Half the size of a window around a single point, in steps of the fine grid on the target; at f/2, 45 degrees and
20 mm of defocus the mean ray misses the mean of the hits by one."""
_PADDING_PX = 4

ImageOf = Callable[[int, np.ndarray, RayGrid], np.ndarray]
"""(number of the plane, vision_from_plane, rays) to J in the frame of the plane; a window of the rays is given where
one point alone is wanted."""


def plane_name(target: str, number: int, planes: int) -> str:
    """Name of the position image of a tangent plane: that of the target, with a number if it has several."""
    return target if planes == 1 else f"{target}.{number}"


def correspond_points(
    points: TargetPoints,
    grid: RayGrid,
    vision_from_target: np.ndarray,
    settings: TruthSettings,
    image_of: ImageOf,
) -> Correspondences | None:
    """All rows of a target that exist, `found.point` counting its points; None if all of them face away."""
    parts = []
    for number, plane in enumerate(points.planes()):
        pose = vision_from_target @ plane.target_from_plane
        if pose[:3, 2] @ pose[:3, 3] >= 0:
            continue
        whole = len(plane.members) > 1 or settings.method == "image"  # traced images come whole
        part = _on_plane(plane, whole, grid, pose, settings, functools.partial(image_of, number, pose))
        parts.append(replace(part, found=replace(part.found, point=plane.members[part.found.point])))
    if not parts:
        return None
    counts = {name: sum(part.counts[name] for part in parts) for name in parts[0].counts}
    joined = functools.reduce(Correspondences.joined, parts)
    return replace(joined, counts=counts).sorted_by(grid.microlenses[:, :2])


def _on_plane(
    plane: TangentPlane,
    whole: bool,
    grid: RayGrid,
    pose: np.ndarray,
    settings: TruthSettings,
    image_of: Callable[[RayGrid], np.ndarray],
) -> Correspondences:
    if whole:
        found, counts = find(image_of(grid), plane.points_mm, grid, settings)
    else:
        rows, columns = _window(grid, apply(pose, plane.points_mm)[0])
        rays = grid.window(rows, columns)
        found, counts = find(image_of(rays), plane.points_mm, rays, settings)
        found = replace(found, x_px=found.x_px + columns.start, y_px=found.y_px + rows.start)
    return completed(found, counts, grid, pose, settings)


def _window(grid: RayGrid, point_mm: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of the image around all pixels whose mean ray passes near a point of the vision frame."""
    share = (point_mm[2] - grid.near_mm) / (grid.far_mm - grid.near_mm)
    crossing = grid.near + share * (grid.far - grid.near)
    steps = [np.abs(np.diff(crossing, axis=axis)).max(axis=-1) for axis in (0, 1)]
    reach = _REACH_STEPS * max(float(np.nanmedian(step)) for step in steps)
    near = np.abs(crossing - point_mm[:2]).max(axis=-1) < reach
    slices = []
    for axis, size in ((1, grid.size_px[1]), (0, grid.size_px[0])):
        hit = np.flatnonzero(near.any(axis=axis)) // grid.supersampling
        low, high = (hit[0], hit[-1]) if len(hit) else (0, 0)
        slices.append(slice(max(0, int(low) - _PADDING_PX), min(size, int(high) + _PADDING_PX + 1)))
    return slices[0], slices[1]


def largest_sag_mm(rows: Correspondences, points: TargetPoints) -> float:
    """Largest distance within a row's blur of the surface from its tangent plane, of all rows; 0 on flat targets.

    Curvature / 2 times the square of two standard deviations, along the widest axis of the bundle on the plane.
    """
    bend = points.curvature_per_mm[rows.found.point]
    if not bend.any():
        return 0.0
    jacobian = rows.found.jacobian
    on_plane = jacobian @ rows.blur_px2 @ jacobian.transpose(0, 2, 1)
    known = ~np.isnan(on_plane).any(axis=(1, 2))
    if not known.any():
        return 0.0
    return float(np.max(2 * bend[known] * np.linalg.eigvalsh(on_plane[known])[:, -1]))
