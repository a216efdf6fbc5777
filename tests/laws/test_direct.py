"""Claim: quadrature over the traced edge integrates bundles to 1e-5 of a pixel, whatever cuts them; method `direct`
finds every row to its stated error; the certificate sees what is wrong.
"""

import math

import numpy as np
import pytest
from laws import rigs
from laws.rigs import FAR_MM, NEAR_MM, PIXEL_MM, POINT_MM, fast
from laws.solving import STEPS, by_quadrature, rig_of, solved
from naive import polar
from tolerances import CLOSED_FORM, DIRECT_PX, RULE_OF_BIAS

from pipeline.camera.figures.outlook import covered_mm
from pipeline.camera.focusing.depth_of_field import focused, middle_focus
from pipeline.camera.integrals import NODES, Bundles, integrals, random_integrals
from pipeline.camera.integrating.quadrature import NOT_STAR_SHAPED, edges
from pipeline.camera.parts.camera import Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.frames import apply
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.judging import Rows, certify
from pipeline.truth.planes import Exposed, tangent_planes


def test_known_biases_are_those_of_brute_force() -> None:
    """f/2, 45 degrees, 20 mm out of focus: two planes are 1.11 px off, quadrature 1e-5.

    Against a polar grid of 65,536 textbook rays.
    """
    camera, pose = fast(17.1), rigs.facing(454.36, 45.0, -21.0, -12.0)
    truth, weight = polar.mean_hit(camera, POINT_MM, pose)
    hits = by_quadrature(camera, STEPS + POINT_MM, np.stack([target_plane(pose)] * 2), NODES[1])
    px_per_mm = np.linalg.inv(np.stack([hits[1] - hits[2], hits[3] - hits[4]], axis=1)[:2] / 0.1) / PIXEL_MM
    flat = by_quadrature(camera, POINT_MM[None], parallel_planes(NEAR_MM, FAR_MM), NODES[1])
    near, far = flat[:, :2], flat[:, 2:4]
    joined = on_target(near, far, NEAR_MM, FAR_MM, pose)
    two_plane, direct = (np.linalg.norm(px_per_mm @ (found - truth)) for found in (joined[0], hits[0, :2]))
    assert two_plane == pytest.approx(1.110, rel=RULE_OF_BIAS)
    assert direct < DIRECT_PX
    assert hits[0, WEIGHT] == pytest.approx(weight, rel=CLOSED_FORM)


def test_a_hole_without_a_lens_has_the_closed_form() -> None:
    """On the axis: weight pi R^2 / (h^2 + R^2) and <r^2> = h^2 ((1 + u) ln(1 + u) / u - 1), u = R^2 / h^2."""
    sensor = Sensor(width_px=9, height_px=9, pitch_mm=0.01)
    for semi, h in ((1.0, 50.0), (10.0, 20.0)):
        camera = rigs.bare(rigs.hole(semi), sensor, h, (10.0, 20.0))
        row = by_quadrature(camera, np.zeros((1, 2)), parallel_planes(1e-9, h), NODES[2])[0]
        u = (semi / h) ** 2
        assert row[WEIGHT] == pytest.approx(math.pi * semi**2 / (h**2 + semi**2), rel=CLOSED_FORM)
        squared = row[COVARIANCE] + row[COVARIANCE + 4]
        assert squared == pytest.approx(h**2 * ((1 + u) * math.log1p(u) / u - 1), rel=CLOSED_FORM)


@pytest.mark.parametrize("height_mm", [0.0, 8.0, 16.0])
def test_the_error_falls_faster_than_any_power(height_mm: float) -> None:
    """At f/2, eight corners off the axis: every level errs 5 times less than the one before, down to the bisection.

    It fails if a corner is missed or misplaced: then all levels err alike.
    """
    camera, pose, start = fast(17.1), rigs.facing(454.36, 45.0), np.array([[height_mm, 0.5]])
    planes = np.stack([target_plane(pose)] * 2)
    means = [by_quadrature(camera, start, planes, nodes)[0, :2] for nodes in ((4, 10), *NODES[:2], (32, 512))]
    error = [float(np.linalg.norm(mean - means[-1])) for mean in means[:-1]]
    assert error[1] < error[0] / 5
    assert error[2] < max(error[1] / 5, 1e-7)


