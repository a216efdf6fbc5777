"""Microlens arrays: the record, and the faces of thick microlenses. Lengths in mm.

Lattice, types and models: CONVENTIONS.md, "Microlens lattice".
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from pipeline.camera.parts.errors import CameraError
from pipeline.errors import PipelineError
from pipeline.optics import table as column
from pipeline.optics.first_order import FirstOrder, first_order
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_scene
from pipeline.records.declared import settle
from pipeline.records.shapes import Float64

PLANE_LIKE = 1e-9
"""Semi-diameter within which every surface is as flat as a plane, for paraxial figures [mm]."""

_MOST_EDGES = 6
"""Straight edges for which a table of faces has room: those of a hexagonal cell; a square one has four."""
SIN_60 = math.sqrt(3) / 2
"""Distance of the lines of a hexagonal lattice over its pitch [1]."""
LAYOUTS = ("hexagonal", "hexagonal-columns", "square")
MODELS = ("thin", "two-plane", "refractive")
_AGREES = 1e-9
"""Relative tolerance between a stated focal length and that of the faces: rounding."""
LEAST_MM = 1e-9
"""Least length of an array [mm]: less than an atom, and ratios to it stay finite."""
_STRETCH = (0.75, 4 / 3)
"""Ratios of the pitches within which a cell of a stretched hexagonal lattice keeps its six edges."""


@dataclass(frozen=True, slots=True)
class Faces:
    """The front face of a microlens towards the scene, the rear face towards the sensor, and the medium between them.

    Radii are positive when the centre lies towards the sensor; inf is a plane. A plane is shared by the array and
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
        """Whether the front face is the aperture: a curved rear face takes precedence."""
        return not self.curved[1]

    def prescription(self, semi_diameter_mm: float) -> Prescription:
        """Both faces up to a semi-diameter; the rear vertex is the origin."""
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

    `cell`: corners of the lattice cell, counter-clockwise; `radius_mm`: that of a disc that replaces it as the
    aperture.
    `flat`: whether the front face is traced as the plane through its vertex without refraction: the two-plane model.
    """
    corner = float(np.hypot(*cell.T).max()) if radius_mm is None else radius_mm
    curved = faces.curved
    table = towards_scene(faces.prescription(PLANE_LIKE if flat else corner))
    rows = [append_edges(row, cell if curved[1 - i] and radius_mm is None else None) for i, row in enumerate(table)]
    table = np.stack(rows)
    for i in range(2):
        if curved[1 - i] and radius_mm is not None:
            table[i, column.SEMI_DIAMETER_SQUARED] = radius_mm**2
        elif curved[1 - i]:
            table[i, column.SEMI_DIAMETER_SQUARED] = (1 + 1e-12) * corner**2
    if flat:
        table[1, [column.CURVATURE, column.INDEX_RATIO, column.CONIC]] = 0.0, 1.0, 0.0
    return table


def append_edges(row: Float64[np.ndarray, "n"], cell: Float64[np.ndarray, "m 2"] | None) -> np.ndarray:
    """A row of a table with a polygonal aperture, given by its corners, or with empty columns for one."""
    base = row[: column.COEFFICIENTS].copy()
    edges = np.zeros(0)
    if cell is not None:
        along = np.roll(cell, -1, axis=0) - cell
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
        edges = np.column_stack([normal, np.sum(normal * cell, axis=1)]).ravel()
        base[column.EDGES] = len(cell)
    base[column.FIRST_EDGE] = column.COEFFICIENTS
    return np.concatenate([base, edges, np.zeros(3 * _MOST_EDGES - len(edges))])


@dataclass(frozen=True, slots=True, kw_only=True)
class MicrolensArray:
    """Microlenses on a regular lattice.

    - `layout`: `hexagonal`, rows along +x; `hexagonal-columns`, columns along +y; `square`.
    - `pitch_mm`: distance of neighbouring vertices, along the rows (of hexagonal-columns: along the columns).
    - `cross_pitch_mm`: pitch across that direction; None: equal to `pitch_mm`.
    - `focal_lengths_mm`: one per type. Of refractive microlenses it follows from their faces, and may be left out.
    - `type_table`, `type_period`: microlens (k, l) has the type table[(l mod period_l) period_k + k mod period_k].
      Without a table one type is everywhere, and three on a hexagonal lattice follow (k - l) mod 3.
    - `width_mm`, `height_mm`: extent of the array: a microlens exists where its vertex lies inside.
    - `columns`, `rows`: instead of the extent, the number of microlenses along x and y, before the rotation.
    - `distance_mm`: from the sensor to the plane of thin microlenses, else to the vertices of the faces towards it.
    - `rotation_deg`: of the lattice, from +x towards +y of the sensor frame.
    - `offset_x_mm`, `offset_y_mm`: microlens (0, 0) from the sensor's centre, sensor frame: both move together.
    - `tilt_x_deg`, `tilt_y_deg`: turn of the array about microlens (0, 0), first about x, then about y of the sensor
      frame (z to the scene, right-handed: a positive tilt about x brings microlenses at +y nearer to the scene).
    - `aperture`: `cell`, the lattice cell; `disc`, a disc of `disc_diameter_mm` in an opaque plate.
    - `model`: `thin`, `two-plane` or `refractive`.
    - `index`, `thickness_mm`: at the camera's wavelength, from vertex to vertex; two-plane and refractive only.
    - `front_radii_mm`, `rear_radii_mm`: of refractive microlenses, one per type: faces towards scene and sensor;
      positive when the centre lies towards the sensor, inf is a plane.
    - `front_conics`, `rear_conics`: one per type; empty: spheres.
    """

    layout: Annotated[str, "plen:layout"] = "hexagonal"
    pitch_mm: Annotated[float, "plen:pitch"]
    cross_pitch_mm: Annotated[float | None, "plen:crossPitch"] = None
    focal_lengths_mm: tuple[float, ...] = ()
    type_table: Annotated[tuple[int, ...], "plen:typeTable"] = ()
    type_period: Annotated[tuple[int, int] | None, "plen:typePeriod"] = None
    width_mm: Annotated[float | None, "plen:width"] = None
    height_mm: Annotated[float | None, "plen:height"] = None
    columns: Annotated[int | None, "plen:columns"] = None
    rows: Annotated[int | None, "plen:rows"] = None
    distance_mm: float
    rotation_deg: Annotated[float, "plen:rotation"] = 0.0
    offset_x_mm: float = 0.0
    offset_y_mm: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0
    aperture: Annotated[str, "plen:aperture"] = "cell"
    disc_diameter_mm: Annotated[float | None, "plen:discDiameter"] = None
    model: Annotated[str, "plen:model"] = "thin"
    index: float | None = None
    thickness_mm: Annotated[float | None, "plen:thickness"] = None
    front_radii_mm: Annotated[tuple[float, ...], "plen:frontRadii"] = ()
    rear_radii_mm: Annotated[tuple[float, ...], "plen:rearRadii"] = ()
    front_conics: Annotated[tuple[float, ...], "plen:frontConics"] = ()
    rear_conics: Annotated[tuple[float, ...], "plen:rearConics"] = ()

    def __post_init__(self) -> None:
        settle(self, CameraError, infinite=("front_radii_mm", "rear_radii_mm"))
        if self.layout not in LAYOUTS or self.model not in MODELS:
            raise CameraError(f'no microlens layout "{self.layout}" or no model "{self.model}"')
        self._check_lattice()
        if self.model == "refractive":
            derived = tuple(lens.efl_mm for lens in self.first_orders)
            stated = self.focal_lengths_mm or derived
            pairs = zip(stated, derived, strict=False)
            if len(stated) != len(derived) or any(abs(a / b - 1) > _AGREES for a, b in pairs):
                raise CameraError(f"focal lengths {stated} mm are not those of the faces, {derived} mm")
            object.__setattr__(self, "focal_lengths_mm", derived)
        if not self.focal_lengths_mm or not min(self.pitch_mm, self.distance_mm, *self.focal_lengths_mm) > LEAST_MM:
            raise CameraError(
                f"microlenses {self.pitch_mm} mm apart, {self.distance_mm} mm away, f = {self.focal_lengths_mm} mm",
                hint="pitch, distance and at least one focal length are positive",
            )
        self._check_types()
        if self.model == "two-plane":
            _ = self.first_orders

    def _check_lattice(self) -> None:
        """Raise a CameraError if extent, pitches or apertures are missing, stated twice or impossible."""
        if (self.width_mm is None or self.height_mm is None) == (self.columns is None or self.rows is None):
            raise CameraError(
                "the size of the array is not stated, or twice", hint="give width and height, or columns and rows"
            )
        if min(1 if self.columns is None else self.columns, 1 if self.rows is None else self.rows) < 1:
            raise CameraError(f"an array of {self.columns} x {self.rows} microlenses")
        if not self.pitch_mm > LEAST_MM:
            raise CameraError(f"microlenses stand {self.pitch_mm} mm apart", hint="a positive pitch")
        cross = self.pitch_mm if self.cross_pitch_mm is None else self.cross_pitch_mm
        if not _STRETCH[0] < cross / self.pitch_mm < _STRETCH[1]:
            raise CameraError(f"microlens pitches {self.pitch_mm:g} and {cross:g} mm differ by more than a third")
        if self.aperture not in ("cell", "disc") or (self.aperture == "disc") != (self.disc_diameter_mm is not None):
            raise CameraError(
                f'aperture "{self.aperture}" with a disc diameter of {self.disc_diameter_mm} mm',
                hint='apertures are "cell", without a diameter, or "disc", with one',
            )
        if self.disc_diameter_mm is not None and not 0 < self.disc_diameter_mm <= self.nearest_mm + 1e-12:
            raise CameraError(
                f"discs of {self.disc_diameter_mm:g} mm overlap: neighbours stand {self.nearest_mm:g} mm apart"
            )

    def _check_types(self) -> None:
        """Raise a CameraError if the table of types does not fit its period or the focal lengths."""
        count = len(self.focal_lengths_mm)
        if bool(self.type_table) != (self.type_period is not None):
            raise CameraError(
                "a type table without a period, or a period without a table", hint="give both, or neither"
            )
        if self.type_period is None:
            if count != 1 and not (count == 3 and self.layout != "square"):
                raise CameraError(f"{count} microlens types need a type table; rules exist for 1, and 3 on hexagons")
            return
        along, across = self.type_period
        if min(along, across) < 1 or len(self.type_table) != along * across:
            raise CameraError(f"a type table of {len(self.type_table)} entries for a period of {along} x {across}")
        if set(self.type_table) != set(range(count)):
            raise CameraError(f"a type table must use every one of {count} types, counted from 0")

    def with_index(self, index: float) -> "MicrolensArray":
        """The faces made of a glass of another index, with other focal lengths. Thin microlenses have no index."""
        if self.model == "thin" or self.index is None or index == self.index:
            return self
        if self.model == "refractive":
            return replace(self, index=index, focal_lengths_mm=())
        focal = tuple(focal * (self.index - 1) / (index - 1) for focal in self.focal_lengths_mm)
        return replace(self, index=index, focal_lengths_mm=focal)

    @property
    def pitches_mm(self) -> tuple[float, float]:
        """Pitch along and across the rows, or columns, of microlenses."""
        return self.pitch_mm, self.pitch_mm if self.cross_pitch_mm is None else self.cross_pitch_mm

    @property
    def nearest_mm(self) -> float:
        """Distance of the nearest neighbours, which is the diameter of the widest disc."""
        along, across = self.pitches_mm
        return min(along, across if self.layout == "square" else math.hypot(along / 2, across * math.sqrt(3) / 2))

    @property
    def aperture_mm(self) -> float:
        """Width of an aperture: the diameter of a disc, or the pitch."""
        return self.pitch_mm if self.disc_diameter_mm is None else self.disc_diameter_mm

    @property
    def is_tilted(self) -> bool:
        """Whether the array is not parallel to the sensor."""
        return self.tilt_x_deg != 0 or self.tilt_y_deg != 0

    @property
    def is_plain(self) -> bool:
        """Whether microlenses are thin and parallel to the sensor."""
        return self.model == "thin" and not self.is_tilted

    @property
    def faces(self) -> tuple[Faces, ...]:
        """Both faces of each type; none for thin microlenses.

        The front face of a two-plane microlens is the sphere whose normals its plane has: R = f (index - 1).
        """
        if self.model == "thin":
            return ()
        if self.index is None or self.thickness_mm is None or not self.index > 1 or not self.thickness_mm > 0:
            raise CameraError(f"{self.model} microlenses need an index above 1 and a positive thickness")
        if self.model == "two-plane":
            radii = tuple(focal * (self.index - 1) for focal in self.focal_lengths_mm)
            return tuple(Faces(radius, math.inf, self.thickness_mm, self.index) for radius in radii)
        count = len(self.front_radii_mm)
        spheres = (0.0,) * count
        rows: list[tuple[float, ...]] = [self.front_radii_mm, self.rear_radii_mm]
        rows += [self.front_conics or spheres, self.rear_conics or spheres]
        if not count or any(len(row) != count for row in rows):
            raise CameraError(
                "refractive microlenses need a front and a rear radius per type, and as many conics or none"
            )
        types = zip(*rows, strict=True)
        return tuple(Faces(front, rear, self.thickness_mm, self.index, *conics) for front, rear, *conics in types)

    @property
    def first_orders(self) -> tuple[FirstOrder, ...]:
        """First-order figures per type; z counts from the vertices of the rear faces towards the scene."""
        try:
            return tuple(faces.first_order(PLANE_LIKE) for faces in self.faces)
        except PipelineError as error:
            raise CameraError(f"a microlens: {error.message}", hint=error.hint) from None

    @property
    def principal_mm(self) -> tuple[tuple[float, float], ...]:
        """Distances of the rear and the front principal plane of each type from the sensor. [mm]"""
        if self.model == "thin":
            return ((self.distance_mm, self.distance_mm),) * len(self.focal_lengths_mm)
        return tuple(
            (self.distance_mm + lens.rear_principal_mm, self.distance_mm + lens.front_principal_mm)
            for lens in self.first_orders
        )

    def is_unfocused(self, pixel_mm: float) -> bool:
        """Whether every type spreads infinity over at most such a pixel: micro-images show the pupil, not the scene."""
        focal = zip(self.focal_lengths_mm, self.principal_mm, strict=True)
        return all(abs(1 - behind_mm / f) * self.aperture_mm <= pixel_mm for f, (behind_mm, _) in focal)

    @property
    def reach_mm(self) -> float:
        """Distance of the front of the array from the sensor, without tilt."""
        return self.distance_mm + (0.0 if self.model == "thin" else self.thickness_mm or 0.0)
