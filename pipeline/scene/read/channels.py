"""Colour channels of a camera: wavelengths that stand for each, and what the glasses of the camera are at them."""

from functools import cache
from typing import Any

import numpy as np
from pxr import Usd

from pipeline.camera.parts.spectrum import Channel, Slices, SpectralNode
from pipeline.render.spectral.nodes import Table, gauss_nodes, points_of, slices_of
from pipeline.scene.read.media import indices, ordered_surfaces
from pipeline.scene.read.microlenses import microlens_index
from pipeline.scene.usd.values import need, read_once, target


def channel_prims(sensor: Usd.Prim) -> list[Usd.Prim]:
    """Channels of a PlenSensor, in stage order."""
    return [prim for prim in sensor.GetChildren() if prim.IsA("PlenChannel")]


def illuminant_of(prim: Usd.Prim) -> str:
    """Illuminant of the dataset on whose stage a prim lies; equal energy where there is no dataset."""
    root = prim.GetStage().GetDefaultPrim()
    return str(need(root, "plen:illuminant")) if root and root.IsA("PlenDataset") else "E"


def read_channels(camera: Usd.Prim) -> tuple[Channel, ...]:
    """Channels of the sensor of a Camera with PlenCameraAPI; none: one wavelength.

    Raises
    ------
    SpectrumError
        A response or the illuminant is none, or they have no wavelength in common.
    GlassError
        A glass is not known at one of the wavelengths.
    """
    prims, illuminant = channel_prims(target(camera, "plen:camera:sensor", "PlenSensor")), illuminant_of(camera)
    return tuple(read_channel(camera, prim, illuminant) for prim in prims)


def wavelengths_of(channel: Usd.Prim, illuminant: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] that stand for a PlenChannel, and their shares; raises SpectrumError as `read_channels`."""
    return _spectrum(_response(channel), illuminant, need(channel, "plen:nodes"))[:2]


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

    one, other = response
    by_name = isinstance(one, str)
    return spectra.sensitivity(one, other) if by_name else (np.array(one), np.array(other)), not by_name


# Checks and readers ask for the same spectra again and again, and colour-science takes half a second to import: only
# stages with channels pay for it.
@cache
def _spectrum(
    response: tuple[Any, Any], illuminant: str, count: int
) -> tuple[np.ndarray, np.ndarray, tuple[Slices, ...]]:
    from pipeline.render.spectral import spectra

    table, counts_photons = _table(response)
    points = points_of(table, spectra.illuminant(illuminant), counts_photons=counts_photons)
    wavelengths_nm, shares = gauss_nodes(points, count)
    return wavelengths_nm, shares, slices_of(points, shares)


@read_once
def read_channel(camera: Usd.Prim, prim: Usd.Prim, illuminant: str) -> Channel:
    """One PlenChannel of a camera; raises as `read_channels`."""
    wavelengths_nm, shares, slices = _spectrum(_response(prim), illuminant, need(prim, "plen:nodes"))
    nodes = tuple(_node(camera, float(nm), float(share)) for nm, share in zip(wavelengths_nm, shares, strict=True))
    middle = _node(camera, float((shares * wavelengths_nm).sum()), 1.0)
    return Channel(name=prim.GetName(), middle=middle, nodes=nodes, slices=slices)


def _node(camera: Usd.Prim, wavelength_nm: float, weight: float) -> SpectralNode:
    lens = target(camera, "plen:camera:lens", "PlenLens")
    array = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
    is_ideal = need(camera, "plen:camera:model") != "prescription"  # a plane in air, which no wavelength tells apart
    has_index = array and need(array, "plen:model") != "thin"
    return SpectralNode(
        wavelength_nm=wavelength_nm,
        weight=weight,
        indices=(1.0,) if is_ideal else indices(lens, ordered_surfaces(lens), wavelength_nm),
        microlens_index=microlens_index(array, wavelength_nm) if has_index else None,
    )
