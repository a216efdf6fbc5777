"""Records of light that parameters of several products have."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelLabel:
    """A channel as images and tables name it: its wavelengths, and their shares."""

    name: str
    wavelengths_nm: tuple[float, ...]
    shares: tuple[float, ...]

    @property
    def text(self) -> str:
        """For the header of a table."""
        nodes = zip(self.wavelengths_nm, self.shares, strict=True)
        return f"channel: {self.name}; " + ", ".join(f"{nm:.6g} nm ({share:.4f})" for nm, share in nodes)


@dataclass(frozen=True, slots=True, kw_only=True)
class BundleLight:
    """Light of a camera's bundles: the weight of their rays, their footprint, and the wavelength."""

    weight: str
    footprint: str
    wavelength_nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """The rays of an image: samples of a pixel, their random numbers, measure and wavelength, or channel; whether they
    are diffracted; the device that traces them, see `products.variants`, or None for the processor."""

    samples: int
    seed: int
    weight: str
    wavelength_nm: float
    channel: ChannelLabel | None = None
    diffraction: bool = False
    device: str | None = None
