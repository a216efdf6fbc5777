"""Parameters of images, and of white images."""

from dataclasses import dataclass

from pipeline.motion import Shutter
from pipeline.products.light import Exposure
from pipeline.products.views import PaintedView

SECONDS_PER_MET = 6e-7
"""Processor time of a ray that is followed to what it meets [s]: those of labels, and of images without lamps of a bent
target, took 0.5 to 1.3 µs on a busy Intel Xeon on 27 November 2026.
"""
FIRST, OWN, STRIP = "first", "own", "tile"
"""Roles, with a number, of the first pass over a strip; of that of its own; and, with a number, of a strip."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rendering:
    """An image: whole, from a number of tiles, or the first to an end row of it.

    `noise`: the standard error that was asked for, relative to the mean of the image; `passes`: most of them over a
    strip.
    """

    exposure: Exposure
    rows: tuple[int, int] | None = None
    passes: int = 0
    tiles: int = 0
    noise: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class White(Rendering):
    """The image of a white scene; `is_smooth`: neither microlenses nor diffraction, so that quadrature may know it."""

    is_smooth: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Image(Rendering):
    """An image of what is in a frame: from tiles, or of the task's own view, which moves before a shutter."""

    view: PaintedView | None
    shutter: Shutter | None = None

    @property
    def seconds_per_ray(self) -> float | None:
        """Processor time of a ray, for forecasts [s]; None: that of an image without lamps."""
        return None
