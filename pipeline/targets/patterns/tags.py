"""Tags by number, from the dictionaries of OpenCV, as shapes: a black square and the outlines of its white parts.

Cells of one colour are merged, so that no print or screen shows hairlines between them.
"""

import functools

import numpy as np

from pipeline.records.shapes import Num
from pipeline.targets.drawing import Polygon, rectangle
from pipeline.targets.patterns.pattern import TargetError

Corner = tuple[int, int]
DICTIONARIES = (
    *(f"{n}x{n}_{count}" for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    "aruco_original",
    "aruco_mip_36h12",
    "apriltag_16h5",
    "apriltag_25h9",
    "apriltag_36h10",
    "apriltag_36h11",
)
"""Names as in stages; OpenCV calls them DICT_4X4_50, DICT_APRILTAG_36h11 and so on."""


@functools.cache
def _dictionary(name: str):  # type: ignore[no-untyped-def]
    import cv2

    official = next(known for known in dir(cv2.aruco) if known.lower() == f"dict_{name}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, official))


def size_of(name: str) -> tuple[int, int]:
    """Number of tags of a dictionary, and of bits along an edge."""
    if name not in DICTIONARIES:
        raise TargetError(f'no dictionary "{name}"', hint="one of: " + ", ".join(DICTIONARIES))
    dictionary = _dictionary(name)
    return len(dictionary.bytesList), dictionary.markerSize


def require_tags(name: str, first: int, count: int) -> None:
    """Refuse more tags than a dictionary has."""
    known, _ = size_of(name)
    if first < 0 or first + count > known:
        raise TargetError(
            f"the target needs tags {first} to {first + count - 1}, and {name} ends at {known - 1}",
            hint="take a larger dictionary, or fewer tags",
            code="too-few-tags",
        )


@functools.cache
def bits_of(name: str, number: int) -> np.ndarray:
    """Bits of a tag without its border, (n, n) uint8, 1 is white; rows from the top, as OpenCV draws it upright."""
    import cv2

    dictionary = _dictionary(name)
    return cv2.aruco.Dictionary.getBitsFromByteList(dictionary.bytesList[number : number + 1], dictionary.markerSize)


def tag_shapes(bits: Num[np.ndarray, "n n"], left: float, bottom: float, edge: float, border: int) -> list[Polygon]:
    """The tag with `border` black cells around its bits, upright, lower left corner at (left, bottom) [mm]."""
    cells = len(bits) + 2 * border
    x = left + edge * np.arange(cells + 1) / cells
    y = bottom + edge * np.arange(cells + 1) / cells
    shapes = [Polygon(corners=rectangle(left, bottom, left + edge, bottom + edge))]
    # Outlines lie inside one another or apart: painted from the largest to the smallest, all are visible.
    for loop in sorted(outlines(bits[::-1]), key=lambda loop: -abs(_area(loop))):
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
