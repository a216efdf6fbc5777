"""Parameters of the tasks `rays` and `rays_tile`, and the labels of rays."""

from dataclasses import dataclass

from pipeline.camera.parts.camera import Sampling


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """Light of a camera's bundles: the weight of their rays, their footprint, and the wavelength."""

    weight: str
    footprint: str
    wavelength_nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RaysTile:
    """A band of rows of the image; `square_px` is the edge of the square on which the rays of J start.

    `device` is where they are traced, see `graph.devices`; None: by the processor.
    """

    first_row: int
    end_row: int
    sampling: Sampling
    square_px: float
    device: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rays:
    """The bundles of a camera, from a number of tiles."""

    tiles: int
    sampling: Sampling
    light: Light
