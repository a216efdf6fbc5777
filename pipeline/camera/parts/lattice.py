"""Vertices, types and cells of the microlenses of an array. Rules: CONVENTIONS.md, "Microlens lattice"."""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.parts.polygon import regular
from pipeline.records.shapes import Float64, Int64

_TOLERANCE_MM = 1e-9
"""Tolerance at the border of an array [mm], as CONVENTIONS.md states: vertices are sums that round, and lie exactly on
the border where an extent is a multiple of the pitch."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """Every microlens of an array, sorted by (l, k)."""

    # Axial indices and type
    k: Int64[np.ndarray, "n"]
    l: Int64[np.ndarray, "n"]
    type: Int64[np.ndarray, "n"]
    # Vertices in the sensor frame, from the sensor's centre
    x_mm: Float64[np.ndarray, "n"]
    y_mm: Float64[np.ndarray, "n"]
    z_mm: Float64[np.ndarray, "n"]  # height above microlens (0, 0), positive towards the scene; 0 without tilt

    def rows(self, k: Int64[np.ndarray, "m"], l: Int64[np.ndarray, "m"], missing: int | None = None) -> np.ndarray:
        """Rows of microlenses by their axial indices, (m,); KeyError, or `missing`, where the array has none."""
        row_of = {pair: row for row, pair in enumerate(zip(self.k.tolist(), self.l.tolist(), strict=True))}
        pairs = list(zip(k.tolist(), l.tolist(), strict=True))
        return np.array([row_of[p] if missing is None else row_of.get(p, missing) for p in pairs], np.int64)


def lattice(array: MicrolensArray) -> Lattice:
    """All microlenses whose vertex lies in the array's rectangle [-w/2, w/2) x [-h/2, h/2) around its centre.

    The rectangle lies in the sensor frame [mm], before any tilt. If the array states numbers of microlenses, it is
    rotated with them.
    """
    basis_mm = array.pitch_mm * rotation(array) @ _basis(array)
    is_counted = array.columns is not None
    width, height = extent_mm(array)
    # List all indices in a parallelogram that holds the rectangle: at any rotation, if that turns with the lattice.
    if is_counted:
        half_width = half_height = math.hypot(width, height) / 2
    else:
        half_width, half_height = width / 2, height / 2
    corners = np.array([[x, y] for x in (-1, 1) for y in (-1, 1)]) * [half_width, half_height]
    # Take one more on each side: rounding, and the tolerance at the border, let vertices in that lie just beyond.
    reach = np.ceil(np.abs(np.linalg.solve(basis_mm, corners.T)).max(axis=1)).astype(int) + 1
    l, k = np.mgrid[-reach[1] : reach[1] + 1, -reach[0] : reach[0] + 1].reshape(2, -1)
    # Keep those whose vertices lie in the rectangle.
    indices = np.stack([k, l]).astype(float)
    x, y = basis_mm @ indices
    in_rectangle = array.pitch_mm * _basis(array) @ indices if is_counted else (x, y)
    inside = _inside(in_rectangle[0], width) & _inside(in_rectangle[1], height)
    k, l = k[inside], l[inside]
    x, y = x[inside], y[inside]
    z = np.zeros(len(k))
    if array.is_tilted:
        x, y, z = tilt(array) @ np.stack([x, y, z])
    return Lattice(k, l, _types(array, k, l), x + array.offset_x_mm, y + array.offset_y_mm, z)


def extent_mm(array: MicrolensArray) -> tuple[float, float]:
    """Width and height of the rectangle that holds the vertices; of counted microlenses before the rotation."""
    if array.width_mm is not None and array.height_mm is not None:
        return array.width_mm, array.height_mm
    assert array.columns is not None and array.rows is not None
    along, across = array.pitches_mm
    if array.layout == "hexagonal-columns":
        return array.columns * across * math.sqrt(3) / 2, array.rows * along
    step = across if array.layout == "square" else across * math.sqrt(3) / 2
    return array.columns * along, array.rows * step


def rotation(array: MicrolensArray) -> np.ndarray:
    """Rotation of the lattice in its plane, (2, 2)."""
    angle = np.deg2rad(array.rotation_deg)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def tilt(array: MicrolensArray) -> np.ndarray:
    """Sensor frame from the frame of the tilted array, (3, 3): first about x, then about y."""
    a, b = np.deg2rad(array.tilt_x_deg), np.deg2rad(array.tilt_y_deg)
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return about_y @ about_x


def cell(array: MicrolensArray) -> np.ndarray:
    """Corners of the cell around a vertex, counter-clockwise, (4 or 6, 2), in the array's plane."""
    along, across = array.pitches_mm
    if array.layout == "hexagonal" and along == across:
        return regular(6, along / 2, array.rotation_deg)
    a, b = (array.pitch_mm * rotation(array) @ _basis(array)).T
    neighbours = [a, b, -a, -b] if array.layout == "square" else [a, b, b - a, -a, -b, a - b]
    # A corner is as far from the vertex as from two neighbours that follow one another.
    pairs = zip(neighbours, neighbours[1:] + neighbours[:1], strict=True)
    corners = [
        np.linalg.solve(np.array([first, second]), [first @ first / 2, second @ second / 2]) for first, second in pairs
    ]
    return np.array(corners)


def _basis(array: MicrolensArray) -> np.ndarray:
    """Columns a and b before the rotation, in pitches, (2, 2)."""
    along, across = array.pitches_mm
    stretch = across / along
    if array.layout == "square":
        return np.array([[1.0, 0.0], [0.0, stretch]])
    if array.layout == "hexagonal-columns":
        return np.array([[np.sqrt(3) / 2 * stretch, 0.0], [0.5, 1.0]])
    return np.array([[1.0, 0.5], [0.0, np.sqrt(3) / 2 * stretch]])


def _types(array: MicrolensArray, k: np.ndarray, l: np.ndarray) -> np.ndarray:
    """Types of microlenses (k, l), by the array's table or the rule for three types."""
    if array.type_period is not None:
        along, across = array.type_period
        return np.array(array.type_table)[l % across * along + k % along]
    return (k - l) % 3 if len(array.focal_lengths_mm) == 3 else np.zeros_like(k)


def _inside(position: np.ndarray, extent: float) -> np.ndarray:
    """Whether coordinates lie in [-extent / 2, extent / 2), to the tolerance."""
    return (position >= -extent / 2 - _TOLERANCE_MM) & (position < extent / 2 - _TOLERANCE_MM)
