"""Parameters of the labels of a camera's pixels in a frame."""

from dataclasses import dataclass

from pipeline.motion import Motion, Shutter
from pipeline.tasks.params.cameras import Exposure
from pipeline.tasks.params.frames import Matrix, PaintedView, PlacedOccluder, PlacedTarget

LABELS, BOXES, PREVIEW = "labels.exr", "boxes.json", "labels.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Channels:
    """Channels that are asked for; names of targets with shares, and of all things by matte, targets first."""

    tokens: tuple[str, ...]
    targets: tuple[str, ...]
    mattes: dict[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class NextFrame:
    """All targets and occluders in the next frame, None: it is not there; and the shutter before which some move."""

    targets: tuple[PlacedTarget, ...]
    occluders: tuple[PlacedOccluder | None, ...]
    shutter: Shutter | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelsTile:
    """Some rows of labels; the world, and the next frame, only if a label asks for them.

    The view has materials, and no lamps, if light passes some things. Before a shutter the view moves, and the camera
    if it has a motion, world_from_vision. Of a camera that is another one in the next frame a role `next` is read.
    """

    exposure: Exposure
    channels: Channels
    view: PaintedView
    world_from_vision: Matrix | None
    later: NextFrame | None = None
    rows: tuple[int, int] = (0, 0)
    shutter: Shutter | None = None
    camera_motion: Motion | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Labels:
    """Labels of a frame from a number of tiles."""

    exposure: Exposure
    channels: Channels
    tiles: int
