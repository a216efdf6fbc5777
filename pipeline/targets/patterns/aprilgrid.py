"""AprilGrids, as Kalibr prints and numbers them.

Source of layout, orientation of the tags and order: ethz-asl/kalibr, GridCalibrationTargetAprilgrid.cpp and
kalibr_create_target_pdf.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pipeline.targets.drawing import Drawing, Polygon, rectangle
from pipeline.targets.patterns.pattern import Marks, Pattern, drawn_once
from pipeline.targets.patterns.tags import bits_of, require_tags, tag_shapes


@dataclass(frozen=True, slots=True, kw_only=True)
class AprilGrid(Pattern):
    """A grid of AprilTags with black squares between their corners, and a white margin twice as wide as the gaps."""

    KIND: ClassVar[str] = "aprilgrid"
    ATTRIBUTES: ClassVar[dict[str, str]] = {
        "columns": "plen:columns",
        "rows": "plen:rows",
        "dictionary": "plen:dictionary",
        "first_tag": "plen:firstTag",
        "tag_mm": "plen:tagSize",
        "spacing": "plen:tagSpacing",
        "border_bits": "plen:borderBits",
    }
    ORDER: ClassVar[str] = (
        "corners of all tags as one grid: id = row * 2 columns + column, row 0 at the bottom, column 0 at the left, as"
        " Kalibr; tags are counted alike"
    )

    columns: int
    rows: int
    tag_mm: float  # edge of a tag, black border included
    spacing: float = 0.3  # gap between tags over `tag_mm`: Kalibr's tagSpacing
    dictionary: str = "apriltag_36h11"
    border_bits: int = 2  # width of a tag's black border in its cells: 2 in Kalibr, 1 elsewhere
    first_tag: int = 0  # number of the tag at the bottom left

    def __post_init__(self) -> None:
        require_tags(self.dictionary, self.first_tag, self.columns * self.rows)

    @property
    def _gap_mm(self) -> float:
        return self.spacing * self.tag_mm

    def _corners(self, count: int) -> np.ndarray:
        """Left ends (or bottoms) of tags, each followed by its right end (or top), relative to the centre."""
        start = np.arange(count) * (self.tag_mm + self._gap_mm)
        both = np.stack([start, start + self.tag_mm], axis=1).ravel()
        return both - both[-1] / 2

    @property
    @drawn_once
    def drawing(self) -> Drawing:
        """Tags, and squares at the corners of the gaps."""
        x, y, gap = self._corners(self.columns), self._corners(self.rows), self._gap_mm
        squares = [
            Polygon(corners=rectangle(left, bottom, left + gap, bottom + gap))
            for bottom in (y[0] - gap, *y[1::2])
            for left in (x[0] - gap, *x[1::2])
        ]
        tags = [
            shape
            for row, bottom in enumerate(y[::2])
            for column, left in enumerate(x[::2])
            # OpenCV stores upside down what Kalibr and the AprilTag library print upright.
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
