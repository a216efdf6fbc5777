"""The two faces of a microlens that has some: a small prescription. Lengths in mm."""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import (
    COEFFICIENTS,
    CONIC,
    CURVATURE,
    EDGES,
    FIRST_EDGE,
    INDEX_RATIO,
    SEMI_DIAMETER_SQUARED,
    towards_scene,
)
from pipeline.records.shapes import Float64

PLANE_LIKE = 1e-9
"""A semi-diameter that fits every sphere, for figures near the axis [mm]."""

_MOST_EDGES = 6
"""Edges that a table of faces has room for: those of a hexagonal cell; a square one has four."""


@dataclass(frozen=True, slots=True)
class Faces:
    """A front face towards the scene, a rear one towards the sensor, and what lies between them.

    Radii are positive when the centre lies towards the sensor; inf is a plane. A plane is one for the whole array and
    blocks nothing; a curved face ends where the microlens does.
    """

    front_radius_mm: float
    rear_radius_mm: float
    thickness_mm: float
    index: float
    front_conic: float = 0.0
    rear_conic: float = 0.0

    @property
    def curved(self) -> tuple[bool, bool]:
        """Whether the front and the rear face are curved."""
        return not math.isinf(self.front_radius_mm), not math.isinf(self.rear_radius_mm)

    @property
    def aperture_is_in_front(self) -> bool:
        """Whether the aperture that counts is on the front face: it is on the rear one, if that is curved."""
        return not self.curved[1]

    def prescription(self, semi_diameter_mm: float) -> Prescription:
        """Both faces as far as a semi-diameter; the rear vertex is the origin."""
        front, rear = (semi_diameter_mm if curved else math.inf for curved in self.curved)
        return Prescription(
            surfaces=(
                Surface(
                    radius_mm=self.front_radius_mm,
                    thickness_mm=self.thickness_mm,
                    index=self.index,
                    semi_diameter_mm=front,
                    conic=self.front_conic,
                ),
                Surface(radius_mm=self.rear_radius_mm, semi_diameter_mm=rear, conic=self.rear_conic, is_stop=True),
            )
        )

    def first_order(self, semi_diameter_mm: float) -> FirstOrder:
        """First-order figures; z counts from the rear vertex towards the scene."""
        return first_order(self.prescription(semi_diameter_mm))

    def aperture_z_mm(self, height_mm: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Distance of the aperture's face from the rear vertex plane, towards the scene, at heights off its axis."""
        surface = self.prescription(PLANE_LIKE).surfaces[0 if self.aperture_is_in_front else 1]
        sag = np.vectorize(surface.sag_mm, otypes=[float])(height_mm)
        return (self.thickness_mm if self.aperture_is_in_front else 0.0) - sag


def face_table(faces: Faces, cell: Float64[np.ndarray, "n 2"], radius_mm: float | None, flat: bool) -> np.ndarray:
    """Rows of a microlens for `optics.kernels.trace_packet`, rear face first, about its rear vertex.

    Parameters
    ----------
    cell : (n, 2) float64
        Corners of the lattice cell, counter-clockwise.
    radius_mm : float or None
        Radius of a disc that is the aperture instead.
    flat : bool
        Whether the front face is traced as the plane through its vertex that does not bend: the two-plane model.
    """
    corner = float(np.hypot(*cell.T).max()) if radius_mm is None else radius_mm
    curved = faces.curved
    table = towards_scene(faces.prescription(PLANE_LIKE if flat else corner))
    rows = [append_edges(row, cell if curved[1 - i] and radius_mm is None else None) for i, row in enumerate(table)]
    table = np.stack(rows)
    for i in range(2):
        if curved[1 - i] and radius_mm is not None:
            table[i, SEMI_DIAMETER_SQUARED] = radius_mm**2
        elif curved[1 - i]:
            table[i, SEMI_DIAMETER_SQUARED] = (1 + 1e-12) * corner**2
    if flat:
        table[1, [CURVATURE, INDEX_RATIO, CONIC]] = 0.0, 1.0, 0.0
    return table


def append_edges(row: Float64[np.ndarray, "n"], cell: Float64[np.ndarray, "m 2"] | None) -> np.ndarray:
    """A row of a table with a polygon for its aperture, or room for one."""
    base = row[:COEFFICIENTS].copy()
    edges = np.zeros(0)
    if cell is not None:
        along = np.roll(cell, -1, axis=0) - cell
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
        edges = np.column_stack([normal, np.sum(normal * cell, axis=1)]).ravel()
        base[EDGES] = len(cell)
    base[FIRST_EDGE] = COEFFICIENTS
    return np.concatenate([base, edges, np.zeros(3 * _MOST_EDGES - len(edges))])
