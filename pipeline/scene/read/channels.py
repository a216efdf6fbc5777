"""Colour channels of a camera: wavelengths that stand for each, and what the glasses of the camera are at them."""

from functools import cache

import numpy as np
from pxr import Usd

from pipeline.camera.parts.spectrum import Channel, SpectralNode
from pipeline.render.spectral.nodes import gauss_nodes
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
    if need(channel, "plen:sensitivity"):
        return _known_nodes(
            need(channel, "plen:sensitivity"),
            need(channel, "plen:component"),
            illuminant,
            need(channel, "plen:nodes"),
        )
    table = tuple(need(channel, "plen:wavelengths")), tuple(need(channel, "plen:response"))
    return _table_nodes(*table, illuminant, need(channel, "plen:nodes"))


def response_of(channel: Usd.Prim) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] and quantum efficiency of a PlenChannel; raises SpectrumError as `read_channels`."""
    from pipeline.render.spectral import spectra

    if need(channel, "plen:sensitivity"):
        return spectra.sensitivity(need(channel, "plen:sensitivity"), need(channel, "plen:component"))
    return np.array(need(channel, "plen:wavelengths")), np.array(need(channel, "plen:response"))


def effective_nm(channel: Usd.Prim, illuminant: str) -> float:
    """Light of the illuminant as a PlenChannel counts it, see `spectra.effective_nm`; raises as `read_channels`."""
    from pipeline.render.spectral import spectra

    return spectra.effective_nm(response_of(channel), spectra.illuminant(illuminant))


# Checks and readers ask for the same spectra again and again, and colour-science takes half a second to import: only
# stages with channels pay for it.
@cache
def _known_nodes(camera: str, component: str, illuminant: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    from pipeline.render.spectral import spectra

    return gauss_nodes(*spectra.product(spectra.sensitivity(camera, component), spectra.illuminant(illuminant)), count)


@cache
def _table_nodes(
    wavelengths_nm: tuple[float, ...], response: tuple[float, ...], illuminant: str, count: int
) -> tuple[np.ndarray, np.ndarray]:
    from pipeline.render.spectral import spectra

    table = np.array(wavelengths_nm), np.array(response)
    return gauss_nodes(*spectra.product(table, spectra.illuminant(illuminant)), count)


@read_once
def read_channel(camera: Usd.Prim, prim: Usd.Prim, illuminant: str) -> Channel:
    """One PlenChannel of a camera; raises as `read_channels`."""
    wavelengths_nm, shares = wavelengths_of(prim, illuminant)
    nodes = [_node(camera, float(nm), float(share)) for nm, share in zip(wavelengths_nm, shares, strict=True)]
    return Channel(name=prim.GetName(), middle=_node(camera, float(shares @ wavelengths_nm), 1.0), nodes=tuple(nodes))


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
