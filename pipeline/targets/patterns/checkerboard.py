"""Checkerboards: corners with ids, extent, and artwork."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.records.declared import settle
from pipeline.targets.drawing import Checks, Drawing
from pipeline.targets.patterns.pattern import Marks, Pattern, TargetError, grid


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkerboard(Pattern):
    """A checkerboard. The top-left square is black, and a white margin one square wide runs around the squares.

    `columns`, `rows`: inner corners along x and y; their sum is odd, so that the board has one orientation.
    """

    KIND: ClassVar[str] = "checkerboard"
    ATTRIBUTES: ClassVar[dict[str, str]] = {
        "columns": "plen:columns",
        "rows": "plen:rows",
        "square_mm": "plen:squareSize",
    }
    ORDER: ClassVar[str] = "id = row * columns + column, row 0 at the top, column 0 at the left as the viewer sees it"

    columns: int
    rows: int
    square_mm: float

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
