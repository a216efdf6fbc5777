"""Parameters of the tasks `expose` and `fixed_pattern`."""

from dataclasses import dataclass

from pipeline.render.sensor.irradiation import Irradiation
from pipeline.render.sensor.response import PatternSpread, SensorResponse

TIFF, DNG, PREVIEW = "raw.tiff", "raw.dng", "raw.png"
MAPS = "fixed_pattern.exr"


@dataclass(frozen=True, slots=True, kw_only=True)
class Expose:
    """A frame of a camera, which is named: its noise is a function of the name, the frame and the seed."""

    camera: str
    frame: int
    seed: int
    response: SensorResponse
    irradiation: Irradiation


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPattern:
    """The sensor of a camera, which is named: its pattern is a function of the name and the specimen."""

    camera: str
    shape: tuple[int, int]
    spread: PatternSpread
