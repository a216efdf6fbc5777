"""A board of triangles, six around every inner corner: a deltille grid (Ha, Perdoch, Alismail, Kweon, Sheikh 2017)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.targets.drawing import Drawing, Polygon
from pipeline.targets.patterns.pattern import Marks, Pattern, drawn_once


@dataclass(frozen=True, slots=True, kw_only=True)
class Deltille(Pattern):
    """Black triangles that point up and white ones that point down, in rows shifted in turn by half an edge."""

    KIND: ClassVar[str] = "deltille"
    ATTRIBUTES: ClassVar[dict[str, str]] = {
        "columns": "plen:columns",
        "rows": "plen:rows",
        "edge_mm": "plen:edgeLength",
    }
    ORDER: ClassVar[str] = (
        "id = row * columns + column, row 0 at the top, column 0 at the left; even rows stand half an edge"
        " further right than odd ones"
    )

    # inner corners in a row, and rows of them
    columns: int
    rows: int
    edge_mm: float

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
        """Black triangles on a sheet with a margin of half an edge."""
        nodes, triangles = self._nodes(), []
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
