"""Parameters of the tasks `white`, `image` and their tiles."""

from dataclasses import dataclass

from pipeline.tasks.params.cameras import ChannelLabel
from pipeline.tasks.params.placed import PaintedView

SPECTRAL = "spectral.exr"


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """The rays of an image: samples of a pixel, their random numbers, measure and wavelength, or channel; whether they
    are diffracted."""

    samples: int
    seed: int
    weight: str
    wavelength_nm: float
    channel: ChannelLabel | None = None
    diffraction: bool = False

    @property
    def wavelengths_nm(self) -> tuple[float, ...]:
        """All wavelengths of its light."""
        return (self.wavelength_nm,) if self.channel is None else self.channel.wavelengths_nm


@dataclass(frozen=True, slots=True, kw_only=True)
class White:
    """The image of a white scene."""

    exposure: Exposure
    tiles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class WhiteTile:
    """First and end row of a tile of the image of a white scene."""

    exposure: Exposure
    rows: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageTile:
    """Some rows of an image: first and end."""

    exposure: Exposure
    view: PaintedView
    rows: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Image:
    """An image from a number of tiles; 0: the task renders the view itself."""

    exposure: Exposure
    tiles: int
    view: PaintedView | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ColourImage:
    """Channels of an image, `image` or `white`, in the order of the tasks that it reads."""

    name: str
    channels: tuple[ChannelLabel, ...]

    @property
    def is_spectral(self) -> bool:
        """Whether it is the image of a frame in which each channel is one wavelength, another one for each."""
        found = [channel.wavelengths_nm for channel in self.channels]
        return self.name == "image" and len(set(found)) == len(found) and all(len(one) == 1 for one in found)
