"""A prescription as the flat table that kernels read, for light in either direction.

In both tables rays travel along +z of the table's frame, so kernels know one direction only: `towards_scene` uses the
vision frame (origin at the stop, z forward), `towards_sensor` the lens frame moved to the stop.

A displaced surface has the rigid motion from its centred position, about the centre of the nominal stop; the surfaces
behind it do not move.

Rays from a tilted sensor start in the film frame: the vision frame, tilted with the sensor. They enter the first
surface of `towards_scene` by another motion than they leave it, and behind it they are in the vision frame.
"""

import math
from collections.abc import Iterator
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np

from pipeline.frames import VISION_FROM_CAMERA, inverse, rigid
from pipeline.optics.prescription import Prescription, Surface
from pipeline.records.shapes import Float64

(
    VERTEX,
    CURVATURE,
    INDEX_RATIO,
    SEMI_DIAMETER_SQUARED,
    CONIC,
    TERMS,
    ODD,
    INNER_SQUARED,
    EDGES,
    FIRST_EDGE,
    POSE,
    ENTRY,
    FORM,
) = range(13)
"""Columns: vertex z [mm], curvature [1/mm], index before / index behind, squared semi-diameter [mm^2], conic constant,
number of polynomial coefficients, whether these include odd powers, squared inner semi-diameter [mm^2], number of
straight edges of the aperture, column of the first edge; first of the twelve columns of the motion by which rays leave
a displaced surface, 0 for a centred one; first of the twelve of the motion by which they enter, another one only for a
tilted sensor; form of the surface, one of those below. Zeros behind the first four make a circular aperture on a
centred sphere. An edge takes three columns: x and y of its outward normal, distance from the axis [mm]. A motion is the
upper three rows of its matrix."""
IDEAL = -1.0
"""Marker instead of a number of coefficients: an ideal thin lens, whose one coefficient is its power [1/mm]."""
TOWARDS_SCENE, TOWARDS_SENSOR = -2.0, -3.0
"""Markers of an ideal lens with distortion, by the direction of the light; its coefficients are power, 1 / image
distance [1/mm] and k1, k2, p1, p2, k3, see `optics.brown`."""
LOW_TERMS = 5
"""Least number of coefficients in the row of an asphere, padded with zeros."""
REVOLVED, CYLINDER, RELIEF = range(3)
"""Forms of surfaces: of revolution, a cylinder, which is straight along x, and a spline of heights."""
RELIEF_COLUMNS, RELIEF_ROWS, RELIEF_SPACING = CONIC, TERMS, ODD
"""Columns of a relief, which has neither a conic constant nor a polynomial: number of its B-spline coefficients along x
and along y, and their spacing [mm]. The coefficients [mm] are rows along x, from the least y on."""
COEFFICIENTS = 13
"""First of the coefficients: of r^2, r^4, r^6, ..., or of r^2, r^3, r^4, ... where `ODD` is 1 [mm^(1 - power)]."""


class Film(NamedTuple):
    """Plane in which rays start, tilted as in `motion` about the point of the axis at a vision z [mm]."""

    tilt_deg: tuple[float, float] = (0.0, 0.0)
    pivot_mm: float = 0.0

    @property
    def vision_from_film(self) -> np.ndarray | None:
        """The vision frame from the film frame, (4, 4); None: they coincide."""
        return motion((0.0, 0.0), self.tilt_deg, self.pivot_mm)


UPRIGHT = Film()
"""The plane across the axis."""


def displacements(prescription: Prescription) -> list[np.ndarray | None]:
    """Rigid motion of every surface from its centred position, (4, 4) [mm]; None for a centred one.

    Lens frame with its origin at the centre of the stop, z towards the sensor. The surface moves first, then its
    group: the displacement of a surface counts in the axes of its group. No surface is in two groups.
    """
    vertices_mm = prescription.vertices_from_stop_mm
    motions = [
        motion(surface.decentre_mm, surface.tilt_deg, pivot_mm=vertex_mm)
        for surface, vertex_mm in zip(prescription.surfaces, vertices_mm, strict=True)
    ]
    for group in prescription.groups:
        pivot_mm = vertices_mm[group.first] + group.pivot_mm
        group_motion = motion(group.decentre_mm, group.tilt_deg, pivot_mm, group.roll_deg)
        if group_motion is None:
            continue
        for i in group.members:
            surface_motion = motions[i]
            motions[i] = group_motion if surface_motion is None else group_motion @ surface_motion
    return motions


def placed(prescription: Prescription) -> Iterator[tuple[Surface, float, np.ndarray | None]]:
    """Each surface, its vertex from the stop along the axis [mm], and its displacement as of `displacements`."""
    return zip(prescription.surfaces, prescription.vertices_from_stop_mm, displacements(prescription), strict=True)


