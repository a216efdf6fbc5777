"""Claim: arrays of every layout have the lenses, types and cells that their descriptions say, pixels and apertures
weigh what closed forms say, and models of microlenses agree where they must.
"""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from laws import rigs
from laws.rigs import acceptance_of, behind_a_hole
from tolerances import ORDER, ROUNDING_MM, STRATIFIED

from pipeline.camera.focusing.depth_of_field import foci
from pipeline.camera.parts.camera import WEIGHTS
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.lattice import cell, lattice
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.parts.polygon import regular
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.acceptance import disc_weight, region_weight
from pipeline.camera.tracing.microlens_kernels import aims_for, rays_before
from pipeline.camera.tracing.moments import FREE_WEIGHT, WEIGHT
from pipeline.optics.first_order import first_order
from pipeline.render.imaging import irradiance_and_crosstalk

pytestmark = pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")


def counted(layout: str, columns: int, rows: int, **more: object) -> MicrolensArray:
    more = {"pitch_mm": 0.02, "focal_lengths_mm": (0.04,), **more}
    return MicrolensArray(layout=layout, columns=columns, rows=rows, distance_mm=0.04, **more)


@pytest.mark.parametrize("rotation_deg", [0.0, 0.9])
@pytest.mark.parametrize(
    ("layout", "columns", "rows"),
    [("hexagonal", 176, 152), ("hexagonal", 541, 434), ("hexagonal-columns", 41, 30), ("square", 33, 20)],
)
def test_counted_arrays_have_so_many_lenses(layout: str, columns: int, rows: int, rotation_deg: float) -> None:
    """Raytrix R12 and UPC-S (comsee-research, compote and prism) among them; a rotation does not change the number."""
    grid = lattice(counted(layout, columns, rows, rotation_deg=rotation_deg))
    assert len(grid.k) == columns * rows
    lines, lenses = np.unique(grid.k if layout == "hexagonal-columns" else grid.l, return_counts=True)
    assert len(lines) == (columns if layout == "hexagonal-columns" else rows)
    assert set(lenses) == {rows if layout == "hexagonal-columns" else columns}


def test_rows_turned_by_thirty_degrees_are_columns() -> None:
    """The column layout is the row layout turned from +x towards +y."""
    rows = lattice(counted("hexagonal", 40, 40, rotation_deg=30.0))
    columns = lattice(counted("hexagonal-columns", 40, 40))
    places = dict(zip(zip(rows.k, rows.l, strict=True), zip(rows.x_mm, rows.y_mm, strict=True), strict=True))
    for k, l, x, y in zip(columns.k, columns.l, columns.x_mm, columns.y_mm, strict=True):
        if (k, l) in places:
            assert math.dist(places[k, l], (x, y)) < ROUNDING_MM


def test_measured_pitches_stretch_the_lattice() -> None:
    """R12: 0.12744 mm along the rows, which stand sqrt(3) / 2 of 0.12746 mm apart."""
    grid = lattice(counted("hexagonal", 176, 152, pitch_mm=0.12744, cross_pitch_mm=0.12746))
    assert np.diff(np.unique(grid.y_mm.round(9))).mean() == pytest.approx(0.12746 * math.sqrt(3) / 2, rel=1e-9)
    row = grid.x_mm[grid.l == 4]
    assert np.diff(np.sort(row)).mean() == pytest.approx(0.12744, rel=1e-9)


def test_a_type_table_can_say_what_the_rule_says() -> None:
    """A period of 3 x 3 with (k - l) mod 3, over negative indices, too."""
    focal = (0.04, 0.05, 0.06)
    rule = lattice(counted("hexagonal", 50, 40, focal_lengths_mm=focal))
    table = tuple((k - l) % 3 for l in range(3) for k in range(3))
    written = counted("hexagonal", 50, 40, focal_lengths_mm=focal, type_table=table, type_period=(3, 3))
    np.testing.assert_array_equal(lattice(written).type, rule.type)
    two = lattice(counted("square", 9, 8, focal_lengths_mm=(0.04, 0.05), type_table=(0, 1, 1, 0), type_period=(2, 2)))
    np.testing.assert_array_equal(two.type, (two.k + two.l) % 2)


