"""Parameters of the bundles of a camera."""

from dataclasses import dataclass

from pipeline.camera.parts.camera import Sampling
from pipeline.products.light import BundleLight


@dataclass(frozen=True, slots=True, kw_only=True)
class RaysTile:
    """A band of rows of the image; `square_px` is the edge of the square on which the rays of J start.

    `device` is where they are traced, see `products.variants`; None: by the processor.
    """

    first_row: int
    end_row: int
    sampling: Sampling
    square_px: float
    device: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinedRays:
    """The bundles of a camera, from a number of tiles."""

    tiles: int
    sampling: Sampling
    light: BundleLight