def motion(
    decentre_mm: tuple[float, float], tilt_deg: tuple[float, float], pivot_mm: float, roll_deg: float = 0.0
) -> np.ndarray | None:
    """Rotation about (0, 0, pivot), first about x, then about the rotated y and z, then a shift; None: no motion."""
    if not any((*decentre_mm, *tilt_deg, roll_deg)):
        return None
    (cos_x, cos_y), (sin_x, sin_y) = ([f(math.radians(angle)) for angle in tilt_deg] for f in (math.cos, math.sin))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_x, -sin_x], [0.0, sin_x, cos_x]])
    about_y = np.array([[cos_y, 0.0, sin_y], [0.0, 1.0, 0.0], [-sin_y, 0.0, cos_y]])
    rotation = about_x @ about_y
    pivot = np.array([0.0, 0.0, pivot_mm])
    if roll_deg:
        cos, sin = math.cos(math.radians(roll_deg)), math.sin(math.radians(roll_deg))
        rotation = rotation @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return rigid(rotation, pivot - rotation @ pivot + np.array([*decentre_mm, 0.0]))


def towards_scene(prescription: Prescription, film: Film = UPRIGHT) -> np.ndarray:
    """Surfaces from the rear one to the front one, in the order of rays from the film, (n, columns), vision frame."""
    return np.ascontiguousarray(_table(prescription, -1.0, film.vision_from_film)[::-1])


def towards_sensor(prescription: Prescription) -> np.ndarray:
    """Surfaces from the front one to the rear one, (n, columns), lens frame with its origin moved to the stop."""
    return _table(prescription, 1.0)


def _table(prescription: Prescription, sign: float, vision_from_film: np.ndarray | None = None) -> np.ndarray:
    """Rows of all surfaces from the front one to the rear one, (n, columns), for light in either direction.

    `sign`: 1 for light towards the sensor, in the lens frame moved to the stop; -1 for light towards the scene, in the
    vision frame, whose z is opposite.
    `vision_from_film`: the film frame of a tilted sensor, (4, 4) [mm], for light towards the scene.
    """
    rows = []
    in_front = prescription.index_in_front
    for surface, vertex_mm, displacement in placed(prescription):
        # Divide the index on the side from which the light comes by that on the other side.
        index_ratio = in_front / surface.index if sign > 0 else surface.index / in_front
        row = _row(surface, sign * vertex_mm, index_ratio, sign)
        if displacement is not None:
            # It is stated in the lens frame. The vision frame is that frame after half a turn about x, its own inverse.
            if sign < 0:
                displacement = VISION_FROM_CAMERA @ displacement @ VISION_FROM_CAMERA
            row = _with_motion(row, displacement)
        rows.append(row)
        in_front = surface.index
    # Rays from a tilted sensor come to the rear surface, their first, in the film frame, and leave it in the vision
    # frame. So its row gets its motion in both: in the vision frame for the exit, and in the film frame for the entry.
    if vision_from_film is not None:
        in_vision = motion_of(np.array(rows[-1]))
        in_film = inverse(vision_from_film) @ in_vision
        rows[-1] = _with_motion(rows[-1], in_vision, in_film)
    # Rows are as long as their coefficients, edges and motions need: fill them up with zeros.
    table = np.zeros((len(rows), max(map(len, rows))))
    for i, row in enumerate(rows):
        table[i, : len(row)] = row
    return table


def _with_motion(row: list[float], *motions: np.ndarray) -> list[float]:
    """The row with the motion by which rays leave its surface, and the one by which they enter, if that differs."""
    columns = [float(len(row) + 12 * i) for i in range(len(motions))]
    numbers = [value for matrix in motions for value in (matrix[:3] + 0.0).ravel().tolist()]
    return [*row[:POSE], columns[0], columns[-1], *row[ENTRY + 1 :], *numbers]


def motion_of(row: Float64[np.ndarray, "n"], column: int = POSE) -> np.ndarray:
    """Displacement of the surface of a row from its centred position, (4, 4), in the frame behind it.

    `column`: POSE, or ENTRY for the frame in which rays arrive.
    """
    result = np.eye(4)
    first = int(row[column])
    if first:
        result[:3] = row[first : first + 12].reshape(3, 4)
    return result


def is_centred(table: Float64[np.ndarray, "surfaces columns"]) -> bool:
    """Whether all surfaces are round and centred: the lens is symmetric about its axis, apertures left aside."""
    return not table[:, [POSE, FORM]].any()