@pytest.mark.parametrize(
    "wrong",
    [
        {"layout": "square", "focal_lengths_mm": (1.0, 2.0, 3.0)},
        {"focal_lengths_mm": (1.0, 2.0)},
        {"type_table": (0, 1), "type_period": (2, 1)},
        {"type_table": (0,)},
        {"aperture": "disc"},
        {"aperture": "disc", "disc_diameter_mm": 0.021},
        {"cross_pitch_mm": 0.03},
        {"width_mm": 1.0, "height_mm": 1.0},
        {"model": "two-plane"},
        {"model": "refractive", "index": 1.5, "thickness_mm": 0.1, "front_radii_mm": (1.0,)},
    ],
)
def test_arrays_that_cannot_exist_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(CameraError):
        counted(**{"layout": "hexagonal", "columns": 9, "rows": 9, **wrong})


def test_stated_focal_lengths_of_faces_are_theirs_or_refused() -> None:
    """A plano-convex microlens has f = R / (n - 1), however thick it is."""
    faces = {"index": 1.5, "thickness_mm": 0.01, "front_radii_mm": (math.inf,), "rear_radii_mm": (-0.02,)}
    array = counted("square", 9, 9, model="refractive", **faces)
    assert array.focal_lengths_mm == pytest.approx((0.04,), rel=1e-12)
    for wrong in (0.04 * (1 + 1e-6), 0.04 * (1 - 1e-6), -0.04):
        with pytest.raises(CameraError, match="are not those of the faces"):
            counted("square", 9, 9, model="refractive", focal_lengths_mm=(wrong,), **faces)


@pytest.mark.parametrize(
    ("layout", "stretch", "area"),
    [
        ("hexagonal", 1.0, math.sqrt(3) / 2),
        ("hexagonal", 1.1, 1.1 * math.sqrt(3) / 2),
        ("hexagonal-columns", 0.9, 0.9 * math.sqrt(3) / 2),
        ("square", 1.2, 1.2),
    ],
)
def test_cells_tile_the_plane(layout: str, stretch: float, area: float) -> None:
    """A cell has the area of the lattice's parallelogram, and is centred."""
    corners = cell(counted(layout, 9, 9, pitch_mm=1.0, cross_pitch_mm=stretch, rotation_deg=11.0))
    following = np.roll(corners, -1, axis=0)
    assert np.sum(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]) / 2 == pytest.approx(
        area, rel=1e-13
    )
    np.testing.assert_allclose(corners.mean(axis=0), 0.0, atol=1e-14)


def test_a_disc_weighs_pi_sine_squared_and_from_aside_what_many_edges_weigh() -> None:
    """On the axis in closed form; off it the polygons around and inside a disc enclose its weight, ever closer."""
    assert disc_weight(3.0, 0.0, 0.0, 4.0) == pytest.approx(math.pi * 9 / 25, rel=1e-15)
    gaps = []
    for sides in (32, 64, 128):
        outer = regular(sides, 1.0, 0.0)
        inner = outer * math.cos(math.pi / sides)
        low, high = (region_weight(p, sides, 1.7, -0.4, 2.0, acceptance_of()) for p in (inner, outer))
        assert low < disc_weight(1.0, 1.7, -0.4, 2.0) < high
        gaps.append(high - low)
    for wide, narrow in itertools.pairwise(gaps):
        assert narrow == pytest.approx(wide / 4, rel=0.01)


