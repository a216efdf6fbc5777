"""Claim: the search kernels find, reject and solve what a search written down from the paper does, on noisy images."""

import math

import numpy as np
import pytest
from shorter import few

from pipeline.truth.grid import quad_search

Point = tuple[float, float]
LAMBDA_D, LAMBDA_ALPHA = 0.15, math.radians(10.0)


def noisy_image(noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sheared, noisy position image of three cells with holes, and target points, some of them outside."""
    rng = np.random.default_rng(seed)
    column, row = np.meshgrid(np.arange(26.0), np.arange(22.0))
    image = np.stack([0.9 * column + 0.1 * row - 12.0, 0.08 * column - 1.1 * row + 11.0], axis=-1)
    image += 0.003 * (column * row)[..., None] + rng.normal(0, noise, image.shape)
    cell = (column > 12).astype(np.int64) + 2 * (row > 15)
    cell[0, :4] = -1
    image[rng.uniform(size=cell.shape) < 0.01] = np.nan
    return image, np.ascontiguousarray(cell), rng.uniform(-14, 14, (60, 2))  # as of a build


def holds(corners: list[Point], p: Point) -> bool:
    """Whether a quadrilateral holds a point: the winding number, by summing the angles of its corners."""
    total = 0.0
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        ux, uy, vx, vy = ax - p[0], ay - p[1], bx - p[0], by - p[1]
        total += math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
    return abs(total) > math.pi


def naive_search(image: np.ndarray, cell: np.ndarray, points: np.ndarray) -> dict[tuple[int, int, int], tuple]:
    """(point, column, row) of every quad that holds a point -> (status, solution or None)."""
    height, width = cell.shape
    found = {}
    for j in range(height - 1):
        for i in range(width - 1):
            places = [(j, i), (j, i + 1), (j + 1, i + 1), (j + 1, i)]
            if any(cell[place] != cell[j, i] for place in places) or cell[j, i] < 0:
                continue
            corners = [(float(image[place][0]), float(image[place][1])) for place in places]
            if any(math.isnan(x) for x, _ in corners):
                continue
            for n, p in enumerate(points):
                if holds(corners, tuple(p)):
                    found[n, i, j] = solve(image, cell, p, i, j)
    return found


def solve(image: np.ndarray, cell: np.ndarray, p: np.ndarray, i: int, j: int) -> tuple:
    """The paper's filters and local linear solve for the quad whose top left position is (i, j)."""
    o = min(((j, i), (j, i + 1), (j + 1, i), (j + 1, i + 1)), key=lambda place: math.dist(image[place], p))
    e_j, e_i = (1 if o[0] == j else -1), (1 if o[1] == i else -1)

    def at(a: int, b: int) -> np.ndarray:
        return image[o[0] + b * e_j, o[1] + a * e_i]

    places = [(o[0] + b * e_j, o[1] + a * e_i) for a in range(-1, 3) for b in range(-1, 3)]
    height, width = cell.shape
    if any(r < 0 or r >= height or c < 0 or c >= width for r, c in places):
        return quad_search.WINDOW, None
    if any(cell[place] != cell[j, i] or np.isnan(image[place]).any() for place in places):
        return quad_search.WINDOW, None
    for lengths in (
        [math.dist(at(a, b), at(a + 1, b)) for a in range(-1, 2) for b in range(-1, 3)],
        [math.dist(at(a, b), at(a, b + 1)) for a in range(-1, 3) for b in range(-1, 2)],
    ):
        mean = sum(lengths) / len(lengths)
        if max(abs(1 - length / mean) for length in lengths) >= LAMBDA_D:
            return quad_search.LENGTHS, None
    angles = []
    for a in range(-1, 2):
        for b in range(-1, 2):
            u, v = at(a + 1, b) - at(a, b), at(a, b + 1) - at(a, b)
            angles.append(math.acos(float(u @ v) / math.hypot(*u) / math.hypot(*v)))
    mean = sum(angles) / len(angles)
    if max(abs(angle - mean) for angle in angles) >= LAMBDA_ALPHA:
        return quad_search.ANGLES, None
    s, t = np.linalg.solve(np.stack([at(1, 0) - at(0, 0), at(0, 1) - at(0, 0)], axis=1), p - at(0, 0))
    return quad_search.ACCEPTED, (o[1] + s * e_i, o[0] + t * e_j, math.dist(at(0, 0), p))


@pytest.mark.parametrize("noise", few([0.02], 0.0, 0.05))
def test_kernels_agree_with_the_search_as_the_paper_tells_it(noise: float) -> None:
    verdicts = set()
    for seed in range(4):
        image, cell, points = noisy_image(noise, seed)
        expected = naive_search(image, cell, points)
        quads = np.empty((500, 3), np.int64)
        count = quad_search.quads_that_hold(image, cell, points, quads)
        assert sorted(map(tuple, quads[:count].tolist())) == sorted(expected)
        status, solutions = np.empty(count, np.int64), np.full((count, 9), np.nan)
        limits = quad_search.Filter(True, LAMBDA_D, LAMBDA_ALPHA)
        quad_search.solve_quads(image, cell, points, quads[:count], limits, status, solutions)
        for quad, verdict, solution in zip(quads[:count].tolist(), status, solutions, strict=True):
            wanted, position = expected[tuple(quad)]
            assert verdict == wanted
            verdicts.add(int(verdict))
            if position is not None:
                np.testing.assert_allclose(solution[:3], position, rtol=0, atol=1e-10)
    assert quad_search.ACCEPTED in verdicts
    assert quad_search.WINDOW in verdicts
    if noise > 0.02:
        assert quad_search.LENGTHS in verdicts
