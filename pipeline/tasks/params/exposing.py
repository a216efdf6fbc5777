"""Parameters of the task `expose`."""

from dataclasses import dataclass

from pipeline.render.sensor.irradiation import Irradiation
from pipeline.render.sensor.response import SensorResponse

TIFF, DNG, PREVIEW = "raw.tiff", "raw.dng", "raw.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Expose:
    """A frame of a camera, which is named: its noise is a function of the name, the frame and the seed."""

    camera: str
    frame: int
    seed: int
    response: SensorResponse
    irradiation: Irradiation
