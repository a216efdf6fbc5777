"""Boards with OpenCV's tags: a black square each, and the outlines of its white parts.

Cells of one colour are merged, so that no print or screen shows hairlines between them.
"""

import functools
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from pipeline.records.shapes import Num
from pipeline.targets.drawing import Checks, Drawing, Polygon, Shape, rectangle
from pipeline.targets.patterns.pattern import Marks, Pattern, TargetError, drawn_once, grid

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

    official = next(attribute for attribute in dir(cv2.aruco) if attribute.lower() == f"dict_{name}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, official))


def size_of(name: str) -> tuple[int, int]:
    """Number of tags of a dictionary, and of bits along an edge."""
    if name not in DICTIONARIES:
        raise TargetError(f'no dictionary "{name}"', hint="one of: " + ", ".join(DICTIONARIES))
    dictionary = _dictionary(name)
    return len(dictionary.bytesList), dictionary.markerSize


def require_tags(name: str, first: int, count: int) -> None:
    """Raise a TargetError for more tags than a dictionary has."""
    available, _ = size_of(name)
    if first < 0 or first + count > available:
        raise TargetError(
            f"the target needs tags {first} to {first + count - 1}, and {name} ends at {available - 1}",
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
    """Borders of the cells that are 1, as loops of grid corners (column, row), with these cells on their left.

    Cells that touch only at a corner count as separate.
    """
    # Collect the edges of all cells, anticlockwise around each, by their starts.
    edges: dict[Corner, list[Corner]] = {}
    for j, i in zip(*np.nonzero(bits), strict=True):
        square = [(int(i), int(j)), (int(i) + 1, int(j)), (int(i) + 1, int(j) + 1), (int(i), int(j) + 1)]
        for start, end in zip(square, square[1:] + square[:1], strict=True):
            if start in edges.get(end, ()):
                edges[end].remove(start)  # an edge between two cells is no border
            else:
                edges.setdefault(start, []).append(end)
    # Two borders at most begin at a corner, where cells touch.
    return [_loop(edges, start) for start in sorted(edges) for _ in range(2) if edges[start]]


def _loop(edges: dict[Corner, list[Corner]], start: Corner) -> list[Corner]:
    """Remove a loop from the edges, from a corner back to it; returns the corners at which it turns."""
    corner = start
    last_step = 0, 0
    loop: list[Corner] = []
    while not loop or corner != start:
        # Where two loops touch, the turn to the left stays with the cell.
        ends = edges[corner]
        end = max(ends, key=lambda e: last_step[0] * (e[1] - corner[1]) - last_step[1] * (e[0] - corner[0]))
        ends.remove(end)
        step = end[0] - corner[0], end[1] - corner[1]
        if step != last_step:
            loop.append(corner)
        corner, last_step = end, step
    return loop


def _area(loop: list[Corner]) -> float:
    """Area inside of a loop [cells], negative for one that runs clockwise (the shoelace formula)."""
    return sum(x * v - u * y for (x, y), (u, v) in zip(loop, loop[1:] + loop[:1], strict=True)) / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Charuco(Pattern):
    """A checkerboard with a tag in every white square, as OpenCV's CharucoBoard draws it.

    The top-left square is black, except in a legacy pattern with an even number of rows of squares, as boards were
    before OpenCV 4.6. A white margin one square wide runs around the squares.
    """

    KIND: ClassVar[str] = "charuco"
    ORDER: ClassVar[str] = (
        "inner corners as of a checkerboard: id = row * columns + column, row 0 at the top, column 0 at the left, as"
        " OpenCV's CharucoBoard; then, if asked for, four corners per tag, clockwise from its top left"
    )

    # inner corners: one less than the squares by which OpenCV counts
    columns: Annotated[int, "plen:columns"]
    rows: Annotated[int, "plen:rows"]
    square_mm: Annotated[float, "plen:squareSize"]
    marker_mm: Annotated[float, "plen:markerSize"]  # edge of a tag
    dictionary: Annotated[str, "plen:dictionary"] = "4x4_50"
    # number of the tag in the first white square; numbers ascend along rows, from the top
    first_tag: Annotated[int, "plen:firstTag"] = 0
    marker_corners: Annotated[bool, "plen:markerCorners"] = False  # their corners are target points, too
    legacy_pattern: Annotated[bool, "plen:legacyPattern"] = False  # OpenCV's setLegacyPattern(True)

    def __post_init__(self) -> None:
        if not self.square_mm > self.marker_mm:
            raise TargetError(
                f"a ChArUco board of {self.rows} x {self.columns} corners with tags of {self.marker_mm} mm"
                f" in squares of {self.square_mm} mm",
                hint="tags are smaller than squares",
            )
        require_tags(self.dictionary, self.first_tag, self.tags)

    @property
    def tags(self) -> int:
        return (self.columns + 1) * (self.rows + 1) // 2

    @property
    def _begins_white(self) -> bool:
        return self.legacy_pattern and self.rows % 2 == 1

    def _centres(self, *, white: bool) -> np.ndarray:
        """Middles of the squares of one colour, rows from the top, each from the left."""
        squares = grid(self.columns + 1, self.rows + 1, self.square_mm)
        column, row = np.meshgrid(np.arange(self.columns + 1), np.arange(self.rows + 1))
        return squares[((column + row + self._begins_white) % 2 == white).ravel()]

    @property
    @drawn_once
    def drawing(self) -> Drawing:
        """Squares, and tags on the white ones."""
        half = (self.columns + 3) * self.square_mm / 2, (self.rows + 3) * self.square_mm / 2
        squares: list[Shape] = [Checks(columns=self.columns, rows=self.rows, square=self.square_mm)]
        if self._begins_white:
            black = self._centres(white=False)
            sides = np.concatenate([black - self.square_mm / 2, black + self.square_mm / 2], axis=1)
            squares = [Polygon(corners=rectangle(*four)) for four in sides.tolist()]
        tags = [
            shape
            for i, (x, y) in enumerate(self._centres(white=True) - self.marker_mm / 2)
            for shape in tag_shapes(bits_of(self.dictionary, self.first_tag + i), x, y, self.marker_mm, 1)
        ]
        return Drawing(*half, (*squares, *tags))

    def marks(self) -> Marks:
        """Inner corners, then those of the tags."""
        corners = ("corner", grid(self.columns, self.rows, self.square_mm))
        if not self.marker_corners:
            return Marks.of(corners)
        from_centre = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * self.marker_mm / 2
        of_tags = self._centres(white=True)[:, None] + from_centre
        return Marks.of(corners, ("marker-corner", of_tags.reshape(-1, 2)))

    def for_face(self, number: int) -> "Charuco":
        return replace(self, first_tag=self.first_tag + number * self.tags)

    def title(self) -> str:
        return (
            f"ChArUco {self.dictionary}, {self.columns + 1} x {self.rows + 1} squares of {self.square_mm:g} mm, tags"
            f" {self.first_tag} to {self.first_tag + self.tags - 1} of {self.marker_mm:g} mm,"
            f" corners 0 to {self.columns * self.rows - 1} from the top left"
            f"{', legacy pattern' if self.legacy_pattern else ''}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class AprilGrid(Pattern):
    """A grid of AprilTags with black squares between their corners, and a white margin twice as wide as the gaps.

    Source of layout, orientation of the tags and order: ethz-asl/kalibr, GridCalibrationTargetAprilgrid.cpp and
    kalibr_create_target_pdf.
    """

    KIND: ClassVar[str] = "aprilgrid"
    ORDER: ClassVar[str] = (
        "corners of all tags as one grid: id = row * 2 columns + column, row 0 at the bottom, column 0 at the left, as"
        " Kalibr; tags are counted alike"
    )

    columns: Annotated[int, "plen:columns"]
    rows: Annotated[int, "plen:rows"]
    tag_mm: Annotated[float, "plen:tagSize"]  # edge of a tag, black border included
    spacing: Annotated[float, "plen:tagSpacing"] = 0.3  # gap between tags over `tag_mm`: Kalibr's tagSpacing
    dictionary: Annotated[str, "plen:dictionary"] = "apriltag_36h11"
    # width of a tag's black border in its cells: 2 in Kalibr, 1 elsewhere
    border_bits: Annotated[int, "plen:borderBits"] = 2
    first_tag: Annotated[int, "plen:firstTag"] = 0  # number of the tag at the bottom left

    def __post_init__(self) -> None:
        require_tags(self.dictionary, self.first_tag, self.columns * self.rows)

    @property
    def _gap_mm(self) -> float:
        return self.spacing * self.tag_mm

    def _corners(self, count: int) -> np.ndarray:
        """Left ends (or bottoms) of tags, each followed by its right end (or top), relative to the centre."""
        start = np.arange(count) * (self.tag_mm + self._gap_mm)
        ends = np.stack([start, start + self.tag_mm], axis=1).ravel()
        return ends - ends[-1] / 2

    @property
    @drawn_once
    def drawing(self) -> Drawing:
        """Tags, and squares at the corners of the gaps."""
        x, y = self._corners(self.columns), self._corners(self.rows)
        gap = self._gap_mm
        squares = [
            Polygon(corners=rectangle(left, bottom, left + gap, bottom + gap))
            for bottom in (y[0] - gap, *y[1::2])
            for left in (x[0] - gap, *x[1::2])
        ]
        tags = [
            shape
            for row, bottom in enumerate(y[::2])
            for column, left in enumerate(x[::2])
            # OpenCV stores tags upside down relative to Kalibr and the AprilTag library.
            for bits in [np.rot90(bits_of(self.dictionary, self.first_tag + row * self.columns + column), 2)]
            for shape in tag_shapes(bits, float(left), float(bottom), self.tag_mm, self.border_bits)
        ]
        return Drawing(float(x[-1]) + 3 * gap, float(y[-1]) + 3 * gap, (*squares, *tags))

    def marks(self) -> Marks:
        x, y = np.meshgrid(self._corners(self.columns), self._corners(self.rows))
        return Marks.of(("corner", np.stack([x.ravel(), y.ravel()], axis=1)))

    def for_face(self, number: int) -> "AprilGrid":
        return replace(self, first_tag=self.first_tag + number * self.columns * self.rows)

    def title(self) -> str:
        return (
            f"AprilGrid {self.dictionary}, {self.columns} x {self.rows} tags of {self.tag_mm:g} mm,"
            f" {self.first_tag} to {self.first_tag + self.columns * self.rows - 1} from the bottom left,"
            f" spacing {self.spacing:g}, border {self.border_bits} cells"
        )
