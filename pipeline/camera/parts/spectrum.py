"""Light of several wavelengths: a colour channel of a camera as a few wavelengths with their shares.

Glass changes smoothly with the wavelength, so that few wavelengths stand for it. Colours do not: each of these
wavelengths stands for a stretch of the spectrum, and scenes are seen in thin slices of that.
"""

from dataclasses import dataclass

from pipeline.camera.parts.errors import CameraError
from pipeline.records.declared import settle


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectralNode:
    """One wavelength of a channel, and what the glasses of a camera are at it."""

    wavelength_nm: float  # wavelength in standard air
    # Share of the channel's signal that this wavelength stands for, where all of them pass the lens alike
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
    """A thin slice of a spectrum, as scenes are seen in it: wavelengths [nm] with shares, whose sum is 1."""

    wavelengths_nm: tuple[float, ...]
    shares: tuple[float, ...]


Slices = tuple[Slice, ...]
"""Slices of equal weight, together the light that one wavelength of a camera stands for."""


def alone(wavelength_nm: float) -> Slices:
    """Light of one wavelength and no other."""
    return (Slice(wavelengths_nm=(wavelength_nm,), shares=(1.0,)),)


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A colour channel of a camera."""

    name: str
    # Its mean wavelength, for what one ray stands for: chief rays, centres of micro-images, first guesses
    middle: SpectralNode
    nodes: tuple[SpectralNode, ...]  # the wavelengths that stand for it; their weights sum up to 1
    # How each of them sees colours; ground truth, which is that of a white target, does without
    slices: tuple[Slices, ...] = ()
