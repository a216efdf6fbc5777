"""A lens as its designer prints it: surfaces in the order in which light from the scene meets them."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pipeline.errors import PipelineError
from pipeline.optics.glass.medium import GAS
from pipeline.records.declared import settle
from pipeline.records.shapes import Float64

UPRIGHT_DEG = 90.0
"""Smallest tilt at which a surface no longer faces the light [deg]."""
_HEIGHTS = 64
"""Number of equal parts of a semi-diameter at whose ends the gap of two surfaces is evaluated: sags are smooth in
between."""


_LEAST_HEIGHTS = 4
"""Fewest heights along an axis of a relief: those of a cubic."""


class PrescriptionError(PipelineError):
    """A lens that cannot exist, or cannot be traced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Relief:
    """Sags on an even grid about the vertex, interpolated by a bicubic spline.

    - `heights_mm`: rows along x, from the least y of the lens frame on; at least four rows of four.
    - `spacing_mm`: distance of neighbours along x and y.
    """

    heights_mm: tuple[tuple[float, ...], ...]
    spacing_mm: float

    def __post_init__(self) -> None:
        settle(self, PrescriptionError, finite=("heights_mm",))
        columns = {len(row) for row in self.heights_mm}
        if len(columns) != 1 or min(*columns, len(self.heights_mm)) < _LEAST_HEIGHTS or not self.spacing_mm > 0:
            raise PrescriptionError(
                f"a relief has {len(self.heights_mm)} rows of {sorted(columns)} heights, {self.spacing_mm} mm apart",
                hint="at least four rows of four, all of the same length",
                code="heights",
            )

    @property
    def half_widths_mm(self) -> tuple[float, float]:
        """Half widths of the grid along x and y."""
        rows, columns = len(self.heights_mm), len(self.heights_mm[0])
        return (columns - 1) / 2 * self.spacing_mm, (rows - 1) / 2 * self.spacing_mm

    @property
    def spline(self) -> np.ndarray:
        """B-spline coefficients, one more on each side, (rows + 2, columns + 2): not-a-knot, so cubics are exact."""
        coefficients = np.array(self.heights_mm)
        for _ in range(2):  # along y, then along x
            count = len(coefficients)
            equations = np.zeros((count + 2, count + 2))
            # The spline has the given height at each line, and no jump of its third derivative next to either edge.
            for line in range(count):
                equations[line, line : line + 3] = 1 / 6, 4 / 6, 1 / 6
            equations[count, :5] = equations[count + 1, -5:] = 1, -4, 6, -4, 1
            values = np.vstack([coefficients, np.zeros((2, coefficients.shape[1]))])
            coefficients = np.linalg.solve(equations, values).T
        return coefficients


