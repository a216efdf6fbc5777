"""Parameters of derivatives of rows."""

from dataclasses import dataclass
from typing import Annotated

from pipeline.motion import Shutter
from pipeline.products.views import PlacedTarget


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenTargets:
    """Targets before a camera in a frame, and its shutter where some move while it is open."""

    targets: Annotated[tuple[PlacedTarget, ...], "targets/*"]
    shutter: Shutter | None


SIDES = "less", "more"
"""Beginnings of the roles of cameras with a number a step less, and more; the index of the number follows."""


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

    nominal: SeenTargets
    numbers: tuple[VariedView, ...]
    square_px: float
    seed: int
    with_blur: bool = False


DERIVATIVES = "derivatives.npz"