@pytest.mark.parametrize(
    "pixels",
    [{}, {"acceptance": "cosine", "acceptance_power": 2.0}, {"acceptance": "cone", "acceptance_half_angle_deg": 40.0}],
)
@pytest.mark.parametrize("disc_mm", [None, 0.8])
@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize(("layout", "area"), [("square", 1.0), ("hexagonal", math.sqrt(3) / 2)])
def test_what_leaves_a_camera_that_blocks_nothing_is_its_free_weight(
    layout: str, area: float, weight: str, disc_mm: float | None, pixels: dict[str, object]
) -> None:
    """Hit fraction 1 from anywhere in a cell, of cells and discs, whatever the pixels take; by area, without
    acceptance, it is their area.
    """
    aperture = {"aperture": "disc", "disc_diameter_mm": disc_mm} if disc_mm else {}
    array = MicrolensArray(
        layout=layout, pitch_mm=1.0, focal_lengths_mm=(3.0,), columns=3, rows=3, distance_mm=1.5, **aperture
    )
    tracer = Tracer(dataclasses.replace(behind_a_hole(array, **pixels).camera, weight=weight))
    positions = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 2))
    row = int(np.flatnonzero((tracer.lattice.k == 0) & (tracer.lattice.l == 0))[0])
    index = np.stack([np.arange(20), np.arange(20)], axis=1)
    found = tracer.moments(positions, np.full(20, row), parallel_planes(20.0, 30.0), 1 << 16, index)
    # A disc and a cone cut through strata: a boundary of n^(1/2) of n strata, each off by a part of itself.
    cut = 5.0 if disc_mm or "acceptance_half_angle_deg" in pixels else 1.0
    np.testing.assert_allclose(found[:, WEIGHT] / found[:, FREE_WEIGHT], 1.0, rtol=0, atol=cut * STRATIFIED)
    if weight == "area" and not pixels:
        assert found[:, FREE_WEIGHT] == pytest.approx(math.pi * 0.16 if disc_mm else area, rel=1e-12)


