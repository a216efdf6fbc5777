"""Readers and checks of colour channels: their quadrature wavelengths, and the lens at each of these."""

import contextlib
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from pxr import Usd

from pipeline.camera.parts.spectrum import Channel, Slices, SpectralNode
from pipeline.channel_names import colour_of
from pipeline.optics.glass.medium import GlassError
from pipeline.optics.glass.row import doubt_of
from pipeline.render.spectral.nodes import SpectrumError, Table, gauss_nodes, points_of, slices_of
from pipeline.scene.lens import (
    attribute_of_medium,
    indices,
    knows_one_wavelength,
    media_behind,
    medium_behind,
    ordered_surfaces,
    uses_catalogue,
)
from pipeline.scene.microlenses import microlens_index
from pipeline.scene.usd.problems import Problem, problem, warning
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import UnreadableValue, need, read, target
from pipeline.scene.windows import indices_before


def channel_prims(sensor: Usd.Prim) -> list[Usd.Prim]:
    """Channels of a PlenSensor, in stage order."""
    return [prim for prim in sensor.GetChildren() if prim.IsA("PlenChannel")]


def images_of(camera: Usd.Prim) -> int:
    """Number of images of a camera in a frame: one for each channel of its sensor."""
    sensor = target(camera, "plen:camera:sensor", "PlenSensor")
    return max(1, len(channel_prims(sensor)) if sensor else 1)


def illuminant_of(prim: Usd.Prim) -> str:
    """Illuminant of the dataset on whose stage a prim lies; equal energy where there is no dataset."""
    root = prim.GetStage().GetDefaultPrim()
    return str(need(root, "plen:illuminant")) if root and root.IsA("PlenDataset") else "E"


def read_channels(camera: Usd.Prim) -> tuple[Channel, ...]:
    """Channels of the sensor of a Camera with PlenCameraAPI; none: one wavelength. SpectrumError if a response or the
    illuminant is none, or they have no wavelength in common; GlassError if a glass is not known at one of them.
    """
    prims = channel_prims(target(camera, "plen:camera:sensor", "PlenSensor"))
    illuminant = illuminant_of(camera)
    return tuple(_read_channel(camera, prim, illuminant) for prim in prims)


def wavelengths_of(channel: Usd.Prim, illuminant: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] that stand for a PlenChannel, and their shares; raises SpectrumError as `read_channels`."""
    spectrum = _spectrum(_response(channel), illuminant, need(channel, "plen:nodes"))
    return spectrum.wavelengths_nm, spectrum.shares


def response_of(channel: Usd.Prim) -> tuple[Table, bool]:
    """Response of a PlenChannel, and whether it counts photons; else it is one to energy. Raises as `read_channels`."""
    return _table(_response(channel))


def effective_nm(channel: Usd.Prim, illuminant: str) -> float:
    """Light of the illuminant as a PlenChannel counts it, see `spectra.effective_nm`; raises as `read_channels`."""
    from pipeline.render.spectral import spectra

    table, counts_photons = response_of(channel)
    return spectra.effective_nm(table, spectra.illuminant(illuminant), counts_photons)


def _response(channel: Usd.Prim) -> tuple[str, str] | tuple[tuple[float, ...], tuple[float, ...]]:
    """Response of a PlenChannel: camera and component by name, or wavelengths and values."""
    if need(channel, "plen:sensitivity"):
        return need(channel, "plen:sensitivity"), need(channel, "plen:component")
    return tuple(need(channel, "plen:wavelengths")), tuple(need(channel, "plen:response"))


def _table(response: tuple[Any, Any]) -> tuple[Table, bool]:
    """A response, and whether it counts photons; those with names are responses to energy."""
    from pipeline.render.spectral import spectra

    if isinstance(response[0], str):
        return spectra.sensitivity(*response), False
    wavelengths_nm, values = map(np.array, response)
    return (wavelengths_nm, values), True


class _Spectrum(NamedTuple):
    """Wavelengths that stand for a channel, their shares, and its light around them."""

    wavelengths_nm: np.ndarray
    shares: np.ndarray
    slices: tuple[Slices, ...]


# Checks and readers ask for the same spectra again and again, and colour-science takes half a second to import: only
# stages with channels pay for it.
@cache
def _spectrum(response: tuple[Any, Any], illuminant: str, count: int) -> _Spectrum:
    """Gauss's rule with `count` wavelengths for a response times an illuminant; raises as `read_channels`."""
    from pipeline.render.spectral import spectra

    table, counts_photons = _table(response)
    points = points_of(table, spectra.illuminant(illuminant), counts_photons=counts_photons)
    wavelengths_nm, shares = gauss_nodes(points, count)
    return _Spectrum(wavelengths_nm, shares, slices_of(points, shares))


