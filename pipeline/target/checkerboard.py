"""A checkerboard: its corners with ids, its extent and its black and white."""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import PipelineError
from pipeline.target.kernels import checkerboard_points


class TargetError(PipelineError):
    """A target that cannot be a calibration pattern."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkerboard:
    """A flat checkerboard. Target frame: origin at the pattern centre, x right, y up, z towards the viewer.

    The top-left square is black, and a white margin one square wide runs around the squares.

    Attributes
    ----------
    columns, rows : int
        Inner corners along x and y; their sum is odd, so that the board has one orientation.
    square_mm : float
        Edge of one square.
    white, black : float
        Radiance of the two colours, relative.
    """

    columns: int
    rows: int
    square_mm: float
    white: float = 1.0
    black: float = 0.0

    def __post_init__(self) -> None:
        if self.columns < 1 or self.rows < 1 or not self.square_mm > 0:
            raise TargetError(
                f"a checkerboard of {self.rows} x {self.columns} corners and squares of {self.square_mm} mm"
            )
        if (self.columns + self.rows) % 2 == 0:
            raise TargetError(
                f"{self.rows} x {self.columns} corners look the same upside down",
                hint="make the sum of rows and columns odd",
            )

    @property
    def half_extent_mm(self) -> tuple[float, float]:
        """Half width and half height with the white margin [mm]."""
        return (self.columns + 3) * self.square_mm / 2, (self.rows + 3) * self.square_mm / 2

    def points_mm(self) -> np.ndarray:
        """Corners in the order of their ids, id = row * columns + column, row 0 at the top.

        Returns
        -------
        (rows * columns, 3) float64
            Target frame [mm].
        """
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        x = (column - (self.columns - 1) / 2) * self.square_mm
        y = ((self.rows - 1) / 2 - row) * self.square_mm
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    def radiance(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Radiance at points of the board's plane, target frame, (n,); NaN outside the white margin."""
        value = np.empty(len(x_mm))
        checkerboard_points(*self.artwork, x_mm, y_mm, value)
        return value

    @property
    def artwork(self) -> tuple[int, int, float, float, float]:
        """Leading arguments of the kernels in `target.kernels`."""
        return self.columns, self.rows, self.square_mm, self.white, self.black
