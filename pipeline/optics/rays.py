"""Trace of a few rays through a table of surfaces by NumPy, for checks, which cannot wait for a compiler.

The equations are those of `optics.kernels`, written for whole arrays; results of a build come from the kernels alone.
"""

from typing import NamedTuple

import numpy as np

from pipeline.frames import apply, inverse
from pipeline.optics import table as column
from pipeline.optics.prescription import relief_at
from pipeline.optics.table import motion_of
from pipeline.records.shapes import Float64

_STEPS = 8
"""Newton steps from the conic to the asphere: more than the five of `optics.aspheres`, and taken by all rays."""
_RESIDUAL_MM = 1e-9
"""Residual beyond which a ray has missed the surface [mm]: that of `optics.aspheres`."""


GRID = 81
"""Rays along each side of a grid over a surface: odd, so that one of them goes through its middle."""


def front_grid(table: Float64[np.ndarray, "surfaces columns"], count: int) -> np.ndarray:
    """Square grid of points on the vertex plane of a table's first surface, over its full aperture, (count^2, 3) [mm].

    In the frame from which rays enter.
    """
    radius = np.sqrt(table[0, column.SEMI_DIAMETER_SQUARED])
    u = np.linspace(-radius, radius, count)
    x, y = (axis.ravel() for axis in np.meshgrid(u, u))
    return apply(motion_of(table[0], column.ENTRY), np.column_stack([x, y, np.full(len(x), table[0, column.VERTEX])]))


def directions_to(
    table: Float64[np.ndarray, "surfaces columns"],
    starts_mm: Float64[np.ndarray, "... 3"],
    points_mm: Float64[np.ndarray, "... 2"],
) -> np.ndarray:
    """Unit directions from starts (..., 3) to points (..., 2) of the vertex plane of a table's first surface.

    Axis by axis: NumPy takes six times as long where the last axis is that short.
    """
    ends_mm = (points_mm[..., 0], points_mm[..., 1], table[0, column.VERTEX])
    x, y, z = (end - starts_mm[..., axis] for axis, end in enumerate(ends_mm))
    length = np.sqrt(x * x + y * y + z * z)
    return np.stack([x / length, y / length, z / length], axis=-1)


def dot(a: Float64[np.ndarray, "*rays axes"], b: Float64[np.ndarray, "*rays axes"]) -> np.ndarray:
    """Scalar products of vectors of two or three coordinates, (...,).

    The bits of NumPy's sum over so short an axis, which takes seven times as long.
    """
    total = a[..., 0] * b[..., 0]
    for axis in range(1, a.shape[-1]):
        total = total + a[..., axis] * b[..., axis]
    return np.asarray(total)


class Traced(NamedTuple):
    """Points on the last surface and unit directions behind it, (n, 3) each; whether each ray passes, (n,) bool."""

    position: np.ndarray
    direction: np.ndarray
    passes: np.ndarray


def traced(
    table: Float64[np.ndarray, "surfaces columns"],
    position_mm: Float64[np.ndarray, "n 3"],
    direction: Float64[np.ndarray, "n 3"],
) -> Traced:
    """Trace rays through all surfaces of a table, in whose frame their unit directions have a positive z."""
    position = position_mm
    alive = np.ones(len(position_mm), bool)
    with np.errstate(all="ignore"):  # rays that miss go on as NaN
        for row in table:
            if row[column.POSE]:
                centred_from_entry = inverse(motion_of(row, column.ENTRY))
                position = apply(centred_from_entry, position)
                direction = direction @ centred_from_entry[:3, :3].T
            # Move the rays to the vertex plane, then to the surface.
            position = position + ((row[column.VERTEX] - position[:, 2]) / direction[:, 2])[:, None] * direction
            position, direction, passed = (
                _ideal(row, position, direction) if row[column.TERMS] < 0 else _crossed(row, position, direction)
            )
            alive &= passed & _is_inside(row, position)
            if row[column.POSE]:
                motion = motion_of(row)
                position = apply(motion, position)
                direction = direction @ motion[:3, :3].T
    return Traced(position, direction, alive)


def incidence(
    row: Float64[np.ndarray, "columns"], point_mm: Float64[np.ndarray, "n 3"], direction: Float64[np.ndarray, "n 3"]
) -> np.ndarray:
    """Cosines of the angles of incidence at a surface, (n,); NaN for a ray that misses."""
    if row[column.POSE]:
        centred_from_surface = inverse(motion_of(row))
        point_mm = apply(centred_from_surface, point_mm)
        direction = direction @ centred_from_surface[:3, :3].T
    with np.errstate(invalid="ignore"):
        _, normal = _surface(row, row[column.CURVATURE], 1.0 + row[column.CONIC], point_mm)
        return np.asarray(np.abs(dot(normal, direction)) / np.sqrt(dot(normal, normal)))


