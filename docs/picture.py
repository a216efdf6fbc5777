"""Draw the pictures of README.md and of the examples: a window of a preview, enlarged, with the exact positions on it.

    python docs/picture.py PICTURE FRAME_FOLDER... [--window LEFT TOP WIDTH HEIGHT] [--zoom N] [--preview raw.png]

FRAME_FOLDER is frames/<frame>/<camera> of an output folder; several are drawn side by side. A camera with channels gets
the positions of its channel green. `make picture` draws all pictures of the project.
"""

import argparse
from pathlib import Path

import numpy as np

from pipeline.files.png import read_png, write_png
from pipeline.files.tables import read_table

COLOURS = (230, 120, 0), (0, 130, 220), (220, 40, 150)
"""Crosses of microlens type 0, 1, 2, and again from 3. A conventional camera has type 0 throughout."""


def enlarged(pixels: np.ndarray, zoom: int) -> np.ndarray:
    """Every pixel as a block of zoom x zoom: nothing is smoothed, so that blur in the picture is blur of the camera."""
    return pixels.repeat(zoom, axis=0).repeat(zoom, axis=1)


def draw_cross(picture: np.ndarray, x: float, y: float, zoom: int, colour: tuple[int, int, int]) -> None:
    """An upright cross about (x, y), in pixels of the picture; what lies outside is left out."""
    column, row = round(x), round(y)
    arm, half = 3 + zoom, zoom // 4
    for i, j in ((arm, half), (half, arm)):
        picture[max(0, row - j) : max(0, row + j + 1), max(0, column - i) : max(0, column + i + 1)] = colour


def picture_of(folder: Path, window: tuple[int, int, int, int], zoom: int, preview: str) -> np.ndarray:
    """The window of a preview with a cross at every row of correspondences.csv, (h zoom, w zoom, 3) uint8."""
    left, top, width, height = window
    picture = enlarged(read_png(folder / preview)[top : top + height, left : left + width], zoom)
    own = folder / "correspondences.csv"
    table = read_table(own if own.exists() else folder / "green" / own.name)
    types = np.nan_to_num(table.numbers("microlens_type")).astype(int)
    for x_px, y_px, kind in zip(table.numbers("x_px"), table.numbers("y_px"), types, strict=True):
        # (0, 0) is the centre of the top-left pixel, also of the picture: the half-pixel rule of CONVENTIONS.md.
        x, y = (x_px - left + 0.5) * zoom - 0.5, (y_px - top + 0.5) * zoom - 0.5
        draw_cross(picture, x, y, zoom, COLOURS[kind % len(COLOURS)])
    return picture


def side_by_side(pictures: list[np.ndarray]) -> np.ndarray:
    """Pictures of one height, with a white gap between them."""
    gap = np.full((len(pictures[0]), 12, 3), 255, np.uint8)
    return np.concatenate([part for picture in pictures for part in (gap, picture)][1:], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", type=Path)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--window", type=int, nargs=4, default=(0, 0, 1 << 20, 1 << 20))
    parser.add_argument("--zoom", type=int, default=1)
    parser.add_argument("--preview", default="image.png")
    given = parser.parse_args()
    pictures = [picture_of(folder, tuple(given.window), given.zoom, given.preview) for folder in given.folders]
    write_png(given.picture, side_by_side(pictures))


if __name__ == "__main__":
    main()
