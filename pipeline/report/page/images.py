"""Images of a build for the viewer: a copy of a small PNG, tiles of a large one, under names made of their digests.

A name stands for its pixels: what a report already holds is not made again.
"""

import dataclasses
import shutil
from pathlib import Path

import numpy as np

from pipeline.files.png import png_size, read_png, write_png
from pipeline.report.page.records import Picture
from pipeline.results.folder import BuiltFolder

_WHOLE_PX = 2048
"""Longest edge of an image that is one file: browsers decode it in a few hundredths of a second."""
_TILE_PX = 512
"""Edge of a tile: a screen shows a dozen, and an image of 12 megapixels has about sixty on all levels."""
_NAME = 16
"""Digits of a digest in a name: 64 bits, among thousands of images never the same by chance."""


def picture_of(folder: BuiltFolder, file: str, kind: str, report: Path) -> Picture:
    """Put an image of the build into the folder of the report, unless it is there; returns where it is.

    Raises UsageError if the image is gone, and DamagedFile.
    """
    source, name = folder.present(file), f"images/{folder.digests[file][:_NAME]}"
    width, height = png_size(source)
    shown = Picture(kind=kind, width_px=width, height_px=height, path=f"{name}.png", tile_px=None, levels=1)
    if max(width, height) <= _WHOLE_PX:
        if not (report / shown.path).is_file():
            shutil.copyfile(source, report / shown.path)
        return shown
    levels = levels_of(width, height)
    if not (report / name / "0").is_dir():  # the smallest level is written last
        _write_tiles(report / name, read_png(source), levels)
    return dataclasses.replace(shown, path=name, tile_px=_TILE_PX, levels=levels)


def levels_of(width_px: int, height_px: int) -> int:
    """Number of levels, each half of the next one; level 0 fits into one tile."""
    levels, longest = 1, max(width_px, height_px)
    while longest > _TILE_PX:
        levels, longest = levels + 1, (longest + 1) // 2
    return levels


def _write_tiles(place: Path, pixels: np.ndarray, levels: int) -> None:
    """Write all levels, the finest with the very pixels of the image."""
    if pixels.ndim == 3 and (pixels == pixels[..., :1]).all():
        pixels = pixels[..., 0]  # a third of the bytes
    for level in reversed(range(levels)):
        aside = place / f"{level}.new"
        aside.mkdir(parents=True, exist_ok=True)
        height, width = pixels.shape[:2]
        for y in range(0, height, _TILE_PX):
            for x in range(0, width, _TILE_PX):
                tile = pixels[y : y + _TILE_PX, x : x + _TILE_PX]
                write_png(aside / f"{x // _TILE_PX}_{y // _TILE_PX}.png", tile)
        aside.replace(place / str(level))
        pixels = _halved(pixels)


def _halved(pixels: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels, the last row and column doubled where they are odd; dtype as before."""
    odd = [(0, size % 2) for size in pixels.shape[:2]] + [(0, 0)] * (pixels.ndim - 2)
    even = np.pad(pixels, odd, mode="edge").astype(np.uint32)
    total = even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]
    return ((total + 2) // 4).astype(pixels.dtype)
