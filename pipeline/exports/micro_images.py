"""Micro-images of a plenoptic camera: the regular array through them, and their numbers by column and row.

Some formats count them from the top left of the image, as libpleno does. In hexagonal rows lines 0, 2, … are shifted by
half a micro-image to the right, in hexagonal columns downwards. `GridMesh_::node` of libpleno, pleno/geometry/mesh.cpp,
moves lines 1, 3, … of columns up instead: the same places from another origin.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.formats import Convention, ExportError, ImageAxes

_SIN_60 = math.sqrt(3) / 2
"""Distance of the lines of a hexagonal lattice over its pitch."""
_ALONG_RAD = {"hexagonal": 0.0, "square": 0.0, "hexagonal-columns": math.pi / 6}
"""Direction of the first basis vector of an array that is not turned, from +x towards +y of the sensor frame [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImages:
    """Micro-images of a plenoptic camera, a row each.

    Attributes
    ----------
    layout : str
        Layout as in camera.json.
    microlenses : (n, 2) int64
    types : (n,) int64
    centres : (n, 2) float64
        Image positions: the real ray through the centre of the stop and the vertex.
    focal_lengths_mm : (types,) float64
    own_types : (types,) int64
        Our number of each type: where it stands in camera.json.
    """

    layout: str
    microlenses: np.ndarray
    types: np.ndarray
    centres: np.ndarray
    focal_lengths_mm: np.ndarray
    own_types: np.ndarray

    def in_image(self, size_px: tuple[int, int]) -> np.ndarray:
        """Whether centres of ours lie in the image, (n,) bool."""
        return np.asarray(((self.centres >= 0) & (self.centres <= np.array(size_px) - 1)).all(axis=1))


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayFit:
    """The regular array through the micro-images of an image.

    Attributes
    ----------
    layout : str
        Layout as in camera.json.
    centre : (2,) float64
        Image position of the micro-image nearest to the middle of the image.
    pitch_px : float
        Length of the first basis vector of CONVENTIONS.md, Microlens lattice.
    turn_rad : float
        Anticlockwise as seen, from an array that is not turned.
    type : int
        Type of the micro-image at the centre.
    """

    layout: str
    centre: np.ndarray
    pitch_px: float
    turn_rad: float
    type: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GridMesh:
    """A regular mesh of micro-image centres: the node of column c and row r is origin + turned (x(c, r), y(c, r)).

    Attributes
    ----------
    layout : str
        `square`, `hexagonal` or `hexagonal-columns`.
    columns, rows : int
    pitch_px : tuple of float
        Along x and along y.
    angle_rad : float
        Rotation from +x towards +y.
    origin : (2,) float64
        An image position.
    """

    layout: str
    columns: int
    rows: int
    pitch_px: tuple[float, float]
    angle_rad: float
    origin: np.ndarray

    @property
    def step_px(self) -> tuple[float, float]:
        """Distance of columns and of rows: lines of a hexagonal mesh stand closer than its pitch."""
        across = _SIN_60 if self.layout == "hexagonal-columns" else 1
        down = _SIN_60 if self.layout == "hexagonal" else 1
        return self.pitch_px[0] * across, self.pitch_px[1] * down

    def place(self, x_px: float, y_px: float) -> np.ndarray:
        """Image position of a place that counts from the origin along the axes of the mesh, (2,)."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return np.array([[cos, -sin], [sin, cos]]) @ [x_px, y_px] + self.origin


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImageGrid:
    """Numbers of the micro-images that matter: those whose centre lies in the image, and those that see a point.

    Attributes
    ----------
    layout : str
        Layout as in camera.json; in hexagonal-columns lines run down, else across.
    first : tuple of int
        Number of the first line, and twice the place along the line that column 0 has in a line that is not shifted.
    types : (types,) int64
        Our type -> that of the grid.
    rows : (n,) int64
        Rows of the micro-images that count, sorted by row and column.
    """

    layout: str
    first: tuple[int, int]
    types: np.ndarray
    rows: np.ndarray

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
        line, place = self._line_and_place(microlenses)
        line = line - self.first[0]
        column = (place - (line % 2 == 0) * self.is_shifted - self.first[1]) // 2
        return np.stack([column, line] if self.across else [line, column], axis=1)

    def renumbered(self, images: MicroImages) -> MicroImages:
        """The micro-images that matter with the numbers of the grid; focal lengths by its types."""
        cells, types = self.cells(images.microlenses[self.rows]), self.types[images.types[self.rows]]
        return retyped(replace(images, microlenses=cells, centres=images.centres[self.rows]), self.types, types)

    def mesh(self, images: MicroImages) -> GridMesh:
        """The regular mesh that fits the centres of renumbered micro-images best, by least squares."""
        columns, rows = images.microlenses.T
        x, y = columns.astype(float), rows.astype(float)
        if self.is_shifted and self.across:
            x, y = x + 0.5 * (rows % 2 == 0), y * _SIN_60
        elif self.is_shifted:
            x, y = x * _SIN_60, y + 0.5 * (columns % 2 == 0)
        found = np.linalg.lstsq(np.stack([x, y, np.ones(len(x))], axis=1), images.centres, rcond=None)[0]
        angle = math.atan2(found[0, 1], found[0, 0])
        down = found[1] @ [-math.sin(angle), math.cos(angle)]
        return GridMesh(
            layout=self.layout,
            columns=int(columns.max()) + 1,
            rows=int(rows.max()) + 1,
            pitch_px=(float(np.hypot(*found[0])), float(down)),
            angle_rad=angle,
            origin=found[2],
        )

    def _line_and_place(self, microlenses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Number of the line of each microlens, and twice its place along the line, in micro-images."""
        k, l = microlenses.T
        if not self.is_shifted:
            return l, 2 * k
        line, along = (l, k) if self.across else (k, l)
        return line, 2 * along + line


def array_fit(ours: MicroImages, stated: MicroImages, size_px: tuple[int, int], convention: Convention) -> ArrayFit:
    """The regular array through the centres in the image, by least squares.

    Parameters
    ----------
    ours, stated : MicroImages
        Micro-images in our conventions, and with their centres as the format counts them.
    """
    rows = ours.in_image(size_px)
    numbers = ours.microlenses[rows]
    middle = (np.array(size_px) - 1) / 2
    nearest = int(np.linalg.norm(ours.centres[rows] - middle, axis=1).argmin())
    steps = np.column_stack([numbers - numbers[nearest], np.ones(len(numbers))])
    along, _, centre = np.linalg.lstsq(steps, stated.centres[rows], rcond=None)[0]
    if convention.axes is ImageAxes.Y_X:
        along = along[::-1]
    upwards = 1 if convention.axes is ImageAxes.X_UP else -1
    return ArrayFit(
        layout=ours.layout,
        centre=centre,
        pitch_px=float(np.hypot(*along)),
        turn_rad=upwards * math.atan2(along[1], along[0]) + _ALONG_RAD[ours.layout],
        type=int(stated.types[rows][nearest]),
    )


def retyped(images: MicroImages, numbers: np.ndarray, types: np.ndarray) -> MicroImages:
    """Micro-images of these types; `numbers` has the new number of each of ours, and focal lengths follow."""
    order = np.argsort(numbers)
    return replace(
        images, types=types, focal_lengths_mm=images.focal_lengths_mm[order], own_types=images.own_types[order]
    )


def micro_image_grid(images: MicroImages, size_px: tuple[int, int], seeing: np.ndarray) -> MicroImageGrid:
    """The grid of micro-images, in our conventions: its smallest column and row are 0.

    Parameters
    ----------
    seeing : (n, 2) int64
        Microlenses that see a point.

    Raises
    ------
    ExportError
        Its types do not repeat as the grid counts them.
    """
    matter = images.in_image(size_px)
    known = {tuple(pair) for pair in seeing.tolist()}
    matter |= np.array([tuple(pair) in known for pair in images.microlenses.tolist()])
    rows, count = np.flatnonzero(matter), len(images.focal_lengths_mm)
    grid = MicroImageGrid(layout=images.layout, first=(0, 0), types=np.arange(count), rows=rows)
    line, place = grid._line_and_place(images.microlenses[rows])
    first = int(line.min())
    grid = replace(grid, first=(first, int((place - grid.is_shifted * ((line - first) % 2 == 0)).min())))
    cells, ours = grid.cells(images.microlenses[rows]), images.types[rows]
    return replace(grid, types=_types(cells, ours, count, grid), rows=rows[np.lexsort(cells.T)])


def _types(cells: np.ndarray, ours: np.ndarray, count: int, grid: MicroImageGrid) -> np.ndarray:
    """Our type -> ((line mod (n - 1)) + place) mod n, libpleno's; only in hexagonal rows the lines are rows."""
    if count == 1:
        return np.zeros(1, np.int64)
    column, row = cells.T
    line, place = (row, column) if grid.layout == "hexagonal" else (column, row)
    theirs = (line % (count - 1) + place) % count
    found = np.array([theirs[ours == kind][0] if (ours == kind).any() else -1 for kind in range(count)])
    if (found[ours] != theirs).any() or sorted(found.tolist()) != list(range(count)):
        raise ExportError(
            "types of these microlenses do not repeat as ((row mod (n - 1)) + column) mod n, as libpleno counts them",
            hint="three types on a hexagonal lattice do, as (k - l) mod 3",
        )
    return found
