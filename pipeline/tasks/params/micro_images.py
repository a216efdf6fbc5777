"""Parameters of the tasks `micro_images` and `micro_images_tile`."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImagesTile:
    """One of so many equal shares of the microlenses."""

    tile: int
    tiles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImages:
    """The micro-images, from so many tiles; 0: the task does the work itself, here and below."""

    tiles: int
