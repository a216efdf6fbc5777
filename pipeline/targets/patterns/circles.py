"""Grids of discs, symmetric and asymmetric, as OpenCV's findCirclesGrid counts them."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from pipeline.targets.drawing import Disc, Drawing
from pipeline.targets.patterns.pattern import Marks, Pattern, TargetError, drawn_once, grid


@dataclass(frozen=True, slots=True, kw_only=True)
class CircleGrid(Pattern):
    """Black discs whose centres are the target points."""

    KIND: ClassVar[str] = "circle-grid"
    ORDER: ClassVar[str] = "id = row * columns + column, row 0 at the top, column 0 at the left as the viewer sees it"

    columns: Annotated[int, "plen:columns"]
    rows: Annotated[int, "plen:rows"]
    # distance of neighbouring rows. In a symmetric grid it is also the distance of neighbouring discs of a row; in an
    # asymmetric one it is half that distance, and every other row is shifted by it
    spacing_mm: Annotated[float, "plen:spacing"]
    diameter_mm: Annotated[float, "plen:diameter"]
    asymmetric: Annotated[bool, "plen:asymmetric"] = False

    def __post_init__(self) -> None:
        nearest = self.spacing_mm * (2**0.5 if self.asymmetric else 1)
        if not self.diameter_mm < nearest:
            raise TargetError(
                f"a grid of {self.rows} x {self.columns} discs of {self.diameter_mm} mm, {nearest:.6g} mm apart",
                hint="discs must not touch",
            )
        if self.asymmetric and self.rows % 2 == 0:
            raise TargetError(
                f"an asymmetric grid of {self.rows} rows looks the same upside down",
                hint="make the number of rows odd",
                code="ambiguous-board",
            )

    def marks(self) -> Marks:
        """Centres, each with the radius of its disc."""
        centres = grid(self.columns, self.rows, self.spacing_mm)
        if self.asymmetric:
            row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
            centres[:, 0] = (2 * column + row % 2 - (2 * self.columns - 1) / 2) * self.spacing_mm
        return Marks.of(("disc", centres), radius_mm=self.diameter_mm / 2)

    @property
    @drawn_once
    def drawing(self) -> Drawing:
        """Discs on a sheet with a margin of one spacing plus a radius around the outermost centres."""
        marks = self.marks().xy_mm
        radius = self.diameter_mm / 2
        half_x, half_y = np.abs(marks).max(axis=0) + self.spacing_mm + radius
        return Drawing(float(half_x), float(half_y), [Disc(x=x, y=y, radius=radius) for x, y in marks])

    def title(self) -> str:
        kind = "asymmetric" if self.asymmetric else "symmetric"
        return (
            f"{kind} circle grid, {self.columns} x {self.rows} discs of {self.diameter_mm:g} mm, spacing"
            f" {self.spacing_mm:g} mm, ids 0 to {self.columns * self.rows - 1} from the top left"
        )
