"""Readers and checks of a lens: its prescription with surfaces, groups and glasses.

Dispersion formulas are evaluated here, while a stage is read: records carry plain numbers, and tasks know no glass.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from pxr import Sdf, Usd

from pipeline.errors import PipelineError
from pipeline.optics.first_order import first_order
from pipeline.optics.glass import row
from pipeline.optics.glass.medium import GlassError, Medium, Melt
from pipeline.optics.prescription import Group, Prescription, PrescriptionError, Relief, Surface, gaps_mm
from pipeline.scene.dataset import LensEntry
from pipeline.scene.temperature import expanded, temperatures_c, warmed
from pipeline.scene.usd.problems import Problem, of_reader, problem, warning
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import UnreadableValue, fields_of, need, read
from pipeline.spelling import did_you_mean

_TOUCH_MM = 1e-9
"""Overlap of surfaces that still counts as touching and is accepted [mm]: numbers in prescriptions have far fewer
digits.
"""
_STEEPEST = 10.0
"""Largest sag at the rim over the semi-diameter: 1 is a hemisphere."""
_BLAMED = {
    "heights": "plen:heights",
    "shape": "plen:cylindrical",
    "ideal-lens": "plen:focalLength",
    "aperture-value": "plen:innerSemiDiameter",
}
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
        index_source=index_source(prim),
        wavelength_nm=need(prim, "plen:wavelength"),
        prescription=read_prescription(prim),
        stop_name=next(surface.GetName() for surface in ordered_surfaces(prim) if need(surface, "plen:isStop")),
    )


def ordered_surfaces(lens: Usd.Prim) -> list[Usd.Prim]:
    """Surfaces of a lens or window in the order it states; names without a prim are left out."""
    named = [lens.GetChild(name) for name in read(lens, "plen:surfaceOrder") or () if name]
    return [prim for prim in named if prim and prim.IsA("PlenSurface")]


def lens_groups(lens: Usd.Prim) -> list[Usd.Prim]:
    """Groups of a lens, in stage order."""
    return [prim for prim in lens.GetChildren() if prim.IsA("PlenLensGroup")]


@read_once
def read_prescription(lens: Usd.Prim, wavelength_nm: float | None = None) -> Prescription:
    """The prescription of a PlenLens at a wavelength, by default that of its printed indices."""
    prims = ordered_surfaces(lens)
    behind = indices(lens, need(lens, "plen:wavelength") if wavelength_nm is None else wavelength_nm)
    shapes = expanded(lens, prims, [read_surface(prim) for prim in prims])
    groups = [_read_group(prim, [surface.GetName() for surface in prims]) for prim in lens_groups(lens)]
    return Prescription(
        surfaces=tuple(replace(surface, index=index) for surface, index in zip(shapes, behind, strict=True)),
        groups=tuple(sorted(groups, key=lambda group: group.first)),
    )


def _read_group(prim: Usd.Prim, surfaces: list[str]) -> Group:
    """The record of a PlenLensGroup; `surfaces` holds the names of all surfaces of its lens in order."""
    names = list(need(prim, "plen:surfaces"))
    if not names or names != _consecutive(surfaces, names):
        raise UnreadableValue(f"<{prim.GetPath()}> does not name surfaces that follow one another", prim)
    first = surfaces.index(names[0])
    return Group(name=prim.GetName(), first=first, count=len(names), **fields_of(prim, Group))


def _consecutive(order: list[str], names: list[str]) -> list[str]:
    """The slice of the order with as many surfaces as names, from the first name on."""
    first = order.index(names[0]) if names[0] in order else len(order)
    return order[first : first + len(names)]


@read_once
def read_surface(prim: Usd.Prim) -> Surface:
    """The record of a PlenSurface, with its printed index."""
    return Surface(relief=_read_relief(prim), **fields_of(prim, Surface))


def _read_relief(prim: Usd.Prim) -> Relief | None:
    """The heights of a surface; None: it has none."""
    heights, columns = need(prim, "plen:heights"), need(prim, "plen:heightColumns")
    if not heights:
        return None
    if len(heights) % columns:
        message = f'"plen:heights" has {len(heights)} entries, which are no rows of {columns} ("plen:heightColumns")'
        raise UnreadableValue(message, prim.GetAttribute("plen:heights"), code="heights")
    rows = tuple(tuple(heights[first : first + columns]) for first in range(0, len(heights), columns))
    return Relief(heights_mm=rows, spacing_mm=need(prim, "plen:heightSpacing"))


def uses_catalogue(lens: Usd.Prim) -> bool:
    """Whether the indices of a lens come from its glasses instead of print."""
    return bool(read(lens, "plen:indexSource") == "catalogue")


def knows_one_wavelength(lens: Usd.Prim) -> bool:
    """Whether indices of a lens are printed for one wavelength; an ideal thin lens has none, and works at any."""
    is_printed = read(lens, "plen:indexSource") == "printed"
    return is_printed and any(read(prim, "plen:index") != 1 for prim in ordered_surfaces(lens))


@read_once
def medium_behind(surface: Usd.Prim, lens: Usd.Prim) -> Medium:
    """The medium behind a surface; GlassError if its glass is unknown or contradicts the printed index."""
    has_index = surface.GetAttribute("plen:index").HasAuthoredValue()
    nominal = row.medium(
        glass=need(surface, "plen:glass"),
        index=need(surface, "plen:index") if has_index else None,
        abbe=read(surface, "plen:abbe"),
        wavelength_nm=need(lens, "plen:wavelength"),
    )
    offset = need(surface, "plen:indexOffset")
    return replace(nominal, dispersion=Melt(nominal.dispersion, offset)) if offset else nominal


def indices(lens: Usd.Prim, wavelength_nm: float) -> tuple[float, ...]:
    """Index behind each surface at a wavelength, or as printed; GlassError if a glass is not known there."""
    prims = ordered_surfaces(lens)
    if uses_catalogue(lens):
        stated = [medium_behind(prim, lens).index(wavelength_nm) for prim in prims]
    else:
        stated = [need(prim, "plen:index") + need(prim, "plen:indexOffset") for prim in prims]
    pairs = zip(prims, stated, strict=True)
    return tuple(warmed(lens, prim, index, wavelength_nm) + 0.0 for prim, index in pairs)


def index_source(lens: Usd.Prim) -> str:
    """Source of the indices of a lens for reports and tables, with the medium of every element."""
    from_c, to_c = temperatures_c(lens)
    temperature = "" if from_c == to_c else f" for {to_c:g} degrees Celsius"
    if not uses_catalogue(lens):
        return f"{need(lens, 'plen:indexSource')}{temperature}"
    labels = [medium_behind(prim, lens).label for prim in ordered_surfaces(lens)]
    return f"catalogue{temperature} ({', '.join(label for label in labels if label != 'air')})"


def media_behind(lens: Usd.Prim, prims: Sequence[Usd.Prim]) -> tuple[dict[Sdf.Path, Medium], list[Problem]]:
    """The media behind surfaces of a lens, by their paths, and the problems of media that cannot be found."""
    media, problems = dict[Sdf.Path, Medium](), list[Problem]()
    for prim in prims:
        try:
            media[prim.GetPath()] = medium_behind(prim, lens)
        except GlassError as error:
            problems.append(problem(attribute_of_medium(prim), error.code, error.message, hint=error.hint))
        except UnreadableValue as error:
            problems.append(of_reader(prim, error))
    return media, problems


def attribute_of_medium(surface: Usd.Prim) -> Usd.Property:
    """The attribute to mend a medium: its glass, or the one that replaces it."""
    names = ("plen:glass", "plen:index")
    written = (surface.GetAttribute(name) for name in names if surface.GetAttribute(name).HasAuthoredValue())
    return next(written, surface)


def check_glass(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the glasses of a PlenLens.

    Beside printed indices a bare name is information only, because many names are from old catalogues. A name with
    its vendor identifies an entry and is always compared with the printed index.
    """
    prims = ordered_surfaces(lens)
    is_used = uses_catalogue(lens)
    named = [prim for prim in prims if is_used or row.names_an_entry(read(prim, "plen:glass") or "")]
    media, problems = media_behind(lens, named)
    yield from problems
    last = media.get(prims[-1].GetPath()) if prims and is_used else None
    if last and last.label != "air" and read(prims[-1], "plen:index") == 1:  # else check_lens reports it
        message = f"the medium behind the last surface is {last.label}, and only air is supported yet"
        yield problem(attribute_of_medium(prims[-1]), "not-yet-supported", message)


