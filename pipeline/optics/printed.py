"""A lens as a publication or a file of another program prints it, before it is known whether we can build it.

What the source says and we cannot represent is kept as `Lost`: named, not dropped.
"""

import math
from dataclasses import dataclass

from pipeline.optics.prescription import Prescription, PrescriptionError, Surface

D_LINE_NM = 587.56
"""The helium d line in air [nm], to which printed indices belong unless a source says otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lost:
    """Something that a source says and that does not become part of the lens.

    Attributes
    ----------
    what : str
        One sentence.
    line : int or None
        Line of the source that says it, counted from 1.
    """

    what: str
    line: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedSurface:
    """One row of a printed prescription. Radius, thickness and signs are those of `prescription.Surface`.

    Attributes
    ----------
    semi_diameter_mm : float or None
        Semi-diameter; None where the source does not state it.
    index, abbe : float, float or None
        Medium behind the surface at the wavelength of the lens; Abbe number, None where unknown.
    glass : str
        Name of that medium as printed; empty for air and for a glass that has no name.
    conic : float
        Conic constant; 0 is a sphere.
    asphere : tuple of (int, float)
        Powers p of the height and their coefficients [mm^(1 - p)], zeros left out.
    inner_semi_diameter_mm, half_widths_mm, blades, aperture_rotation_deg
        Figures of an annular, a rectangular or a polygonal aperture, as in `prescription.Surface`.
    focal_length_mm : float or None
        Focal length of an ideal thin lens.
    """

    radius_mm: float = math.inf
    thickness_mm: float = 0.0
    semi_diameter_mm: float | None = None
    index: float = 1.0
    glass: str = ""
    abbe: float | None = None
    is_stop: bool = False
    conic: float = 0.0
    asphere: tuple[tuple[int, float], ...] = ()
    inner_semi_diameter_mm: float = 0.0
    half_widths_mm: tuple[float, float] | None = None
    blades: int = 0
    aperture_rotation_deg: float = 0.0
    focal_length_mm: float | None = None

    def power_per_mm(self, index_in_front: float) -> float:
        """Refracting power near the axis, where an r^2 term bends, too."""
        if self.focal_length_mm is not None:
            return 1 / self.focal_length_mm
        curvature = (0.0 if math.isinf(self.radius_mm) else 1 / self.radius_mm) + 2 * dict(self.asphere).get(2, 0.0)
        return (self.index - index_in_front) * curvature

    def coefficients(self, first: int) -> tuple[float, ...]:
        """Coefficients of the powers `first`, `first` + 2, ... up to the last one that is not zero."""
        terms = dict(self.asphere)
        last = max((power for power in terms if power % 2 == first % 2), default=0)
        return tuple(terms.get(power, 0.0) for power in range(first, last + 1, 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedLens:
    """A lens with what is known about where it comes from.

    Attributes
    ----------
    name : str
        For people.
    provenance : tuple of str
        Paragraphs: publication, where the numbers were read, notes.
    surfaces : tuple of PrintedSurface
        Surfaces from the scene to the sensor; neither object nor image.
    wavelength_nm : float
        Wavelength to which the indices belong.
    nominal_efl_mm, nominal_bfd_mm : float or None
        Values that the source states, for an object at infinity; None where it does not.
    lost : tuple of Lost
        Statements of the source that this record cannot hold.
    """

    name: str
    provenance: tuple[str, ...] = ()
    surfaces: tuple[PrintedSurface, ...]
    wavelength_nm: float = D_LINE_NM
    nominal_efl_mm: float | None = None
    nominal_bfd_mm: float | None = None
    lost: tuple[Lost, ...] = ()


class NotRepresentable(PrescriptionError):
    """A lens that somebody can build, but not we."""


def prescription_of(lens: PrintedLens) -> Prescription:
    """The lens as it is traced.

    Raises
    ------
    PrescriptionError
        The lens cannot exist, or cannot be represented; it names all surfaces that are to blame.
    """
    wrong = [
        f"surface {i}: {what}" for i, surface in enumerate(lens.surfaces, 1) for what in not_representable(surface)
    ]
    if wrong:
        raise NotRepresentable(f'"{lens.name}" cannot be represented: {"; ".join(wrong)}')
    if lens.surfaces and lens.surfaces[-1].index != 1:
        raise NotRepresentable(f'"{lens.name}" ends in a medium of index {lens.surfaces[-1].index}, not in air')
    return Prescription(surfaces=tuple(_surface(surface, i) for i, surface in enumerate(lens.surfaces, 1)))


def not_representable(surface: PrintedSurface) -> list[str]:
    """Reason why one surface cannot be represented: the only place that says so."""
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


def _surface(surface: PrintedSurface, number: int) -> Surface:
    assert surface.semi_diameter_mm is not None  # not_representable has said so
    try:
        return Surface(
            radius_mm=surface.radius_mm,
            thickness_mm=surface.thickness_mm,
            semi_diameter_mm=surface.semi_diameter_mm,
            index=surface.index,
            is_stop=surface.is_stop,
            conic=surface.conic,
            even_coefficients=surface.coefficients(2),
            odd_coefficients=surface.coefficients(3),
            inner_semi_diameter_mm=surface.inner_semi_diameter_mm,
            half_widths_mm=surface.half_widths_mm,
            blades=surface.blades,
            focal_length_mm=surface.focal_length_mm,
            aperture_rotation_deg=surface.aperture_rotation_deg,
        )
    except PrescriptionError as error:
        raise PrescriptionError(f"surface {number}: {error.what}", hint=error.hint) from None
