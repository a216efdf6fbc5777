"""Parameters of raw images, of the fixed pattern of their sensors, and of losses in lenses."""

from dataclasses import dataclass

from pipeline.optics.transmission import Losses
from pipeline.render.sensor.colours import Colorimetry
from pipeline.render.sensor.response import Irradiation, PatternSpread, SensorResponse

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
