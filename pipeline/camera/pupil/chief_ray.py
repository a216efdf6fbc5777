"""The real chief ray: from a point behind the lens backwards through the centre of the aperture stop.

The centre of the stop is its vertex, displaced or not. The crossing x of the ray with the rear vertex plane solves m(x)
= 0, m the hit on the stop relative to its centre. In a centred lens the ray stays in the plane of its point and the
axis, and x is a height, found by the secant method; in any other lens x has two coordinates, found by Newton's method.

`table` is one of `optics.table.towards_scene`, `stop_row` the row of its aperture stop.
"""

import numpy as np

from pipeline.camera.boundary import halved
from pipeline.camera.parts.errors import CameraError
from pipeline.frames import apply, inverse
from pipeline.optics.kernels import trace
from pipeline.optics.rays import Traced, directions_to, traced
from pipeline.optics.table import ENTRY, VERTEX, is_centred, motion_of, unbounded
from pipeline.records.shapes import Float64

_STEPS = 25
"""Most steps of Newton's method or of the secant method: both multiply digits near the end."""
_TOLERANCE_MM = 1e-12
"""Distance from the centre of the stop at which a search has converged [mm]: about 70 roundings of a length near 100
mm."""
_ACCEPTED_MM = 1e-9
"""Distance at which a ray still is a chief ray [mm]: for steep rays rounding prevents full convergence."""
_DIFFERENCE_MM = 1e-4
"""Step of finite differences [mm]: roundings of 1e-13 mm leave nine digits, and an error costs one more step at
most."""
_HALVINGS = 10
"""Most halvings of a step that comes no nearer: to a thousandth of it."""
_REACHES = 2.0
"""Half width of the search for a crossing where secants fail, over paraxial crossing plus distance [1]: rays of more
than 60 degrees."""
_TRIED = 4001
"""Crossings that are tried there: two changes of sign closer than a 2000th of the half width are missed."""
_BISECTIONS = 60
"""Bisections between two of them: a double has 53 bits."""
_NO_CHIEF_RAY = "no ray from {} mm off the axis reaches the centre of the aperture stop"
TOO_WIDE = "the lens has no image so far off its axis: is the pixel pitch in mm, and the sensor or array not too large?"


def chief_slopes(
    table: Float64[np.ndarray, "n columns"], stop_row: int, points_mm: Float64[np.ndarray, "m 3"]
) -> np.ndarray:
    """Initial slopes dx/dz and dy/dz of the chief rays of points behind the lens, (m, 2), vision frame.

    Raises CameraError: the rear group lets no such ray through.
    """
    xy_mm = points_mm[:, :2]
    to_rear_mm = (table[0, VERTEX] - points_mm[:, 2])[:, None]
    if not is_centred(table[: stop_row + 1]):
        crossing = chief_crossings(table, stop_row, points_mm)
        if np.isnan(crossing).any():
            x, y = xy_mm[np.argmax(np.isnan(crossing[:, 0]))]
            raise CameraError(_NO_CHIEF_RAY.format(f"({x:.4g}, {y:.4g})"), hint=TOO_WIDE)
        return (crossing - xy_mm) / to_rear_mm
    # In a centred lens the crossing depends on the height of a point alone: trace each height once.
    height = np.hypot(*xy_mm.T)
    unique, row_of = np.unique(np.stack([height, points_mm[:, 2]], axis=1), axis=0, return_inverse=True)
    crossing_at = chief_heights(table, stop_row, unique[:, 1], unique[:, 0])
    if np.isnan(crossing_at).any():
        raise CameraError(_NO_CHIEF_RAY.format(f"{unique[np.isnan(crossing_at), 0].max():.4g}"), hint=TOO_WIDE)
    crossing = crossing_at[row_of.reshape(-1)]
    outward = np.divide(xy_mm, height[:, None], out=np.zeros_like(xy_mm), where=height[:, None] > 0)
    return (crossing - height)[:, None] * outward / to_rear_mm


