"""Tags as shapes: a black square and the outlines of its white parts.

Cells of one colour are merged, so that no print or screen shows hairlines between them.
"""

import numpy as np

from pipeline.records.shapes import Num
from pipeline.targets.drawing import Polygon, rectangle

Corner = tuple[int, int]


def tag_shapes(bits: Num[np.ndarray, "n n"], left: float, bottom: float, edge: float, border: int) -> list[Polygon]:
    """The tag with `border` black cells around its bits, upright, lower left corner at (left, bottom) [mm]."""
    cells = len(bits) + 2 * border
    x = left + edge * np.arange(cells + 1) / cells
    y = bottom + edge * np.arange(cells + 1) / cells
    shapes = [Polygon(corners=rectangle(left, bottom, left + edge, bottom + edge))]
    # Outlines lie inside one another or apart: painted from the largest to the smallest, all are visible.
    for loop in sorted(outlines(bits[::-1]), key=lambda one: -abs(_area(one))):
        corners = tuple((float(x[i + border]), float(y[j + border])) for i, j in loop)
        shapes.append(Polygon(corners=corners, is_black=_area(loop) < 0))
    return shapes


def outlines(bits: Num[np.ndarray, "rows columns"]) -> list[list[Corner]]:
    """Borders of the cells that are 1, as loops of grid corners (column, row); the cells that are 1 lie to their
    left.

    Cells that touch only at a corner count as separate.
    """
    ways: dict[Corner, list[Corner]] = {}
    for j, i in zip(*np.nonzero(bits), strict=True):
        square = [(int(i), int(j)), (int(i) + 1, int(j)), (int(i) + 1, int(j) + 1), (int(i), int(j) + 1)]
        for start, end in zip(square, square[1:] + square[:1], strict=True):
            if start in ways.get(end, ()):
                ways[end].remove(start)  # an edge between two cells is no border
            else:
                ways.setdefault(start, []).append(end)
    return [_loop(ways, start) for start in sorted(ways) for _ in range(2) if ways[start]]


def _loop(ways: dict[Corner, list[Corner]], start: Corner) -> list[Corner]:
    here, came = start, (0, 0)
    loop: list[Corner] = []
    while not loop or here != start:
        # Where two loops touch, the turn to the left stays with the cell.
        ends = ways[here]
        end = max(ends, key=lambda e: came[0] * (e[1] - here[1]) - came[1] * (e[0] - here[0]))
        ends.remove(end)
        way = end[0] - here[0], end[1] - here[1]
        if way != came:
            loop.append(here)
        here, came = end, way
    return loop


def _area(loop: list[Corner]) -> float:
    """Area inside of a loop [cells], negative for one that runs clockwise (the shoelace formula)."""
    return sum(x * v - u * y for (x, y), (u, v) in zip(loop, loop[1:] + loop[:1], strict=True)) / 2
