"""Glasses of a lens: the media behind its surfaces, and so its indices at a wavelength.

Dispersion formulas are evaluated here, while a stage is read: records carry plain numbers, and tasks know no glass.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pxr import Sdf, Usd

from pipeline.optics.glass import row
from pipeline.optics.glass.errors import GlassError
from pipeline.optics.glass.medium import Medium
from pipeline.optics.glass.row import names_an_entry
from pipeline.optics.prescription import Surface
from pipeline.scene.usd.problems import Problem, of_reader, problem
from pipeline.scene.usd.values import UnreadableValue, need, read, read_once


def ordered_surfaces(lens: Usd.Prim) -> list[Usd.Prim]:
    """Surfaces of a lens in the order it states; names without a prim are left out."""
    named = [lens.GetChild(name) for name in read(lens, "plen:surfaceOrder") or () if name]
    return [prim for prim in named if prim and prim.IsA("PlenSurface")]


def uses_catalogue(lens: Usd.Prim) -> bool:
    """Whether the indices of a lens come from its glasses instead of print."""
    return bool(need(lens, "plen:indexSource") == "catalogue")


def knows_one_wavelength(lens: Usd.Prim) -> bool:
    """Whether indices of a lens are printed, for its wavelength; an ideal thin lens has none, and works at any."""
    return not uses_catalogue(lens) and any(read(prim, "plen:index") != 1 for prim in ordered_surfaces(lens))


@read_once
def medium_behind(surface: Usd.Prim, lens: Usd.Prim) -> Medium:
    """The medium behind a surface, from its glass and compared with the printed index.

    Raises
    ------
    GlassError
        The glass is unknown, or contradicts the printed index.
    """
    has_index = surface.GetAttribute("plen:index").HasAuthoredValue()
    return row.medium(
        glass=need(surface, "plen:glass"),
        index=need(surface, "plen:index") if has_index else None,
        abbe=read(surface, "plen:abbe"),
        wavelength_nm=need(lens, "plen:wavelength"),
    )


def with_indices(
    lens: Usd.Prim, prims: Sequence[Usd.Prim], surfaces: Sequence[Surface], wavelength_nm: float | None
) -> tuple[Surface, ...]:
    """Surfaces with their indices at a wavelength; the printed ones know only their own and stay as they are."""
    light_nm = need(lens, "plen:wavelength") if wavelength_nm is None else wavelength_nm
    pairs = zip(surfaces, indices(lens, prims, light_nm), strict=True)
    return tuple(replace(surface, index=index) for surface, index in pairs)


def indices(lens: Usd.Prim, prims: Sequence[Usd.Prim], wavelength_nm: float) -> tuple[float, ...]:
    """Refractive index behind each surface of a lens at a wavelength; printed ones are the same at all.

    Raises
    ------
    GlassError
        A glass is not known, or not at that wavelength.
    """
    if not uses_catalogue(lens):
        return tuple(need(prim, "plen:index") for prim in prims)
    return tuple(medium_behind(prim, lens).index(wavelength_nm) + 0.0 for prim in prims)


def index_source(lens: Usd.Prim, prims: Sequence[Usd.Prim]) -> str:
    """Source of the indices of a lens for reports and tables, with the medium of every element."""
    if not uses_catalogue(lens):
        return str(need(lens, "plen:indexSource"))
    labels = [medium_behind(prim, lens).label for prim in prims]
    return f"catalogue ({', '.join(label for label in labels if label != 'air')})"


def check_glass(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the glasses of a PlenLens.

    Beside printed indices a bare name is information only, because many names are from old catalogues. A name with
    its vendor identifies an entry and is always compared with the printed index.
    """
    prims = ordered_surfaces(lens)
    media, problems = media_behind(lens, [prim for prim in prims if _counts(prim, lens)])
    yield from problems
    last = media.get(prims[-1].GetPath()) if prims and says_catalogue(lens) else None
    if last and last.label != "air" and read(prims[-1], "plen:index") == 1:  # else check_lens has said so
        message = f"the medium behind the last surface is {last.label}, and only air is supported yet"
        yield problem(attribute_of_medium(prims[-1]), "not-yet-supported", message)


def says_catalogue(lens: Usd.Prim) -> bool:
    return bool(read(lens, "plen:indexSource") == "catalogue")


def _counts(surface: Usd.Prim, lens: Usd.Prim) -> bool:
    return says_catalogue(lens) or names_an_entry(read(surface, "plen:glass") or "")


def media_behind(lens: Usd.Prim, prims: Sequence[Usd.Prim]) -> tuple[dict[Sdf.Path, Medium], list[Problem]]:
    """The media behind surfaces of a lens, by their paths, and the problems of those that are not there."""
    media, problems = dict[Sdf.Path, Medium](), list[Problem]()
    for prim in prims:
        try:
            media[prim.GetPath()] = medium_behind(prim, lens)
        except GlassError as error:
            problems.append(problem(attribute_of_medium(prim), error.code, error.what, hint=error.hint))
        except UnreadableValue as error:
            problems.append(of_reader(prim, error))
    return media, problems


def attribute_of_medium(surface: Usd.Prim) -> Usd.Property:
    """The attribute to mend a medium: its glass, or the one that replaces it."""
    names = ("plen:glass", "plen:index")
    written = (surface.GetAttribute(name) for name in names if surface.GetAttribute(name).HasAuthoredValue())
    return next(written, surface)
