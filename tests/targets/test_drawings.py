"""Claim: what is painted around a target point is what its kind promises, in every pattern."""

import numpy as np
import pytest
from targets.examples import EXAMPLES, name_of

from pipeline.targets.drawing import BESIDE, MIXED, Checks, Disc, Drawing, Polygon, Spokes, colour_of_box
from pipeline.targets.patterns.checkerboard import Checkerboard, Deltille
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.patterns.lines import Lines, SlantedEdge
from pipeline.targets.patterns.pattern import TargetError
from pipeline.targets.patterns.stars import SiemensStar, Stars
from pipeline.targets.patterns.tags import AprilGrid, Charuco
from pipeline.targets.surfaces import Cube, Cylinder, Warped
from pipeline.targets.target import PATTERNS, SURFACES, Target, plain_from_target, target_from_plain
from pipeline.truth.positions.column_sets import corner_edges, corners_of


def around(pattern, xy_mm: np.ndarray, radius_mm: float, count: int = 7200) -> np.ndarray:
    """Colours on a small circle around a point, in order."""
    angle = (np.arange(count) + 0.5) * 2 * np.pi / count
    return pattern.drawing.whiteness(xy_mm[0] + radius_mm * np.cos(angle), xy_mm[1] + radius_mm * np.sin(angle))


def changes(colours: np.ndarray) -> int:
    """How often black and white change once around; a sheet's end counts as white."""
    colours = np.nan_to_num(colours, nan=1.0)
    return int(np.sum(colours != np.roll(colours, 1)))


@pytest.mark.parametrize("pattern", EXAMPLES, ids=name_of)
def test_edges_meet_in_every_point(pattern) -> None:
    """Checkers four, triangles six, a star two per spoke, a tag's corner four with the black square beside it."""
    marks = pattern.marks()
    expected = {
        "checkerboard": {"corner": 4},
        "charuco": {"corner": 4, "marker-corner": 2},
        "aprilgrid": {"corner": 4},
        "circle-grid": {"disc": 0},
        "deltille": {"corner": 6},
        "stars": {"centre": 2 * getattr(pattern, "spokes", 0)},
        "siemens-star": {"centre": 0 if getattr(pattern, "hub_mm", 0) else 2 * getattr(pattern, "spokes", 0), "rim": 2},
        "slanted-edge": {"centre": 2, "end": 2},
        "lines": {"crossing": 0, "end": 2},
    }[pattern.KIND]
    assert {changes(around(pattern, xy, 0.01)) for xy in marks.xy_mm} <= set(expected.values())
    for kind, xy in zip(marks.kinds, marks.xy_mm, strict=True):
        assert changes(around(pattern, xy, 0.01)) == expected[kind]


def test_a_disc_is_black_up_to_its_radius() -> None:
    for pattern in EXAMPLES[4:6]:
        marks = pattern.marks()
        for xy, radius in zip(marks.xy_mm, marks.radius_mm, strict=True):
            assert not around(pattern, xy, radius - 1e-9).any()
            assert around(pattern, xy, radius + 1e-9).all()


def test_edges_are_exact_to_rounding() -> None:
    """A picometre to either side of an edge of a square, a tag and a triangle the colour is that of the side."""
    for pattern, (x, y) in ((EXAMPLES[0], (0.0, 5.0)), (EXAMPLES[2], (-12.4 + 8.0, -8.0))):
        xy = pattern.marks().xy_mm
        edge = xy[np.argmin(np.linalg.norm(xy - [x, y], axis=1)), 0]
        sides = pattern.drawing.whiteness(np.array([edge - 1e-9, edge + 1e-9]), np.full(2, y + 0.3))
        assert set(sides) == {0.0, 1.0}


@pytest.mark.parametrize("pattern", EXAMPLES, ids=name_of)
def test_a_sheet_ends_where_it_says_and_all_points_lie_on_it(pattern) -> None:
    drawing = pattern.drawing
    x, y = drawing.half_x_mm, drawing.half_y_mm
    inside = drawing.whiteness(np.array([x, -x]) * (1 - 1e-12), np.array([-y, y]) * (1 - 1e-12))
    outside = drawing.whiteness(np.array([x * (1 + 1e-12), 0.0]), np.array([0.0, -y * (1 + 1e-12)]))
    assert not np.isnan(inside).any()
    assert np.isnan(outside).all()
    assert (np.abs(pattern.marks().xy_mm) <= np.array([x, y]) * (1 + 1e-12)).all()


