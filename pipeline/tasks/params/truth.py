"""Parameters of the tasks `positions`, `truth` and `truth_tile`."""

from dataclasses import dataclass

from pipeline.camera.parts.camera import Sampling
from pipeline.tasks.params.cameras import ChannelLabel
from pipeline.tasks.params.placed import Matrix, View
from pipeline.tasks.params.rays import Light
from pipeline.truth.settings import TruthSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneAsked:
    """A tangent plane of a target and the points on it (vision frame) [mm]."""

    name: str
    vision_from_target: Matrix
    points_mm: list[list[float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Positions:
    """J on each plane, in the part of the image that `extent` names."""

    planes: tuple[PlaneAsked, ...]
    extent: str
    sampling: Sampling
    light: Light
    square_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TableLabels:
    """Labels of a table of correspondences; no samples without position images."""

    light: Light
    index_source: str
    stop: str
    seed: int
    samples: int | None
    channel: ChannelLabel | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthTable:
    """A table of correspondences: its labels, and the method that finds its rows."""

    frame: int
    camera: str
    settings: TruthSettings
    labels: TableLabels


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthTile:
    """Rows of some points: first and end index of the points of each target, by its name."""

    table: TruthTable
    view: View
    square_px: float
    points: dict[str, tuple[int, int]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """A table from a number of tiles; 0: the task computes the view itself."""

    table: TruthTable
    tiles: int
    view: View | None
    square_px: float
