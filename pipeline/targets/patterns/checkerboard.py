"""Checkerboards, of squares and of triangles."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from pipeline.records.declared import settle
from pipeline.targets.drawing import Checks, Drawing, Polygon
from pipeline.targets.patterns.pattern import Marks, Pattern, TargetError, drawn_once, grid


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkerboard(Pattern):
    """A checkerboard. The top-left square is black, and a white margin one square wide runs around the squares.

    `columns`, `rows`: inner corners along x and y; their sum is odd, so that the orientation of the board is unique.
    """

    KIND: ClassVar[str] = "checkerboard"
    ORDER: ClassVar[str] = "id = row * columns + column, row 0 at the top, column 0 at the left as the viewer sees it"

    columns: Annotated[int, "plen:columns"]
    rows: Annotated[int, "plen:rows"]
    square_mm: Annotated[float, "plen:squareSize"]

    def __post_init__(self) -> None:
        settle(self, TargetError)
        if self.columns < 1 or self.rows < 1 or not self.square_mm > 0:
            raise TargetError(
                f"a checkerboard of {self.rows} x {self.columns} corners and squares of {self.square_mm} mm"
            )
        if (self.columns + self.rows) % 2 == 0:
            raise TargetError(
                f"{self.rows} x {self.columns} inner corners look the same upside down",
                hint="make the sum of rows and columns odd",
                code="ambiguous-board",
            )

    @property
    def drawing(self) -> Drawing:
        """Squares on a sheet with a margin of one square."""
        half = (self.columns + 3) * self.square_mm / 2, (self.rows + 3) * self.square_mm / 2
        return Drawing(*half, (Checks(columns=self.columns, rows=self.rows, square=self.square_mm),))

    def marks(self) -> Marks:
        return Marks.of(("corner", grid(self.columns, self.rows, self.square_mm)))

    def title(self) -> str:
        return (
            f"checkerboard, {self.columns} x {self.rows} inner corners, square {self.square_mm:g} mm,"
            f" ids 0 to {self.columns * self.rows - 1} from the top left"
        )

    def points_mm(self) -> np.ndarray:
        """Corners of the flat board in the order of their ids, target frame, (rows * columns, 3) [mm]."""
        return np.pad(self.marks().xy_mm, ((0, 0), (0, 1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Deltille(Pattern):
    """A deltille grid, six triangles around every inner corner (Ha, Perdoch, Alismail, Kweon and Sheikh, 2017).

    Black triangles point up and white ones down, in rows shifted alternately by half an edge.
    """

    KIND: ClassVar[str] = "deltille"
    ORDER: ClassVar[str] = (
        "id = row * columns + column, row 0 at the top, column 0 at the left; even rows stand half an edge"
        " further right than odd ones"
    )

    # inner corners in a row, and rows of them
    columns: Annotated[int, "plen:columns"]
    rows: Annotated[int, "plen:rows"]
    edge_mm: Annotated[float, "plen:edgeLength"]

    def _nodes(self) -> np.ndarray:
        """All corners of triangles, outer ones included, about the middle, (rows + 2, columns + 2, 2)."""
        row, column = np.meshgrid(np.arange(self.rows + 2), np.arange(self.columns + 2), indexing="ij")
        x = column + row % 2 / 2 - (self.columns + 1.5) / 2
        y = ((self.rows + 1) / 2 - row) * 3**0.5 / 2
        return np.stack([x, y], axis=-1) * self.edge_mm

    def marks(self) -> Marks:
        return Marks.of(("corner", self._nodes()[1:-1, 1:-1].reshape(-1, 2)))

    @property
    @drawn_once
    def drawing(self) -> Drawing:
        """Six triangles around every inner corner: black triangles on a sheet with a margin of half an edge."""
        nodes = self._nodes()
        triangles = []
        for row in range(self.rows + 1):
            for column in range(self.columns + 2):
                left = column - 1 + row % 2
                if left >= 0 and left + 1 <= self.columns + 1:
                    ends = nodes[row, column], nodes[row + 1, left], nodes[row + 1, left + 1]
                    triangles.append(Polygon(corners=tuple((float(x), float(y)) for x, y in ends)))
        half_x, half_y = np.abs(nodes).max(axis=(0, 1)) + self.edge_mm / 2
        return Drawing(float(half_x), float(half_y), triangles)

    def title(self) -> str:
        return (
            f"deltille board, {self.columns} x {self.rows} inner corners, edge {self.edge_mm:g} mm,"
            f" ids 0 to {self.columns * self.rows - 1} from the top left"
        )
