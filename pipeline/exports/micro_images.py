"""Micro-images of a plenoptic camera: their numbers by column and row, and the regular mesh through them.

Some formats count them from the top left of the image, as libpleno does. In hexagonal rows lines 0, 2, … are shifted by
half a micro-image to the right, in hexagonal columns downwards. `GridMesh_::node` of libpleno, pleno/geometry/mesh.cpp,
moves lines 1, 3, … of columns up instead: the same places from another origin.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.camera.parts.microlens_array import SIN_60
from pipeline.formats import ExportError


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImages:
    """Micro-images of a plenoptic camera, a row each."""

    layout: str  # as in camera.json
    microlenses: np.ndarray  # (n, 2) int64
    types: np.ndarray  # (n,) int64
    centres: np.ndarray  # (n, 2), image positions: the real ray through the centre of the stop and the vertex
    focal_lengths_mm: np.ndarray  # (types,)
    own_types: np.ndarray  # (types,) int64, our number of each type: where it stands in camera.json


@dataclass(frozen=True, slots=True, kw_only=True)
class GridMesh:
    """A regular mesh of micro-image centres: the node of column c and row r is origin + turned (x(c, r), y(c, r))."""

    layout: str  # `square`, `hexagonal` or `hexagonal-columns`
    columns: int
    rows: int
    pitch_px: tuple[float, float]  # along x and along y
    angle_rad: float  # from +x towards +y
    origin: np.ndarray  # (2,), image position of the first node
    middle: np.ndarray  # (2,), image position of the node nearest to the middle of the image

    @property
    def step_px(self) -> tuple[float, float]:
        """Distance of columns and of rows: lines of a hexagonal mesh stand closer than its pitch."""
        across = SIN_60 if self.layout == "hexagonal-columns" else 1
        down = SIN_60 if self.layout == "hexagonal" else 1
        return self.pitch_px[0] * across, self.pitch_px[1] * down

    def image_position(self, x_px: float, y_px: float) -> np.ndarray:
        """Image position of a point given from the origin along the axes of the mesh, (2,)."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return np.array([[cos, -sin], [sin, cos]]) @ [x_px, y_px] + self.origin


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImageGrid:
    """Numbers of the micro-images that matter: those whose centre lies in the image, and those that see a point."""

    layout: str  # as in camera.json; in hexagonal-columns lines run down, else across
    # Number of the first line, and twice the offset along the line that column 0 has in a line that is not shifted
    first: tuple[int, int]
    rows: np.ndarray  # (n,), rows of the micro-images that count, sorted by row and column

    @property
    def across(self) -> bool:
        """Whether lines are rows."""
        return self.layout != "hexagonal-columns"

    @property
    def is_shifted(self) -> bool:
        """Whether every other line is shifted."""
        return self.layout != "square"

    def cells(self, microlenses: np.ndarray) -> np.ndarray:
        """Column and row of microlenses (n, 2)."""
        line, offset = self._line_and_offset(microlenses)
        line = line - self.first[0]
        column = (offset - (line % 2 == 0) * self.is_shifted - self.first[1]) // 2
        return np.stack([column, line] if self.across else [line, column], axis=1)

    def renumbered(self, images: MicroImages) -> MicroImages:
        """The micro-images that matter, by numbers and types of the grid; ExportError if its types do not repeat so."""
        cells = self.cells(images.microlenses[self.rows])
        our_types = images.types[self.rows]
        theirs_by_ours = self._their_type_of_ours(cells, our_types, len(images.focal_lengths_mm))
        renumbered = replace(images, microlenses=cells, centres=images.centres[self.rows])
        return retyped(renumbered, theirs_by_ours, theirs_by_ours[our_types])

    def mesh(self, images: MicroImages, central: int) -> GridMesh:
        """The regular mesh that fits centres best, by least squares.

        `images`: micro-images with our numbers, and centres as the format counts them.
        `central`: row of the one nearest to the middle of the image.
        """
        cells = self.cells(images.microlenses)
        columns, rows = cells.T
        # Nodes of a mesh of pitch 1; lines of a hexagonal one are closer, and every other one is shifted.
        x, y = cells.T.astype(float)
        if self.is_shifted and self.across:
            x += 0.5 * (rows % 2 == 0)
            y *= SIN_60
        elif self.is_shifted:
            x *= SIN_60
            y += 0.5 * (columns % 2 == 0)
        nodes = np.stack([x, y, np.ones(len(x))], axis=1)
        # The affine map from nodes to centres: images of both axes, and of the first node
        along, across, origin = np.linalg.lstsq(nodes[self.rows], images.centres[self.rows], rcond=None)[0]
        angle = math.atan2(along[1], along[0])
        return GridMesh(
            layout=self.layout,
            columns=int(columns[self.rows].max()) + 1,
            rows=int(rows[self.rows].max()) + 1,
            pitch_px=(float(np.hypot(*along)), float(across @ [-math.sin(angle), math.cos(angle)])),
            angle_rad=angle,
            origin=origin,
            middle=nodes[central] @ [along, across, origin],
        )

    def _line_and_offset(self, microlenses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Number of the line of each microlens, and twice its offset along the line, in micro-images."""
        k, l = microlenses.T
        if not self.is_shifted:
            return l, 2 * k
        line, along = (l, k) if self.across else (k, l)
        return line, 2 * along + line

    def _their_type_of_ours(self, cells: np.ndarray, our_types: np.ndarray, count: int) -> np.ndarray:
        """Type of libpleno for each of our `count` types, (count,); those without a micro-image take what is left.

        Theirs is ((line mod (count - 1)) + index in the line) mod count; lines are columns, but rows in `hexagonal`.

        `cells`, (m, 2): column and row of each micro-image. `our_types`, (m,): its type.
        """
        if count == 1:
            return np.zeros(1, np.int64)
        column, row = cells.T
        if self.layout == "hexagonal":
            line, index, rule = row, column, "((row mod (n - 1)) + column) mod n"
        else:
            line, index, rule = column, row, "((column mod (n - 1)) + row) mod n"
        their_types = (line % (count - 1) + index) % count
        theirs_by_ours = np.full(count, -1)
        theirs_by_ours[our_types] = their_types
        unused = theirs_by_ours < 0
        left = np.setdiff1d(np.arange(count), their_types)
        if (theirs_by_ours[our_types] != their_types).any() or len(left) != np.count_nonzero(unused):
            raise ExportError(
                f"types of these microlenses do not repeat as {rule}, as libpleno counts",
                hint="three types on a hexagonal lattice do, as (k - l) mod 3",
            )
        theirs_by_ours[unused] = left
        return theirs_by_ours


def retyped(images: MicroImages, numbers: np.ndarray, types: np.ndarray) -> MicroImages:
    """Micro-images of these types; `numbers` has the new number of each of ours, and focal lengths follow."""
    order = np.argsort(numbers)
    return replace(
        images, types=types, focal_lengths_mm=images.focal_lengths_mm[order], own_types=images.own_types[order]
    )


def micro_image_grid(images: MicroImages, size_px: tuple[int, int], seeing: np.ndarray) -> MicroImageGrid:
    """The grid of micro-images from column and row 0; `seeing`, (n, 2) int64, are microlenses that see a point."""
    is_in_image = ((images.centres >= 0) & (images.centres <= np.array(size_px) - 1)).all(axis=1)
    seeing_pairs = {tuple(pair) for pair in seeing.tolist()}
    sees_point = np.array([tuple(pair) in seeing_pairs for pair in images.microlenses.tolist()])
    rows = np.flatnonzero(is_in_image | sees_point)
    grid = MicroImageGrid(layout=images.layout, first=(0, 0), rows=rows)
    line, offset = grid._line_and_offset(images.microlenses[rows])
    first = int(line.min())
    grid = replace(grid, first=(first, int((offset - grid.is_shifted * ((line - first) % 2 == 0)).min())))
    return replace(grid, rows=rows[np.lexsort(grid.cells(images.microlenses[rows]).T)])