@read_once
def _read_channel(camera: Usd.Prim, prim: Usd.Prim, illuminant: str) -> Channel:
    """A PlenChannel before a camera, whose glasses have their indices at each of its wavelengths."""
    wavelengths_nm, shares, slices = _spectrum(_response(prim), illuminant, need(prim, "plen:nodes"))
    nodes = tuple(_node(camera, float(nm), float(share)) for nm, share in zip(wavelengths_nm, shares, strict=True))
    middle = _node(camera, float((shares * wavelengths_nm).sum()), 1.0)
    return Channel(name=prim.GetName(), middle=middle, nodes=nodes, slices=slices)


def _node(camera: Usd.Prim, wavelength_nm: float, weight: float) -> SpectralNode:
    """A wavelength with the indices of windows, lens and microlenses of a camera."""
    lens = target(camera, "plen:camera:lens", "PlenLens")
    array = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
    is_ideal = need(camera, "plen:camera:model") != "prescription"  # a plane in air, which no wavelength tells apart
    has_index = array and need(array, "plen:model") != "thin"
    before = indices_before(camera, wavelength_nm)
    return SpectralNode(
        wavelength_nm=wavelength_nm,
        weight=weight,
        indices=(*before.behind, *((1.0,) if is_ideal else indices(lens, wavelength_nm))),
        index_in_front=before.index_in_front,
        microlens_index=microlens_index(array, wavelength_nm) if has_index else None,
    )


def check_illuminant(root: Usd.Prim) -> Iterator[Problem]:
    """A problem of a PlenDataset with an unknown illuminant."""
    name = read(root, "plen:illuminant")
    if name in (None, "E"):
        return
    from pipeline.render.spectral.spectra import illuminant  # colour-science takes half a second to import

    try:
        illuminant(name)
    except SpectrumError as error:
        yield problem(root.GetAttribute("plen:illuminant"), error.code, error.message, hint=error.hint)


