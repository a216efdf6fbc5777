"""Spheres, cubes, cylinders, cones, capsules and planes of USD as triangles with exact normals at their corners.

Corners are on the solid, and no triangle is farther from it than a tolerance. Lengths are in one unit, that of the
solid. Texture coordinates go once around the axis, from 0 to 1, and up along it; on a cube over each side.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.records.shapes import Float64, Int64

_TURN = {"X": [1, 2, 0], "Y": [2, 0, 1], "Z": [0, 1, 2]}
"""Components (x, y, z) of a solid along each axis, among those of one along z: cyclic, so that nothing is mirrored."""
_FEWEST = 8
"""Fewest sides around an axis [1]: with fewer, normals turn by more between corners than shading can follow."""


@dataclass(frozen=True)
class Solid:
    """Triangles anticlockwise as seen from outside."""

    points: Float64[np.ndarray, "v 3"]
    triangles: Int64[np.ndarray, "t 3"]
    normals: Float64[np.ndarray, "t 3 3"]
    st: Float64[np.ndarray, "t 3 2"]

    def along(self, axis: str) -> "Solid":
        """The solid, of which z is the axis, about another axis."""
        turn = np.argsort(_TURN[axis])
        return Solid(self.points[:, turn], self.triangles, self.normals[:, :, turn], self.st)


def _steps(radius: float, angle: float, tolerance: float) -> int:
    """Number of chords of an arc, nowhere farther from it than half the tolerance: the other arc has the other half."""
    if radius <= 0:
        return 1
    half = math.acos(max(1.0 - tolerance / (2.0 * radius), -1.0))
    return max(math.ceil(angle / (2.0 * half)), math.ceil(_FEWEST * angle / (2.0 * math.pi)))


def _arc(radius: float, height: float, start: float, end: float, tolerance: float) -> np.ndarray:
    """An arc of a meridian: rows of distance from the axis, height, and both components of the normal."""
    angle = np.linspace(start, end, _steps(radius, abs(end - start), tolerance) + 1)
    across, up = np.cos(angle), np.sin(angle)
    across[np.isclose(np.abs(angle), math.pi / 2, rtol=0, atol=1e-12)] = 0.0
    return np.stack([radius * across, height + radius * up, across, up], axis=1)


def _line(start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    """A straight part of a meridian, solid on its left."""
    across, up = end[0] - start[0], end[1] - start[1]
    length = math.hypot(across, up) or 1.0
    return np.array([(*start, up / length, -across / length), (*end, up / length, -across / length)])


def _turned(parts: list[np.ndarray], tolerance: float) -> Solid:
    """The solid of revolution of a meridian, from its lower end to its upper one."""
    around = _steps(max(float(part[:, 0].max()) for part in parts), 2 * math.pi, tolerance)
    angle = 2 * math.pi * np.arange(around + 1) / around
    cosine, sine, one = np.cos(angle), np.sin(angle), np.ones(around + 1)
    cosine[-1], sine[-1] = cosine[0], sine[0]  # the seam is closed
    lengths = [np.hypot(*np.diff(part[:, :2], axis=0).T) for part in parts]
    total = sum(float(length.sum()) for length in lengths) or 1.0
    points, normals, st, triangles = [], [], [], []
    below, first = 0.0, 0  # length of the meridian before a part, and number of its first point
    for part, length in zip(parts, lengths, strict=True):
        # A ring of points for each point of the meridian, and two triangles for each quad between two rings.
        distance, height, across, up = part.T
        points.append(np.stack([np.outer(distance, cosine), np.outer(distance, sine), np.outer(height, one)], axis=2))
        normals.append(np.stack([np.outer(across, cosine), np.outer(across, sine), np.outer(up, one)], axis=2))
        t = (below + np.concatenate([[0.0], np.cumsum(length)])) / total
        st.append(np.stack(np.broadcast_arrays(angle[None] / (2 * math.pi), t[:, None]), axis=2))
        grid = first + np.arange(len(part) * (around + 1)).reshape(len(part), around + 1)
        a, b, c, d = (corner.ravel() for corner in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]))
        triangles += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
        below += float(length.sum())
        first += grid.size
    all_points, all_normals, all_st = (
        np.concatenate([part.reshape(-1, part.shape[2]) for part in parts_of]) for parts_of in (points, normals, st)
    )
    faces = np.concatenate(triangles)
    corners = all_points[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = faces[area > 1e-12 * area.max(initial=0.0)]  # at a pole every other one has no area
    return Solid(all_points, faces, all_normals[faces], all_st[faces])


def sphere(radius: float, tolerance: float) -> Solid:
    return _turned([_arc(radius, 0.0, -math.pi / 2, math.pi / 2, tolerance)], tolerance)


def frustum(bottom: float, top: float, height: float, tolerance: float) -> Solid:
    """A cylinder or a cone with caps: its radii at -height / 2 and height / 2."""
    low, high = (bottom, -height / 2), (top, height / 2)
    parts = [_line((0.0, low[1]), low), _line(low, high), _line(high, (0.0, high[1]))]
    return _turned([part for part in parts if part[:, :2].any() and np.ptp(part[:, :2], axis=0).any()], tolerance)


def capsule(bottom: float, top: float, height: float, tolerance: float) -> Solid:
    """A cylinder or a cone with a hemisphere at each end, beyond its height."""
    low, high = -height / 2, height / 2
    return _turned(
        [
            _arc(bottom, low, -math.pi / 2, 0.0, tolerance),
            _line((bottom, low), (top, high)),
            _arc(top, high, 0.0, math.pi / 2, tolerance),
        ],
        tolerance,
    )


def plane(width: float, length: float) -> Solid:
    """A rectangle, `width` along x and `length` along y."""
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    points = np.concatenate([(square - 0.5) * (width, length), np.zeros((4, 1))], axis=1)
    triangles = np.array([(0, 1, 2), (0, 2, 3)])
    return Solid(points, triangles, np.broadcast_to([0.0, 0.0, 1.0], (2, 3, 3)), square[triangles])


def cube(size: float) -> Solid:
    """A cube about the origin, each side a plane of its own corners."""
    sheet = plane(size, size)
    sides = []
    for axis in "XYZ":
        for sign in (1.0, -1.0):
            # The opposite side is turned by half a turn about an axis across, and so not mirrored.
            turned = np.array([1.0, 1.0, 1.0]) if sign > 0 else np.array([-1.0, 1.0, -1.0])
            side = Solid(
                (sheet.points + np.array([0, 0, size / 2])) * turned, sheet.triangles, sheet.normals * turned, sheet.st
            )
            sides.append(side.along(axis))
    return Solid(
        np.concatenate([side.points for side in sides]),
        np.concatenate([side.triangles + 4 * number for number, side in enumerate(sides)]),
        np.concatenate([side.normals for side in sides]),
        np.concatenate([side.st for side in sides]),
    )
