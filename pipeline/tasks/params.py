"""Parameters of every kind of task: the graph makes the records, and `run` of the kind gets them back.

In between they are plain JSON and part of the key. So a record holds what its task reads, in the camera's own frame,
and nothing else: moving a rig touches no ray, and names are known only to tasks that write them. This module imports
neither the compiler nor a library of the tasks, because a plan makes all records and runs nothing.
"""

from dataclasses import dataclass
from typing import Any

from pipeline.camera.camera import Camera, Sampling
from pipeline.camera.request import FocusRequest
from pipeline.truth.settings import TruthSettings

Matrix = list[list[float]]
"""A transform a_from_b, row by row, (4, 4) [mm]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """Light of a camera's bundles: the measure over their rays, where they start, and the wavelength."""

    weight: str
    footprint: str
    wavelength_nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedTarget:
    """A target in a frame, as `target_from_plain` reads it; its name is empty where the task does not know it."""

    name: str
    target: dict[str, Any]
    vision_from_target: Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedOccluder:
    """An occluder in a frame; `occluder` is a plain `target.occluder.Occluder`."""

    occluder: dict[str, Any]
    vision_from_occluder: Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Everything in a frame, as a camera has it before it."""

    targets: tuple[PlacedTarget, ...]
    occluders: tuple[PlacedOccluder, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PaintedView(View):
    """With the radiance of everything, and that of what is behind it all."""

    background: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Nothing:
    """Of a kind that reads other tasks alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Focus:
    """A camera, or what it shall have in focus; without near and far planes and names."""

    camera: Camera | None
    request: FocusRequest | None

    @property
    def asked(self) -> Camera | FocusRequest:
        """The one that is there."""
        asked = self.camera or self.request
        assert asked is not None
        return asked


@dataclass(frozen=True, slots=True, kw_only=True)
class Planes:
    """Planes of J_near and J_far as authored, None: derived from the depth of field."""

    near_mm: float | None
    far_mm: float | None
    circle_of_confusion_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """Another F-number of the same camera."""

    f_number: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusLabels:
    """A focus request, as camera.json tells it."""

    focus_distance_mm: float | None
    focus_type: int | None
    focus_groups: tuple[str, ...]
    group_shift_mm: float | None
    stop_match: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraLabels:
    """Labels of a camera in camera.json, besides its figures."""

    lens_name: str
    index_source: str
    light: Light
    focus_request: FocusLabels | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrder:
    """What camera.json says besides figures."""

    labels: CameraLabels
    circle_of_confusion_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RaysTile:
    """A band of rows of the image; `square_px` is the edge of the square that the rays of J start on.

    `device` is where they are traced, see `tasks.devices`; None: by the processor.
    """

    first_row: int
    end_row: int
    sampling: Sampling
    square_px: float
    device: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rays:
    """The bundles of a camera, from so many tiles."""

    tiles: int
    sampling: Sampling
    light: Light


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImagesTile:
    """One of so many equal shares of the microlenses."""

    tile: int
    tiles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImages:
    """The micro-images, from so many tiles; 0: the task does the work itself, here and below."""

    tiles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """The rays of an image: samples of a pixel, their random numbers, measure and wavelength."""

    samples: int
    seed: int
    weight: str
    wavelength_nm: float


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
    """An image, from so many tiles; without tiles of this view."""

    exposure: Exposure
    tiles: int
    view: PaintedView | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneAsked:
    """A tangent plane of a target, and the points on it (vision frame) [mm]."""

    name: str
    vision_from_target: Matrix
    points_mm: list[list[float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Positions:
    """J of each plane: of the whole image, or of `tiles` around the points."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthTable:
    """A table of correspondences: whose it is, and how its rows are found."""

    frame: int
    camera: str
    settings: TruthSettings
    labels: TableLabels


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthTile:
    """Rows of some points: first and end of those of each target that are asked for, by its name."""

    table: TruthTable
    view: View
    square_px: float
    points: dict[str, tuple[int, int]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """A table, from so many tiles; without tiles of this view."""

    table: TruthTable
    tiles: int
    view: View | None
    square_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedFrame:
    """Targets of a frame."""

    number: int
    targets: tuple[PlacedTarget, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """The tables of all frames of a camera; no claim where the method promises nothing."""

    frames: tuple[JudgedFrame, ...]
    claim_px: float | None
    square_px: float
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PosedFrame:
    """Poses in a frame; camera_from_target by the name of the target."""

    number: int
    camera_from_world: Matrix
    targets: dict[str, Matrix]


@dataclass(frozen=True, slots=True, kw_only=True)
class FramePoses:
    """Poses of a camera, which is named, in all frames."""

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