def check_channel(channel: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenChannel alone."""
    if not channel.GetParent().IsA("PlenSensor"):
        message = "a PlenChannel stands directly below its PlenSensor, and this one does not"
        yield problem(channel, "misplaced-channel", message, hint="channels are the colours of their sensor")
        return
    prims = channel_prims(channel.GetParent())
    named = [colour_of(prim.GetName()) or prim.GetName().casefold() for prim in prims]
    index = prims.index(channel) if channel in prims else 0
    if named[index] in named[:index]:  # files are named by channels, and by their colours
        message = f'two channels of a sensor share the name "{named[index]}"'
        yield problem(channel, "name-collision", message, hint="rename one of the prims")
    table = read(channel, "plen:wavelengths")
    name = read(channel, "plen:sensitivity")
    response = read(channel, "plen:response")
    if table is None or response is None or name is None:
        return  # values that are wrong by themselves
    if bool(table) == bool(name):
        both = "says its response by a table and by a name" if name else "has no response"
        hint = 'either "plen:wavelengths" and "plen:response", or "plen:sensitivity" and "plen:component"'
        yield problem(channel, "channel-response", f"the channel {both}", hint=hint)
    elif len(table) != len(response):
        message = f"{len(table)} wavelengths have {len(response)} values"
        yield problem(channel.GetAttribute("plen:response"), "channel-response", message, hint="one value for each")
    else:
        try:
            wavelengths_of(channel, illuminant_of(channel))
        except SpectrumError as error:
            attribute = channel.GetAttribute("plen:sensitivity" if name else "plen:wavelengths")
            if error.code != "unknown-illuminant":  # reported where the dataset is checked
                yield problem(attribute, error.code, error.message, hint=error.hint)
        except UnreadableValue:
            return  # reported where the value is checked


def check_channels(camera: Usd.Prim, lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the light of channels, of which lens or microlenses lack the index."""
    sensor = target(camera, "plen:camera:sensor", "PlenSensor")
    if not sensor or not channel_prims(sensor):
        return
    if knows_one_wavelength(lens):
        message = "the indices of the lens are printed for one wavelength, and the sensor has channels"
        hint = 'plen:indexSource = "catalogue" on the lens computes them for any wavelength'
        yield problem(camera, "printed-wavelength", message, hint=hint)
        return
    array = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
    if array and read(array, "plen:model") != "thin" and not read(array, "plen:glass"):
        message = "the microlenses have the same index at all wavelengths, and the sensor has channels"
        yield warning(array, "printed-wavelength", message, hint="plen:glass on the array says what they are made of")
    for prim in channel_prims(sensor):
        try:
            _read_channel(camera, prim, illuminant_of(camera))
        except GlassError as error:
            hint = "narrow the response of the channel, or choose glasses that are known at all of its wavelengths"
            yield problem(prim, error.code, error.message, hint=hint)
        except (SpectrumError, UnreadableValue):
            continue  # reported where the channel is checked


def check_wavelength(camera: Usd.Prim, lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of a camera's wavelength, at which the glasses of its lens must be known."""
    attribute = camera.GetAttribute("plen:camera:wavelength")
    camera_nm, lens_nm = read(camera, "plen:camera:wavelength"), read(lens, "plen:wavelength")
    if None in (camera_nm, lens_nm):
        return
    if uses_catalogue(lens):
        media, problems = media_behind(lens, ordered_surfaces(lens))
        yield from problems
        # Several elements of one glass are one problem of the camera.
        for medium in {medium.label: medium for medium in media.values()}.values():
            try:
                medium.index(camera_nm)
            except GlassError as error:
                hint = error.hint or "choose a wavelength at which every glass of the lens is known"
                yield problem(attribute, error.code, error.message, hint=hint)
    elif camera_nm != lens_nm and knows_one_wavelength(lens):
        message = f"the camera sees {camera_nm} nm, but the indices of its lens are printed for {lens_nm} nm"
        hint = 'plen:indexSource = "catalogue" on the lens computes them for any wavelength'
        yield problem(attribute, "printed-wavelength", message, hint=hint)


def readable_wavelengths_nm(camera: Usd.Prim) -> list[float]:
    """Wavelengths that a camera or its channels use, as far as they can be read."""
    lights_nm = [nm for nm in [read(camera, "plen:camera:wavelength")] if nm is not None]
    sensor = target(camera, "plen:camera:sensor", "PlenSensor")
    for channel in channel_prims(sensor) if sensor else []:
        with contextlib.suppress(SpectrumError, UnreadableValue):  # reported where the channel is checked
            lights_nm += wavelengths_of(channel, illuminant_of(camera))[0].tolist()
    return lights_nm


def check_formulas(camera: Usd.Prim, lens: Usd.Prim) -> Iterator[Problem]:
    """Doubts about formulas in place of glasses, at the wavelengths that a camera or its channels use; one for each
    surface."""
    if not uses_catalogue(lens):
        return
    lights_nm = readable_wavelengths_nm(camera)
    for prim in ordered_surfaces(lens):
        try:
            medium = medium_behind(prim, lens)
            doubt = next(filter(None, (doubt_of(medium, wavelength_nm) for wavelength_nm in lights_nm)), None)
        except (GlassError, UnreadableValue):
            continue  # reported where the glass or the wavelength is checked
        if doubt:
            yield warning(attribute_of_medium(prim), "glass-resonance", doubt.message, hint=doubt.hint)
