"""Drawings: the artwork of a target as shapes painted on a white sheet, exact and without a resolution.

A drawing is the only definition of the appearance of a pattern: kernels look up the colour of a point, and of a box of
one colour, and `pages/artwork` prints the shapes. It is in the chart: x right, y up, origin at the centre of the sheet
[mm]. In kernels `drawing` is a `DrawingArrays`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel
from pipeline.records.shapes import Float64

KINDS = ("Polygon", "Disc", "Spokes", "Checks")
"""Kinds of shapes, by their number in kernels."""
POLYGON, DISC, SPOKES, CHECKS = range(4)
"""Numbers of the kinds of shapes."""

NOT_PAINTED = -1.0
"""Value for a point outside of a shape; black is 0 and white is 1."""
COLOUR, LEFT, RIGHT, BOTTOM, TOP = range(5)
"""Columns of the numbers of a polygon: 0 for black or 1 for white, and its bounds."""
MIDDLE_X, MIDDLE_Y, RADIUS = 1, 2, 3
"""Columns of a disc after its colour; spokes have a centre, too."""
SPOKES_COUNT, INNER, OUTER, PHASE = 0, 3, 4, 5
"""Columns of spokes: their number, both radii, the direction of the first [rad]."""
COLUMNS, ROWS, SQUARE = range(3)
"""Columns of checks: inner corners along x and y, and the edge of a square."""
NUMBERS = 6
"""Number of columns for a shape; spokes need all."""
BESIDE, MIXED = -1.0, -2.0
"""Values for a box besides 0 (black) and 1 (white): off the sheet; of several colours, or possibly so."""
_MOST_BINS = 16
"""Most bins that a box may overlap before it counts as mixed: a look at more costs more than the rays that it saves."""


class DrawingArrays(NamedTuple):
    """A drawing for the kernels, from `drawing.Drawing.arrays`; chart, mm."""

    # half the width and half the height of the sheet
    half_x: float
    half_y: float
    kinds: np.ndarray  # (s,) int64, kinds of the shapes, numbers of `KINDS`
    numbers: np.ndarray  # (s, NUMBERS) float64, numbers of each shape, in columns that depend on its kind
    first: np.ndarray  # (s + 1,) int64, index of the first of the `corners`, (c, 2) float64, of each shape
    corners: np.ndarray
    bins: int  # bins of a grid over the sheet, along each axis
    # (bins^2 + 1,), (i,) int64, start of each bin's items; shapes that may be visible in each bin, the last one first
    starts: np.ndarray
    items: np.ndarray


@inline
def in_polygon(corners, first, end, x, y):
    """Even-odd rule: of two polygons with a common edge only one contains a point on it."""
    inside = False
    j = end - 1
    for i in range(first, end):
        xi, yi, xj, yj = corners[i, 0], corners[i, 1], corners[j, 0], corners[j, 1]
        if (yi > y) != (yj > y) and x < (xj - xi) * (y - yi) / (yj - yi) + xi:
            inside = not inside
        j = i
    return inside


@inline
def check_colour(columns, rows, square, x, y):
    """0 on the black squares of a checkerboard, 1 on its white ones, NOT_PAINTED beside it."""
    column = math.floor(x / square + 0.5 * (columns + 1))
    row = math.floor(0.5 * (rows + 1) - y / square)
    if 0 <= column <= columns and 0 <= row <= rows:
        return 0.0 if (int(column) + int(row)) % 2 == 0 else 1.0
    return NOT_PAINTED


@inline
def spoke_colour(count, inner, outer, phase, x, y):
    """0 on the black sectors of a ring about the origin, NOT_PAINTED elsewhere."""
    squared = x * x + y * y
    if squared > outer * outer or squared < inner * inner:
        return NOT_PAINTED
    turn = (math.atan2(y, x) - phase) * count / (2.0 * math.pi)
    return 0.0 if turn - math.floor(turn) < 0.5 else NOT_PAINTED


@inline
def painted(drawing, s, x, y):
    """Colour of a point by shape number s, NOT_PAINTED outside of it."""
    kind, numbers, first = drawing.kinds[s], drawing.numbers, drawing.first
    if kind == CHECKS:
        return check_colour(numbers[s, COLUMNS], numbers[s, ROWS], numbers[s, SQUARE], x, y)
    if kind == POLYGON:
        if x < numbers[s, LEFT] or x > numbers[s, RIGHT] or y < numbers[s, BOTTOM] or y > numbers[s, TOP]:
            return NOT_PAINTED
        return numbers[s, COLOUR] if in_polygon(drawing.corners, first[s], first[s + 1], x, y) else NOT_PAINTED
    dx, dy = x - numbers[s, MIDDLE_X], y - numbers[s, MIDDLE_Y]
    if kind == DISC:
        return numbers[s, COLOUR] if dx * dx + dy * dy <= numbers[s, RADIUS] * numbers[s, RADIUS] else NOT_PAINTED
    return spoke_colour(numbers[s, SPOKES_COUNT], numbers[s, INNER], numbers[s, OUTER], numbers[s, PHASE], dx, dy)


@inline
def _bin(x, half, bins):
    """Number of the bin of a coordinate, of those between -half and half."""
    return min(int((x + half) / (2.0 * half) * bins), bins - 1)


@inline
def whiteness(drawing, x, y):
    """1 on white, 0 on black, NaN beside the sheet: the last shape that contains the point decides."""
    half_x, half_y, bins, starts = drawing.half_x, drawing.half_y, drawing.bins, drawing.starts
    if not (abs(x) <= half_x and abs(y) <= half_y):
        return math.nan
    number = _bin(y, half_y, bins) * bins + _bin(x, half_x, bins) if bins > 1 else 0
    for item in range(starts[number], starts[number + 1]):
        colour = painted(drawing, drawing.items[item], x, y)
        if colour != NOT_PAINTED:
            return colour
    return 1.0


@kernel
def whiteness_at_points(drawing, x, y, value):
    """Write `whiteness` at many points, (n,) each, into `value`."""
    for i in range(x.size):
        value[i] = whiteness(drawing, x[i], y[i])


@inline
def only_checks(drawing):
    """Whether a drawing is one checkerboard, and its columns, rows and square."""
    if drawing.kinds.size == 1 and drawing.kinds[0] == CHECKS:
        return True, drawing.numbers[0, COLUMNS], drawing.numbers[0, ROWS], drawing.numbers[0, SQUARE]
    return False, 0.0, 0.0, 1.0


@inline
def colour_of_box(drawing, left, right, bottom, top):
    """1 if a box is entirely white, 0 if entirely black, else `BESIDE` or `MIXED`.

    A colour is always right; with many or round shapes, a box of one colour may be called mixed.
    """
    half_x, half_y, bins, starts = drawing.half_x, drawing.half_y, drawing.bins, drawing.starts
    if not (left <= right and bottom <= top):  # NaN
        return MIXED
    if right < -half_x or left > half_x or top < -half_y or bottom > half_y:
        return BESIDE
    if left < -half_x or right > half_x or bottom < -half_y or top > half_y:
        return MIXED
    # Look for an outline that passes through the box, among the shapes of the bins that it overlaps.
    i0, i1 = _bin(left, half_x, bins), _bin(right, half_x, bins)
    j0, j1 = _bin(bottom, half_y, bins), _bin(top, half_y, bins)
    if (i1 - i0 + 1) * (j1 - j0 + 1) > _MOST_BINS:
        return MIXED
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            number = j * bins + i
            for item in range(starts[number], starts[number + 1]):
                if _has_edge_in(drawing, drawing.items[item], left, right, bottom, top):
                    return MIXED
    # Without an outline the colour of any point of the box is that of all.
    x, y = 0.5 * (left + right), 0.5 * (bottom + top)
    return whiteness(drawing, x, y)


@inline
def _has_edge_in(drawing, s, left, right, bottom, top):
    """Whether the outline of shape number s may pass through a box."""
    kind, numbers, first, corners = drawing.kinds[s], drawing.numbers, drawing.first, drawing.corners
    if kind == CHECKS:
        return _checks_change(numbers[s, COLUMNS], numbers[s, ROWS], numbers[s, SQUARE], left, right, bottom, top)
    if kind == POLYGON:
        if right < numbers[s, LEFT] or left > numbers[s, RIGHT] or top < numbers[s, BOTTOM] or bottom > numbers[s, TOP]:
            return False
        j = first[s + 1] - 1
        for i in range(first[s], first[s + 1]):
            ax, ay, bx, by = corners[j, 0], corners[j, 1], corners[i, 0], corners[i, 1]
            if _may_cross(ax, ay, bx, by, left, right, bottom, top):
                return True
            j = i
        return False
    # A circle passes through a box if the nearest point of the box lies inside it and the farthest outside: compare
    # their squared distances from the centre with the outer and the inner radius.
    x, y = numbers[s, MIDDLE_X], numbers[s, MIDDLE_Y]
    near_x, near_y = max(left - x, x - right, 0.0), max(bottom - y, y - top, 0.0)
    far_x, far_y = max(right - x, x - left), max(top - y, y - bottom)
    near, far = near_x * near_x + near_y * near_y, far_x * far_x + far_y * far_y
    inner, outer = (numbers[s, RADIUS], numbers[s, RADIUS]) if kind == DISC else (numbers[s, INNER], numbers[s, OUTER])
    return near <= outer * outer and far >= inner * inner


@inline
def _checks_change(columns, rows, square, left, right, bottom, top):
    """Whether a box overlaps several squares of a checkerboard, or its rim."""
    i0, i1 = math.floor(left / square + 0.5 * (columns + 1)), math.floor(right / square + 0.5 * (columns + 1))
    j0, j1 = math.floor(0.5 * (rows + 1) - top / square), math.floor(0.5 * (rows + 1) - bottom / square)
    if i1 < 0 or i0 > columns or j1 < 0 or j0 > rows:
        return False
    return i0 != i1 or j0 != j1


@inline
def _may_cross(ax, ay, bx, by, left, right, bottom, top):
    """Whether a segment may meet a box: neither the box's sides nor the line through the segment separate them."""
    if max(ax, bx) < left or min(ax, bx) > right or max(ay, by) < bottom or min(ay, by) > top:
        return False
    # The distance of the box's middle from the line, times the length of the segment, against the same of its corner
    # that reaches farthest; with a margin for rounding.
    edge_x, edge_y = bx - ax, by - ay
    middle = edge_x * (0.5 * (bottom + top) - ay) - edge_y * (0.5 * (left + right) - ax)
    return abs(middle) <= 0.5 * (abs(edge_x) * (top - bottom) + abs(edge_y) * (right - left)) * (1.0 + 1e-12)


