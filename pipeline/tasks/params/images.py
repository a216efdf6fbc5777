"""Parameters of the tasks `white`, `image` and their tiles."""

from dataclasses import dataclass

from pipeline.render.sensor.colorimetry import Colorimetry
from pipeline.tasks.params.cameras import ChannelLabel
from pipeline.tasks.params.placed import PaintedView

BEFORE, CHECK, STRIP = "before", "check", "tile"
"""Roles of the pass before, of the verdict about it, and, with a number, of a pass over some rows."""
SPECTRAL = "spectral.exr"


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """The rays of an image: samples of a pixel, their random numbers, measure and wavelength, or channel; whether they
    are diffracted; the device that traces them, see `graph.devices`, or None for the processor."""

    samples: int
    seed: int
    weight: str
    wavelength_nm: float
    channel: ChannelLabel | None = None
    diffraction: bool = False
    device: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class White:
    """The image of a white scene; with `noise`, the standard error that was asked for, from the last passes.

    `is_smooth`: neither microlenses nor diffraction. Then it is by quadrature, wherever that knows the light.
    """

    exposure: Exposure
    tiles: int
    is_smooth: bool
    noise: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WhiteTile:
    """First and end row of a tile of the image of a white scene."""

    exposure: Exposure
    rows: tuple[int, int]
    is_smooth: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageTile:
    """Some rows of an image: first and end."""

    exposure: Exposure
    view: PaintedView
    rows: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Image:
    """An image from a number of tiles; 0: the task renders the view itself. `noise` as of `White`."""

    exposure: Exposure
    tiles: int
    view: PaintedView | None
    noise: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WhitePass:
    """A pass over some rows, first and end, of the image of a white scene; passes count from 0."""

    exposure: Exposure
    rows: tuple[int, int]
    is_smooth: bool
    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ImagePass:
    """A pass over some rows, first and end, of an image; passes count from 0."""

    exposure: Exposure
    view: PaintedView
    rows: tuple[int, int]
    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseCheck:
    """Standard error that was asked for, relative to the mean of the image."""

    noise: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ColourImage:
    """Channels of an image, `image` or `white`, in the order of the tasks that it reads."""

    name: str
    channels: tuple[ChannelLabel, ...]
    colorimetry: Colorimetry | None = None

    @property
    def is_spectral(self) -> bool:
        """Whether it is the image of a frame in which each channel is one wavelength, another one for each."""
        lights = [channel.wavelengths_nm for channel in self.channels]
        return self.name == "image" and len(set(lights)) == len(lights) and set(map(len, lights)) == {1}
