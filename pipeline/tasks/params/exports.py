"""Parameters of the task `export`."""

from dataclasses import dataclass

from pipeline.exports.noise import Noise
from pipeline.files.jsonfile import Json
from pipeline.tasks.params.placed import PlacedView


@dataclass(frozen=True, slots=True, kw_only=True)
class SightedCamera:
    """A camera whose rays are asked for: roles of its tasks `focus` (or `channel`) and `planes`, and its accuracy."""

    camera_role: str
    planes_role: str
    seed: int
    square_px: float
    min_hit_fraction: float
    accuracy_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenFrame:
    """Everything before a camera in a frame."""

    camera: str
    number: int
    view: PlacedView


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """An export of one format.

    `code`: digest of the code that writes the format, which no import of the task names.
    `stage`: name of the dataset, which the files mention.
    `files`: path in the output folder -> role and output of the task that makes the file.
    `records`: path in the output folder -> content of a JSON file that is written from the stage itself.
    `numbers`: the frames.
    `sights`: name of each camera whose rays the format reads.
    `views`: views for formats that read the scene.
    """

    format: str
    code: str
    position: str
    noise: Noise
    stage: str
    files: dict[str, tuple[str, str]]
    records: Json
    numbers: tuple[int, ...]
    sights: dict[str, SightedCamera]
    views: tuple[SeenFrame, ...]