def _crossed(row: np.ndarray, start: np.ndarray, direction: np.ndarray) -> Traced:
    """Move rays from the vertex plane to the surface and refract them by Snell's law in vectors."""
    # With S the polynomial and w = z - S the surface is F = w - c (r^2 + (1 + k) w^2) / 2 = 0, and m = grad F its
    # normal. A cylinder has y^2 in place of r^2.
    is_relief = row[column.FORM] == column.RELIEF
    is_cylinder = float(row[column.FORM] == column.CYLINDER)
    bulge = 1.0 if is_relief else 1.0 + row[column.CONIC]
    c = row[column.CURVATURE]
    mu = row[column.INDEX_RATIO]
    # Meet the conic: the root t = f / (g + sqrt(g^2 - a f)) of the quadratic, as in `optics.aspheres`.
    curved = np.array([1.0 - is_cylinder, 1.0])
    dz = direction[:, 2]
    across, squared = (dot(curved * start[:, :2], part[:, :2]) for part in (direction, start))
    length = 1.0 - is_cylinder * direction[:, 0] ** 2
    f = c * squared
    g = dz - c * across
    path = f / (g + np.sqrt(g * g - c * (length + (bulge - 1.0) * dz * dz) * f))
    # Go on to the asphere or relief by Newton's method on F = 0.
    for _ in range(_STEPS if row[column.TERMS] else 0):
        value, normal = _surface(row, c, bulge, start + path[:, None] * direction)
        path = path - value / dot(normal, direction)
    point = start + path[:, None] * direction
    # Refract by the normal at the point, and block rays that have missed the surface.
    value, normal = _surface(row, c, bulge, point)
    squared = dot(normal, normal)
    along = dot(normal, direction)
    root = squared - mu * mu * (squared - along * along)
    refracted = mu * direction + ((np.sqrt(root) - mu * along) / squared)[:, None] * normal
    meets = (np.abs(value) <= _RESIDUAL_MM * np.abs(normal[:, 2])) & (normal[:, 2] > 0) & (along >= 0)
    return Traced(point, refracted, meets & (root >= 0))


def _surface(row: np.ndarray, c: float, bulge: float, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F of `_crossed` at points, (n,) [mm], and its gradient, (n, 3)."""
    if row[column.FORM] == column.RELIEF:
        columns, rows = int(row[column.RELIEF_COLUMNS]), int(row[column.RELIEF_ROWS])
        spline = row[column.COEFFICIENTS :][: rows * columns].reshape(rows, columns)
        height, by_x, by_y = relief_at(spline, row[column.RELIEF_SPACING], point[:, :2])
        return point[:, 2] - row[column.VERTEX] - height, np.column_stack([-by_x, -by_y, np.ones(len(point))])
    # The polynomial is S = r^2 p(v), in powers of v = r^2, or of v = r if it has odd ones: dS/d(r^2) = p + share v p'.
    curved = 1.0 - float(row[column.FORM] == column.CYLINDER)
    r2 = curved * point[:, 0] ** 2 + point[:, 1] ** 2
    coefficients = row[column.COEFFICIENTS : column.COEFFICIENTS + int(row[column.TERMS])]
    v, share = (np.sqrt(r2), 0.5) if row[column.ODD] else (r2, 1.0)
    polynomial = np.polynomial.Polynomial([*coefficients, 0.0])
    p, dp = (polynomial(v), polynomial.deriv()(v)) if len(coefficients) else (0.0, 0.0)
    # The gradient is (-slope x, -slope y, upright), where F depends on r^2 by c and, through S, by upright.
    w = point[:, 2] - row[column.VERTEX] - r2 * p
    upright = 1.0 - c * bulge * w
    slope = c + 2.0 * upright * (p + share * v * dp)
    normal = np.column_stack([-curved * slope * point[:, 0], -slope * point[:, 1], upright])
    return w - c * (r2 + bulge * w * w) / 2, normal


def _ideal(row: np.ndarray, point: np.ndarray, direction: np.ndarray) -> Traced:
    """Deflect rays on the plane of an ideal thin lens."""
    slope = direction[:, :2] / direction[:, 2:] - row[column.COEFFICIENTS] * point[:, :2]
    deflected = np.column_stack([slope, np.ones(len(slope))])
    return Traced(point, deflected / np.sqrt(dot(deflected, deflected))[:, None], np.ones(len(point), bool))


def _is_inside(row: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Whether points lie in the aperture of their surface."""
    r2 = dot(point[:, :2], point[:, :2])
    inside = (r2 <= row[column.SEMI_DIAMETER_SQUARED]) & (r2 >= row[column.INNER_SQUARED])
    edges = row[int(row[column.FIRST_EDGE]) :][: 3 * int(row[column.EDGES])].reshape(-1, 3)
    return inside & (point[:, :2] @ edges[:, :2].T <= edges[:, 2]).all(axis=1)
