"""Position images around single rows, traced again: the same rays as in rays.exr, without reading that file.

Random numbers depend only on the seed and the fine position, so a window uses the numbers of the whole image.
"""

import math
from dataclasses import dataclass

import numpy as np

from pipeline.camera.parts.camera import Sampling
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes, target_plane
from pipeline.tasks.artefacts.cameras import Stretch
from pipeline.tasks.rays import error_of
from pipeline.tasks.rays_tile import FAR, HIT_FRACTION, NEAR, WIDTH, traced
from pipeline.truth.grid.correspond import completed, find
from pipeline.truth.grid.per_plane import REACH_PX, REACH_STEPS
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import RayGrid, image_from_fine
from pipeline.truth.grid.second_order import corrected
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import TruthSettings


@dataclass(frozen=True, slots=True)
class Window:
    """The rays of some whole pixels of an image.

    Attributes
    ----------
    grid : RayGrid
        Rays of the window, whose first pixel is (0, 0).
    first_px : (2,) int64
        The same pixel in the image, x and y.
    piece : Stretch
        The fine positions, row by row.
    """

    grid: RayGrid
    first_px: np.ndarray
    piece: Stretch


def window_around(rig: Rig, x_px: np.ndarray, sampling: Sampling) -> Window:
    """The window that a search for a row at an image position (2,) reads.

    Parameters
    ----------
    rig : Rig
        Camera made ready with the seed of the build.
    sampling : Sampling
        Sampling that the task `rays_tile` reads.
    """
    sensor, k = rig.tracer.camera.sensor, sampling.supersampling
    reach, most = REACH_PX + math.ceil(REACH_STEPS / k), np.array([sensor.width_px, sensor.height_px])
    middle = np.clip(np.rint(x_px), 0, most - 1).astype(np.int64)
    first, end = np.maximum(middle - reach, 0), np.minimum(middle + reach + 1, most)
    width, height = (end - first) * k
    index = np.arange(width * height)
    pixels = np.stack([index % width, index // width], axis=1) + first * k
    positions = rig.tracer.positions_mm(*image_from_fine(pixels.T, k))
    piece = Stretch(index, pixels, positions, rig.microlens_at(positions))
    return Window(_grid(rig, piece, (height, width), first, sampling), first, piece)


def _grid(rig: Rig, piece: Stretch, shape: tuple[int, int], first_px: np.ndarray, sampling: Sampling) -> RayGrid:
    """Values of `rays.exr` at the positions, with the same rounding."""
    camera, lattice, k = rig.tracer.camera, rig.tracer.lattice, sampling.supersampling
    assert camera.near_mm is not None and camera.far_mm is not None
    found, second = (values.astype(np.float32) for values in traced(rig.tracer, piece, sampling, rig.square_px))
    bundles = found.reshape(*shape, WIDTH)
    cells = (piece.microlens if rig.images else np.zeros_like(piece.microlens)).reshape(shape)
    microlenses, centres = np.zeros((1, 3), np.int64), None
    if lattice is not None and rig.images is not None:
        microlenses = np.stack([lattice.k, lattice.l, lattice.type], axis=1)
        centres = rig.tracer.pixels_at(rig.images.centre_mm) - first_px
    return RayGrid(
        supersampling=k,
        near_mm=camera.near_mm,
        far_mm=camera.far_mm,
        near=bundles[..., NEAR].astype(np.float64),
        far=bundles[..., FAR].astype(np.float64),
        covariance=second.reshape(*shape, 10)[k // 2 :: k, k // 2 :: k].astype(np.float64),
        hit_fraction=bundles[..., HIT_FRACTION].astype(np.float64),
        error_px=error_of(bundles, cells, k).astype(np.float32).astype(np.float64),
        cell=cells,
        microlenses=microlenses,
        centres_px=centres,
        square_steps=rig.square_px * k,
    )


def rows_near(
    rig: Rig,
    window: Window,
    point_mm: np.ndarray,
    vision_from_plane: np.ndarray,
    settings: TruthSettings,
    sampling: Sampling,
) -> Correspondences:
    """Rows that the search finds in a window for one point (3,) of a tangent plane; positions are those of the whole
    image.
    """
    image = _position_image(rig, window, vision_from_plane, settings.method, sampling)
    found, counts = find(image, point_mm[None], window.grid, settings)
    rows = completed(found, counts, window.grid, vision_from_plane, settings)
    return rows.moved(window.first_px)


def _position_image(
    rig: Rig, window: Window, vision_from_plane: np.ndarray, method: str, sampling: Sampling
) -> np.ndarray:
    """J on a plane, in its frame, by a method, (K h, K w, 2) [mm]."""
    grid, piece = window.grid, window.piece
    if method == "image":
        planes = np.stack([target_plane(vision_from_plane), parallel_planes(1.0, 2.0)[0]])
        rays = piece.positions_mm, piece.microlens, planes, sampling.samples, piece.pixels
        crossings = rig.tracer.moments(*rays, rig.square_px)[:, :2].astype(np.float32)
        return crossings.reshape(*grid.cell.shape, 2).astype(np.float64)
    image = on_target(grid.near, grid.far, grid.near_mm, grid.far_mm, vision_from_plane)
    return corrected(image, grid, vision_from_plane) if method == "moments" else image
