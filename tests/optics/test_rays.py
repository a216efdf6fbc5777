"""Claim: the rays of checks, by NumPy, are those of the kernels, which textbook and bisection judge."""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from naive.lenses import BALL, PHONE, SINGLET, random_rays
from tolerances import TEXTBOOK_MM

from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.rays import traced
from pipeline.optics.table import towards_scene

CUT = dataclasses.replace(
    SINGLET,
    surfaces=(
        *SINGLET.surfaces[:2],
        dataclasses.replace(SINGLET.stop, blades=5, aperture_rotation_deg=20.0),
    ),
)
IDEAL = Prescription(
    surfaces=(
        Surface(focal_length_mm=50.0, thickness_mm=5.0, semi_diameter_mm=20.0),
        Surface(semi_diameter_mm=8.0, is_stop=True),
    )
)


@pytest.mark.parametrize(
    ("lens", "behind_mm", "field_mm"),
    [
        (rigs.tronnier(), 101.5, 40.0),
        (rigs.displaced(rigs.conventional(17.1)).prescription, 101.5, 40.0),
        (BALL, 3.0, 8.0),
        (CUT, 70.0, 30.0),
        (PHONE, 20.0, 5.0),
        (IDEAL, 60.0, 20.0),
    ],
    ids=["double Gauss", "displaced", "ball", "polygon", "aspheres", "ideal"],
)
def test_numpy_and_kernels_agree_on_every_ray(lens: Prescription, behind_mm: float, field_mm: float) -> None:
    start, way = random_rays(lens, behind_mm, field_mm, 5_000)
    position, direction, passed = traced(towards_scene(lens), start, way)

    alive = np.ones(len(start))
    trace_rays(towards_scene(lens), start, way, alive)

    assert 0.02 < passed.mean() < 0.98
    np.testing.assert_array_equal(passed, alive > 0)
    np.testing.assert_allclose(position[passed], start[passed], rtol=0, atol=TEXTBOOK_MM)
    np.testing.assert_allclose(direction[passed], way[passed], rtol=0, atol=TEXTBOOK_MM)
