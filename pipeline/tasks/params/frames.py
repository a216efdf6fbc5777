"""Parameters of the tasks of frames: what cameras see in them, images, and truth."""

from dataclasses import dataclass, field

from pipeline.camera.parts.camera import Sampling
from pipeline.files.jsonfile import Json
from pipeline.motion import Motion, Shutter
from pipeline.render.spectral.prints import Colours
from pipeline.tasks.params.cameras import BundleLight, ChannelLabel, Rendering
from pipeline.truth.settings import TruthSettings

Matrix = list[list[float]]
"""A transform a_from_b, row by row, (4, 4) [mm]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedTarget:
    """A target in a frame, as `target_from_plain` reads it; its name is empty if the task must not depend on it, and it
    has a motion where a shutter is open while it moves.
    """

    name: str
    target: Json
    vision_from_target: Matrix
    motion: Motion | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedOccluder:
    """An occluder in a frame; `occluder` is a plain `targets.mesh.Occluder`."""

    occluder: Json
    vision_from_occluder: Matrix
    motion: Motion | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedView:
    """Everything in a frame, in the vision frame of a camera."""

    targets: tuple[PlacedTarget, ...]
    occluders: tuple[PlacedOccluder, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PaintedView(PlacedView):
    """A view with the radiance of everything and of the background; `colours` are those of each target, empty for a
    neutral one.
    """

    background: float
    colours: tuple[Colours, ...] = ()


SHEET = "sheet.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A target whose pattern viewers show."""

    target: Json


@dataclass(frozen=True, slots=True, kw_only=True)
class Image(Rendering):
    """An image of what is in a frame: from tiles, or of the task's own view, which moves before a shutter."""

    view: PaintedView | None
    shutter: Shutter | None = None


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
class TruthTable:
    """A table of correspondences: the method that finds its rows, and its labels; no samples without a search."""

    frame: int
    camera: str
    settings: TruthSettings
    light: BundleLight
    index_source: str
    seed: int
    samples: int | None
    channel: ChannelLabel | None = None
    shutter: Shutter | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """A table from tiles, or of the task's own view; `points`: first and end of those of a tile, by target."""

    table: TruthTable
    view: PlacedView | None
    square_px: float
    points: dict[str, tuple[int, int]] | None = None
    tiles: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenTargets:
    """Targets before a camera in a frame, and its shutter where some move while it is open."""

    targets: tuple[PlacedTarget, ...]
    shutter: Shutter | None


SIDES = "less", "more"
"""A number a step less, and more: begin of the roles of cameras with it, which end with its index."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VariedView:
    """Targets of a frame with a number a little different; None: they are the same."""

    name: str
    unit: str
    step: float
    less: SeenTargets | None
    more: SeenTargets | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RowDerivatives:
    """Derivatives of the rows of a frame by all numbers; cameras that differ, too, are read as `less3` and `more3`."""

    here: SeenTargets
    numbers: tuple[VariedView, ...]
    square_px: float
    seed: int
    with_blur: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedFrame:
    number: int
    targets: tuple[PlacedTarget, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """The tables of all frames of a camera; no claim if the method promises none."""

    frames: tuple[JudgedFrame, ...]
    claim_px: float | None
    square_px: float
    seed: int
    shutter: Shutter | None = None


BASELINES = "baselines.csv"
"""Output of the task `baselines`."""


def poses_file(number: int) -> str:
    """Output of the task `frame_poses` that holds a frame."""
    return f"{number:04d}.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class PosedFrame:
    """Poses in a frame; camera_from_target by the name of the target.

    `at_lines`: those when the first line of a camera with a shutter is exposed, and the last, in the middle.
    """

    number: int
    camera_from_world: Matrix
    targets: dict[str, Matrix]
    at_lines: dict[str, tuple[Matrix, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class FramePoses:
    """Poses of a camera, with its name, in all frames."""

    camera: str
    frames: tuple[PosedFrame, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFrame:
    """camera_from_world of all cameras in a frame, in the order of their names; None of a camera that is not in it."""

    number: int
    camera_from_world: tuple[Matrix | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Baselines:
    """All cameras of a dataset, by name."""

    cameras: tuple[str, ...]
    frames: tuple[RigFrame, ...]
