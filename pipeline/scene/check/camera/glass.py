"""Checks of the glasses of a lens: known, unambiguous, in agreement with printed indices, and known at the camera's
wavelength.
"""

from collections.abc import Iterator

from pxr import Usd

from pipeline.optics.glass.errors import GlassError
from pipeline.optics.glass.medium import Medium
from pipeline.optics.glass.row import names_an_entry
from pipeline.scene.read.media import medium_behind, uses_catalogue
from pipeline.scene.read.prims import ordered_surfaces
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import UnreadableValue, read


def check_glass(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the glasses of a PlenLens.

    Beside printed indices a bare name is information only, because many names are from old catalogues. A name with
    its vendor identifies an entry and is always compared with the printed index.
    """
    prims = ordered_surfaces(lens)
    for prim in prims:
        if _counts(prim, lens):
            try:
                medium_behind(prim, lens)
            except GlassError as error:
                yield problem(_where(prim), error.code, error.what, hint=error.hint)
            except UnreadableValue as error:
                yield problem(error.thing, error.code, error.what)
    last = _known(prims[-1], lens) if prims and _is_catalogue(lens) else None
    if last and last.label != "air" and read(prims[-1], "plen:index") == 1:  # otherwise check_lens has reported it
        message = f"the medium behind the last surface is {last.label}, and only air is supported yet"
        yield problem(_where(prims[-1]), "not-yet-supported", message)


def check_wavelength(camera: Usd.Prim, lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of a camera's wavelength, at which the glasses of its lens must be known."""
    attribute = camera.GetAttribute("plen:camera:wavelength")
    camera_nm, lens_nm = read(camera, "plen:camera:wavelength"), read(lens, "plen:wavelength")
    if None in (camera_nm, lens_nm):
        return
    if _is_catalogue(lens):
        # Several elements of one glass cause one problem of the camera.
        media = {found.label: found for prim in ordered_surfaces(lens) if (found := _known(prim, lens))}
        for medium in media.values():
            try:
                medium.index(camera_nm)
            except GlassError as error:
                hint = "choose a wavelength at which every glass of the lens is known"
                yield problem(attribute, error.code, error.what, hint=hint)
    elif camera_nm != lens_nm:
        message = f"the camera sees {camera_nm} nm, but the indices of its lens are printed for {lens_nm} nm"
        hint = 'plen:indexSource = "catalogue" on the lens computes them for any wavelength'
        yield problem(attribute, "printed-wavelength", message, hint=hint)


def _is_catalogue(lens: Usd.Prim) -> bool:
    try:
        return uses_catalogue(lens)
    except UnreadableValue:
        return False


def _counts(surface: Usd.Prim, lens: Usd.Prim) -> bool:
    return _is_catalogue(lens) or names_an_entry(read(surface, "plen:glass") or "")


def _known(surface: Usd.Prim, lens: Usd.Prim) -> Medium | None:
    """The medium behind a surface; None if it is wrong, which is reported elsewhere."""
    try:
        return medium_behind(surface, lens)
    except (GlassError, UnreadableValue):
        return None


def _where(surface: Usd.Prim) -> Usd.Property:
    """The attribute to mend a medium: its glass, or the one that replaces it."""
    names = ("plen:glass", "plen:index")
    written = (surface.GetAttribute(name) for name in names if surface.GetAttribute(name).HasAuthoredValue())
    return next(written, surface)
