"""Parameters of the tasks `micro_images` and `micro_images_tile`."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImagesTile:
    """One of a number of equal shares of the microlenses."""

    tile: int
    tiles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImages:
    """The micro-images from a number of tiles; 0: the task does the work itself."""

    tiles: int
