"""Claim: groups of a lens that shall focus stand where object and sensor are conjugate, or say how far they reach."""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs

from pipeline.camera.focusing.depth_of_field import foci, focused
from pipeline.camera.focusing.focus_request import FocusRequest, group_shift, moved, solved, travel_mm
from pipeline.camera.parts.camera import Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Group, Prescription, least_gap_mm

SENSOR = Sensor(width_px=64, height_px=48, pitch_mm=0.01)
GROUPS = (
    Group(name="Front", first=0, count=2),
    Group(name="Meniscus", first=2, count=3),
    Group(name="Doublet", first=6, count=3),
    Group(name="Rear", first=9, count=2),
)


def lens() -> Prescription:
    return dataclasses.replace(rigs.tronnier(4.5), groups=GROUPS)


def request(distance_mm: float, *names: str, sensor_mm: float = 125.0, **others) -> FocusRequest:
    asked = {"sensor_distance_mm": sensor_mm, "focus_distance_mm": distance_mm, "focus_groups": names}
    return FocusRequest(prescription=lens(), sensor=SENSOR, **asked, **others)


@pytest.mark.parametrize(
    ("names", "distance_mm"),
    [
        (("Front",), 450.0),
        (("Meniscus",), 500.0),
        (("Doublet",), 541.0),
        (("Rear",), 560.0),
        (("Doublet", "Rear"), 530.0),
    ],
)
def test_the_object_that_is_asked_for_is_conjugate_to_the_sensor_that_stays(names, distance_mm) -> None:
    camera = solved(request(distance_mm, *names))
    assert camera.sensor_distance_mm == 125.0
    assert first_order(camera.prescription).object_mm(-125.0) == pytest.approx(distance_mm, rel=0, abs=1e-8)


@pytest.mark.parametrize("names", [("Meniscus",), ("Doublet",), ("Doublet", "Rear"), ("Front", "Meniscus")])
def test_air_before_and_behind_changes_by_one_length_and_nothing_else_does(names) -> None:
    before = lens()
    after = moved(before, names, 0.1)
    change = np.array([b.thickness_mm - a.thickness_mm for a, b in zip(before.surfaces, after.surfaces, strict=True)])
    at_group = [i for i in range(len(change)) if abs(change[i]) > 1e-12]
    assert all(before.surfaces[i].index == 1 for i in at_group)
    shifts = np.subtract(after.vertices_from_stop_mm, before.vertices_from_stop_mm)
    held = [i for group in GROUPS if group.name in names for i in group.members]
    expected = [0.1 if i in held else 0.0 for i in range(len(change))]
    np.testing.assert_allclose(shifts, expected, rtol=0, atol=1e-12)


def test_a_front_group_focuses_infinity_where_the_whole_lens_has_its_rear_focus_on_the_sensor() -> None:
    camera = focused(request(math.inf, "Front", sensor_mm=102.0, near_mm=1e3, far_mm=2e3))
    assert first_order(camera.prescription).rear_focus_mm == pytest.approx(-102.0, rel=0, abs=1e-9)
    assert foci(camera)[0].focus_distance_mm == math.inf


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_groups_focus_the_microlens_type_that_is_asked_for(kind) -> None:
    asked = request(410.0, "Front", microlenses=rigs.michels_array(3.0), focus_type=kind)
    assert foci(solved(asked))[kind].focus_distance_mm == pytest.approx(410.0, rel=0, abs=1e-8)


@pytest.mark.parametrize("name", ["Meniscus", "Doublet", "Rear"])
def test_travel_ends_where_surfaces_touch(name) -> None:
    for end in travel_mm(lens(), (name,), 125.0):
        surfaces = moved(lens(), (name,), end).surfaces
        gaps = [least_gap_mm(*surfaces[i : i + 2]) for i in range(len(surfaces) - 1)]
        is_at_sensor = name == "Rear" and end > 0
        assert min(gaps) == pytest.approx(gaps_at_rest() if is_at_sensor else 0.0, rel=0, abs=1e-12)
        if is_at_sensor:
            assert moved(lens(), (name,), end).vertices_from_stop_mm[-1] == pytest.approx(125.0, rel=0, abs=1e-12)


def gaps_at_rest() -> float:
    """The least gap that the rear element does not change."""
    surfaces = lens().surfaces
    return min(least_gap_mm(*surfaces[i : i + 2]) for i in range(len(surfaces) - 1) if i != 8)


def test_what_lies_beyond_the_ends_is_refused_with_the_reach() -> None:
    """The far end of the doublet's reach is where it touches the rear element."""
    ends = travel_mm(lens(), ("Doublet",), 125.0)
    distances = sorted(first_order(moved(lens(), ("Doublet",), end)).object_mm(-125.0) for end in ends)
    with pytest.raises(CameraError, match=r'"Doublet" between .* brings 2000 mm') as caught:
        solved(request(2000.0, "Doublet"))
    near, far = map(float, caught.value.hint.split("between ")[1].removesuffix(" mm").split(" and "))
    assert far == pytest.approx(distances[1], rel=1e-5)
    for distance in (0.9999 * far, 1.0001 * near):
        assert ends[0] < group_shift(request(distance, "Doublet")) < ends[1]
    for distance in (1.0001 * far, 0.9999 * near):
        with pytest.raises(CameraError):
            solved(request(distance, "Doublet"))


@pytest.mark.parametrize(
    ("names", "groups", "message"),
    [
        (("Rer",), GROUPS, 'no group "Rer"'),
        (("All",), (Group(name="All", first=0, count=11),), "the stop would move"),
        (("Half",), (Group(name="Half", first=2, count=1),), "there is glass"),
    ],
)
def test_groups_that_cannot_move_are_refused(names, groups, message) -> None:
    asked = dataclasses.replace(request(500.0, *names), prescription=dataclasses.replace(lens(), groups=groups))
    with pytest.raises(CameraError, match=message):
        solved(asked)