def relief_at(
    spline: Float64[np.ndarray, "rows columns"], spacing_mm: float, point_mm: Float64[np.ndarray, "n 2"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights of a spline at points (n, 2), and slopes along x and y, (n,) each; NaN beyond the grid.

    `spline`: coefficients (rows, columns).
    """
    from scipy.interpolate import BSpline  # few lenses have a relief

    def basis(axis: int, order: int) -> np.ndarray:
        """B-splines along an axis at the points, or their derivatives of an order per spacing, (n, count)."""
        count = spline.shape[1 - axis]
        splines = BSpline(np.arange(-2, count + 2), np.eye(count), 3, extrapolate=False)
        return np.asarray(splines(point_mm[:, axis] / spacing_mm + (count - 1) / 2, nu=order))

    x, x_slope = basis(0, 0), basis(0, 1) / spacing_mm
    y, y_slope = basis(1, 0), basis(1, 1) / spacing_mm
    products = ((y, x), (y, x_slope), (y_slope, x))
    height, by_x, by_y = (np.einsum("ni,ij,nj->n", up, spline, across) for up, across in products)
    return height, by_x, by_y


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """One row of a prescription: a plane, sphere, conic or asphere about the axis.

    With r the height above the axis and c = 1 / radius the sag is
    c r^2 / (1 + sqrt(1 - (1 + conic) c^2 r^2)) + a2 r^2 + a3 r^3 + a4 r^4 + ..., positive towards the sensor.

    - `radius_mm`: radius of curvature, positive when the centre lies towards the sensor; `inf` is a plane.
    - `thickness_mm`: along the axis to the next vertex; of the last surface: the back focus as printed, unused.
    - `semi_diameter_mm`: half the clear aperture, a hard edge that blocks rays. Other apertures lie within its circle.
    - `index`: of the medium behind the surface, relative to air, at the prescription's wavelength.
    - `is_stop`: whether this is the aperture stop.
    - `conic`: 0 a sphere, -1 a paraboloid, below that a hyperboloid.
    - `even_coefficients`, `odd_coefficients`: a2, a4, a6, ... and a3, a5, a7, ... [mm^(1 - power)].
    - `inner_semi_diameter_mm`: half the central obstruction of an annular aperture; 0 for none.
    - `half_widths_mm`: half widths of a rectangular aperture.
    - `blades`: edges of a regular polygon whose corners lie on the circle of the semi-diameter; 0 for none.
    - `aperture_rotation_deg`: of rectangle or polygon, from +x towards +y of the lens frame; at 0 a corner of the
      polygon lies on +x.
    - `focal_length_mm`: that of an ideal thin lens; None for a surface. The lens is a plane in air that adds -height
      over focal length to the slope of a ray: a collineation, so every object plane has a sharp, undistorted image.
    - `distortion`: k1, k2, p1, p2, k3 of OpenCV, in the vision frame, by which an ideal thin lens that is the stop
      distorts its image (see `optics.brown`); empty: it does not.
    - `image_distance_mm`: behind that lens, of the plane whose image is distorted.
    - `decentre_mm`: distance of the vertex from the axis along x and y of the lens frame, or of its group.
    - `relief`: sags instead of a radius; first-order figures count a plane.
    - `is_cylinder`: whether it is curved along y alone: its sag is that of the height along y. No coefficients.
    - `tilt_deg`: turn about the vertex: first about x, then about y as it has been turned, right-handed.
    """

    radius_mm: Annotated[float, "plen:radius"] = math.inf
    thickness_mm: Annotated[float, "plen:thickness"] = 0.0
    semi_diameter_mm: Annotated[float, "plen:semiDiameter"]
    index: Annotated[float, "plen:index"] = 1.0
    is_stop: Annotated[bool, "plen:isStop"] = False
    conic: Annotated[float, "plen:conic"] = 0.0
    even_coefficients: Annotated[tuple[float, ...], "plen:evenCoefficients"] = ()
    odd_coefficients: Annotated[tuple[float, ...], "plen:oddCoefficients"] = ()
    inner_semi_diameter_mm: Annotated[float, "plen:innerSemiDiameter"] = 0.0
    half_widths_mm: Annotated[tuple[float, float] | None, "plen:halfWidths"] = None
    blades: Annotated[int, "plen:blades"] = 0
    aperture_rotation_deg: Annotated[float, "plen:apertureRotation"] = 0.0
    focal_length_mm: Annotated[float | None, "plen:focalLength"] = None
    distortion: tuple[float, ...] = ()
    image_distance_mm: float = 1.0
    decentre_mm: Annotated[tuple[float, float], "plen:decentre"] = (0.0, 0.0)
    tilt_deg: Annotated[tuple[float, float], "plen:tilt"] = (0.0, 0.0)
    is_cylinder: Annotated[bool, "plen:cylindrical"] = False
    relief: Relief | None = None

    def __post_init__(self) -> None:
        coefficients = "conic", "even_coefficients", "odd_coefficients"
        settle(self, PrescriptionError, infinite=("radius_mm", "semi_diameter_mm"), finite=coefficients)
        if self.radius_mm == 0 or math.isnan(self.radius_mm):
            raise PrescriptionError(f"a surface has radius {self.radius_mm}", hint="a plane has radius inf")
        if not self.semi_diameter_mm > 0:
            raise PrescriptionError(f"a surface has semi-diameter {self.semi_diameter_mm} mm")
        if not all(map(math.isfinite, (self.conic, *self.even_coefficients, *self.odd_coefficients))):
            raise PrescriptionError(
                f"conic constant {self.conic} or coefficients {self.even_coefficients}, {self.odd_coefficients} are not"
                " finite"
            )
        # Spheres and ellipsoids stand upright at their equator.
        if self.conic > -1 and self.semi_diameter_mm > abs(self.radius_mm) / math.sqrt(1.0 + self.conic):
            shape = "a sphere" if self.conic == 0 else f"a conic ({self.conic})"
            raise PrescriptionError(
                f"semi-diameter {self.semi_diameter_mm} mm reaches beyond {shape} of radius {self.radius_mm} mm",
                code="beyond-sphere",
            )
        if not 0 <= self.inner_semi_diameter_mm < self.semi_diameter_mm:
            raise PrescriptionError(
                f"a central obstruction of semi-diameter {self.inner_semi_diameter_mm} mm in an aperture of"
                f" {self.semi_diameter_mm} mm",
                code="aperture-value",
            )
        if self.half_widths_mm and not min(self.half_widths_mm) > 0:
            raise PrescriptionError(f"a rectangular aperture has half widths {self.half_widths_mm} mm")
        if self.blades and self.blades < 3:
            raise PrescriptionError(f"a polygonal aperture has {self.blades} blades")
        if self.relief is not None:
            self._check_relief(self.relief)
        if self.is_cylinder and any(self.even_coefficients + self.odd_coefficients):
            raise PrescriptionError(
                "a cylinder has coefficients", hint="its profile is a circle or a conic", code="shape"
            )
        if not self.index >= 1 - GAS:
            raise PrescriptionError(f"refractive index {self.index} is below that of a gas")
        if self.focal_length_mm is not None:
            self._check_ideal()
        elif self.distortion:
            raise PrescriptionError(
                "only an ideal thin lens has a distortion of its own",
                hint="give the surface a focal_length_mm, or no distortion",
                code="ideal-lens",
            )
        _check_displacement("a surface", self.decentre_mm, self.tilt_deg)

    def _check_relief(self, relief: Relief) -> None:
        """Raise a PrescriptionError if the surface has another shape, too, or an aperture beyond the heights."""
        if not math.isinf(self.radius_mm) or any(self.even_coefficients + self.odd_coefficients) or self.is_cylinder:
            hint = "write the whole sag into the heights"
            raise PrescriptionError("a surface has heights and another shape", hint=hint, code="heights")
        if self.semi_diameter_mm > min(relief.half_widths_mm):
            width, height = relief.half_widths_mm
            raise PrescriptionError(
                f"semi-diameter {self.semi_diameter_mm} mm reaches beyond its heights, {width} x {height} mm each way",
                hint="state heights up to its edge, or a smaller aperture",
                code="heights",
            )

    def _check_ideal(self) -> None:
        """Raise a PrescriptionError if the numbers of an ideal thin lens contradict each other."""
        if self.focal_length_mm == 0 or not math.isfinite(self.focal_length_mm or math.nan):
            raise PrescriptionError(
                f"an ideal thin lens has the focal length {self.focal_length_mm} mm", code="ideal-lens"
            )
        if not math.isinf(self.radius_mm) or any(self.even_coefficients + self.odd_coefficients) or self.index != 1:
            raise PrescriptionError(
                "an ideal thin lens has a shape or an index", hint="it is a plane in air", code="ideal-lens"
            )
        if self.distortion and (len(self.distortion) != 5 or not (self.is_stop and self.image_distance_mm > 0)):
            raise PrescriptionError(
                f"a distortion {self.distortion} of an image {self.image_distance_mm:g} mm behind a lens",
                hint="k1, k2, p1, p2, k3 of a lens that is the stop, with its image behind it",
                code="ideal-lens",
            )

    def power_per_mm(self, index_in_front: float) -> float:
        """Paraxial refracting power, an r^2 term included: the decrease of index times slope per height.

        A cylinder counts by the direction in which it has none.
        """
        if self.is_cylinder:
            return 0.0
        if self.focal_length_mm is not None:
            return 1 / self.focal_length_mm
        return (self.index - index_in_front) * (self.curvature_per_mm + 2 * sum(self.even_coefficients[:1]))

    @property
    def is_before_glass(self) -> bool:
        """Whether the medium behind it is more than a gas."""
        return self.index > 1 + GAS

    @property
    def curvature_per_mm(self) -> float:
        """1 / radius, 0 for a plane."""
        return 0.0 if math.isinf(self.radius_mm) else 1.0 / self.radius_mm

    @property
    def aperture(self) -> str:
        """The clear aperture in words."""
        if self.half_widths_mm:
            width, height = (2 * half for half in self.half_widths_mm)
            return f"rectangular, {width} x {height} mm"
        across = f"diameter {2 * self.semi_diameter_mm} mm"
        if self.blades:
            return f"polygonal, {self.blades} blades, {across} from corner to corner of its circle"
        if self.inner_semi_diameter_mm:
            return f"annular, {across}, obstruction {2 * self.inner_semi_diameter_mm} mm"
        return f"circular, {across}"

    @property
    def edges(self) -> tuple[tuple[float, float, float], ...]:
        """Straight edges of the aperture: (x, y) of the outward normal in the lens frame, distance from the axis [mm].

        A circular aperture has none.
        """
        turn = math.radians(self.aperture_rotation_deg)
        edges = []
        if self.half_widths_mm:
            width, height = self.half_widths_mm
            edges += [(turn + i * math.pi / 2, width if i % 2 == 0 else height) for i in range(4)]
        if self.blades:
            inradius = self.semi_diameter_mm * math.cos(math.pi / self.blades)
            edges += [(turn + (2 * i + 1) * math.pi / self.blades, inradius) for i in range(self.blades)]
        return tuple((math.cos(angle), math.sin(angle), distance) for angle, distance in edges)

    def sag_mm(self, height_mm: float) -> float:
        """Sag of the surface at a height above the axis, of a relief along y [mm]."""
        c = self.curvature_per_mm
        base = c * height_mm**2 / (1.0 + math.sqrt(1.0 - (1.0 + self.conic) * (c * height_mm) ** 2))
        if self.relief is not None:
            return float(relief_at(self.relief.spline, self.relief.spacing_mm, np.array([[0.0, height_mm]]))[0][0])
        even = sum(a * height_mm ** (2 * i + 2) for i, a in enumerate(self.even_coefficients))
        odd = sum(a * height_mm ** (2 * i + 3) for i, a in enumerate(self.odd_coefficients))
        return base + even + odd


def least_gap_mm(front: Surface, behind: Surface) -> float:
    """Least axial gap between neighbouring surfaces within both apertures; negative: they cross. [mm]"""
    return min(gap for gap, _ in gaps_mm(front, behind))


def gaps_mm(front: Surface, behind: Surface) -> list[tuple[float, float]]:
    """Axial gaps between neighbouring surfaces, each with its height above the axis. [mm]

    Spheres are closest on the axis or at the edge; aspheres may be so in between, and 64 heights are tried.
    """
    edge = min(front.semi_diameter_mm, behind.semi_diameter_mm)
    is_sphere = [not (s.relief or s.conic or s.even_coefficients or s.odd_coefficients) for s in (front, behind)]
    steps = 1 if all(is_sphere) else _HEIGHTS
    heights = [edge * i / steps for i in range(steps + 1)]
    return [(front.thickness_mm + behind.sag_mm(h) - front.sag_mm(h), h) for h in heights]


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Consecutive surfaces in one mount: when displaced, they move together as a rigid body."""

    name: str
    first: int  # its first surface, counted from 0
    count: int
    # from the axis along x and y of the lens frame
    decentre_mm: Annotated[tuple[float, float], "plen:decentre"] = (0.0, 0.0)
    # about the pivot: first about x, then about the turned y
    tilt_deg: Annotated[tuple[float, float], "plen:tilt"] = (0.0, 0.0)
    roll_deg: float = 0.0  # about the axis, before the tilt
    # position of the pivot on the axis, from the vertex of the first surface, + towards the sensor
    pivot_mm: Annotated[float, "plen:pivot"] = 0.0

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)
        if self.first < 0 or self.count < 1:
            raise PrescriptionError(f'group "{self.name}" holds no surface')
        _check_displacement(f'group "{self.name}"', self.decentre_mm, self.tilt_deg)

    @property
    def members(self) -> range:
        """Numbers of the surfaces in the group."""
        return range(self.first, self.first + self.count)


def _check_displacement(subject: str, decentre_mm: tuple[float, float], tilt_deg: tuple[float, float]) -> None:
    """Raise a PrescriptionError about a subject whose displacement is not finite, or turns it from the light."""
    if not all(map(math.isfinite, decentre_mm)):
        raise PrescriptionError(f"{subject} is decentred by {decentre_mm} mm")
    if not all(abs(angle) < UPRIGHT_DEG for angle in tilt_deg):
        raise PrescriptionError(f"{subject} is tilted by {tilt_deg} deg", hint="less than 90 deg either way")


@dataclass(frozen=True, slots=True, kw_only=True)
class Prescription:
    """Surfaces from the scene to the sensor, with exactly one aperture stop.

    Lens frame: origin at the first vertex, +z from scene to sensor. Vertices and thicknesses are those of the centred
    lens: a displaced surface or group moves nothing but itself. Groups do not overlap.
    """

    surfaces: tuple[Surface, ...]
    groups: tuple[Group, ...] = ()
    index_in_front: float = 1.0  # of the medium before the first surface, relative to air

    def __post_init__(self) -> None:
        settle(self, PrescriptionError)
        grouped = [i for group in self.groups for i in group.members]
        if len(set(grouped)) < len(grouped) or not set(grouped) <= set(range(len(self.surfaces))):
            raise PrescriptionError(
                f"groups hold the surfaces {sorted(grouped)} of {len(self.surfaces)}",
                hint="a group holds consecutive surfaces of the prescription, and no surface is in two groups",
            )
        if not self.index_in_front > 0:
            raise PrescriptionError(f"the medium before the lens has the index {self.index_in_front}")
        before = (self.index_in_front, *(surface.index for surface in self.surfaces))
        for index, surface in zip(before, self.surfaces, strict=False):
            if surface.focal_length_mm is not None and index != 1:
                hint = "it stands in air, of index 1: in another medium, behind a window with air behind it"
                raise PrescriptionError(f"an ideal thin lens stands in a medium of index {index:g}", hint=hint)
        stops = sum(surface.is_stop for surface in self.surfaces)
        if stops != 1:
            raise PrescriptionError(f"a prescription needs exactly one aperture stop, this one has {stops}")

    @property
    def vertices_mm(self) -> tuple[float, ...]:
        """z of each vertex in the lens frame [mm]."""
        positions = [0.0]
        for surface in self.surfaces[:-1]:
            positions.append(positions[-1] + surface.thickness_mm)
        return tuple(positions)

    @property
    def is_centred(self) -> bool:
        """Whether all surfaces are round, and no surface and no group is displaced."""
        parts: tuple[Surface | Group, ...] = (*self.surfaces, *self.groups)
        rolls = (group.roll_deg for group in self.groups)
        if any(surface.is_cylinder or surface.relief for surface in self.surfaces):
            return False
        return not any((*(value for part in parts for value in (*part.decentre_mm, *part.tilt_deg)), *rolls))

    @property
    def stop_index(self) -> int:
        """Number of the surface that is the aperture stop, counted from 0."""
        return next(i for i, surface in enumerate(self.surfaces) if surface.is_stop)

    @property
    def ideal(self) -> Surface | None:
        """The ideal thin lens if it is the only surface, else None."""
        return self.stop if len(self.surfaces) == 1 and self.stop.focal_length_mm is not None else None

    @property
    def stop(self) -> Surface:
        return self.surfaces[self.stop_index]

    @property
    def vertices_from_stop_mm(self) -> tuple[float, ...]:
        """z of each vertex, counted from the stop, + towards the sensor [mm]."""
        stop_mm = self.vertices_mm[self.stop_index]
        return tuple(z - stop_mm for z in self.vertices_mm)