def chief_crossings(
    table: Float64[np.ndarray, "surfaces columns"], stop_row: int, points_mm: Float64[np.ndarray, "n 3"]
) -> np.ndarray:
    """Crossings of the chief rays of points with the rear vertex plane, in any lens, (m, 2) [mm]; NaN: none.

    Parameters are those of `chief_slopes`. Newton's method with finite differences; a step that does not reduce the
    distance from the centre of the stop is halved (damped Newton).
    """
    rear = unbounded(table[: stop_row + 1])  # The chief ray may lie outside of the clear apertures.
    crossing, miss = _nearest_start(rear, points_mm)
    for _ in range(_STEPS):
        # Find the Newton step from a Jacobian by finite differences.
        ends = [_stop_miss(rear, points_mm, crossing + step) for step in _DIFFERENCE_MM * np.eye(2)]
        jacobian = np.stack([(end - miss) / _DIFFERENCE_MM for end in ends], axis=2)
        regular = np.isfinite(jacobian).all(axis=(1, 2))
        regular[regular] = np.linalg.det(jacobian[regular]) != 0
        step = np.zeros_like(crossing)
        step[regular] = np.linalg.solve(jacobian[regular], miss[regular, :, None])[..., 0]
        # Halve the steps that come no nearer to the centre of the stop.
        searches = _length(miss) > _TOLERANCE_MM
        for halving in range(_HALVINGS):
            trial = crossing - step / 2**halving
            trial_miss = _stop_miss(rear, points_mm, trial)
            better = searches & (_length(trial_miss) < _length(miss))
            crossing = np.where(better[:, None], trial, crossing)
            miss = np.where(better[:, None], trial_miss, miss)
            searches &= ~better
            if not searches.any():
                break
        if not (_length(miss) > _TOLERANCE_MM).any():
            break
    return np.where((_length(miss) < _ACCEPTED_MM)[:, None], crossing, np.nan)


def chief_rays(
    table: Float64[np.ndarray, "surfaces columns"], stop_row: int, points_mm: Float64[np.ndarray, "n 3"]
) -> Traced:
    """The chief rays of points behind the lens where they leave it, apertures ignored; NaN: there is none."""
    towards = directions_to(table, points_mm, chief_crossings(table, stop_row, points_mm))
    return traced(unbounded(table), points_mm, towards)


