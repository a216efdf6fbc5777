"""Parameters of the tables of micro-images."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImagesTile:
    """One of a number of equal shares of the microlenses."""

    tile: int
    tiles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImageTables:
    """The micro-images from a number of tiles; 0: the task does the work itself."""

    tiles: int
