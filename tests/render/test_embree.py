"""Embree names the board that a ray/plane computation in double names too."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from render.lens_rays import lens_rays, nearest

from pipeline.render.surroundings import MeshScene


def board(
    centre: tuple[float, float, float], half_x: float, half_y: float, yaw_deg: float, tilt_deg: float
) -> np.ndarray:
    """Corners around a tilted rectangle, vision frame [mm]."""
    yaw, tilt = np.radians([yaw_deg, tilt_deg])
    about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    flat = np.array([[-half_x, -half_y, 0], [half_x, -half_y, 0], [half_x, half_y, 0], [-half_x, half_y, 0]])
    return flat @ (about_y @ about_x).T + centre


BOARDS = [
    board((-20, 5, 400), 60, 40, 20, -15),
    board((25, -10, 440), 70, 50, -30, 10),
    board((0, 0, 520), 90, 90, 0, 0),
]


class Boards:
    """Parallelograms of two triangles each; answers with the number of the board."""

    def __init__(self, quads: list[np.ndarray]) -> None:
        self.scene = MeshScene([np.asarray(quad)[[[0, 1, 2], [0, 2, 3]]] for quad in quads])

    def first_hit(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        triangle = self.scene.first_hit(origins, directions)
        assert triangle.dtype == np.int32
        return np.where(triangle >= 0, triangle // 2, -1)


def test_the_first_board_is_named() -> None:
    """Away from edges every ray agrees; the share of rays within float32 of an edge is tiny."""
    origins, directions = lens_rays(300_000, seed=1)
    hit = Boards(BOARDS).first_hit(origins, directions)
    expected = nearest(BOARDS, origins, directions)
    assert set(np.unique(expected)) == {-1, 0, 1, 2}
    assert np.mean(hit != expected) < 1e-5


@pytest.mark.parametrize("clearance_mm", [1e-3, -1e-3])
def test_a_micrometre_from_an_edge_is_enough(clearance_mm: float) -> None:
    """float32 resolves 3e-5 mm at 400 mm; rays that pass 1e-3 mm inside or outside an edge are never mistaken."""
    quad = BOARDS[0]
    rng = np.random.default_rng(2)
    along, edge, count = rng.uniform(0.01, 0.99, 200_000), rng.integers(0, 4, 200_000), 200_000
    start, end = quad[edge], quad[(edge + 1) % 4]
    inwards = quad.mean(axis=0) - (start + end) / 2
    inwards /= np.linalg.norm(inwards, axis=1)[:, None]
    aims = start + along[:, None] * (end - start) + clearance_mm * inwards
    origins, _ = lens_rays(count, seed=3)
    hit = Boards([quad]).first_hit(origins, aims - origins)
    assert np.all(hit == (0 if clearance_mm > 0 else -1))


def test_no_ray_slips_through_the_diagonal() -> None:
    """Two triangles make a board; their common edge is no gap."""
    quad = BOARDS[0]
    along = np.random.default_rng(4).uniform(0.001, 0.999, (200_000, 1))
    origins, _ = lens_rays(len(along), seed=5)
    for first, last in ((0, 2), (1, 3)):
        aims = quad[first] + along * (quad[last] - quad[first])
        assert np.all(Boards([quad]).first_hit(origins, aims - origins) == 0)


def test_boards_behind_the_start_are_not_seen_and_rays_without_numbers_hit_nothing() -> None:
    """A ray that failed in the lens is NaN."""
    origins = np.array([[0.0, 0.0, 600.0], [0.0, 0.0, 480.0], [0.0, 0.0, 0.0], [np.nan] * 3, [0.0, 0.0, 0.0]])
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [np.nan] * 3, [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    assert Boards(BOARDS).first_hit(origins, directions).tolist() == [-1, 2, -1, -1, 0]


def test_an_empty_scene_and_no_rays() -> None:
    origins, directions = lens_rays(5, seed=7)
    assert Boards([]).first_hit(origins, directions).tolist() == [-1] * 5
    assert Boards(BOARDS).first_hit(origins[:0], directions[:0]).shape == (0,)


def test_the_answer_does_not_depend_on_parts_threads_or_length() -> None:
    origins, directions = lens_rays(600_000, seed=8)
    scene = Boards(BOARDS)
    whole = scene.first_hit(origins, directions)
    with ThreadPoolExecutor(4) as pool:
        pieces = list(pool.map(scene.first_hit, np.array_split(origins, 7), np.array_split(directions, 7)))
    np.testing.assert_array_equal(np.concatenate(pieces), whole)
    assert np.mean(scene.first_hit(origins, directions * 1e-3) != whole) < 1e-5


@pytest.mark.parametrize(
    "corners", [[[0, 0, np.nan], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 0, 0]]], ids=["nan", "edge"]
)
def test_what_is_no_triangle_is_refused(corners: list) -> None:
    with pytest.raises(ValueError, match="mesh 1 "):
        MeshScene([BOARDS[0][None, :3], np.array(corners, dtype=np.float64)[None]])
