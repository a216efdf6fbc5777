"""A lens: its prescription with surfaces and groups, and whether it can be built."""

import math
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

from pxr import Usd

from pipeline.errors import PipelineError
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Group, Prescription, PrescriptionError, Surface, gaps_mm
from pipeline.scene.dataset import LensEntry
from pipeline.scene.glass import index_source, ordered_surfaces, with_indices
from pipeline.scene.usd.problems import Problem, did_you_mean, of_reader, problem
from pipeline.scene.usd.values import UnreadableValue, need, read, read_once, target

APERTURE_VALUES = {
    "annular": {"inner_semi_diameter_mm": "plen:innerSemiDiameter"},
    "rectangular": {"half_widths_mm": "plen:halfWidths"},
    "polygonal": {"blades": "plen:blades"},
}
"""Attributes that set the size of an aperture, by shape and field of `Surface`."""

_TOUCH_MM = 1e-9
"""Overlap of surfaces that still counts as touching and is accepted [mm]: numbers in prescriptions have far fewer
digits.
"""
_STEEPEST = 10.0
"""Largest sag at the rim over the semi-diameter: 1 is a hemisphere."""
_BLAMED = {"ideal-lens": "plen:focalLength", "aperture-value": "plen:innerSemiDiameter"}
"""The attribute to mend, by the code of an error of a surface; other errors concern the whole surface."""
_THIN = 1 / 200
"""Ratio of rim thickness to diameter of an element below which there is a warning; the thinnest of the published
lenses in the library has 1/130.
"""
_NOMINAL = 0.05
"""Relative deviation from the nominal focal length above which there is a warning: names are round numbers."""


def read_lens_entry(stage: Usd.Stage) -> LensEntry | None:
    """The lens that is the default prim of a stage that passed the checks; None for any other stage."""
    prim = stage.GetDefaultPrim()
    if not prim or not prim.IsA("PlenLens"):
        return None
    return LensEntry(
        name=prim.GetName(),
        lens_name=need(prim, "plen:name") or prim.GetName(),
        index_source=index_source(prim, ordered_surfaces(prim)),
        wavelength_nm=need(prim, "plen:wavelength"),
        prescription=read_prescription(prim),
        stop_name=next(surface.GetName() for surface in ordered_surfaces(prim) if need(surface, "plen:isStop")),
    )


def lens_groups(lens: Usd.Prim) -> list[Usd.Prim]:
    """Groups of a lens, in stage order."""
    return [prim for prim in lens.GetChildren() if prim.IsA("PlenLensGroup")]


@read_once
def read_prescription(lens: Usd.Prim, wavelength_nm: float | None = None) -> Prescription:
    """The prescription of a PlenLens at a wavelength, by default that of its printed indices."""
    prims = ordered_surfaces(lens)
    surfaces = with_indices(lens, prims, [read_surface(prim) for prim in prims], wavelength_nm)
    groups = [read_group(prim, [surface.GetName() for surface in prims]) for prim in lens_groups(lens)]
    return Prescription(surfaces=surfaces, groups=tuple(sorted(groups, key=lambda group: group.first)))


def prescription_of(camera: Usd.Prim) -> Prescription:
    """The prescription of the lens of a Camera with PlenCameraAPI, at its wavelength."""
    return read_prescription(target(camera, "plen:camera:lens", "PlenLens"), read(camera, "plen:camera:wavelength"))


def read_group(prim: Usd.Prim, surfaces: list[str]) -> Group:
    """The record of a PlenLensGroup; `surfaces` holds the names of all surfaces of its lens in order."""
    names = need(prim, "plen:surfaces")
    first = surfaces.index(names[0]) if names and names[0] in surfaces else 0
    if not names or list(names) != surfaces[first : first + len(names)]:
        raise UnreadableValue(f"<{prim.GetPath()}> does not name surfaces that follow one another", prim)
    return Group(
        name=prim.GetName(),
        first=first,
        count=len(names),
        decentre_mm=need(prim, "plen:decentre"),
        tilt_deg=need(prim, "plen:tilt"),
        pivot_mm=need(prim, "plen:pivot"),
    )


@read_once
def read_surface(prim: Usd.Prim) -> Surface:
    """The record of a PlenSurface, with its printed index."""
    return Surface(
        radius_mm=need(prim, "plen:radius"),
        thickness_mm=need(prim, "plen:thickness"),
        semi_diameter_mm=need(prim, "plen:semiDiameter"),
        index=need(prim, "plen:index"),
        is_stop=need(prim, "plen:isStop"),
        conic=need(prim, "plen:conic"),
        even_coefficients=need(prim, "plen:evenCoefficients"),
        odd_coefficients=need(prim, "plen:oddCoefficients"),
        focal_length_mm=read(prim, "plen:focalLength"),
        decentre_mm=need(prim, "plen:decentre"),
        tilt_deg=need(prim, "plen:tilt"),
        **_read_aperture(prim),
    )


