"""Rows of correspondences, and the rule that decides which exist, shared by all methods."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from pipeline.records.shapes import Bool, Float64, Int64


@dataclass(frozen=True, slots=True)
class Solutions:
    """Raw solutions of a search, one row each."""

    point: Int64[np.ndarray, "n"]
    cell: Int64[np.ndarray, "n"]
    x_px: Float64[np.ndarray, "n"]
    y_px: Float64[np.ndarray, "n"]
    # derivative of J by image position, mm on the target per px; columns are x and y
    jacobian: Float64[np.ndarray, "n 2 2"]
    noise_gain: Float64[np.ndarray, "n"]  # standard error of the solution over that of a single position of the grid

    @property
    def xy_px(self) -> np.ndarray:
        """Positions, (n, 2)."""
        return np.stack([self.x_px, self.y_px], axis=1)

    def only(self, kept: Bool[np.ndarray, "n"] | Int64[np.ndarray, "m"]) -> "Solutions":
        """The rows selected by a mask or by indices."""
        return Solutions(*(getattr(self, name)[kept] for name in self.__slots__))

    def joined(self, other: "Solutions") -> "Solutions":
        """These rows and those of another."""
        return Solutions(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in self.__slots__))


@dataclass(frozen=True, slots=True)
class Correspondences:
    """Rows of correspondences.csv that depend on optics, sorted by point, l, k."""

    solutions: Solutions
    sigma_px: Float64[np.ndarray, "n 2"]  # standard error from the ray sampling
    hit_fraction: Float64[np.ndarray, "n"]
    blur_px2: Float64[np.ndarray, "n 2 2"]  # NaN if the second moments are unknown
    rho_px: Float64[np.ndarray, "n"]
    counts: dict[str, int]  # numbers of solutions found, rejected and dropped, by reason
    # Points and cells of candidates that may have rows but were not solved
    unsolved: Int64[np.ndarray, "m 2"] = field(default_factory=lambda: np.zeros((0, 2), np.int64))

    def only(self, kept: Bool[np.ndarray, "n"] | Int64[np.ndarray, "m"]) -> "Correspondences":
        """The rows selected by a mask or by indices; counts are not changed."""
        columns = (getattr(self, name)[kept] for name in _PER_ROW)
        return dataclasses.replace(
            self, solutions=self.solutions.only(kept), **dict(zip(_PER_ROW, columns, strict=True))
        )

    def joined(self, other: "Correspondences") -> "Correspondences":
        """These rows and those of another; counts are those of this record."""
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _PER_ROW
        }
        unsolved = np.concatenate([self.unsolved, other.unsolved])
        return dataclasses.replace(self, solutions=self.solutions.joined(other.solutions), unsolved=unsolved, **columns)

    def recounted(self, **counts: int) -> "Correspondences":
        """The rows with additional counts; that of the rows moves to the end."""
        before = {name: count for name, count in self.counts.items() if name != "rows"}
        return dataclasses.replace(self, counts={**before, **counts})

    def sorted_by(self, axial: Int64[np.ndarray, "m 2"]) -> "Correspondences":
        """The rows in the order of the table; `axial` holds k and l of all cells."""
        return self.only(np.lexsort((*axial[self.solutions.cell].T, self.solutions.point)))


_PER_ROW = ("sigma_px", "hit_fraction", "blur_px2", "rho_px")


class ImageCells(Protocol):
    """An image and the cells of its micro-images: a `camera.rig.Rig` or position images."""

    @property
    def axial(self) -> np.ndarray:
        """k and l of every cell, (m, 2)."""

    def in_image(self, x_px: Float64[np.ndarray, "n 2"]) -> np.ndarray:
        """Whether positions lie in the image."""

    def in_cell(self, x_px: Float64[np.ndarray, "n 2"], cell: Int64[np.ndarray, "n"]) -> np.ndarray:
        """Whether positions lie in their own cell."""


def existing_indices(
    image: ImageCells,
    x_px: Float64[np.ndarray, "n 2"],
    cell: Int64[np.ndarray, "n"],
    is_lit: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, dict[str, int]]:
    """Indices of the rows inside the image and their own cell with enough light; counts of the rest by reason.

    `is_lit` tells whether rows, given by index, have enough light; only rows inside image and cell are passed to it.
    """
    counts = {}
    rows = np.arange(len(cell))
    tests: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "dropped_outside_image": lambda rows: image.in_image(x_px[rows]),
        "dropped_outside_cell": lambda rows: image.in_cell(x_px[rows], cell[rows]),
        "dropped_hit_fraction": is_lit,
    }
    for name, test in tests.items():
        kept = test(rows)
        counts[name] = int(np.sum(~kept))
        rows = rows[kept]
    return rows, counts


def existing(rows: Correspondences, image: ImageCells, min_hit_fraction: float) -> Correspondences:
    """The rows that exist, sorted by point, l, k; the rest is counted by reason."""
    solutions = rows.solutions
    is_lit = rows.hit_fraction >= min_hit_fraction
    kept, dropped = existing_indices(image, solutions.xy_px, solutions.cell, lambda inside: is_lit[inside])
    counts = {**rows.counts, **dropped, "rows": len(kept)}
    return dataclasses.replace(rows.only(kept), counts=counts).sorted_by(image.axial)
