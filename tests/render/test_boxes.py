"""Rays that pass a box by: none of their points lies in it; what is seen past boxes is what Embree sees of all."""

import numpy as np

from pipeline.frames import rigid
from pipeline.render.glow import TargetLight
from pipeline.render.glow_kernels import may_meet
from pipeline.targets.mesh import Occluder
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

BOXES = np.array([[[-1.0, -2.0, 3.0], [0.5, 1.0, 4.0]], [[2.0, 2.0, 5.0], [2.1, 6.0, 5.0]]])
CARD = Occluder(vertices_mm=((0.0, 0.0, 0.0), (6.0, 0.0, 1.0), (0.0, 5.0, 2.0)), triangles=((0, 1, 2),), radiance=0.4)


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