@pytest.mark.parametrize("count", [3, pytest.param(24, marks=pytest.mark.heavy)])
def test_behind_microlenses_the_edge_has_many_corners(count: int) -> None:
    """Positions all over micro-images, hexagon and pupil cutting each other: against polar grids of textbook rays."""
    camera = rigs.plenoptic(2.0)
    tracer, rig, pose = Tracer(camera), rig_of(camera), rigs.facing(420.0, 30.0)
    assert rig.images is not None and camera.microlenses is not None and tracer.lattice is not None
    x = np.random.default_rng(5).uniform([30, 30], [97, 65], (24, 2))[:count]
    owner = rig.images.owner(tracer.positions_mm(*x.T))
    planes = np.repeat(np.stack([target_plane(pose)] * 2)[None], len(x), axis=0)
    found = integrals(tracer, Bundles(x, owner, planes), 1)
    assert not found.is_random.any()
    checked = 0
    for i, start in enumerate(tracer.positions_mm(*x.T)):
        focal = camera.microlenses.focal_lengths_mm[tracer.lattice.type[owner[i]]]
        if found.moments[i, WEIGHT] < 0.05 * tracer.reference_weight_sr:
            continue
        mean, weight = polar.mean_hit(camera, start, pose, (tracer.vertices_mm[owner[i]], focal), 4096, 8)
        assert np.abs(found.moments[i, :2] - mean).max() < 0.02 * DIRECT_PX  # a pixel covers 0.15 to 0.25 mm
        assert found.moments[i, WEIGHT] == pytest.approx(weight, rel=2e-6)
        checked += 1
    assert checked > 0.6 * count


RINGS = {"stop": (rigs.conventional(17.1, pitch_mm=0.4), 5.0), "behind microlenses": (rigs.plenoptic(2.0), 0.6)}
"""Cameras, and how large an obstruction their stops get [mm]."""


@pytest.mark.parametrize("ring", RINGS)
def test_a_ring_is_what_passes_less_what_its_obstruction_takes(ring: str) -> None:
    """Random rays, which know of no parts, are the judge, all over the image, where rims and cells cut both parts.

    One region alone is refused: a ring is not star-shaped. Behind microlenses most are crescents, which are.
    """
    camera, inner_mm = RINGS[ring]
    rig = rig_of(rigs.reshaped(camera, {camera.prescription.stop_index: {"inner_semi_diameter_mm": inner_mm}}))
    tracer, size = rig.tracer, np.array([camera.sensor.width_px, camera.sensor.height_px])
    x = np.random.default_rng(5).uniform(-0.5, size - 0.5, (40, 2))
    own = np.full(40, NO_MICROLENS) if rig.images is None else rig.images.owner(tracer.positions_mm(*x.T))
    bundles = Bundles(x, own, np.repeat(parallel_planes(400.0, 460.0)[None], 40, axis=0))
    found, judge = integrals(tracer, bundles, 2), random_integrals(tracer, bundles, 1 << 18)
    lit = judge.moments[:, WEIGHT] > 0.05 * tracer.reference_weight_sr
    off, error_mm = np.abs(found.moments[:, :2] - judge.moments[:, :2])[lit], DIRECT_PX * camera.sensor.pitch_mm * 3.3
    assert lit.sum() > 20 and not found.is_random.any()
    assert off.max() < 10 * error_mm and found.error_mm[lit].max() < error_mm
    # Errors of four replicas: Student's law with three degrees of freedom, whose squares have the mean 3.
    assert np.mean((off / judge.error_mm[lit]) ** 2) < 6.0
    blur = [values[lit, COVARIANCE] + values[lit, COVARIANCE + 4] for values in (found.moments, judge.moments)]
    np.testing.assert_allclose(*blur, rtol=1e-3)
    status = edges(tracer.arrays, tracer.positions_mm(*x.T), own).moments(bundles.planes, NODES[1])[1]
    assert NOT_STAR_SHAPED in status or ring == "behind microlenses"


