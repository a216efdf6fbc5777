"""Correspondences by position images: search, half-pixel rule, blur, and the rows that exist; each point on its own
tangent plane, points with a common plane together.

A point whose front faces away from the centre of the aperture stop has no row. Obstacles in front of a point, other
targets or parts of its own, are ignored here: see `truth.visibility`.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.frames import apply
from pipeline.records.shapes import Float64
from pipeline.targets.points import TangentPlane, TargetPoints
from pipeline.truth import blur
from pipeline.truth.grid import quad_search
from pipeline.truth.grid.position_image import parameter_on_target
from pipeline.truth.grid.ray_grid import AnyRayGrid, RayGrid, fine_from_image, image_from_fine, matrix_4
from pipeline.truth.rows import Correspondences, Solutions, existing
from pipeline.truth.settings import TruthSettings


@dataclass(frozen=True, slots=True)
class RawSolutions:
    """Solutions of a search in the order of the grid, before the best one of each point and cell is chosen."""

    solutions: Solutions
    # distance of the nearest value from the point; the solution with the smallest is the best
    nearest_mm: Float64[np.ndarray, "n"]
    counts: dict[str, int]  # of candidates, and of rejections by reason


def find(
    image: Float64[np.ndarray, "n m 2"], points_mm: Float64[np.ndarray, "p 3"], grid: RayGrid, settings: TruthSettings
) -> tuple[Solutions, dict]:
    """Search target points in a position image, both in the target frame; flat targets have z = 0.

    Returns at most one row per point and cell, and counts of candidates, rejections by reason, and ambiguous rows.
    """
    raw = sightings(image, points_mm, grid, settings, slice(0, len(image)))
    best, ambiguous = best_of(raw.solutions, raw.nearest_mm, settings)
    return raw.solutions.only(best), {**raw.counts, "ambiguous": ambiguous}


def sightings(
    image: Float64[np.ndarray, "h w 2"],
    points_mm: Float64[np.ndarray, "n 3"],
    grid: RayGrid,
    settings: TruthSettings,
    searched: slice,
) -> RawSolutions:
    """All solutions that begin in the rows `searched` of a position image; the rows around them are only read."""
    image = np.ascontiguousarray(image)
    points = np.ascontiguousarray(points_mm[:, :2])
    search_for = _by_nearest if settings.search == "nearest" else _in_quads
    return search_for(image, points, grid, settings, searched)


def best_of(
    solutions: Solutions, nearest_mm: Float64[np.ndarray, "n"], settings: TruthSettings
) -> tuple[np.ndarray, int]:
    """Indices of the best solutions by point and cell, and the number of the rest."""
    # The quad whose nearest value is closest to the point wins its (point, cell); the first one of equals.
    order = np.lexsort((nearest_mm, solutions.cell, solutions.point))
    pair = np.stack([solutions.point[order], solutions.cell[order]], axis=1)
    first = np.ones(len(order), bool)
    first[1:] = (pair[1:] != pair[:-1]).any(axis=1)
    return order[first], int(np.sum(~first)) if settings.search == "quad" else 0


def _in_quads(
    image: np.ndarray, points: np.ndarray, grid: RayGrid, settings: TruthSettings, searched: slice
) -> RawSolutions:
    """Solutions by the paper's quad search with its filters, in the quads that begin in the rows `searched`.

    `image` (h, w, 2) and `points` (n, 2): in the target frame [mm].
    """
    # Count the quads that contain a point, and list them.
    no_quads = np.empty((0, 3), np.int64)
    quads = np.empty((quad_search.quads_that_hold(image, grid.cell, points, no_quads), 3), np.int64)
    quad_search.quads_that_hold(image, grid.cell, points, quads)
    quads = np.ascontiguousarray(quads[(quads[:, 2] >= searched.start) & (quads[:, 2] < searched.stop)])
    # Filter them, and solve in each.
    status = np.empty(len(quads), np.int64)
    solutions = np.full((len(quads), quad_search.SOLUTION), np.nan)
    filters = quad_search.Filter(settings.filter != "none", settings.lambda_d, math.radians(settings.lambda_alpha_deg))
    quad_search.solve_quads(image, grid.cell, points, quads, filters, status, solutions)
    counts = {
        "quads": len(quads),
        "rejected_window": int(np.sum(status == quad_search.WINDOW)),
        "rejected_lengths": int(np.sum(status == quad_search.LENGTHS)),
        "rejected_angles": int(np.sum(status == quad_search.ANGLES)),
    }
    accepted = status == quad_search.ACCEPTED
    quads = quads[accepted]
    solutions = solutions[accepted]
    # Convert them to positions and derivatives in the image.
    k = grid.supersampling
    point, column, row = quads.T
    s, t = solutions[:, quad_search.S], solutions[:, quad_search.T]
    first_corner = quads[:, 1:] + np.array(grid.first_px) * k
    x_fine = first_corner[:, 0] + _offset_in_quad(solutions[:, quad_search.COLUMN], column, s)
    y_fine = first_corner[:, 1] + _offset_in_quad(solutions[:, quad_search.ROW], row, t)
    by_column_and_row = solutions[:, quad_search.BY_COLUMN : quad_search.S].reshape(-1, 2, 2)
    in_image = Solutions(
        point=point,
        cell=grid.cell[row, column],
        x_px=image_from_fine(x_fine, k),
        y_px=image_from_fine(y_fine, k),
        # Each derivative becomes a column; k steps of the grid are a pixel.
        jacobian=by_column_and_row.transpose(0, 2, 1) * k,
        # Weights of the three values: errors of independent positions add in quadrature.
        noise_gain=np.sqrt((1 - s - t) ** 2 + s**2 + t**2),
    )
    return RawSolutions(in_image, solutions[:, quad_search.DISTANCE], counts)


def _offset_in_quad(solution: np.ndarray, first_corner: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Offsets of solutions from the first corners of their quads along an axis of the grid, from s (or t) [steps]."""
    # s starts at the corner whose value is nearest to the point and may run backwards: the offset then is 1 - s. It is
    # not the difference of positions, whose last digits depend on where the window begins; this only tells which.
    difference = solution - first_corner
    return np.where(np.abs(difference - s) <= np.abs(difference - (1 - s)), s, 1 - s)


