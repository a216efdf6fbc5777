"""Claim: behind microlenses of every kind, whatever pixels accept, quadrature converges to what random rays find, and
its stated error covers its actual one.
"""

import numpy as np
import pytest
from naive.kinds import KINDS, PIXELS, camera_with
from tolerances import QUADRATURE_MM, SIGMAS

from pipeline.camera.integrals import NODES, Bundles, integrals, random_integrals
from pipeline.camera.integrating.quadrature import INTEGRATED, edges
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import WEIGHT

CELLS = ((0, 0), (17, -9), (-5, 24))
OFF_CENTRE_MM = np.array([(0.01, -0.004), (0.07, 0.04), (-0.03, 0.1)])
SEEDS, RAYS = 12, 1 << 14
QUICK = {("square", "cone"), ("biconvex cells", "all"), ("tilted", "cone"), ("convex to the sensor", "cosine")}


@pytest.mark.parametrize(
    ("kind", "pixels"),
    [
        pytest.param(kind, pixels, marks=() if (kind, pixels) in QUICK else pytest.mark.heavy)
        for kind in KINDS
        for pixels in PIXELS
    ],
)
def test_quadrature_and_random_rays_agree(kind: str, pixels: str) -> None:
    """Positions in the middle and near the edges of three micro-images; the reference level has 4 times the nodes."""
    camera = camera_with(kind, 5.0, pixels)
    tracer = Tracer(camera)
    assert tracer.lattice is not None
    lens = np.array([np.flatnonzero((tracer.lattice.k == k) & (tracer.lattice.l == l))[0] for k, l in CELLS])
    x = tracer.pixels_at(micro_images(tracer).centre_mm[lens] + OFF_CENTRE_MM)
    planes = np.repeat(parallel_planes(400.0, 470.0)[None], len(x), axis=0)
    exact, status, _ = edges(tracer.arrays, tracer.positions_mm(*x.T), lens).moments(planes, (48, 1024))
    assert (status == INTEGRATED).all()

    bundles = Bundles(x, lens, planes)
    random = [random_integrals(Tracer(camera, seed), bundles, RAYS).moments for seed in range(SEEDS)]
    columns = [0, 1, WEIGHT]
    scatter = np.std(random, axis=0, ddof=1)[:, columns] / np.sqrt(SEEDS)
    assert np.all(np.abs(np.mean(random, axis=0) - exact)[:, columns] < SIGMAS * scatter)

    for level in range(1, len(NODES)):
        found = integrals(tracer, bundles, level)
        assert not found.is_random.any()
        actual = np.abs(found.moments[:, :2] - exact[:, :2]).max()
        assert actual < found.error_mm.max() + QUADRATURE_MM
    assert actual < QUADRATURE_MM
