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
    """Write positions.exr; and, for the task `truth`, what was traced on each plane: two arrays, if there is any."""
    rig = rig_of(inputs, params.sampling.seed, params.square_px)
    head: dict[str, str | float | int] = {
        "frame": "frame of the tangent plane, mm: x right, y up, z = 0",
        "extent": params.extent,
    }
    head |= {**dataclasses.asdict(params.sampling), **dataclasses.asdict(params.light)}
    sensor, k = rig.tracer.camera.sensor, params.sampling.supersampling
    shape = sensor.height_px * k, sensor.width_px * k
    parts = []
    for plane in params.planes:
        wanted = tiles(rig, np.array(plane.points_mm), k) if params.extent == "tiles" else None
        pose = np.array(plane.vision_from_target)
        traced = functools.partial(position_image, rig, pose, params.sampling, wanted)
        rows = functools.partial(_kept, traced_files(plane.name, out), shape, wanted, traced)
        parts.append(BandedPart(name=plane.name, shape=shape, channels=("X", "Y"), rows=rows, attributes=head))
    write_bands(out / "positions.exr", parts)


def tiles(rig: Rig, points_mm: np.ndarray, supersampling: int) -> list[Tile]:
    """Parts of the fine grid where images of points (p, 3) may lie, with room for the search."""
    found = candidates(rig, points_mm)
    centre = np.rint(fine_from_image(found.x_px, supersampling)).astype(int)
    room = np.ceil(found.reach_px * supersampling).astype(int) + 2
    return [
        (slice(max(row - far, 0), max(row + far + 1, 0)), slice(max(column - far, 0), max(column + far + 1, 0)))
        for (column, row), far in zip(centre.tolist(), room.tolist(), strict=True)
    ]


def is_wanted(wanted: list[Tile] | None, width: int, first: int, end: int) -> np.ndarray:
    """Mask of the positions to trace in rows [first, end) of the fine grid, (rows, width); all without tiles."""
    mask = np.full((end - first, width), wanted is None)
    for down, across in wanted or ():
        mask[max(down.start - first, 0) : max(down.stop - first, 0), across] = True
    return mask


def traced_files(plane: str, folder: Path = Path()) -> tuple[Path, Path]:
    """Files of the positions that were traced: places in the fine grid, row by row, (n,), and J there, (n, 2)."""
    return folder / f"{plane}.index.npy", folder / f"{plane}.traced.npy"


def _kept(
    files: tuple[Path, Path], shape: tuple[int, int], wanted: list[Tile] | None, traced: Rows, first: int, end: int
) -> np.ndarray:
    """Rows of a position image, whose traced positions are appended to the files."""
    image, mask = traced(first, end), is_wanted(wanted, shape[1], first, end)

    def count() -> int:
        bands = pairwise([*range(0, shape[0], _ROWS), shape[0]])
        return sum(int(np.count_nonzero(is_wanted(wanted, shape[1], *band))) for band in bands)

    if mask.any():
        append_npy(files[0], np.flatnonzero(mask) + first * shape[1], count)
        append_npy(files[1], image[mask], count)
    return image


def position_image(
    rig: Rig,
    vision_from_target: np.ndarray,
    sampling: Sampling,
    wanted: list[Tile] | None = None,
    *rows: int,
) -> np.ndarray:
    """J on the infinite plane of a target, in the target frame, (K h, K w, 2) float32 [mm]; NaN where not wanted.

    `rows` are the first and end row of the fine grid, if not all are asked for.
    """
    sensor, k = rig.tracer.camera.sensor, sampling.supersampling
    first, end = rows or (0, sensor.height_px * k)
    mask = is_wanted(wanted, sensor.width_px * k, first, end)
    planes = np.stack([target_plane(vision_from_target), parallel_planes(1.0, 2.0)[0]])
    result = np.full((mask.size, 2), np.nan, np.float32)
    for piece in stretches(rig, k, first, end) if mask.any() else ():
        is_traced = mask.ravel()[piece.index]
        arguments = (
            piece.positions_mm[is_traced],
            piece.microlens[is_traced],
            planes,
            sampling.samples,
            piece.pixels[is_traced],
        )
        result[piece.index[is_traced]] = rig.tracer.moments(*arguments, rig.square_px)[:, :2]
    return result.reshape(*mask.shape, 2)
