"""Light of several wavelengths: a colour channel of a camera as a few weighted wavelengths.

Refractive indices vary smoothly with the wavelength, so few wavelengths represent them. Colours do not: each of these
wavelengths represents a band of the spectrum, and scenes are evaluated in thin slices of it.
"""

from dataclasses import dataclass

from pipeline.camera.parts.errors import CameraError
from pipeline.records.declared import settle


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectralNode:
    """One wavelength of a channel, with the refractive indices of a camera at it."""

    wavelength_nm: float  # wavelength in standard air
    # Weight of this wavelength in the channel's signal, if all of them pass the lens alike
    weight: float
    indices: tuple[float, ...]  # refractive index behind each surface of the lens, relative to air
    microlens_index: float | None = None  # index of the microlenses; None where there are none, or thin ones
    index_in_front: float = 1.0  # of the medium before the lens

    def __post_init__(self) -> None:
        settle(self, CameraError)
        if not (self.wavelength_nm > 0 and self.weight > 0):
            raise CameraError(f"a wavelength of {self.wavelength_nm} nm with the weight {self.weight}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Slice:
    """A thin slice of a spectrum in which scenes are evaluated: wavelengths [nm] with shares, whose sum is 1."""

    wavelengths_nm: tuple[float, ...]
    shares: tuple[float, ...]


Slices = tuple[Slice, ...]
"""Slices of equal weight, together the light that one wavelength of a camera represents."""


def alone(wavelength_nm: float) -> Slices:
    """Light of a single wavelength."""
    return (Slice(wavelengths_nm=(wavelength_nm,), shares=(1.0,)),)


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A colour channel of a camera."""

    name: str
    # Its mean wavelength, for single rays: chief rays, centres of micro-images, first guesses
    middle: SpectralNode
    nodes: tuple[SpectralNode, ...]  # the wavelengths that represent it; their weights sum up to 1
    # Spectrum of each of them for colours; ground truth, which is that of a white target, has none
    slices: tuple[Slices, ...] = ()