@pytest.mark.parametrize("pattern", EXAMPLES, ids=name_of)
def test_targets_cross_a_process_border_unchanged(pattern) -> None:
    assert target_from_plain(plain_from_target(Target(pattern))) == Target(pattern)
    assert {type(example) for example in EXAMPLES} == set(PATTERNS.values())
    assert len(SURFACES) == 6


def test_ids_go_from_the_top_left_to_the_right_except_kalibrs_that_go_up() -> None:
    for pattern in (EXAMPLES[0], EXAMPLES[4], EXAMPLES[5], EXAMPLES[6], EXAMPLES[7], EXAMPLES[11]):
        xy = pattern.marks().xy_mm
        rows = xy[:: pattern.columns, 1]
        assert (np.diff(rows) < 0).all()
        assert (np.diff(xy[: pattern.columns, 0]) > 0).all()
    assert (np.diff(EXAMPLES[2].marks().xy_mm[::6, 1]) > 0).all()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Charuco(columns=9, rows=9, square_mm=5.0, marker_mm=4.0, first_tag=1), "tags 1 to 50"),
        (lambda: Charuco(columns=4, rows=3, square_mm=5.0, marker_mm=5.0), "smaller than squares"),
        (lambda: AprilGrid(columns=4, rows=3, tag_mm=5.0, dictionary="36h11"), "no dictionary"),
        (lambda: Stars(columns=4, rows=3, spacing_mm=5.0, diameter_mm=6.0), "overlap"),
        (lambda: SiemensStar(spokes=20, diameter_mm=5.0, hub_mm=5.0), "hub"),
        (lambda: SlantedEdge(width_mm=5.0, height_mm=200.0), "upper to the lower"),
        (lambda: Lines(columns=0, rows=0, spacing_mm=5.0, width_mm=1.0), "0 upright"),
    ],
)
def test_what_cannot_be_is_refused(make, words) -> None:
    with pytest.raises(TargetError, match=words):
        make()


SHAPES = {
    "polygon": Polygon(corners=((-8.0, -3.0), (7.5, -11.0), (2.0, 14.0))),
    "disc": Disc(x=1.0, y=-2.0, radius=8.5),
    "spokes": Spokes(x=-1.0, y=3.0, inner=1.0, outer=9.0, count=5, phase=0.2),
    "checks, high": Checks(columns=1, rows=6, square=4.3),
    "checks, wide": Checks(columns=5, rows=2, square=3.1),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_shape_looks_the_same_alone_and_among_many(shape: str) -> None:
    """On a sheet with forty specks in its corner, whose grid of bins is finer than the shape: up to its last edge."""
    specks = [Disc(x=-18.0 + 0.05 * i, y=19.0, radius=0.01) for i in range(40)]
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-19.7, 19.7, 301), np.linspace(-18.7, 18.3, 301)))
    alone, among = (Drawing(20.0, 20.0, shapes) for shapes in ([SHAPES[shape]], [*specks, SHAPES[shape]]))
    assert 0.02 < np.mean(alone.whiteness(x, y) == 0) < 0.6
    np.testing.assert_array_equal(among.whiteness(x, y), alone.whiteness(x, y))


@pytest.mark.parametrize("pattern", EXAMPLES, ids=name_of)
def test_a_box_of_one_colour_has_no_other(pattern) -> None:
    """Boxes of a chart: one that is said to have a colour has it at every point, and most that have one are said so."""
    rng, drawing = np.random.default_rng(4), pattern.drawing
    half = np.array([drawing.half_x_mm, drawing.half_y_mm])
    judged, plain = 0, 0
    for middle, size in zip(rng.uniform(-1.1, 1.1, (400, 2)) * half, rng.uniform(0.005, 0.4, (400, 2)), strict=True):
        low, high = middle - size, middle + size
        found = colour_of_box(drawing.arrays, low[0], high[0], low[1], high[1])
        x, y = (axis.ravel() for axis in np.meshgrid(*np.linspace(low, high, 24).T))
        values = np.nan_to_num(drawing.whiteness(x, y), nan=BESIDE)
        if found != MIXED:
            assert np.all(values == found)
        judged, plain = judged + (found != MIXED), plain + (np.ptp(values) == 0)
    assert judged > 0
    if not isinstance(pattern, (Stars, SiemensStar)):  # between spokes no box is plain
        assert judged > 0.95 * plain


def test_a_box_that_holds_nan_is_doubted() -> None:
    arrays = EXAMPLES[0].drawing.arrays
    for place in range(4):
        box = [-0.1, 0.1, -0.1, 0.1]
        box[place] = np.nan
        assert colour_of_box(arrays, *box) == MIXED


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
            chord = patch.surface_at(xy + along)[0] - patch.surface_at(xy - along)[0]
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
