"""Position images of a camera in the form that the ground truth reads."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.micro_images.centres import Nearby
from pipeline.records.shapes import Float64, Int64, Num


class AnyRayGrid:
    """The bundles of a camera, in memory or in a file that is read by windows; fields as in `RayGrid`.

    Cells are those of the centres of micro-images; see the protocol `truth.rows.ImageCells`.
    """

    __slots__ = ()
    supersampling: int
    microlenses: Int64[np.ndarray, "m 3"]
    centres_px: Float64[np.ndarray, "m 2"] | None

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the image."""
        raise NotImplementedError

    def window(self, rows: slice, columns: slice) -> "RayGrid":
        """The bundles of some rows and columns of the image, with all micro-images."""
        raise NotImplementedError

    @property
    def axial(self) -> np.ndarray:
        """k and l of every cell, (m, 2)."""
        return self.microlenses[:, :2]

    def in_image(self, x_px: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Whether positions lie in the image."""
        size = np.array(self.size_px)
        return np.all(np.abs(x_px - (size - 1) / 2) <= size / 2, axis=1)

    def in_cell(self, x_px: Float64[np.ndarray, "n 2"], cell: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Whether positions lie in their own cell."""
        if self.centres_px is None:
            return np.ones(len(cell), bool)
        return Nearby(self.centres_px).nearest(x_px)[1][:, 0] == cell


@dataclass(frozen=True, slots=True)
class RayGrid(AnyRayGrid):
    """Bundles of a camera, as the task `rays` stores them, on a grid K times finer than the image."""

    supersampling: int
    # vision z of the two planes
    near_mm: float
    far_mm: float
    # J_near and J_far: mean crossings, vision frame [mm]
    near: Float64[np.ndarray, "rows columns 2"]
    far: Float64[np.ndarray, "rows columns 2"]
    # upper triangle of the covariance of (x_near, y_near, x_far, y_far) at K = 1, of rays that start at one point
    # [mm^2]
    covariance: Float64[np.ndarray, "h w 10"]
    hit_fraction: Float64[np.ndarray, "rows columns"]
    # standard error of J from the ray sampling, on the worse of the two planes
    error_px: Float64[np.ndarray, "rows columns 2"]
    # index of the microlens in `microlenses`; 0 everywhere for a conventional camera
    cell: Int64[np.ndarray, "rows columns"]
    microlenses: Int64[np.ndarray, "m 3"]  # k, l and type; one row of zeros for a conventional camera
    centres_px: Float64[np.ndarray, "m 2"] | None  # micro-image centres; None for a conventional camera
    # edge of the square around a position from which its rays start, in steps of the grid: 1, or 0 for the position
    # itself
    square_steps: float = 0.0
    # column and row of the first pixel in the full image. Image positions are always those of the full image: relative
    # to a window they would be rounded otherwise
    first_px: tuple[int, int] = (0, 0)

    def window(self, rows: slice, columns: slice) -> "RayGrid":
        k = self.supersampling
        fine = slice(rows.start * k, rows.stop * k), slice(columns.start * k, columns.stop * k)
        names = ("near", "far", "hit_fraction", "error_px")
        return replace(
            self,
            covariance=self.covariance[rows, columns],
            cell=np.ascontiguousarray(self.cell[fine]),  # or kernels would be compiled once more
            first_px=(self.first_px[0] + columns.start, self.first_px[1] + rows.start),
            **{name: getattr(self, name)[fine] for name in names},
        )

    @property
    def fine(self) -> tuple[slice, slice]:
        """Rows and columns of the full fine grid that this grid covers."""
        k = self.supersampling
        width, height = self.size_px
        left, above = self.first_px
        return slice(above * k, (above + height) * k), slice(left * k, (left + width) * k)

    @property
    def size_px(self) -> tuple[int, int]:
        return self.covariance.shape[1], self.covariance.shape[0]


def fine_from_image(x_px: Float64[np.ndarray, "..."], supersampling: int) -> np.ndarray:
    """Position in the K times finer grid of an image position: x_K = (x + 1/2) K - 1/2."""
    return (x_px + 0.5) * supersampling - 0.5


def image_from_fine(x_fine: Num[np.ndarray, "..."], supersampling: int) -> np.ndarray:
    """Image position of a position in the K times finer grid: x = (x_K + 1/2) / K - 1/2, the half-pixel rule."""
    return (x_fine + 0.5) / supersampling - 0.5


def matrix_4(covariance: Float64[np.ndarray, "... 10"]) -> np.ndarray:
    """Full (..., 4, 4) matrices from upper triangles (..., 10)."""
    full = np.empty((*covariance.shape[:-1], 4, 4))
    rows, columns = np.triu_indices(4)
    full[..., rows, columns] = covariance
    full[..., columns, rows] = covariance
    return full
