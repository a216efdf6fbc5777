"""Task `positions`: J of every tangent plane of all targets in one frame, traced to the planes (method `image`).

Only where target points may be seen, unless the whole image is asked for: the candidates are those of method
`direct`.
"""

import dataclasses
import functools
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.camera.parts.camera import Sampling
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes, target_plane
from pipeline.files.exr_bands import BandedPart, Rows, write_bands
from pipeline.files.npy import append_npy
from pipeline.products.cameras import Inputs, rig_of, stretches
from pipeline.products.positions.params import Positions
from pipeline.truth.direct.candidates import candidates
from pipeline.truth.grid.ray_grid import fine_from_image

Tile = tuple[slice, slice]
"""Rows and columns of the fine grid."""
_ROWS = 256
"""Rows of the fine grid in which traced positions are counted at once."""


def positions(params: Positions, inputs: Inputs, out: Path) -> None:
    """Write positions.exr and, for the task `truth`, two arrays of the traced positions on each plane that has any."""
    rig = rig_of(inputs, params.sampling.seed, params.square_px)
    head: dict[str, str | float | int] = {
        "frame": "frame of the tangent plane, mm: x right, y up, z = 0",
        "extent": params.extent,
    }
    head |= {**dataclasses.asdict(params.sampling), **dataclasses.asdict(params.light)}
    sensor = rig.tracer.camera.sensor
    supersampling = params.sampling.supersampling
    shape = sensor.height_px * supersampling, sensor.width_px * supersampling
    parts = []
    for plane in params.planes:
        tiles_to_trace = None  # the whole image
        if params.extent == "tiles":
            tiles_to_trace = tiles(rig, np.array(plane.points_mm), supersampling)
        pose = np.array(plane.vision_from_target)
        # Both are called with the first and end row of each band.
        trace = functools.partial(position_image, rig, pose, params.sampling, tiles_to_trace)
        files = traced_files(plane.name, out)
        rows = functools.partial(_rows_and_append_traced, files, shape, tiles_to_trace, trace)
        parts.append(BandedPart(name=plane.name, shape=shape, channels=("X", "Y"), rows=rows, attributes=head))
    write_bands(out / "positions.exr", parts)


def tiles(rig: Rig, points_mm: np.ndarray, supersampling: int) -> list[Tile]:
    """Parts of the fine grid where images of points (p, 3) may lie, with a margin for the search."""
    guesses = candidates(rig, points_mm)
    centre = np.rint(fine_from_image(guesses.x_px, supersampling)).astype(int)
    reach = np.ceil(guesses.reach_px * supersampling).astype(int) + 2
    return [
        (slice(max(row - far, 0), max(row + far + 1, 0)), slice(max(column - far, 0), max(column + far + 1, 0)))
        for (column, row), far in zip(centre.tolist(), reach.tolist(), strict=True)
    ]


def is_traced(tiles: list[Tile] | None, width: int, first: int, end: int) -> np.ndarray:
    """Mask of the positions to trace in rows [first, end) of the fine grid, (rows, width); all without tiles."""
    mask = np.full((end - first, width), tiles is None)
    for down, across in tiles or ():
        mask[max(down.start - first, 0) : max(down.stop - first, 0), across] = True
    return mask


def traced_files(plane: str, folder: Path = Path()) -> tuple[Path, Path]:
    """Files of the positions that were traced: indices in the fine grid, row by row, (n,), and J there, (n, 2)."""
    return folder / f"{plane}.index.npy", folder / f"{plane}.traced.npy"


def _rows_and_append_traced(
    files: tuple[Path, Path], shape: tuple[int, int], tiles: list[Tile] | None, trace: Rows, first: int, end: int
) -> np.ndarray:
    """Rows of a position image; the positions among them that were traced are appended to the files."""
    image = trace(first, end)
    mask = is_traced(tiles, shape[1], first, end)

    def count() -> int:
        """Number of positions in all rows, for the headers of the files."""
        bands = pairwise([*range(0, shape[0], _ROWS), shape[0]])
        return sum(int(np.count_nonzero(is_traced(tiles, shape[1], *band))) for band in bands)

    if mask.any():
        append_npy(files[0], np.flatnonzero(mask) + first * shape[1], count)
        append_npy(files[1], image[mask], count)
    return image


def position_image(
    rig: Rig,
    vision_from_target: np.ndarray,
    sampling: Sampling,
    tiles: list[Tile] | None = None,
    *rows: int,
) -> np.ndarray:
    """J on the infinite plane of a target, in the target frame, (K h, K w, 2) float32 [mm]; NaN outside the tiles.

    `rows` are the first and end row of the fine grid; by default all.
    """
    sensor = rig.tracer.camera.sensor
    k = sampling.supersampling
    first, end = rows or (0, sensor.height_px * k)
    mask = is_traced(tiles, sensor.width_px * k, first, end)
    planes = np.stack([target_plane(vision_from_target), parallel_planes(1.0, 2.0)[0]])
    result = np.full((mask.size, 2), np.nan, np.float32)
    for piece in stretches(rig, k, first, end) if mask.any() else ():
        chosen = mask.ravel()[piece.index]
        arguments = (
            piece.positions_mm[chosen],
            piece.microlens[chosen],
            planes,
            sampling.samples,
            piece.pixels[chosen],
        )
        result[piece.index[chosen]] = rig.tracer.moments(*arguments, rig.square_px)[:, :2]
    return result.reshape(*mask.shape, 2)
