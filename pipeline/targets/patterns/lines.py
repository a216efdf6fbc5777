"""Straight edges and lines."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from pipeline.targets.drawing import Drawing, Polygon, rectangle
from pipeline.targets.patterns.pattern import Marks, Pattern, TargetError, grid


@dataclass(frozen=True, slots=True, kw_only=True)
class SlantedEdge(Pattern):
    """A sheet, white to the left of an edge through its centre and black to the right of it, for ISO 12233."""

    KIND: ClassVar[str] = "slanted-edge"
    ORDER: ClassVar[str] = "0 the centre of the edge, 1 its upper end, 2 its lower end"

    width_mm: Annotated[float, "plen:width"]
    height_mm: Annotated[float, "plen:height"]
    angle_deg: Annotated[float, "plen:angle"] = 5.0  # of the edge from the vertical, clockwise as the viewer sees it

    def __post_init__(self) -> None:
        # The schema bounds the angle to 45 degrees: the tangent is finite.
        if abs(self.height_mm * math.tan(math.radians(self.angle_deg))) >= self.width_mm:
            raise TargetError(
                f"an edge at {self.angle_deg} degrees on a sheet of {self.width_mm} x {self.height_mm} mm",
                hint="the edge must run from the upper to the lower side of the sheet, within 45 degrees",
            )

    def marks(self) -> Marks:
        x = self.height_mm / 2 * math.tan(math.radians(self.angle_deg))
        ends = np.array([[x, self.height_mm / 2], [-x, -self.height_mm / 2]])
        return Marks.of(("centre", np.zeros((1, 2))), ("end", ends))

    @property
    def drawing(self) -> Drawing:
        """One polygon to the right of the edge."""
        _, (top, y), (bottom, _) = self.marks().xy_mm
        right = self.width_mm / 2
        corners = ((float(bottom), -float(y)), (right, -float(y)), (right, float(y)), (float(top), float(y)))
        return Drawing(right, self.height_mm / 2, (Polygon(corners=corners),))

    def title(self) -> str:
        return f"slanted edge, {self.angle_deg:g} degrees from the vertical, {self.width_mm:g} x {self.height_mm:g} mm"


@dataclass(frozen=True, slots=True, kw_only=True)
class Lines(Pattern):
    """Black lines, vertical, horizontal or both.

    Each extends half a spacing beyond the outermost lines of the other direction.
    """

    KIND: ClassVar[str] = "lines"
    ORDER: ClassVar[str] = (
        "crossings of the centres of lines: id = row * columns + column, row 0 at the top, column 0 at the left; of"
        " lines of one direction their ends: 2 n the upper or left end of line n, 2 n + 1 the other one"
    )

    # vertical and horizontal lines; one of them may be 0. Lines of one direction alone are as long as the distance
    # between the outermost ones
    columns: Annotated[int, "plen:columns"]
    rows: Annotated[int, "plen:rows"]
    spacing_mm: Annotated[float, "plen:spacing"]  # distance of the centres of neighbouring lines
    width_mm: Annotated[float, "plen:lineWidth"]

    def __post_init__(self) -> None:
        if not (self.columns or self.rows):
            raise TargetError(f"{self.columns} upright and {self.rows} level lines")
        if not self.width_mm < self.spacing_mm:
            raise TargetError(
                f"lines of {self.width_mm} mm, {self.spacing_mm} mm apart", hint="lines must not touch one another"
            )

    @property
    def _half_mm(self) -> tuple[float, float]:
        """Half the length of the horizontal and of the vertical lines."""
        across, down = self.columns or self.rows, self.rows or self.columns
        return across * self.spacing_mm / 2, down * self.spacing_mm / 2

    def marks(self) -> Marks:
        half_x, half_y = self._half_mm
        if self.columns and self.rows:
            return Marks.of(("crossing", grid(self.columns, self.rows, self.spacing_mm)))
        lines = grid(self.columns or 1, self.rows or 1, self.spacing_mm)
        to_first_end = np.array([[0.0, half_y]]) if self.columns else np.array([[-half_x, 0.0]])
        ends = np.stack([lines + to_first_end, lines - to_first_end], axis=1)
        return Marks.of(("end", ends.reshape(-1, 2)))

    @property
    def drawing(self) -> Drawing:
        """A rectangle per line, on a sheet with a margin of half a spacing."""
        half_x, half_y = self._half_mm
        half = self.width_mm / 2
        vertical_x = grid(self.columns, 1, self.spacing_mm)[:, 0].tolist()
        horizontal_y = grid(1, self.rows, self.spacing_mm)[:, 1].tolist()
        shapes = [Polygon(corners=rectangle(x - half, -half_y, x + half, half_y)) for x in vertical_x]
        shapes += [Polygon(corners=rectangle(-half_x, y - half, half_x, y + half)) for y in horizontal_y]
        return Drawing(half_x + self.spacing_mm / 2, half_y + self.spacing_mm / 2, shapes)

    def title(self) -> str:
        return (
            f"{self.columns} upright and {self.rows} level lines, width {self.width_mm:g} mm,"
            f" spacing {self.spacing_mm:g} mm"
        )
