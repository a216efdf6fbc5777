"""A lens as a publication or a file of another program prints it, before it is checked whether it can be traced.

Statements of the source that have no equivalent here are kept as `Lost`: named, not dropped.
"""

import math
from dataclasses import dataclass, fields

from pipeline.optics.prescription import Prescription, PrescriptionError, Surface

D_LINE_NM = 587.56
"""The helium d line in air [nm], to which printed indices belong unless a source says otherwise."""


@dataclass(frozen=True, slots=True)
class Lost:
    """A statement of a source, in one sentence, that does not become part of the lens."""

    statement: str
    line: int | None = None  # line of the source that says it, counted from 1


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedSurface:
    """One row of a printed prescription; fields and signs are those of `prescription.Surface`. None: not stated."""

    radius_mm: float = math.inf
    thickness_mm: float = 0.0
    semi_diameter_mm: float | None = None
    index: float = 1.0  # of the medium behind the surface at the wavelength of the lens
    glass: str = ""  # name of that medium as printed; empty for air and for a glass that has no name
    abbe: float | None = None
    is_stop: bool = False
    conic: float = 0.0
    asphere: tuple[tuple[int, float], ...] = ()  # powers p of the height, coefficients [mm^(1 - p)]; zeros left out
    inner_semi_diameter_mm: float = 0.0
    half_widths_mm: tuple[float, float] | None = None
    blades: int = 0
    aperture_rotation_deg: float = 0.0
    focal_length_mm: float | None = None
    decentre_mm: tuple[float, float] = (0.0, 0.0)
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    is_cylinder: bool = False

    def power_per_mm(self, index_in_front: float) -> float:
        """Paraxial refracting power, an r^2 term included."""
        if self.focal_length_mm is not None:
            return 1 / self.focal_length_mm
        if self.is_cylinder:
            return 0.0
        curvature = (0.0 if math.isinf(self.radius_mm) else 1 / self.radius_mm) + 2 * dict(self.asphere).get(2, 0.0)
        return (self.index - index_in_front) * curvature

    def coefficients(self, first: int) -> tuple[float, ...]:
        """Coefficients of the powers `first`, `first` + 2, ... up to the last one that is not zero."""
        terms = dict(self.asphere)
        last = max((power for power in terms if power % 2 == first % 2), default=0)
        return tuple(terms.get(power, 0.0) for power in range(first, last + 1, 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedLens:
    """A printed lens and its provenance."""

    name: str  # for people
    provenance: tuple[str, ...] = ()  # paragraphs: publication, where the numbers were read, notes
    surfaces: tuple[PrintedSurface, ...]  # from the scene to the sensor; neither object nor image
    wavelength_nm: float = D_LINE_NM  # to which the indices belong
    nominal_efl_mm: float | None = None  # stated for an object at infinity, as the back focal distance is
    nominal_bfd_mm: float | None = None
    lost: tuple[Lost, ...] = ()


def prescription_of(lens: PrintedLens) -> Prescription:
    """The lens as it is traced; a PrescriptionError that names every surface that cannot be represented."""
    wrong = [
        f"surface {i}: {reason}" for i, surface in enumerate(lens.surfaces, 1) for reason in not_representable(surface)
    ]
    if wrong:
        raise PrescriptionError(f'"{lens.name}" cannot be represented: {"; ".join(wrong)}')
    if lens.surfaces and lens.surfaces[-1].index != 1:
        raise PrescriptionError(f'"{lens.name}" ends in a medium of index {lens.surfaces[-1].index}, not in air')
    return Prescription(surfaces=tuple(surface_of(surface, i) for i, surface in enumerate(lens.surfaces, 1)))


def not_representable(surface: PrintedSurface) -> list[str]:
    """Reasons why a surface cannot be represented; this is the only list of them."""
    reasons = []
    if dict(surface.asphere).get(1):
        reasons.append("the term r^1 of its asphere makes the vertex a tip")
    if surface.half_widths_mm and surface.inner_semi_diameter_mm:
        reasons.append("its aperture is a rectangle with an obstruction")
    if surface.semi_diameter_mm is None:
        reasons.append("its semi-diameter is not known")
    if not surface.thickness_mm >= 0:
        reasons.append(f"thickness {surface.thickness_mm:g} mm leads back towards the scene")
    return reasons


def surface_of(surface: PrintedSurface, number: int = 0) -> Surface:
    """The surface as it is traced; `number` identifies it in the PrescriptionError if it cannot be."""
    try:
        shared = {field.name: getattr(surface, field.name) for field in fields(Surface) if hasattr(surface, field.name)}
        even, odd = surface.coefficients(2), surface.coefficients(3)
        return Surface(**shared, even_coefficients=even, odd_coefficients=odd)
    except PrescriptionError as error:
        raise PrescriptionError(f"surface {number}: {error.message}", hint=error.hint) from None
