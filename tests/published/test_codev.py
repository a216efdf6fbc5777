"""Claim: rays and first-order values of a commercial program's double Gauss come out as printed.

The listing is CODE V's of its sample lens "Double Gauss F/2 - Available Glasses"; codev_double_gauss.json names its
source. Rays start at the listed intercept with the first surface, with the exact field angle.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from public_numbers import codev_lens
from tolerances import PRINTED_4_MM, PRINTED_6_MM, PRINTED_6_TANGENT

from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription
from pipeline.optics.table import towards_sensor

LISTING = json.loads((Path(__file__).parent / "codev_double_gauss.json").read_text(encoding="utf-8"))
FIELDS_DEG = {0: 0.0, 10: 10.0000000023, 14: 14.0000000032}


@pytest.fixture(scope="module")
def lens() -> Prescription:
    """The listed lens at 587.6 nm; edges, which are not listed, lie a little outside of all listed rays."""
    return codev_lens(LISTING)


@pytest.mark.parametrize("ray", LISTING["rays"], ids=lambda ray: ray["what"])
def test_every_listed_ray_meets_every_surface_as_printed(lens: Prescription, ray: dict) -> None:
    """x, y, z to 1e-6 mm and slopes to 1e-6 at all eleven surfaces; no semi-diameter blocks it."""
    rows = np.array(ray["rows"])
    slope = math.tan(math.radians(FIELDS_DEG[ray["field_deg"]]))
    vertices = np.array(lens.vertices_from_stop_mm)
    position = rows[:1, 1:4] + [0.0, 0.0, vertices[0]]
    direction = np.array([[0.0, slope, 1.0]]) / math.hypot(slope, 1.0)
    alive, table = np.ones(1), towards_sensor(lens)
    for surface, listed in enumerate(rows):
        trace_rays(table[surface : surface + 1], position, direction, alive)
        local = position[0] - [0.0, 0.0, vertices[surface]]
        np.testing.assert_allclose(local, listed[1:4], rtol=0, atol=PRINTED_6_MM)
        np.testing.assert_allclose(direction[0, :2] / direction[0, 2], listed[4:6], rtol=0, atol=PRINTED_6_TANGENT)
    assert alive[0] == 1.0


def test_one_call_gives_the_same_rays_as_one_call_per_surface(lens: Prescription) -> None:
    """The last listed surface is reached by tracing all nine rays through the whole table."""
    first = np.array([ray["rows"][0] for ray in LISTING["rays"]])
    last = np.array([ray["rows"][-1] for ray in LISTING["rays"]])
    slopes = np.tan(np.radians([FIELDS_DEG[ray["field_deg"]] for ray in LISTING["rays"]]))
    position = first[:, 1:4] + [0.0, 0.0, lens.vertices_from_stop_mm[0]]
    direction = np.column_stack([np.zeros(9), slopes, np.ones(9)]) / np.hypot(slopes, 1.0)[:, None]
    alive = np.ones(9)
    trace_rays(towards_sensor(lens), position, direction, alive)
    assert alive.all()
    position[:, 2] -= lens.vertices_from_stop_mm[-1]
    np.testing.assert_allclose(position, last[:, 1:4], rtol=0, atol=PRINTED_6_MM)


def test_first_order_values_come_out_as_printed(lens: Prescription) -> None:
    """Focal length, focal distances, pupils and image distance, four decimals; distances turned to CODE V's signs."""
    found, printed = first_order(lens), LISTING["first_order"]
    first, last = -lens.vertices_from_stop_mm[0], -lens.vertices_from_stop_mm[-1]
    assert found.efl_mm == pytest.approx(printed["EFL"], rel=0, abs=PRINTED_4_MM)
    assert found.bfd_mm == pytest.approx(printed["BFL"], rel=0, abs=PRINTED_4_MM)
    assert first - found.front_focus_mm == pytest.approx(printed["FFL"], rel=0, abs=PRINTED_4_MM)
    assert last - found.rear_focus_mm == pytest.approx(printed["BFL"], rel=0, abs=PRINTED_4_MM)
    assert first - found.entrance_pupil.z_mm == pytest.approx(
        printed["entrance_pupil_from_first"], rel=0, abs=PRINTED_4_MM
    )
    assert last - found.exit_pupil.z_mm == pytest.approx(printed["exit_pupil_from_last"], rel=0, abs=PRINTED_4_MM)
    image_mm = found.bfd_mm + LISTING["image_shift_mm"]
    assert image_mm == pytest.approx(printed["image_distance"], rel=0, abs=PRINTED_4_MM)
    height_mm = found.efl_mm * math.tan(math.radians(FIELDS_DEG[14]))
    assert height_mm == pytest.approx(printed["paraxial_image_height_14deg"], rel=0, abs=PRINTED_4_MM)


def test_f_number_and_pupil_diameters_come_out_as_printed(lens: Prescription) -> None:
    """The stop's semi-diameter is listed to four decimals, so diameters are good to that, magnified."""
    found, printed = first_order(lens), LISTING["first_order"]
    for pupil, name in ((found.entrance_pupil, "entrance"), (found.exit_pupil, "exit")):
        from_rounded_stop = 2 * abs(pupil.magnification) * PRINTED_4_MM
        assert pupil.diameter_mm == pytest.approx(
            printed[f"{name}_pupil_diameter"], rel=0, abs=PRINTED_4_MM + from_rounded_stop
        )
    assert found.f_number == pytest.approx(printed["F_number"], rel=0, abs=PRINTED_4_MM)
    ratio = printed["exit_pupil_diameter"] / printed["entrance_pupil_diameter"]
    assert found.pupil_magnification == pytest.approx(ratio, rel=0, abs=2 * PRINTED_4_MM / 50)
