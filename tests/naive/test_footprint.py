"""Claim: with footprint `pixel`, J is the mean over all rays from the square, also where that is half in the dark.

The twin sends textbook rays from random points of the square through random points of the whole aperture.
"""

import numpy as np
import pytest
from laws import rigs
from naive.bundles import GROUPS, POSES, brute_moments, deviations, packed_moments
from tolerances import SIGMAS

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.tracer import Tracer, target_plane
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS

PIXEL_MM, FOCAL_MM, MANY_RAYS = 0.01, 1.9, 10_000


def test_conventional_bundles_of_squares_are_those_of_random_starts() -> None:
    """At f/2, squares of 3 mm: means on two tilted planes, second moments, weight."""
    camera, start = rigs.conventional(17.1, 900, 900), np.array([7.0, 4.0])
    expected = brute_moments(camera, start, None, None, 60 * 0.05, 2_000)
    assert np.abs(deviations(packed_moments(camera, start, NO_MICROLENS, 60.0), expected)).max() < SIGMAS


@pytest.mark.parametrize(
    ("off_mm", "pull_px"),
    [
        (0.11, 0.17),
        pytest.param(0.113, 0.26, marks=pytest.mark.heavy),
        pytest.param(0.05, 0.0, marks=pytest.mark.heavy),
    ],
)
def test_in_the_penumbra_the_pixel_pulls_j_to_the_brighter_side(off_mm: float, pull_px: float) -> None:
    """Paper's rig, f = 1.9 mm, K = 1: 0.17 px at a hit fraction of 0.18, 0.26 px at 0.09, nothing in full light.

    `pull_px` was printed by the twin alone; its rays scatter by 0.005 px. Random rays and quadrature agree with it.
    """
    camera = rigs.plenoptic(2.0)
    tracer, images = Tracer(camera), micro_images(Tracer(camera))
    row = int(np.flatnonzero((tracer.lattice.k == 0) & (tracer.lattice.l == 0))[0])
    start = images.centre_mm[row] + off_mm * np.array([0.96, 0.28])
    through = tracer.vertices_mm[row], FOCAL_MM
    point, square = (brute_moments(camera, start, *through, edge_mm, MANY_RAYS) for edge_mm in (0.0, PIXEL_MM))
    steps = [
        brute_moments(camera, start + 0.001 * way, *through, 0.0, 2_000)[:, :2].mean(axis=0)
        for way in (*np.eye(2), *-np.eye(2))
    ]
    # Image positions and vision coordinates on the sensor run against each other.
    px_from_mm = np.linalg.inv(-np.stack([steps[0] - steps[2], steps[1] - steps[3]], axis=1) / 0.002 * PIXEL_MM)
    pull = px_from_mm @ (square - point)[:, :2].mean(axis=0)
    bright = np.array([0.96, 0.28])
    assert np.hypot(*pull) == pytest.approx(pull_px, rel=0, abs=0.015)
    assert pull_px == 0 or pull @ bright > 0.9 * np.hypot(*pull)
    assert np.abs(deviations(packed_moments(camera, start, row, 1.0), square)).max() < SIGMAS
    x, planes = tracer.pixels_at(start[None]), np.stack([target_plane(pose) for pose in POSES])[None]
    found = integrals(tracer, Bundles(x, np.array([row]), planes, 1.0), 3)
    assert not found.is_random[0]
    here = found.moments[0, [*range(COVARIANCE + 10), WEIGHT]]
    error = square.std(axis=0, ddof=1) / np.sqrt(GROUPS)
    assert np.abs((square.mean(axis=0) - here) / error).max() < SIGMAS
