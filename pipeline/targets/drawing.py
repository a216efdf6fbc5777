"""Drawings: artwork of a target as shapes painted on a white sheet one after the other, exact and without a resolution.

A drawing is the only definition of the appearance of a pattern: kernels ask it for the colour of a point, and
`report/artwork` prints the same shapes. It is in the chart: x right, y up, origin at the centre of the sheet [mm].
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.records.shapes import Float64
from pipeline.targets import drawing_kernels as kernels

Points = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Polygon:
    """A simple polygon; points on its edge belong to one side of the edge only (even-odd rule)."""

    corners: Points
    is_black: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Disc:
    """A disc."""

    x: float
    y: float
    radius: float
    is_black: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Spokes:
    """Black sectors of a ring, as wide as the gaps between them; the first begins at `phase` from +x towards +y."""

    x: float
    y: float
    inner: float
    outer: float
    count: int
    phase: float = 0.0

    @property
    def sectors(self) -> list[tuple[float, float]]:
        """First and last angle of each sector [rad]."""
        step = math.pi / self.count
        return [(self.phase + 2 * i * step, self.phase + (2 * i + 1) * step) for i in range(self.count)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Checks:
    """Squares about the centre of the sheet, black and white in turn; the top-left one is black.

    `columns` and `rows` count inner corners, so there is one square more.
    """

    columns: int
    rows: int
    square: float

    @property
    def squares(self) -> list[Points]:
        """Corners of the black squares, anticlockwise from the bottom left."""
        left, top, a = -self.square * (self.columns + 1) / 2, self.square * (self.rows + 1) / 2, self.square
        cells = [(c, r) for r in range(self.rows + 1) for c in range(self.columns + 1) if (c + r) % 2 == 0]
        return [rectangle(left + c * a, top - (r + 1) * a, left + (c + 1) * a, top - r * a) for c, r in cells]


Shape = Polygon | Disc | Spokes | Checks


def rectangle(left: float, bottom: float, right: float, top: float) -> Points:
    """Corners of an upright rectangle, anticlockwise from the bottom left."""
    return ((left, bottom), (right, bottom), (right, top), (left, top))


@dataclass(frozen=True)
class Drawing:
    """A white sheet, by half its width and height, with shapes; a later shape covers earlier ones."""

    half_x_mm: float
    half_y_mm: float
    shapes: Sequence[Shape] = ()

    def whiteness(self, x_mm: Float64[np.ndarray, "n"], y_mm: Float64[np.ndarray, "n"]) -> np.ndarray:
        """1 on white, 0 on black, NaN beside the sheet, (n,)."""
        value = np.empty(len(x_mm))
        kernels.whiteness_at_points(self.arrays, np.ascontiguousarray(x_mm), np.ascontiguousarray(y_mm), value)
        return value

    @cached_property
    def arrays(self) -> kernels.DrawingArrays:
        """The drawing for the kernels."""
        kinds = np.array([kernels.KINDS.index(type(shape).__name__) for shape in self.shapes], np.int64)
        numbers = np.array([_numbers(shape) for shape in self.shapes], float).reshape(-1, kernels.NUMBERS)
        outlines = [shape.corners if isinstance(shape, Polygon) else () for shape in self.shapes]
        first = np.cumsum([0, *map(len, outlines)])
        corners = np.array([corner for outline in outlines for corner in outline], float).reshape(-1, 2)
        sheet = float(self.half_x_mm), float(self.half_y_mm)
        bins, starts, items = _bins(*sheet, self.shapes)
        return kernels.DrawingArrays(*sheet, kinds, numbers, first, corners, bins, starts, items)


def _numbers(shape: Shape) -> tuple[float, ...]:
    """Numbers of a shape, in the columns that `kernels` names."""
    if isinstance(shape, Polygon):
        return (0.0 if shape.is_black else 1.0, *bounds(shape), 0)
    if isinstance(shape, Disc):
        return (0.0 if shape.is_black else 1.0, shape.x, shape.y, shape.radius, 0, 0)
    if isinstance(shape, Spokes):
        return (shape.count, shape.x, shape.y, shape.inner, shape.outer, shape.phase)
    return (shape.columns, shape.rows, shape.square, 0, 0, 0)


def bounds(shape: Shape) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a shape."""
    if isinstance(shape, Polygon):
        x, y = np.array(shape.corners).T
        return x.min(), x.max(), y.min(), y.max()
    if isinstance(shape, Checks):
        half_x, half_y = (shape.columns + 1) * shape.square / 2, (shape.rows + 1) * shape.square / 2
        return -half_x, half_x, -half_y, half_y
    reach = shape.radius if isinstance(shape, Disc) else shape.outer
    return shape.x - reach, shape.x + reach, shape.y - reach, shape.y + reach


def _bins(half_x: float, half_y: float, shapes: Sequence[Shape]) -> tuple[int, np.ndarray, np.ndarray]:
    """Shapes that may be seen in each bin of a grid over the sheet: `bins`, `starts` and `items` of `DrawingArrays`."""
    count = math.ceil(2 * math.sqrt(len(shapes))) if len(shapes) > 3 else 1
    lists: list[list[int]] = [[] for _ in range(count * count)]

    def touched(low: float, high: float, half: float) -> range:
        # Slightly larger than the bounds, so that the rounding of a quotient does not matter.
        first = max(0, math.floor((low + half) / (2 * half) * count - 1e-6))
        return range(first, min(count - 1, math.floor((high + half) / (2 * half) * count + 1e-6)) + 1)

    for item in reversed(range(len(shapes))):
        left, right, bottom, top = bounds(shapes[item])
        for j in touched(bottom, top, half_y):
            for i in touched(left, right, half_x):
                lists[j * count + i].append(item)
    starts = np.concatenate([[0], np.cumsum([len(items) for items in lists])]).astype(np.int64)
    return count, starts, np.array([item for items in lists for item in items], np.int64)
