"""Flat sheets one by one, in double, against a linear solve per ray and sheet; rays that pass a box by: none of their
points lies in it; what is seen past boxes is what Embree sees of all.
"""

import numpy as np
from laws.rigs import facing
from render.lens_rays import lens_rays, nearest

from pipeline.frames import apply, rigid
from pipeline.render.glow import TargetLight, first_sheet, may_meet
from pipeline.targets.mesh import Occluder
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

BOXES = np.array([[[-1.0, -2.0, 3.0], [0.5, 1.0, 4.0]], [[2.0, 2.0, 5.0], [2.1, 6.0, 5.0]]])
CARD = Occluder(vertices_mm=((0.0, 0.0, 0.0), (6.0, 0.0, 1.0), (0.0, 5.0, 2.0)), triangles=((0, 1, 2),), radiance=0.4)
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


def rays(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins about the vision frame's own, unit directions within 30 degrees or so of the axis."""
    rng = np.random.default_rng(8)
    direction = np.column_stack([rng.normal(0.0, 0.4, (count, 2)), np.ones(count)])
    return rng.normal(0.0, 1.0, (count, 3)), direction / np.linalg.norm(direction, axis=1)[:, None]


def test_points_of_rays_that_pass_by_lie_in_no_box() -> None:
    origin, direction = rays(4000)
    near = np.empty(len(origin), bool)
    may_meet(BOXES, origin, direction, near)
    points = origin[:, None] + np.linspace(0.0, 12.0, 2000)[:, None] * direction[:, None]
    inside = np.array([((points >= low) & (points <= high)).all(axis=2).any(axis=1) for low, high in BOXES]).any(axis=0)
    assert 100 < inside.sum() <= near.sum() < 1.2 * inside.sum()
    assert near[inside].all()


def test_rays_along_the_axis() -> None:
    origin = np.array([[0.0, 0.0, 9.0], [0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    near = np.empty(4, bool)
    may_meet(BOXES[:1], origin, np.tile([0.0, 0.0, 1.0], (4, 1)), near)
    assert near.tolist() == [False, True, True, True]


def test_what_is_seen_past_a_card_is_what_embree_sees_of_all() -> None:
    away = rigid(np.diag([1.0, -1.0, -1.0]), np.array([1.0, 0.0, 40.0]))
    before = rigid(np.eye(3), np.array([0.0, 0.0, 30.0]))
    light = TargetLight([(Target(Checkerboard(columns=4, rows=3, square_mm=4.0)), away)], 0.25, [(CARD, before)])
    origin, direction = rays(20_000)
    asked = np.full(len(origin), 0.25)
    light._by_embree(origin, direction, asked)
    found = light.radiance(origin, direction)
    assert (found == 0.4).sum() > 100
    assert np.array_equal(found == 0.4, asked == 0.4)
    assert (found != asked).mean() < 1e-3  # at the rim of the board Embree rounds in single precision
