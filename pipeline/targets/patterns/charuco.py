"""A ChArUco board: a checkerboard with a tag in every white square, as OpenCV's CharucoBoard draws it."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pipeline.targets.drawing import Checks, Drawing
from pipeline.targets.patterns.pattern import Marks, Pattern, TargetError, drawn_once, grid
from pipeline.targets.patterns.tags import bits_of, require_tags, tag_shapes


@dataclass(frozen=True, slots=True, kw_only=True)
class Charuco(Pattern):
    """A ChArUco board; the top-left square is black, a white margin one square wide runs around the squares."""

    KIND: ClassVar[str] = "charuco"
    ATTRIBUTES: ClassVar[dict[str, str]] = {
        "columns": "plen:columns",
        "rows": "plen:rows",
        "dictionary": "plen:dictionary",
        "first_tag": "plen:firstTag",
        "square_mm": "plen:squareSize",
        "marker_mm": "plen:markerSize",
        "marker_corners": "plen:markerCorners",
    }
    ORDER: ClassVar[str] = (
        "inner corners as of a checkerboard: id = row * columns + column, row 0 at the top, column 0 at the left, as"
        " OpenCV's CharucoBoard; then, if asked for, four corners per tag, clockwise from its top left"
    )

    # inner corners: one less than the squares by which OpenCV counts
    columns: int
    rows: int
    square_mm: float
    marker_mm: float  # edge of a tag
    dictionary: str = "4x4_50"
    # number of the tag in the first white square; the others follow, rows from the top, each from the left
    first_tag: int = 0
    marker_corners: bool = False  # whether the corners of the tags are target points, too

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

    def _tag_centres(self) -> np.ndarray:
        squares = grid(self.columns + 1, self.rows + 1, self.square_mm)
        column, row = np.meshgrid(np.arange(self.columns + 1), np.arange(self.rows + 1))
        return squares[((column + row) % 2 == 1).ravel()]

    @property
    @drawn_once
    def drawing(self) -> Drawing:
        """Squares, and tags on the white ones."""
        half = (self.columns + 3) * self.square_mm / 2, (self.rows + 3) * self.square_mm / 2
        checks = Checks(columns=self.columns, rows=self.rows, square=self.square_mm)
        tags = [
            shape
            for i, (x, y) in enumerate(self._tag_centres() - self.marker_mm / 2)
            for shape in tag_shapes(bits_of(self.dictionary, self.first_tag + i), x, y, self.marker_mm, 1)
        ]
        return Drawing(*half, (checks, *tags))

    def marks(self) -> Marks:
        """Inner corners, then those of the tags."""
        corners = ("corner", grid(self.columns, self.rows, self.square_mm))
        if not self.marker_corners:
            return Marks.of(corners)
        around = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * self.marker_mm / 2
        return Marks.of(corners, ("marker-corner", (self._tag_centres()[:, None] + around).reshape(-1, 2)))

    def for_face(self, number: int) -> "Charuco":
        return replace(self, first_tag=self.first_tag + number * self.tags)

    def title(self) -> str:
        return (
            f"ChArUco {self.dictionary}, {self.columns + 1} x {self.rows + 1} squares of {self.square_mm:g} mm, tags"
            f" {self.first_tag} to {self.first_tag + self.tags - 1} of {self.marker_mm:g} mm,"
            f" corners 0 to {self.columns * self.rows - 1} from the top left"
        )