def _nearest_start(rear: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The best of a few crossings to start from, and its miss of the centre of the stop."""
    crossing = np.zeros((len(points), 2))
    miss = np.full((len(points), 2), np.inf)
    for share in (0.0, 0.25, 0.5, -0.25):
        trial = motion_of(rear[0], ENTRY)[:2, 3] + share * points[:, :2]
        trial_miss = _stop_miss(rear, points, trial)
        better = (_length(trial_miss) < _length(miss))[:, None]
        crossing = np.where(better, trial, crossing)
        miss = np.where(better, trial_miss, miss)
    return crossing, miss


def _stop_miss(rear: np.ndarray, points: np.ndarray, crossings: np.ndarray) -> np.ndarray:
    """Hits on the stop, from its centre, of rays through points and crossings of the rear vertex plane; NaN: a miss."""
    position, _, passes = trace(rear, points, directions_to(rear, points, crossings))
    on_stop = apply(inverse(motion_of(rear[-1])), position)[:, :2]
    return np.where(passes[:, None], on_stop, np.nan)


def _length(vectors: np.ndarray) -> np.ndarray:
    """Lengths of vectors (n, 2)."""
    return np.hypot(vectors[:, 0], vectors[:, 1])


def chief_heights(
    table: Float64[np.ndarray, "n columns"],
    stop_row: int,
    plane_mm: float | Float64[np.ndarray, "m"],
    heights: Float64[np.ndarray, "m"],
) -> np.ndarray:
    """Crossing of the chief ray of each point (height, 0, plane) of a centred lens with the rear vertex plane, (m,).

    The secant method ends when the ray meets the stop within 1e-12 mm of its centre, or when it stops improving. Where
    it fails the crossing is bracketed; NaN where the rear group lets no such ray through. [mm]
    """
    rear = unbounded(table[: stop_row + 1])  # The chief ray may lie outside of the clear apertures.
    if np.isclose(rear[-1, VERTEX], rear[0, VERTEX]):  # the stop is at the rear vertex plane
        return np.zeros_like(heights)
    crossing, miss = _by_secants(rear, plane_mm, heights)
    planes = np.broadcast_to(plane_mm, heights.shape)
    for row in np.flatnonzero(~(np.abs(miss) < _ACCEPTED_MM)):
        crossing[row] = _by_bisection(rear, float(planes[row]), float(heights[row]))
    return crossing


def _by_secants(rear: np.ndarray, plane_mm: float | np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Crossings of the rear vertex plane by the secant method, and the misses of their rays at the stop."""
    older = np.zeros_like(heights)
    newer = heights * 1e-3 + 1e-3
    miss_older, miss_newer = (_stop_height(rear, plane_mm, heights, r) for r in (older, newer))
    for _ in range(_STEPS):
        slope = (miss_newer - miss_older) / np.where(newer == older, 1.0, newer - older)
        done = (np.abs(miss_newer) < _TOLERANCE_MM) | (slope == 0)
        newest = np.where(done, newer, newer - miss_newer / np.where(slope == 0, 1.0, slope))
        older, miss_older = newer, miss_newer
        newer = newest
        miss_newer = _stop_height(rear, plane_mm, heights, newest)
    return newer, miss_newer


def _by_bisection(rear: np.ndarray, plane_mm: float, height_mm: float) -> float:
    """Crossing of a point's chief ray with the rear vertex plane where the secant method failed; NaN: none.

    Among several crossings, the one nearest to the paraxial crossing.
    """
    # Extrapolate the paraxial crossing from a ray near the axis.
    paraxial_height = np.array([1e-3 * height_mm])
    per_mm = float(_by_secants(rear, plane_mm, paraxial_height)[0][0] / paraxial_height[0])
    paraxial = per_mm * height_mm
    # Scan crossings for changes of sign, and take the one nearest to it.
    reach = _REACHES * float(np.abs(paraxial) + np.abs(rear[0, VERTEX] - plane_mm))
    crossings = np.linspace(-reach, reach, _TRIED)
    heights = np.full(_TRIED, height_mm)
    miss = _stop_height(rear, plane_mm, heights, crossings)
    changes = np.flatnonzero(miss[1:] * miss[:-1] <= 0)
    if not len(changes) or not np.isfinite(per_mm):
        return float("nan")
    first = changes[np.argmin(np.abs(crossings[changes] - paraxial))]
    sign = np.sign(miss[first + 1] - miss[first])

    def is_before(crossing: np.ndarray) -> np.ndarray:
        """Whether the root lies beyond a crossing."""
        return ~(sign * _stop_height(rear, plane_mm, heights[:1], crossing) > 0)

    # Bisect, and reject a change of sign that is a gap.
    _, crossing = halved(is_before, crossings[[first]], crossings[[first + 1]], _BISECTIONS)
    remaining = _stop_height(rear, plane_mm, heights[:1], crossing)
    return float(crossing[0]) if abs(remaining[0]) < _ACCEPTED_MM else float("nan")


def _stop_height(
    rear: np.ndarray, plane_mm: float | np.ndarray, heights: np.ndarray, crossings: np.ndarray
) -> np.ndarray:
    """Height at which rays through (height, plane) and (crossing, rear vertex plane) meet the stop; NaN for a miss."""
    zero = np.zeros_like(heights)
    points = np.stack([heights, zero, np.full_like(heights, plane_mm)], axis=1)
    return _stop_miss(rear, points, np.stack([crossings, zero], axis=1))[:, 0]