def through(array: MicrolensArray, heights: np.ndarray) -> np.ndarray:
    """Slopes before the array of rays from the sensor point on the axis through heights of a microlens's aperture."""
    tracer, n = behind_a_hole(array), len(heights)
    row = np.full(n, int(np.flatnonzero((tracer.lattice.k == 0) & (tracer.lattice.l == 0))[0]))
    is_curved = array.model == "refractive"
    z_mm = array.faces[0].aperture_z_mm(heights) if is_curved else np.full(n, array.reach_mm - array.distance_mm)
    points = np.column_stack([heights, np.zeros(n), z_mm])
    aims, position, direction, passes = np.empty((n, 2)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    aims_for(tracer.arrays, row, np.zeros((n, 2)), points, aims)
    rays_before(tracer.arrays, row, np.zeros((n, 2)), aims, position, direction, passes)
    assert np.all(passes > 0)
    if is_curved:  # whose points stand back by its sag
        np.testing.assert_allclose(position[:, 0], heights, rtol=0, atol=1e-12)
    return direction[:, 0] / direction[:, 2]


def test_the_two_plane_model_nears_a_sheet_that_bends_sines_as_its_index_grows() -> None:
    """Direction cosines before it are those behind it minus height / f: double eta, halve the difference."""
    heights, errors = np.array([0.05, 0.1, 0.2]), []
    for eta in (50.0, 100.0, 200.0, 400.0):
        array = MicrolensArray(
            pitch_mm=0.5,
            focal_lengths_mm=(2.1,),
            columns=3,
            rows=3,
            distance_mm=1.7,
            model="two-plane",
            index=eta,
            thickness_mm=0.01,
        )
        slope = heights / 1.7
        sine = slope / np.hypot(1, slope) - heights / 2.1
        found = through(array, heights)
        errors.append(found / np.hypot(1, found) - sine)
    assert np.all(np.abs(np.log2(np.abs(np.array(errors[:-1]) / errors[1:])) - 1) < 2 * ORDER)


def test_thin_plano_convex_microlenses_near_the_thin_model_as_they_grow_narrow() -> None:
    """Halve all angles: differences of slopes, relative to the slopes, fall fourfold."""
    errors = []
    for share in (1.0, 0.5, 0.25, 0.125):
        radius, index = 1.05, 1.5
        array = MicrolensArray(
            pitch_mm=0.5,
            columns=3,
            rows=3,
            distance_mm=1.7,
            model="refractive",
            index=index,
            thickness_mm=1e-9,
            front_radii_mm=(radius,),
            rear_radii_mm=(math.inf,),
        )
        height = np.array([0.2 * share])
        assert array.focal_lengths_mm[0] == pytest.approx(2.1, rel=1e-12)
        slope = float(through(array, height)[0])
        errors.append(slope / (height[0] / 1.7 - height[0] / 2.1) - 1)
    assert np.all(np.abs(np.log2(np.array(errors[:-1]) / errors[1:])[1:] - 2) < ORDER)


def test_a_thick_plano_convex_microlens_has_textbook_principal_planes() -> None:
    """f = R / (n - 1); both planes at the curved vertex and t / n away from the flat one (Hecht, Optics)."""
    shared = {"pitch_mm": 0.2, "columns": 3, "rows": 3, "distance_mm": 1.7, "model": "refractive", "index": 1.5}
    front = MicrolensArray(**shared, thickness_mm=0.6, front_radii_mm=(1.0,), rear_radii_mm=(math.inf,))
    rear = MicrolensArray(**shared, thickness_mm=0.6, front_radii_mm=(math.inf,), rear_radii_mm=(-1.0,))
    np.testing.assert_allclose([front.focal_lengths_mm, rear.focal_lengths_mm], 2.0, rtol=1e-12)
    np.testing.assert_allclose(front.principal_mm[0], (1.7 + 0.4, 1.7 + 0.6), rtol=1e-12)
    np.testing.assert_allclose(rear.principal_mm[0], (1.7, 1.7 + 0.2), rtol=1e-12)


@pytest.mark.parametrize(("focal_mm", "kind"), [(2.1, "Galilean"), (1.4, "Keplerian"), (1.7, "unfocused")])
def test_plenoptic_kinds_look_where_thin_lenses_look(focal_mm: float, kind: str) -> None:
    """1 / B = 1 / f + 1 / a with the main-lens image a behind the array: behind it, before it, infinitely far."""
    array = dataclasses.replace(rigs.michels_array(3.0), focal_lengths_mm=(focal_mm,))
    camera = dataclasses.replace(rigs.plenoptic(3.0), microlenses=array)
    (focus,) = foci(camera)
    lens = first_order(camera.prescription)
    if kind == "unfocused":  # a microlens looks at infinity, and a view at what the lens images onto the array
        assert lens.image_mm(focus.focus_distance_mm) == pytest.approx(-123.3, rel=1e-12)
        assert math.isinf(focus.virtual_depth)
        return
    behind_array = 1 / (1 / 1.7 - 1 / focal_mm)
    assert (behind_array > 0) == (kind == "Galilean")
    assert lens.image_mm(focus.focus_distance_mm) == pytest.approx(-123.3 - behind_array, rel=1e-12)
    assert focus.virtual_depth == pytest.approx(abs(behind_array) / 1.7, rel=1e-12)


def test_crosstalk_is_absent_at_small_stops_and_grows_with_them() -> None:
    """Below 8.2 mm micro-images of the paper's rig stay in their cells; beyond they spill into others, ever more."""
    shares = []
    for stop_semi_mm in (2.0, 5.3, 8.0, 17.0):
        camera = dataclasses.replace(rigs.plenoptic(3.0, 40, 40, 0.01), prescription=rigs.tronnier(stop_semi_mm))
        tracer = Tracer(camera)
        white, foreign = irradiance_and_crosstalk(Rig.of(tracer), 64, None)
        shares.append(foreign.sum() / white.sum())
    assert shares[0] < 1e-3
    assert np.all(np.diff(shares) > 0)
    assert shares[-1] > 0.5
