"""Flat sheets one by one, in double, against a linear solve per ray and sheet."""

import numpy as np
from laws.rigs import facing
from render.lens_rays import lens_rays, nearest

from pipeline.frames import apply
from pipeline.render.glow import TargetLight
from pipeline.render.glow_kernels import first_sheet
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

HALF_SIZES = np.array([[12.0, 20.0], [15.0, 9.0], [40.0, 30.0]])
POSES = np.stack([facing(400.0, 20.0, 3.0), facing(430.0, -35.0, -6.0, 2.0), facing(500.0, 5.0)])
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])


def sheets_hit(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    first = np.empty(len(origins), np.int64)
    first_sheet(POSES, HALF_SIZES, origins, directions, first)
    return first


def test_the_nearest_sheet_in_front_is_named() -> None:
    origins, directions = lens_rays(100_000, seed=3)
    quads = [apply(pose, SQUARE * [*half, 1.0]) for pose, half in zip(POSES, HALF_SIZES, strict=True)]
    expected = nearest(quads, origins, directions)
    assert set(np.unique(expected)) == {-1, 0, 1, 2}
    assert np.array_equal(sheets_hit(origins, directions), expected)


def test_sheets_behind_the_start_and_rays_without_numbers_are_passed_over() -> None:
    origins = np.array([[0.0, 0.0, 450.0], [0.0, 0.0, 600.0], [np.nan] * 3, [0.0, 0.0, 0.0]])
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [np.nan] * 3])
    assert sheets_hit(origins, directions).tolist() == [2, -1, -1, -1]


def test_one_board_alone_shines_as_among_others() -> None:
    """A second board that no ray meets changes nothing: the way for one board gives the bits of that for several."""
    board = Target(Checkerboard(columns=20, rows=19, square_mm=4.0))
    here, away = facing(420.0, 15.0, 2.0), facing(420.0)
    away[0, 3] += 1e6
    origins, directions = lens_rays(20_000, seed=4)
    alone = TargetLight([(board, here)], 0.25).radiance(origins, directions)
    assert set(np.unique(alone)) == {0.0, 0.25, 1.0}
    assert np.array_equal(alone, TargetLight([(board, here), (board, away)], 0.25).radiance(origins, directions))


def test_one_board_alone_is_not_seen_behind_the_start_or_by_rays_without_numbers() -> None:
    light = TargetLight([(Target(Checkerboard(columns=20, rows=19, square_mm=4.0)), facing(420.0))], 0.25)
    origins = np.array([[0.0, 0.0, 450.0], [np.nan] * 3, [0.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [np.nan] * 3, [0.0, 0.0, 1.0]])
    assert light.radiance(origins, directions).tolist()[:3] == [0.25] * 3
    assert light.radiance(origins, directions)[3] in (0.0, 1.0)
