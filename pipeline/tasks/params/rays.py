"""Parameters of the tasks `rays` and `rays_tile`, and what rays are labelled with."""

from dataclasses import dataclass

from pipeline.camera.parts.camera import Sampling


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """Light of a camera's bundles: the measure over their rays, where they start, and the wavelength."""

    weight: str
    footprint: str
    wavelength_nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RaysTile:
    """A band of rows of the image; `square_px` is the edge of the square that the rays of J start on.

    `device` is where they are traced, see `graph.devices`; None: by the processor.
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
