"""Parameters of the tasks about ground truth: `positions`, `truth`, `certificate`, and the poses of all frames."""

from dataclasses import dataclass

from pipeline.camera.parts.camera import Sampling
from pipeline.tasks.params.cameras import BundleLight, ChannelLabel
from pipeline.tasks.params.placed import Matrix, PlacedTarget, PlacedView
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
    light: BundleLight
    square_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TableLabels:
    """Labels of a table of correspondences; no samples without position images."""

    light: BundleLight
    index_source: str
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
    view: PlacedView
    square_px: float
    points: dict[str, tuple[int, int]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """A table from a number of tiles; 0: the task computes the view itself."""

    table: TruthTable
    tiles: int
    view: PlacedView | None
    square_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedFrame:
    """Targets of a frame."""

    number: int
    targets: tuple[PlacedTarget, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """The tables of all frames of a camera; no claim if the method promises none."""

    frames: tuple[JudgedFrame, ...]
    claim_px: float | None
    square_px: float
    seed: int


BASELINES = "baselines.csv"
"""Output of the task `baselines`."""


def poses_file(number: int) -> str:
    """Output of the task `frame_poses` that holds a frame."""
    return f"{number:04d}.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class PosedFrame:
    """Poses in a frame; camera_from_target by the name of the target."""

    number: int
    camera_from_world: Matrix
    targets: dict[str, Matrix]


@dataclass(frozen=True, slots=True, kw_only=True)
class FramePoses:
    """Poses of a camera, with its name, in all frames."""

    camera: str
    frames: tuple[PosedFrame, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFrame:
    """camera_from_world of all cameras in a frame, in the order of their names."""

    number: int
    camera_from_world: tuple[Matrix, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Baselines:
    """All cameras of a dataset, by name."""

    cameras: tuple[str, ...]
    frames: tuple[RigFrame, ...]
