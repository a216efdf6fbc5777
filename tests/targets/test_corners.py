"""Which points are X-corners, and which of their sectors are white: against the drawings and the surfaces."""

import numpy as np
import pytest

from pipeline.targets.corners import corner_edges, corners_of
from pipeline.targets.patterns.aprilgrid import AprilGrid
from pipeline.targets.patterns.charuco import Charuco
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.patterns.deltille import Deltille
from pipeline.targets.patterns.lines import Lines, SlantedEdge
from pipeline.targets.patterns.stars import SiemensStar, Stars
from pipeline.targets.surfaces import Cube, Cylinder, Warped
from pipeline.targets.target import Target

BOARD = Checkerboard(columns=4, rows=3, square_mm=2.0)


@pytest.mark.parametrize(
    ("pattern", "corners"),
    [
        (BOARD, 12),
        (Charuco(columns=3, rows=2, square_mm=6.0, marker_mm=4.5, marker_corners=True), 6),  # of 30: tags stand alone
        (AprilGrid(columns=2, rows=2, tag_mm=8.0), 16),  # a tag and a small square meet
        (Stars(columns=2, rows=1, spacing_mm=6.0, diameter_mm=5.0, spokes=2), 2),
        (Stars(columns=2, rows=1, spacing_mm=6.0, diameter_mm=5.0, spokes=4), 0),
        (Deltille(columns=3, rows=2, edge_mm=5.0), 0),  # six sectors
        (CircleGrid(columns=2, rows=1, spacing_mm=6.0, diameter_mm=3.0), 0),
        (Lines(columns=2, rows=2, spacing_mm=6.0, width_mm=1.0), 0),
        (SlantedEdge(width_mm=30.0, height_mm=20.0), 0),
        (SiemensStar(spokes=6, diameter_mm=20.0), 0),
    ],
    ids=lambda value: getattr(value, "KIND", str(value)),
)
def test_white_lies_between_the_edges_of_a_corner_and_black_beside_them(pattern, corners):
    xy = pattern.marks().xy_mm
    edges = corner_edges(pattern.drawing, xy)
    is_corner = np.isfinite(edges).all(axis=1)
    assert is_corner.sum() == corners
    middle, quarter = edges[is_corner].mean(axis=1), np.pi / 2
    for turn, colour in ((0, 1), (quarter, 0), (2 * quarter, 1), (3 * quarter, 0)):
        beside = xy[is_corner] + 0.05 * np.stack([np.cos(middle + turn), np.sin(middle + turn)], axis=1)
        assert (pattern.drawing.whiteness(*beside.T) == colour).all()


@pytest.mark.parametrize(
    "surface", [Warped(deflection_mm=(1.0, -2.0)), Cylinder(radius_mm=9.0), Cube(edge_mm=16.0)], ids=lambda s: s.KIND
)
def test_edges_run_along_the_surface(surface):
    """From point to neighbour in a row or a column, to first order: the chord's middle leaves the edge by its sag."""
    target = Target(BOARD, surface)
    edges, step = corners_of(target).edges, 1e-4
    points = target.points()
    moved = []
    for patch, pattern in target.surface.patches(BOARD):
        xy, direction = pattern.marks().xy_mm, corner_edges(pattern.drawing, pattern.marks().xy_mm)
        for k in range(2):
            along = step * np.stack([np.cos(direction[:, k]), np.sin(direction[:, k])], axis=1)
            chord = patch.place(xy + along)[0] - patch.place(xy - along)[0]
            moved.append(chord @ patch.target_from_patch[:3, :3].T)
    chords = np.stack([np.concatenate(moved[0::2]), np.concatenate(moved[1::2])], axis=1)
    assert edges == pytest.approx(chords / np.linalg.norm(chords, axis=2, keepdims=True), abs=1e-7)
    assert np.abs(np.einsum("nki,ni->nk", edges, points.axes[:, :, 2])).max() < 1e-12


def test_a_pattern_of_one_grey_has_no_corners():
    board = Checkerboard(columns=4, rows=3, square_mm=2.0, white=0.5, black=0.5)
    assert np.isnan(corners_of(Target(board)).edges).all()


def test_colours_are_mean_over_contrast():
    board = Checkerboard(columns=4, rows=3, square_mm=2.0, white=0.9, black=0.1)
    assert corners_of(Target(board)).mean_over_contrast == pytest.approx(np.full(12, 1.25))