def _read_aperture(prim: Usd.Prim) -> dict[str, Any]:
    """Fields of the aperture of a surface, which lies inside the circle of its semi-diameter."""
    shape = need(prim, "plen:apertureShape")
    fields = {field: need(prim, name) for field, name in APERTURE_VALUES.get(shape, {}).items()}
    if shape in ("rectangular", "polygonal"):
        fields["aperture_rotation_deg"] = need(prim, "plen:apertureRotation")
    return fields


def check_lens(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenLens as a whole."""
    yield from _check_order(lens)
    prims = ordered_surfaces(lens)
    if not prims:
        return
    yield from _check_stop(lens, prims)
    parts = [_part(prim) for prim in prims]
    for part in parts:
        yield from _check_shape(part)
        yield from _check_steep(part)
    for front, behind in pairwise(parts):
        yield from _check_in_air(front, behind)
        crossing = list(_check_crossing(front, behind))
        yield from crossing or _check_rim(front, behind)
    last = parts[-1].surface
    if last and last.index != 1:
        message = f"the medium behind the last surface has index {last.index}, and only air (1) is supported yet"
        yield problem(prims[-1].GetAttribute("plen:index"), "not-yet-supported", message)


def check_nominal(lens: Usd.Prim) -> Iterator[Problem]:
    """A warning if the focal length of a PlenLens without errors is far from its nominal one."""
    nominal_mm = read(lens, "plen:nominalFocalLength")
    if not nominal_mm or nominal_mm <= 0:
        return
    try:
        prescription = read_prescription(lens)
    except PipelineError as error:
        yield of_reader(lens, error)
        return
    try:
        efl_mm = first_order(prescription).efl_mm
    except (PrescriptionError, ArithmeticError):
        efl_mm = math.inf  # A lens alone may be afocal, but then it goes by no focal length.
    if abs(efl_mm / nominal_mm - 1) <= _NOMINAL:
        return
    off = f"the lens has {efl_mm:.6g} mm, {100 * (efl_mm / nominal_mm - 1):+.3g} %"
    message = (
        f"the nominal focal length is {nominal_mm:g} mm, but {'the lens has no power' if math.isinf(efl_mm) else off}"
    )
    hint = "is a radius, an index or a thickness mistyped, or the whole table scaled?"
    attribute = lens.GetAttribute("plen:nominalFocalLength")
    yield problem(attribute, "focal-length", message, hint=hint, severity="warning")


def _check_order(lens: Usd.Prim) -> Iterator[Problem]:
    order = lens.GetAttribute("plen:surfaceOrder")
    names = list(read(lens, "plen:surfaceOrder") or ())
    children = [child.GetName() for child in lens.GetChildren() if child.IsA("PlenSurface")]
    for name, count in Counter(names).items():
        if count > 1:
            yield problem(order, "surface-order", f'"{name}" occurs {count} times in the order of the surfaces')
        if name not in children:
            hint = did_you_mean(name, children)
            yield problem(order, "surface-order", f'"{name}" is no PlenSurface below the lens', hint=hint)
    for name in sorted(set(children) - set(names)):
        message = f'surface "{name}" is missing in "plen:surfaceOrder"'
        yield problem(lens.GetChild(name), "surface-order", message)


def _check_stop(lens: Usd.Prim, prims: list[Usd.Prim]) -> Iterator[Problem]:
    stops = [prim.GetName() for prim in prims if read(prim, "plen:isStop")]
    if not stops:
        hint = "write uniform bool plen:isStop = 1 on one of its surfaces"
        yield problem(lens, "no-stop", "the lens has no aperture stop", hint=hint)
    elif len(stops) > 1:
        yield problem(lens, "several-stops", f"the lens has {len(stops)} aperture stops: {', '.join(stops)}")


class _Part(NamedTuple):
    """A surface: its prim, and its record or the reason why there is none."""

    prim: Usd.Prim
    surface: Surface | None = None
    error: PrescriptionError | UnreadableValue | None = None

    @property
    def name(self) -> str:
        return str(self.prim.GetName())


def _part(prim: Usd.Prim) -> _Part:
    try:
        surface = read_surface(prim)
    except (UnreadableValue, PrescriptionError) as error:
        return _Part(prim, error=error)
    finite = math.isfinite(surface.thickness_mm + surface.semi_diameter_mm + surface.index)
    return _Part(prim, surface if finite else None)


def _check_shape(part: _Part) -> Iterator[Problem]:
    """Problems of a surface whose values contradict each other or cannot be used."""
    error = part.error
    if isinstance(error, UnreadableValue):
        yield problem(error.thing, error.code, error.what)
    elif error is not None and error.code:
        attribute = _BLAMED.get(error.code)
        place = part.prim.GetAttribute(attribute) if attribute else part.prim
        yield problem(place, error.code, error.what, hint=error.hint)


def _check_steep(part: _Part) -> Iterator[Problem]:
    """A problem if an asphere is impossible: its sag at the rim is larger than that of any real one."""
    surface = part.surface
    if surface is None:
        return
    sag, most = surface.sag_mm(surface.semi_diameter_mm), _STEEPEST * surface.semi_diameter_mm
    if not abs(sag) <= most:
        message = (
            f"the sag of the surface at its rim is {sag:.4g} mm, and its semi-diameter {surface.semi_diameter_mm:g} mm"
        )
        hint = "are conic and coefficients those of millimetres, and in the right order?"
        yield problem(part.prim, "sag", message, hint=hint)


def _check_in_air(front: _Part, behind: _Part) -> Iterator[Problem]:
    first, second = front.surface, behind.surface
    if first and second and second.focal_length_mm is not None and first.index != 1:
        message = f'"{behind.name}", an ideal thin lens, is in a medium of index {first.index:g}, not in air'
        yield problem(behind.prim.GetAttribute("plen:focalLength"), "ideal-lens", message)


def _check_crossing(front: _Part, behind: _Part) -> Iterator[Problem]:
    first, second = front.surface, behind.surface
    if not first or not second:
        return
    gap, height = min(gaps_mm(first, second))
    if gap < -_TOUCH_MM:
        message = (
            f'surfaces "{front.name}" and "{behind.name}" cross: {first.thickness_mm:g} mm apart on the axis,'
            f" {gap:.4g} mm at {height:g} mm from it"
        )
        hint = "enlarge the thickness or reduce a semi-diameter"
        yield problem(front.prim.GetAttribute("plen:thickness"), "surfaces-cross", message, hint=hint)


def _check_rim(front: _Part, behind: _Part) -> Iterator[Problem]:
    """Problems of an element with no or hardly any thickness at its rim."""
    first, second = front.surface, behind.surface
    if not first or not second or first.index == 1:
        return
    widest = max(first.semi_diameter_mm, second.semi_diameter_mm)
    # Outside its clear aperture a surface may continue or be ground flat, whichever leaves more glass.
    flat = first.thickness_mm + second.sag_mm(second.semi_diameter_mm) - first.sag_mm(first.semi_diameter_mm)
    try:
        rim = max(flat, first.thickness_mm + second.sag_mm(widest) - first.sag_mm(widest))
    except ValueError:  # the sphere ends before this height
        rim = flat
    if rim >= 2 * widest * _THIN:
        return
    what = f'the element between "{front.name}" and "{behind.name}"'
    if rim < -_TOUCH_MM:
        message = f"{what} lacks {-rim:.4g} mm of glass at its rim, {widest:g} mm from the axis"
        severity = "error"
    else:
        message = f"{what} is {max(rim, 0.0):.4g} mm thick at its rim, {widest:g} mm from the axis"
        severity = "warning"
    hint = "enlarge the thickness or reduce a semi-diameter"
    yield problem(front.prim.GetAttribute("plen:thickness"), "rim-thickness", message, hint=hint, severity=severity)


def check_group_place(group: Usd.Prim) -> Iterator[Problem]:
    """A problem if a PlenLensGroup is not a child of a lens, so that no lens would read it."""
    if not group.GetParent().IsA("PlenLens"):
        message = "a PlenLensGroup must be a direct child of a PlenLens, and this one is not"
        yield problem(group, "misplaced-group", message, hint="groups hold surfaces of their lens, and no groups")


def check_groups(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the groups of a PlenLens: unknown surfaces, gaps, and surfaces that two groups hold."""
    order = [prim.GetName() for prim in ordered_surfaces(lens)]
    holder: dict[str, str] = {}
    for group in lens_groups(lens):
        attribute = group.GetAttribute("plen:surfaces")
        names = list(read(group, "plen:surfaces") or ())
        unknown = [name for name in names if name not in order]
        for name in unknown:
            message, hint = f'"{name}" is no surface of the lens', did_you_mean(name, order)
            yield problem(attribute, "group-surfaces", message, hint=hint)
        if not names and attribute.HasAuthoredValue():
            yield problem(attribute, "group-surfaces", "the group holds no surface", hint="name some, or remove it")
        if names and not unknown and names != _stretch(order, names):
            message = f"{', '.join(names)} do not follow one another in the order of the lens"
            yield problem(attribute, "group-surfaces", message, hint=f"its order: {', '.join(order)}")
        for name in names:
            if holder.setdefault(name, group.GetName()) != group.GetName():
                message = f'"{name}" belongs to the groups "{holder[name]}" and "{group.GetName()}"'
                yield problem(attribute, "group-surfaces", message, hint="a surface belongs to one group or to none")


def _stretch(order: list[str], names: list[str]) -> list[str]:
    first = order.index(names[0])
    return order[first : first + len(names)]
