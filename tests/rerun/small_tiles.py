"""Work in the smallest tiles that there can be, for tests of what must not depend on them."""

import pytest

from pipeline.files import exr_bands
from pipeline.graph import tiles
from pipeline.tasks.artefacts import cameras
from pipeline.truth.grid import correspond as searching


def in_small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles of nine rows or four points, and bands of as little as there can be."""

    def bands(count: int, _: float) -> list[tuple[int, int]]:
        size = 9 if count > 9 else 4
        return [(first, min(first + size, count)) for first in range(0, count, size)]

    monkeypatch.setattr(tiles, "bands", bands)
    monkeypatch.setattr(tiles, "_MICROLENSES", 12)
    monkeypatch.setattr(searching, "_BAND_POSITIONS", 1)
    monkeypatch.setattr(exr_bands, "_BAND_PX", 1)
    monkeypatch.setattr(cameras, "_PICTURE_ROWS", 7)
