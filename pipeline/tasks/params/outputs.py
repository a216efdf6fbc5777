"""Parameters of the tasks that make files of results: images in colour, raw images, and exports."""

from dataclasses import dataclass

from pipeline.exports.noise import Noise
from pipeline.optics.transmission import Losses
from pipeline.render.sensor.colours import Colorimetry
from pipeline.render.sensor.response import Irradiation, PatternSpread, SensorResponse
from pipeline.tasks.params.cameras import ChannelLabel

SPECTRAL = "spectral.exr"
DERIVATIVES = "derivatives.npz"


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


TIFF, DNG, PREVIEW = "raw.tiff", "raw.dng", "raw.png"
MAPS = "fixed_pattern.exr"
TRANSMISSION = "transmission.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Expose:
    """A frame of a camera, which is named: its noise is a function of the name, the frame and the seed."""

    camera: str
    frame: int
    seed: int
    response: SensorResponse
    irradiation: Irradiation
    colorimetry: tuple[Colorimetry, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PatternMaps:
    """The sensor of a camera, which is named: its pattern is a function of the name and the specimen."""

    camera: str
    shape: tuple[int, int]
    spread: PatternSpread


@dataclass(frozen=True, slots=True, kw_only=True)
class LossesOfLight:
    """Losses of a lens at each wavelength of the light of a camera, or of one of its channels, which is named."""

    channel: str | None
    of_each: tuple[Losses | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Transmission:
    """Losses at the surfaces and in the glass of a lens, in each light that its sensor counts by itself."""

    lights: tuple[LossesOfLight, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """An export of one format.

    `code`: digest of the code that writes the format, which no import of the task names.
    `stage`: name of the dataset, which the files mention.
    `cameras`: names of those that the format can describe.
    `written`: digest of the files that are written from the stage itself.
    """

    format: str
    code: str
    position: str
    noise: Noise
    stage: str
    cameras: tuple[str, ...]
    written: str
