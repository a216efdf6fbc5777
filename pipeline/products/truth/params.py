"""Parameters of tables of correspondences."""

from dataclasses import dataclass
from typing import Annotated

from pipeline.motion import Shutter
from pipeline.products.light import BundleLight, ChannelLabel
from pipeline.products.views import PlacedView
from pipeline.truth.settings import TruthSettings


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
    points: Annotated[dict[str, tuple[int, int]] | None, "targets/*"] = None
    tiles: int = 0