def check_lens(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenLens as a whole."""
    prims = ordered_surfaces(lens)
    if not prims:
        yield from _check_order(lens)
        return
    stops = [prim.GetName() for prim in prims if read(prim, "plen:isStop")]
    if not stops:
        hint = "write uniform bool plen:isStop = 1 on one of its surfaces"
        yield problem(lens, "no-stop", "the lens has no aperture stop", hint=hint)
    elif len(stops) > 1:
        yield problem(lens, "several-stops", f"the lens has {len(stops)} aperture stops: {', '.join(stops)}")
    yield from check_surfaces(lens)
    if (read(prims[-1], "plen:index") or 1) != 1:
        message = f"the medium behind the last surface has index {read(prims[-1], 'plen:index')}, and only air (1) is"
        attribute = prims[-1].GetAttribute("plen:index")
        yield problem(attribute, "not-yet-supported", f"{message} supported yet")


def check_surfaces(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the surfaces of a PlenLens or PlenWindow, one by one and with their neighbours."""
    yield from _check_order(lens)
    prims = ordered_surfaces(lens)
    surfaces = dict[Usd.Prim, Surface]()
    for prim in prims:
        try:
            surfaces[prim] = read_surface(prim)
        except UnreadableValue as error:
            yield of_reader(prim, error)
        except PrescriptionError as error:
            attribute = _BLAMED.get(error.code)
            if error.code:
                at = prim.GetAttribute(attribute) if attribute else prim
                yield problem(at, error.code, error.message, hint=error.hint)
        else:
            semi_mm = surfaces[prim].semi_diameter_mm
            sag_mm = surfaces[prim].sag_mm(semi_mm)
            if not abs(sag_mm) <= _STEEPEST * semi_mm:
                message = f"the sag of the surface at its rim is {sag_mm:.4g} mm, and its semi-diameter {semi_mm:g} mm"
                hint = "are conic and coefficients those of millimetres, and in the right order?"
                yield problem(prim, "sag", message, hint=hint)
    for front, behind in pairwise(prims):
        if front in surfaces and behind in surfaces:
            yield from _check_gap(front, behind, surfaces[front], surfaces[behind])


def check_nominal(lens: Usd.Prim) -> Iterator[Problem]:
    """A warning if the focal length of a PlenLens without errors is far from its nominal one."""
    nominal_mm = read(lens, "plen:nominalFocalLength")
    if nominal_mm is None:
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
    computed = (
        "the lens has no power"
        if math.isinf(efl_mm)
        else f"the lens has {efl_mm:.6g} mm, {100 * (efl_mm / nominal_mm - 1):+.3g} %"
    )
    message = f"the nominal focal length is {nominal_mm:g} mm, but {computed}"
    hint = "is a radius, an index or a thickness mistyped, or the whole table scaled?"
    attribute = lens.GetAttribute("plen:nominalFocalLength")
    yield warning(attribute, "focal-length", message, hint=hint)


def _check_order(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the order of surfaces: names without a surface, repeated ones, and surfaces without a name there."""
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
        yield problem(lens.GetChild(name), "surface-order", f'surface "{name}" is missing in "plen:surfaceOrder"')


def _check_gap(front: Usd.Prim, behind: Usd.Prim, first: Surface, second: Surface) -> Iterator[Problem]:
    """Problems of two neighbouring surfaces: they cross, or the glass between them is hardly there at the rim."""
    if second.focal_length_mm is not None and first.index != 1:
        message = f'"{behind.GetName()}", an ideal thin lens, is in a medium of index {first.index:g}, not in air'
        yield problem(behind.GetAttribute("plen:focalLength"), "ideal-lens", message)
    thickness = front.GetAttribute("plen:thickness")
    hint = "enlarge the thickness or reduce a semi-diameter"
    gap, height = min(gaps_mm(first, second))
    if gap < -_TOUCH_MM:
        message = (
            f'surfaces "{front.GetName()}" and "{behind.GetName()}" cross: {first.thickness_mm:g} mm apart on the axis,'
            f" {gap:.4g} mm at {height:g} mm from it"
        )
        yield problem(thickness, "surfaces-cross", message, hint=hint)
    if gap < -_TOUCH_MM or not first.is_before_glass:
        return
    widest = max(first.semi_diameter_mm, second.semi_diameter_mm)
    # Outside its clear aperture a surface may continue or be ground flat, whichever leaves more glass.
    flat = first.thickness_mm + second.sag_mm(second.semi_diameter_mm) - first.sag_mm(first.semi_diameter_mm)
    try:
        rim = max(flat, first.thickness_mm + second.sag_mm(widest) - first.sag_mm(widest))
    except ValueError:  # the sphere ends before this height
        rim = flat
    if rim < 2 * widest * _THIN:
        is_missing = rim < -_TOUCH_MM
        size = f"lacks {-rim:.4g} mm of glass" if is_missing else f"is {max(rim, 0.0):.4g} mm thick"
        between = f'the element between "{front.GetName()}" and "{behind.GetName()}"'
        message = f"{between} {size} at its rim, {widest:g} mm from the axis"
        severity = "error" if is_missing else "warning"
        yield problem(thickness, "rim-thickness", message, hint=hint, severity=severity)


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
        if names and not unknown and names != _consecutive(order, names):
            message = f"{', '.join(names)} do not follow one another in the order of the lens"
            yield problem(attribute, "group-surfaces", message, hint=f"its order: {', '.join(order)}")
        for name in names:
            if holder.setdefault(name, group.GetName()) != group.GetName():
                message = f'"{name}" belongs to the groups "{holder[name]}" and "{group.GetName()}"'
                yield problem(attribute, "group-surfaces", message, hint="a surface belongs to one group or to none")


def check_group_parent(group: Usd.Prim) -> Iterator[Problem]:
    """A problem if a PlenLensGroup is not a child of a lens, so that no lens would read it."""
    if not group.GetParent().IsA("PlenLens"):
        message = "a PlenLensGroup must be a direct child of a PlenLens, and this one is not"
        yield problem(group, "misplaced-group", message, hint="groups hold surfaces of their lens, and no groups")