@pytest.fixture(scope="module")
def small() -> Rig:
    return rig_of(rigs.plenoptic(2.0))


def test_direct_finds_every_row_that_a_dense_scan_finds(small: Rig) -> None:
    """Scan: every micro-image and point from the micro-image's centre outwards, without the forward trace."""
    board, pose = Checkerboard(columns=3, rows=2, square_mm=1.0), rigs.facing(420.0, 20.0)
    planes = tangent_planes(pose, board.points_mm())
    found = solved(small, board, pose)
    assert small.images is not None
    from pipeline.truth.direct.direct_rows import Guess

    point, cell = (part.ravel() for part in np.mgrid[:6, : len(small.images.centre_mm)])
    scanned = solve(small, Guess(point, cell, small.home_px(cell)), planes, 1e-4, 0.05)
    assert len(found.solutions.point) > 40
    assert found.solutions.point.tolist() == scanned.solutions.point.tolist()
    assert found.solutions.cell.tolist() == scanned.solutions.cell.tolist()
    both = np.abs(found.solutions.x_px - scanned.solutions.x_px), np.abs(found.solutions.y_px - scanned.solutions.y_px)
    assert np.max(both) < 2 * DIRECT_PX


@pytest.mark.parametrize("is_direct", [True, False])
def test_a_planted_bias_of_a_fiftieth_pixel_is_caught(small: Rig, is_direct: bool) -> None:
    board, pose = Checkerboard(columns=3, rows=2, square_mm=1.0), rigs.facing(420.0, 20.0)
    planes = tangent_planes(pose, board.points_mm())
    rows = solved(small, board, pose).solutions
    x = rows.xy_px

    def verdict(bias_px: float) -> dict:
        return certify(
            small,
            Rows(Exposed.still(planes[rows.point]), rows.cell, x + np.array([bias_px, 0.0]), is_direct),
            len(x),
            1e-3,
        )

    honest, biased = verdict(0.0), verdict(0.02)
    assert honest["passed"] is True and honest["max_px"] < 5e-4
    assert biased["passed"] is False and biased["mean_px"] == pytest.approx(0.02, rel=0.02)
    assert biased["own_sigma_px"] < 1e-3 / 3


def test_points_before_the_camera_have_candidates_and_others_none(small: Rig) -> None:
    """What the lens does not see has no candidate, and no error."""
    seen, _ = guesses(small, tangent_planes(rigs.facing(420.0), np.zeros((1, 3))))
    assert len(seen.point) > 5
    far_off = tangent_planes(rigs.facing(420.0, 0.0, 2000.0, 0.0), np.zeros((1, 3)))
    assert len(guesses(small, far_off)[0].point) == 0
    assert np.allclose(far_off[0, 0], apply(rigs.facing(420.0, 0.0, 2000.0, 0.0), np.zeros(3)))


def test_a_camera_without_microlenses_drops_what_lies_beside_its_image_and_nothing_outside_a_cell() -> None:
    """A board moved sideways by half the width of the view: points are in the image or beside it, each counted once."""
    camera = focused(rigs.conventional())
    board, z_mm = Checkerboard(rows=4, columns=7, square_mm=1.0), middle_focus(camera)
    counts = solved(rig_of(camera), board, rigs.facing(z_mm, 0.0, covered_mm(camera, z_mm)[0] / 2, 0.0)).counts

    assert counts["dropped_outside_cell"] == 0
    assert 0 < counts["dropped_outside_image"] == 28 - counts["rows"] < 28
