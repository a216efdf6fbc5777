"""Stars: grids of them for calibration, and a single Siemens star for resolution."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from pipeline.targets.drawing import Drawing, Spokes
from pipeline.targets.patterns.pattern import Marks, Pattern, TargetError, grid


@dataclass(frozen=True, slots=True, kw_only=True)
class Stars(Pattern):
    """A grid of stars whose centres are the target points, on a sheet with a margin of one spacing."""

    KIND: ClassVar[str] = "stars"
    ORDER: ClassVar[str] = "id = row * columns + column, row 0 at the top, column 0 at the left as the viewer sees it"

    columns: Annotated[int, "plen:columns"]
    rows: Annotated[int, "plen:rows"]
    spacing_mm: Annotated[float, "plen:spacing"]  # distance of neighbouring centres
    diameter_mm: Annotated[float, "plen:diameter"]
    spokes: Annotated[int, "plen:spokes"] = 8  # black sectors of a star

    def __post_init__(self) -> None:
        if not self.diameter_mm <= self.spacing_mm:
            raise TargetError(
                f"{self.rows} x {self.columns} stars of {self.spokes} spokes and {self.diameter_mm} mm,"
                f" {self.spacing_mm} mm apart",
                hint="stars must not overlap",
            )

    def marks(self) -> Marks:
        return Marks.of(("centre", grid(self.columns, self.rows, self.spacing_mm)))

    @property
    def drawing(self) -> Drawing:
        """A star at every mark; its first spoke is centred on +x."""
        marks = self.marks().xy_mm
        phase = -np.pi / self.spokes / 2
        half_x, half_y = np.abs(marks).max(axis=0) + self.spacing_mm
        stars = [
            Spokes(x=x, y=y, inner=0.0, outer=self.diameter_mm / 2, count=self.spokes, phase=phase) for x, y in marks
        ]
        return Drawing(float(half_x), float(half_y), stars)

    def title(self) -> str:
        return (
            f"{self.columns} x {self.rows} stars of {self.spokes} spokes and {self.diameter_mm:g} mm, spacing"
            f" {self.spacing_mm:g} mm, ids 0 to {self.columns * self.rows - 1} from the top left"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SiemensStar(Pattern):
    """One star with many spokes around a white hub: the spatial frequency rises towards the centre."""

    KIND: ClassVar[str] = "siemens-star"
    ORDER: ClassVar[str] = (
        "0 the centre; 1 + n the end of edge n on the rim, at n * 180 / spokes degrees from +x towards +y"
    )

    spokes: Annotated[int, "plen:spokes"]  # black sectors: cycles around the star
    diameter_mm: Annotated[float, "plen:diameter"]
    hub_mm: Annotated[float, "plen:hubDiameter"] = 0.0

    def __post_init__(self) -> None:
        if not self.hub_mm < self.diameter_mm:
            raise TargetError(
                f"a Siemens star of {self.spokes} spokes from {self.hub_mm} to {self.diameter_mm} mm",
                hint="the hub is smaller than the star",
            )

    def marks(self) -> Marks:
        angle = np.arange(2 * self.spokes) * np.pi / self.spokes
        rim = self.diameter_mm / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return Marks.of(("centre", np.zeros((1, 2))), ("rim", rim))

    @property
    def drawing(self) -> Drawing:
        """The star on a square with a margin of a tenth of its diameter."""
        half = 0.6 * self.diameter_mm
        star = Spokes(x=0.0, y=0.0, inner=self.hub_mm / 2, outer=self.diameter_mm / 2, count=self.spokes)
        return Drawing(half, half, (star,))

    def title(self) -> str:
        return f"Siemens star, {self.spokes} cycles, diameter {self.diameter_mm:g} mm, hub {self.hub_mm:g} mm"