Points = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Polygon:
    """A simple polygon; points on its edge belong to one side of the edge only (even-odd rule)."""

    corners: Points
    is_black: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Disc:
    """A disc by its centre and radius."""

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
    """Alternating black and white squares about the centre of the sheet; the top-left one is black.

    `columns` and `rows` count inner corners, one less than squares.
    """

    columns: int
    rows: int
    square: float

    @property
    def squares(self) -> list[Points]:
        """Corners of the black squares, anticlockwise from the bottom left."""
        left = -self.square * (self.columns + 1) / 2
        top = self.square * (self.rows + 1) / 2
        a = self.square
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
        whiteness_at_points(self.arrays, np.ascontiguousarray(x_mm), np.ascontiguousarray(y_mm), value)
        return value

    @cached_property
    def arrays(self) -> DrawingArrays:
        """The drawing for the kernels."""
        kinds = np.array([KINDS.index(type(shape).__name__) for shape in self.shapes], np.int64)
        numbers = np.array([_numbers(shape) for shape in self.shapes], float).reshape(-1, NUMBERS)
        outlines = [shape.corners if isinstance(shape, Polygon) else () for shape in self.shapes]
        first = np.cumsum([0, *map(len, outlines)])
        corners = np.array([corner for outline in outlines for corner in outline], float).reshape(-1, 2)
        sheet = float(self.half_x_mm), float(self.half_y_mm)
        bins, starts, items = _bins(*sheet, self.shapes)
        return DrawingArrays(*sheet, kinds, numbers, first, corners, bins, starts, items)


def _numbers(shape: Shape) -> tuple[float, ...]:
    """Numbers of a shape, in the columns named above."""
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
    """Shapes that may be visible in each bin of a grid over the sheet: `bins`, `starts`, `items` of `DrawingArrays`."""
    count = math.ceil(2 * math.sqrt(len(shapes))) if len(shapes) > 3 else 1
    lists: list[list[int]] = [[] for _ in range(count * count)]

    def touched(low: float, high: float, half: float) -> range:
        """Bins along an axis that a range overlaps, or nearly: the rounding of a quotient does not matter then."""
        first = max(0, math.floor((low + half) / (2 * half) * count - 1e-6))
        return range(first, min(count - 1, math.floor((high + half) / (2 * half) * count + 1e-6)) + 1)

    # The last shape is painted over the others, so it comes first.
    for item in reversed(range(len(shapes))):
        left, right, bottom, top = bounds(shapes[item])
        for j in touched(bottom, top, half_y):
            for i in touched(left, right, half_x):
                lists[j * count + i].append(item)
    starts = np.concatenate([[0], np.cumsum([len(items) for items in lists])]).astype(np.int64)
    return count, starts, np.array([item for items in lists for item in items], np.int64)
