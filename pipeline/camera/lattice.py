"""Vertices and types of the microlenses of an array. Rules: CONVENTIONS.md, "Microlens lattice"."""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.camera import MicrolensArray

_TOLERANCE_MM = 1e-9


@dataclass(frozen=True, slots=True)
class Lattice:
    """Every microlens of an array, sorted by (l, k).

    Attributes
    ----------
    k, l, type : (n,) int64
        Axial indices and type.
    x_mm, y_mm : (n,) float64
        Vertices in the sensor frame, from the sensor's centre.
    """

    k: np.ndarray
    l: np.ndarray
    type: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray


def lattice(array: MicrolensArray) -> Lattice:
    """All microlenses whose vertex lies in the array's rectangle [-w/2, w/2) x [-h/2, h/2) around its centre."""
    angle = np.deg2rad(array.rotation_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    basis = array.pitch_mm * turn @ np.array([[1.0, 0.5], [0.0, np.sqrt(3) / 2]])
    corners = np.array([[x, y] for x in (-1, 1) for y in (-1, 1)]) * [array.width_mm / 2, array.height_mm / 2]
    reach = np.ceil(np.abs(np.linalg.solve(basis, corners.T)).max(axis=1)).astype(int) + 1
    l, k = np.mgrid[-reach[1] : reach[1] + 1, -reach[0] : reach[0] + 1].reshape(2, -1)
    x, y = basis @ np.stack([k, l]).astype(float)
    inside = _inside(x, array.width_mm) & _inside(y, array.height_mm)
    k, l = k[inside], l[inside]
    types = (k - l) % 3 if len(array.focal_lengths_mm) == 3 else np.zeros_like(k)
    return Lattice(k, l, types, x[inside] + array.offset_x_mm, y[inside] + array.offset_y_mm)


def _inside(position: np.ndarray, extent: float) -> np.ndarray:
    return (position >= -extent / 2 - _TOLERANCE_MM) & (position < extent / 2 - _TOLERANCE_MM)