def _by_nearest(
    image: np.ndarray, points: np.ndarray, grid: RayGrid, settings: TruthSettings, searched: slice
) -> RawSolutions:
    """Solutions by the paper's naive search: the nearest value to each point, in each cell, within a threshold."""
    shape = (len(points), len(grid.microlenses))
    nearest_mm = np.full(shape, settings.nearest_threshold_mm)
    position = np.full((*shape, 2), -1)
    quad_search.nearest_positions(image[searched], grid.cell[searched], points, nearest_mm, position)
    point, cell = np.nonzero(position[..., 0] >= 0)
    column, row = position[point, cell].T
    row = row + searched.start
    k = grid.supersampling
    solutions = Solutions(
        point=point,
        cell=cell,
        x_px=image_from_fine(column + grid.first_px[0] * k, k),
        y_px=image_from_fine(row + grid.first_px[1] * k, k),
        jacobian=_central_jacobian(image, column, row) * k,
        noise_gain=np.ones(len(point)),
    )
    return RawSolutions(solutions, nearest_mm[point, cell], {"quads": 0})


def _central_jacobian(image: np.ndarray, column: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Derivative of J per step of the grid by central differences, (n, 2, 2); NaN at the edge of a bundle."""
    height, width = image.shape[:2]
    left, right = np.maximum(column - 1, 0), np.minimum(column + 1, width - 1)
    above, below = np.maximum(row - 1, 0), np.minimum(row + 1, height - 1)
    along_x = (image[row, right] - image[row, left]) / (right - left)[:, None]
    along_y = (image[below, column] - image[above, column]) / (below - above)[:, None]
    return np.stack([along_x, along_y], axis=-1)


def with_light(solutions: Solutions, grid: RayGrid, vision_from_target: Float64[np.ndarray, "4 4"]) -> Correspondences:
    """All results of a search with light, blur and error; counts are empty."""
    covariance, ray_near, ray_far = _bundle_at(solutions, grid)
    t, _, direction = parameter_on_target(ray_near, ray_far, grid.near_mm, grid.far_mm, vision_from_target)
    uu, uv = blur.deviations(covariance, t)
    blurred = blur.in_image(blur.on_plane(uu, direction, vision_from_target), solutions.jacobian)
    return Correspondences(
        solutions,
        _sigma(solutions, grid, blurred, covariance),
        grid.hit_fraction[_nearest_fine(solutions, grid)],
        blurred,
        blur.signed_radius_px(blurred, uv),
        {},
    )


def _nearest_fine(solutions: Solutions, grid: RayGrid) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of the position of the fine grid next to each solution, (n,) int each."""
    k = grid.supersampling
    height, width = grid.cell.shape
    column, row = (
        np.rint(fine_from_image(np.nan_to_num(x), k)) - first * k
        for x, first in zip((solutions.x_px, solutions.y_px), grid.first_px, strict=True)
    )
    return row.clip(0, height - 1).astype(int), column.clip(0, width - 1).astype(int)


def _bundle_at(solutions: Solutions, grid: RayGrid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance (n, 4, 4) and mean crossings (n, 2) of the pixel nearest to each row, within the row's own cell.

    NaN if none of the nine pixels around a row belongs to its cell.
    """
    width, height = grid.size_px
    left, above = grid.first_px
    k = grid.supersampling
    n = len(solutions.point)
    covariance = np.full((n, 10), np.nan)
    near, far = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    closest = np.full(n, np.inf)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            # Visit one of the nine pixels around each row, in the window of the grid.
            x = (np.rint(np.nan_to_num(solutions.x_px)) - left + dx).clip(0, width - 1).astype(int)
            y = (np.rint(np.nan_to_num(solutions.y_px)) - above + dy).clip(0, height - 1).astype(int)
            # The fine position next to the pixel's centre determines whose bundle the pixel kept.
            fine = y * k + k // 2, x * k + k // 2
            # Take its bundle where it is nearer than those before, and of the cell.
            distance = np.hypot(x + left - solutions.x_px, y + above - solutions.y_px)
            usable = (grid.cell[fine] == solutions.cell) & (distance < closest) & ~np.isnan(grid.covariance[y, x, 0])
            closest = np.where(usable, distance, closest)
            covariance[usable] = grid.covariance[y, x][usable]
            near[usable], far[usable] = grid.near[fine][usable], grid.far[fine][usable]
    return matrix_4(covariance), near, far


def _sigma(solutions: Solutions, grid: RayGrid, blurred: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard error of each row: that of the worse plane, scaled by the blur."""
    # The error of a bundle's mean is proportional to the bundle's width, because both are linear in the crossings with
    # the pupil. So the error at the target is that at the near or far plane times the ratio of the blurs. Blur and
    # error are those of the surrounding positions, not of the row's own bundle, because the row is computed from these
    # positions.
    row, column = _nearest_fine(solutions, grid)
    widths = []
    square_px2 = (grid.square_steps / grid.supersampling) ** 2 / 12
    for image, block in ((grid.near, covariance[:, :2, :2]), (grid.far, covariance[:, 2:, 2:])):
        jacobian = _central_jacobian(image, column, row) * grid.supersampling
        finite = np.isfinite(jacobian).all(axis=(1, 2))
        regular = finite & (np.abs(np.linalg.det(np.where(finite[:, None, None], jacobian, 0.0))) > 0)
        jacobian = np.where(regular[:, None, None], jacobian, np.nan)
        widths.append(np.diagonal(blur.in_image(block, jacobian), axis1=1, axis2=2))
    worst = np.fmax(*widths) + square_px2
    own_blur = np.diagonal(blurred, axis1=1, axis2=2) + square_px2
    return _pooled_error(grid, row, column, solutions.cell) * np.sqrt(own_blur / worst) * solutions.noise_gain[:, None]


def _pooled_error(grid: RayGrid, row: np.ndarray, column: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Root mean square of the errors of up to nine surrounding positions in the same cell, (n, 2) [px]."""
    # The error of a single position is estimated from four replicas and is itself uncertain by 40 %.
    total = np.zeros((len(row), 2))
    count = np.zeros((len(row), 1))
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            y, x = (row + j).clip(0, grid.cell.shape[0] - 1), (column + i).clip(0, grid.cell.shape[1] - 1)
            error = grid.error_px[y, x]
            usable = (grid.cell[y, x] == cell) & ~np.isnan(error).any(axis=1)
            total[usable] += error[usable] ** 2
            count[usable] += 1
    return np.sqrt(np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0))


REACH_PX, REACH_STEPS = 2, 4
"""Reach of the search around a row: two pixels, and four steps of the fine grid."""
_WINDOW_STEPS = 16
"""Half the size of a window around a single point, in steps of the fine grid on the target. At f/2, 45 degrees and 20
mm of defocus the mean ray misses the mean of the hits by one step."""
_PADDING_PX = 4
"""Margin around a window [px]: the reach of the search around a row at K = 1, `REACH_STEPS`."""
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
    rows_by_plane: dict[int, list[tuple[Correspondences, np.ndarray]]] = {plane.number: [] for plane in planes}
    for rows_px, rows in _bands(rays):
        band = _Band(rays.window(rows, slice(0, rays.size_px[0])), rows_px, settings)
        for plane in planes:
            rows_by_plane[plane.number].append(band.rows_of(plane, image_of))
    parts = [_best(plane, rows_by_plane[plane.number], rays, settings) for plane in planes]
    counts = {name: sum(part.counts[name] for part in parts) for name in parts[0].counts}
    joined = functools.reduce(Correspondences.joined, parts)
    return replace(joined, counts=counts).sorted_by(rays.axial)


@dataclass(frozen=True, slots=True)
class _Plane:
    """A tangent plane with the points that share it, and its pose vision_from_plane, (4, 4)."""

    number: int
    plane: TangentPlane
    pose: np.ndarray


def _bands(rays: AnyRayGrid) -> Iterator[tuple[slice, slice]]:
    """Bands of rows of the image, each also with the surrounding rows that a search reads."""
    width, height = rays.size_px
    rows = max(1, _BAND_POSITIONS // (width * rays.supersampling**2))
    margin = REACH_PX + math.ceil(REACH_STEPS / rays.supersampling)
    for first in range(0, height, rows):
        end = min(first + rows, height)
        yield slice(first, end), slice(max(first - margin, 0), min(end + margin, height))


@dataclass(frozen=True, slots=True)
class _Band:
    """A band of complete rows; `searched` holds the rows of the image to search."""

    rays: RayGrid
    searched: slice
    settings: TruthSettings

    def rows_of(self, plane: _Plane, image_of: ImageOf) -> tuple[Correspondences, np.ndarray]:
        """Rows of the points of a plane, with positions in the full image, and the distance of the nearest value."""
        k = self.rays.supersampling
        width, height = self.rays.size_px
        # A point with a plane of its own, as on a curved target, is sought in a window around it.
        rows, columns = slice(0, height), slice(0, width)
        if len(plane.plane.members) == 1 and self.settings.method != "image":
            rows, columns = _window(self.rays, apply(plane.pose, plane.plane.points_mm)[0])
        window = self.rays.window(rows, columns)
        image = image_of(plane.number, plane.pose, window)
        # Search the rows of the band that lie in the window.
        low, high = ((row - window.first_px[1]) * k for row in (self.searched.start, self.searched.stop))
        searched = slice(max(low, 0), max(min(high, len(image)), 0))
        raw = sightings(image, plane.plane.points_mm, window, self.settings, searched)
        lit = with_light(raw.solutions, self.rays, plane.pose)
        return replace(lit, counts=raw.counts), raw.nearest_mm


def _best(
    plane: _Plane, bands: list[tuple[Correspondences, np.ndarray]], rays: AnyRayGrid, settings: TruthSettings
) -> Correspondences:
    """Rows of a plane that exist, from those of all bands and their distances of the nearest value: the best of each
    point and cell, with the numbers of points in the target.
    """
    parts = [part for part, _ in bands]
    counts = {name: sum(part.counts[name] for part in parts) for name in parts[0].counts}
    rows = functools.reduce(Correspondences.joined, parts)
    best, ambiguous = best_of(rows.solutions, np.concatenate([nearest for _, nearest in bands]), settings)
    chosen = replace(rows.only(best), counts={**counts, "ambiguous": ambiguous})
    kept = existing(chosen, rays, settings.min_hit_fraction)
    return replace(kept, solutions=replace(kept.solutions, point=plane.plane.members[kept.solutions.point]))


def _window(grid: RayGrid, point_mm: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of the image around all pixels whose mean ray passes near a point of the vision frame."""
    # Cross the plane at the point's depth with the mean rays, and take those within a few of their own steps from it.
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

    Half the curvature times the square of two standard deviations, along the widest axis of the bundle on the plane.
    """
    curvature_per_mm = points.curvature_per_mm[rows.solutions.point]
    if not curvature_per_mm.any():
        return 0.0
    jacobian = rows.solutions.jacobian
    on_plane = jacobian @ rows.blur_px2 @ jacobian.transpose(0, 2, 1)
    finite = ~np.isnan(on_plane).any(axis=(1, 2))
    if not finite.any():
        return 0.0
    widest_mm2 = np.linalg.eigvalsh(on_plane[finite])[:, -1]
    return float(np.max(2 * curvature_per_mm[finite] * widest_mm2))
