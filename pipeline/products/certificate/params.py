"""Parameters of certificates."""

from dataclasses import dataclass
from typing import Annotated

from pipeline.motion import Shutter
from pipeline.products.views import PlacedTarget


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedFrame:
    """A frame whose table is judged, with its targets."""

    number: int
    targets: Annotated[tuple[PlacedTarget, ...], "targets/*"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """The tables of all frames of a camera; no claim if the method promises none."""

    frames: tuple[JudgedFrame, ...]
    claim_px: float | None
    square_px: float
    seed: int
    shutter: Shutter | None = None
