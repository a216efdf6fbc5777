"""Tiles: the number of tasks that share the work of a camera. It depends on the dataset only.

Neither machine nor workers count, so that keys and bytes are the same everywhere. A tile takes about a second, because
every task first makes its camera ready: 0.1 s, and a second behind 20,000 microlenses. For such cameras tiles grow: no
kind has more than so many. Work that is one tile has no task of its own: the task that would join tiles does it itself,
except that labels have a task of each tile, however few.
"""

import math

from pipeline.camera.parts.camera import Sampling, Sensor
from pipeline.camera.parts.lattice import extent_mm
from pipeline.camera.parts.microlens_array import MicrolensArray

Bands = list[tuple[int, int]]
"""First and end of every tile."""

_BUNDLE_RAYS, _BUNDLE_TILES = 20_000_000, 512
"""Rays in a tile of bundles, 50 ns each, and the most tiles."""
_POSITIONS = 1 << 21
"""Fine positions in a tile, 120 bytes each: with few rays per position memory is the limit."""
_IMAGE_RAYS, _IMAGE_TILES = 5_000_000, 128
"""Samples of pixels in a tile of an image, 100 ns each, and the most tiles: behind microlenses a pixel takes 1.4
times as many.
"""
_STRIP_PX = 1 << 16
"""Pixels of an image that take passes together: enough that pooled estimates of noise bias none, few enough that
calm parts of the image take few passes. Strips decide bytes, so neither samples nor workers count.
"""
_MICROLENSES, _FEW_MICROLENSES, _SMALL_TILES = 1024, 256, 8
"""Microlenses in a tile, a millisecond each; in a tile of a small array, and the most such tiles: later tasks wait for
all microlenses, and making a small camera ready takes little.
"""
_ROWS = 480
"""Rows of ground truth in a tile, a millisecond each: with fewer, the fixed cost of each search step is shared by
too few.
"""
_MICRO_IMAGES_OF_A_POINT = 24
"""Approximate number of micro-images that see a point with the arrays of the library's rigs."""


def bands(count: int, tiles: float) -> Bands:
    """A number of things divided into about `tiles` tiles of equal size, the last one perhaps smaller."""
    size = math.ceil(count / max(1, min(count, math.ceil(tiles))))
    return [(first, min(first + size, count)) for first in range(0, count, size)]


def bundle_bands(sensor: Sensor, sampling: Sampling) -> Bands:
    """Rows of the image in each tile of its bundles."""
    positions = sensor.width_px * sensor.height_px * sampling.supersampling**2
    tiles = min(_BUNDLE_TILES, positions * sampling.samples / _BUNDLE_RAYS)
    return bands(sensor.height_px, max(tiles, positions / _POSITIONS))


def image_bands(sensor: Sensor, samples: int) -> Bands:
    """Rows of the image in each of its tiles."""
    rays = sensor.width_px * sensor.height_px * samples
    return bands(sensor.height_px, min(_IMAGE_TILES, rays / _IMAGE_RAYS))


def strips(sensor: Sensor) -> Bands:
    """Rows of an image that take passes together until their noise is low enough."""
    return bands(sensor.height_px, min(_IMAGE_TILES, sensor.width_px * sensor.height_px / _STRIP_PX))


def microlens_tiles(sensor: Sensor, array: MicrolensArray) -> int:
    """Number of tiles for the microlenses that light the image."""
    width, height = (min(sides) for sides in zip(sensor.size_mm, extent_mm(array), strict=True))
    along, across = array.pitches_mm
    count = width * height / (along * across)
    return max(1, math.ceil(count / _MICROLENSES), min(_SMALL_TILES, math.ceil(count / _FEW_MICROLENSES)))


def point_tiles(points: dict[str, int], *, is_plenoptic: bool) -> list[dict[str, tuple[int, int]]]:
    """First and end of the points of each target, by name, in each tile of truth; `points` has their numbers."""
    count = sum(points.values())
    rows = count * (_MICRO_IMAGES_OF_A_POINT if is_plenoptic else 1)
    tiles = []
    for low, high in bands(count, rows / _ROWS) if count else []:
        before = 0  # points of the targets before this one
        tile = dict[str, tuple[int, int]]()
        for name, size in sorted(points.items()):
            first = max(low - before, 0)
            end = min(high - before, size)
            if first < end or (size == 0 and low == 0):
                tile[name] = first, end
            before += size
        tiles.append(tile)
    return tiles
