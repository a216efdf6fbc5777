"""Checks of the glasses of a lens: known, unambiguous, in agreement with printed indices, and known at the camera's
wavelength.
"""

import contextlib
from collections.abc import Iterator, Sequence

from pxr import Sdf, Usd

from pipeline.optics.glass.doubt import doubt_of
from pipeline.optics.glass.errors import GlassError
from pipeline.optics.glass.medium import Medium
from pipeline.optics.glass.row import names_an_entry
from pipeline.render.spectral.nodes import SpectrumError
from pipeline.scene.read.channels import channel_prims, illuminant_of, wavelengths_of
from pipeline.scene.read.media import knows_one_wavelength, medium_behind, ordered_surfaces
from pipeline.scene.usd.hints import of_reader
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import UnreadableValue, read, target


def check_glass(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the glasses of a PlenLens.

    Beside printed indices a bare name is information only, because many names are from old catalogues. A name with
    its vendor identifies an entry and is always compared with the printed index.
    """
    prims = ordered_surfaces(lens)
    media, found = _media(lens, [prim for prim in prims if _counts(prim, lens)])
    yield from found
    last = media.get(prims[-1].GetPath()) if prims and _is_catalogue(lens) else None
    if last and last.label != "air" and read(prims[-1], "plen:index") == 1:  # else check_lens has said so
        message = f"the medium behind the last surface is {last.label}, and only air is supported yet"
        yield problem(_where(prims[-1]), "not-yet-supported", message)


def check_wavelength(camera: Usd.Prim, lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of a camera's wavelength, at which the glasses of its lens must be known."""
    attribute = camera.GetAttribute("plen:camera:wavelength")
    camera_nm, lens_nm = read(camera, "plen:camera:wavelength"), read(lens, "plen:wavelength")
    if None in (camera_nm, lens_nm):
        return
    if _is_catalogue(lens):
        media, found = _media(lens, ordered_surfaces(lens))
        yield from found
        # Several elements of one glass are one problem of the camera.
        for medium in {medium.label: medium for medium in media.values()}.values():
            try:
                medium.index(camera_nm)
            except GlassError as error:
                hint = error.hint or "choose a wavelength at which every glass of the lens is known"
                yield problem(attribute, error.code, error.what, hint=hint)
    elif camera_nm != lens_nm and knows_one_wavelength(lens):
        message = f"the camera sees {camera_nm} nm, but the indices of its lens are printed for {lens_nm} nm"
        hint = 'plen:indexSource = "catalogue" on the lens computes them for any wavelength'
        yield problem(attribute, "printed-wavelength", message, hint=hint)


def check_formulas(camera: Usd.Prim, lens: Usd.Prim) -> Iterator[Problem]:
    """Doubts about formulas in place of glasses, at the wavelengths that a camera or its channels use; one for each
    surface."""
    if not _is_catalogue(lens):
        return
    seen_nm = _wavelengths_nm(camera)
    for prim in ordered_surfaces(lens):
        try:
            medium = medium_behind(prim, lens)
            found = next(filter(None, (doubt_of(medium, wavelength_nm) for wavelength_nm in seen_nm)), None)
        except (GlassError, UnreadableValue):
            continue  # reported where the glass or the wavelength is checked
        if found:
            yield problem(_where(prim), "glass-resonance", found.what, hint=found.hint, severity="warning")


def _wavelengths_nm(camera: Usd.Prim) -> list[float]:
    """Wavelengths at which a camera asks its lens; those that cannot be read are reported where they are checked."""
    found = [nm for nm in [read(camera, "plen:camera:wavelength")] if nm is not None]
    sensor = target(camera, "plen:camera:sensor", "PlenSensor")
    for channel in channel_prims(sensor) if sensor else []:
        with contextlib.suppress(SpectrumError, UnreadableValue):
            found += wavelengths_of(channel, illuminant_of(camera))[0].tolist()
    return found


def _is_catalogue(lens: Usd.Prim) -> bool:
    return bool(read(lens, "plen:indexSource") == "catalogue")


def _counts(surface: Usd.Prim, lens: Usd.Prim) -> bool:
    return _is_catalogue(lens) or names_an_entry(read(surface, "plen:glass") or "")


def _media(lens: Usd.Prim, prims: Sequence[Usd.Prim]) -> tuple[dict[Sdf.Path, Medium], list[Problem]]:
    """The media behind surfaces of a lens, by their paths, and the problems of those that are not there."""
    media, found = dict[Sdf.Path, Medium](), list[Problem]()
    for prim in prims:
        try:
            media[prim.GetPath()] = medium_behind(prim, lens)
        except GlassError as error:
            found.append(problem(_where(prim), error.code, error.what, hint=error.hint))
        except UnreadableValue as error:
            found.append(of_reader(prim, error))
    return media, found


def _where(surface: Usd.Prim) -> Usd.Property:
    """The attribute to mend a medium: its glass, or the one that replaces it."""
    names = ("plen:glass", "plen:index")
    written = (surface.GetAttribute(name) for name in names if surface.GetAttribute(name).HasAuthoredValue())
    return next(written, surface)
