"""Parameters of the labels of a camera's pixels in a frame."""

from dataclasses import dataclass

from pipeline.tasks.params.cameras import Exposure
from pipeline.tasks.params.frames import Matrix, PlacedOccluder, PlacedView

LABELS, BOXES, PREVIEW = "labels.exr", "boxes.json", "labels.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Named:
    """Names of all things: those of mattes by matte, and those of the targets, which are the first things."""

    targets: tuple[str, ...] = ()
    mattes: dict[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class NextFrame:
    """The next frame, in its vision frame: vision_from_target, and all occluders; None: it is not there."""

    targets: tuple[Matrix, ...]
    occluders: tuple[PlacedOccluder | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Labels:
    """Labels of a frame: whole, from a number of tiles, or the first to an end row.

    `world_from_vision`: None if no label is in the frame of the world.
    """

    exposure: Exposure
    tokens: tuple[str, ...]
    names: Named
    view: PlacedView | None
    world_from_vision: Matrix | None
    later: NextFrame | None = None
    rows: tuple[int, int] | None = None
    tiles: int = 0