def enclosing(table: Float64[np.ndarray, "surfaces columns"]) -> np.ndarray:
    """The table with every aperture replaced by its enclosing circle, which passes at least as many rays."""
    result = table.copy()
    result[:, [INNER_SQUARED, EDGES]] = 0.0
    return result


def without_obstructions(table: Float64[np.ndarray, "surfaces columns"]) -> list[tuple[float, np.ndarray]]:
    """Lenses without obstructions, with signs, whose light adds up to that of a lens with obstructions.

    Inclusion and exclusion: the light within all outer edges (the first lens), less the light that would meet an
    obstruction, plus the light that would meet two of them, and so on. An obstruction that is met becomes an aperture
    of its size.
    """
    holes = np.flatnonzero(table[:, INNER_SQUARED] > 0)
    plain = table.copy()
    plain[:, INNER_SQUARED] = 0.0
    parts = []
    for rows in chain.from_iterable(combinations(holes, count) for count in range(len(holes) + 1)):
        part = plain.copy()
        part[list(rows), SEMI_DIAMETER_SQUARED] = table[list(rows), INNER_SQUARED]
        parts.append((float((-1) ** len(rows)), part))
    return parts


def unbounded(table: Float64[np.ndarray, "surfaces columns"]) -> np.ndarray:
    """The table without apertures, for rays that are lines of the geometry."""
    result = enclosing(table)
    result[:, SEMI_DIAMETER_SQUARED] = np.inf
    return result


def _row(surface: Surface, vertex_mm: float, index_ratio: float, sign: float) -> list[float]:
    """One surface; `sign` is that of the frame's z against the lens frame's."""
    coefficients, has_odd = _polynomial(surface)
    conic = 0.0 if surface.curvature_per_mm == 0 else surface.conic + 0.0
    terms: float = max(len(coefficients), LOW_TERMS) if coefficients else 0
    odd = float(has_odd)
    form = REVOLVED
    if surface.is_cylinder and surface.curvature_per_mm != 0:
        form = CYLINDER
    if surface.relief is not None:
        spline = surface.relief.spline[:: int(sign)]  # the vision frame has y down
        form = RELIEF
        coefficients = spline.ravel().tolist()
        # Three columns have another meaning for a relief: RELIEF_COLUMNS, RELIEF_ROWS and RELIEF_SPACING.
        conic, terms = float(spline.shape[1]), float(spline.shape[0])
        odd = surface.relief.spacing_mm
    elif surface.focal_length_mm is not None:
        coefficients = [sign * value for value in _ideal(surface, sign)]  # without the sign that they get below
        distorting = TOWARDS_SENSOR if sign > 0 else TOWARDS_SCENE
        terms = distorting if surface.distortion else IDEAL
    elif coefficients:
        coefficients += [0.0] * (LOW_TERMS - len(coefficients))
    # The vision frame is the lens frame turned about x: y changes its sign, as z does.
    edges = [value + 0.0 for x, y, distance in surface.edges for value in (x, sign * y, distance)]
    return [
        vertex_mm + 0.0,
        sign * surface.curvature_per_mm + 0.0,
        index_ratio,
        surface.semi_diameter_mm**2,
        conic,
        terms,
        odd,
        surface.inner_semi_diameter_mm**2,
        len(edges) / 3,
        COEFFICIENTS + len(coefficients),
        0.0,
        0.0,
        float(form),
        *(sign * a + 0.0 for a in coefficients),
        *edges,
    ]


def _ideal(surface: Surface, sign: float) -> list[float]:
    """Power of an ideal thin lens, and its distortion; the lens frame has y up, which changes the sign of p2."""
    assert surface.focal_length_mm is not None
    if not surface.distortion:
        return [1 / surface.focal_length_mm]
    k1, k2, p1, p2, k3 = surface.distortion
    return [1 / surface.focal_length_mm, 1 / surface.image_distance_mm, k1, k2, p1, -sign * p2, k3]


def _polynomial(surface: Surface) -> tuple[list[float], bool]:
    """Coefficients without trailing zeros, and whether they include odd powers."""
    even, odd = surface.even_coefficients, surface.odd_coefficients
    if not any(odd):
        return _trimmed(even), False
    coefficients = [0.0] * (2 * max(len(even), len(odd)))
    coefficients[: 2 * len(even) : 2] = even
    coefficients[1 : 2 * len(odd) : 2] = odd
    return _trimmed(coefficients), True


def _trimmed(coefficients: tuple[float, ...] | list[float]) -> list[float]:
    """The coefficients up to the last one that is not zero."""
    used = max((i + 1 for i, a in enumerate(coefficients) if a != 0), default=0)
    return list(coefficients[:used])
