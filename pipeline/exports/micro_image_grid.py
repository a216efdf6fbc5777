"""Micro-images counted by column and row from the top left of the image, as libpleno does it."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.exports.material import ExportCamera, ExportError, MicroImages


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImageGrid:
    """Numbers of micro-images in an image.

    Attributes
    ----------
    across : bool
        Whether rows run along x, so that every other row is shifted by half a micro-image; else columns along y are.
    is_shifted : bool
        False of a square lattice, in which nothing is shifted.
    first : tuple of int
        Number of the first line, and twice the place along the line that column 0 has in a line that is not shifted.
    types : (types,) int64
        Our type -> that of the grid.
    """

    across: bool
    is_shifted: bool
    first: tuple[int, int]
    types: np.ndarray

    def numbers(self, microlenses: np.ndarray, types: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Column and row of microlenses (n, 2), and their types as the grid counts them."""
        return _cells(microlenses, self), self.types[types]

    def renumbered(self, images: MicroImages) -> MicroImages:
        """Micro-images with the numbers and types of the grid, sorted by row and column; focal lengths by type."""
        cells, types = self.numbers(images.microlenses, images.types)
        order = np.lexsort(cells.T)
        focal = np.empty_like(images.focal_lengths_mm)
        focal[self.types] = images.focal_lengths_mm
        return replace(
            images,
            microlenses=cells[order],
            types=types[order],
            centres=images.centres[order],
            focal_lengths_mm=focal,
        )


def micro_image_grid(camera: ExportCamera) -> MicroImageGrid:
    """The grid of all microlenses of a camera: its smallest column and row are 0.

    Raises
    ------
    ExportError
        Its types do not repeat as the grid counts them.
    """
    images = camera.micro_images
    assert images is not None
    layout = camera.built.record["mla"]["layout"]
    across, shifted = layout != "hexagonal-columns", layout != "square"
    line, place = _line_and_place(images.microlenses, across, shifted)
    first = int(line.min())
    # Lines 0, 2, … of the grid are shifted by half a micro-image, so their column is half a place back.
    free = int((place - (shifted & ((line - first) % 2 == 0))).min())
    count = len(images.focal_lengths_mm)
    grid = MicroImageGrid(across=across, is_shifted=shifted, first=(first, free), types=np.arange(count))
    return replace(grid, types=_types(_cells(images.microlenses, grid), images.types, count, across and shifted))


def _line_and_place(microlenses: np.ndarray, across: bool, is_shifted: bool) -> tuple[np.ndarray, np.ndarray]:
    """Number of the line of each microlens, and twice its place along the line, in micro-images."""
    k, l = microlenses.T
    if not is_shifted:
        return l, 2 * k
    line, along = (l, k) if across else (k, l)
    return line, 2 * along + line


def _cells(microlenses: np.ndarray, grid: MicroImageGrid) -> np.ndarray:
    """Column and row, (n, 2) int64."""
    line, place = _line_and_place(microlenses, grid.across, grid.is_shifted)
    first, free = grid.first
    line = line - first
    half = line % 2 == 0 if grid.is_shifted else np.zeros(len(line), bool)
    column = (place - half - free) // 2
    return np.stack([column, line] if grid.across else [line, column], axis=1)


def _types(cells: np.ndarray, ours: np.ndarray, count: int, across: bool) -> np.ndarray:
    """Our type -> ((line mod (n - 1)) + place) mod n, libpleno's; only in hexagonal rows the lines are rows."""
    if count == 1:
        return np.zeros(1, np.int64)
    column, row = cells.T
    line, place = (row, column) if across else (column, row)
    theirs = (line % (count - 1) + place) % count
    found = np.array([theirs[ours == kind][0] if (ours == kind).any() else -1 for kind in range(count)])
    if (found[ours] != theirs).any() or len(set(found)) < count:
        raise ExportError(
            "types of these microlenses do not repeat as ((row mod (n - 1)) + column) mod n, as libpleno counts them",
            hint="three types on a hexagonal lattice do, as (k - l) mod 3",
        )
    return found
