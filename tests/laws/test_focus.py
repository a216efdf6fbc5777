"""Claim: a camera that is asked to focus, or to match its stop, does so; what it cannot do is named with its reach.

Objects at the ends of the depth of field blur to the circle of confusion, as real rays through ideal lenses show; near
and far planes leave none of it out, and their bounds are those that are documented.
"""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from laws import rigs
from published.library import prescription
from tolerances import ORDER, ROUNDING_MM

from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.focusing.depth_of_field import foci, focused, middle_focus
from pipeline.camera.focusing.focus_request import (
    FocusRequest,
    group_shift,
    moved,
    reachable,
    solved,
    travel_mm,
)
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Group, Prescription, Surface, least_gap_mm
from pipeline.optics.table import towards_sensor
from pipeline.records.plain import from_plain, to_plain

SENSOR = Sensor(width_px=64, height_px=48, pitch_mm=0.01)


def conventional(focus_mm: float) -> FocusRequest:
    return FocusRequest(prescription=rigs.tronnier(4.5), sensor=SENSOR, focus_distance_mm=focus_mm)


def plenoptic(focus_mm: float | None = 430.0, **others) -> FocusRequest:
    asked = {"sensor_distance_mm": 125.0} if focus_mm is None else {"focus_distance_mm": focus_mm}
    parts = {"prescription": rigs.tronnier(5.0), "sensor": SENSOR, "microlenses": rigs.michels_array(3.0)}
    return FocusRequest(**{**parts, **asked, **others})


@pytest.mark.parametrize("distance_mm", [150.0, 434.0, 5e3, 1e6])
def test_a_conventional_camera_focuses_where_it_is_asked_to(distance_mm: float) -> None:
    """The object conjugate to the solved sensor is the requested one, to 1e-9 of it: image distances near 100 mm carry
    14 digits, the longitudinal magnification of 1e6 mm costs 8 of them."""
    camera = solved(conventional(distance_mm))
    found = first_order(camera.prescription).object_mm(-camera.sensor_distance_mm)
    tolerance = 1e-9 if distance_mm < 1e3 else 1e-9 * distance_mm
    assert found == pytest.approx(distance_mm, rel=0, abs=tolerance)


@pytest.mark.parametrize("kind", [0, 1, 2])
@pytest.mark.parametrize("distance_mm", [300.0, 430.0, 800.0])
def test_each_microlens_type_focuses_where_it_is_asked_to(kind: int, distance_mm: float) -> None:
    camera = solved(plenoptic(distance_mm, focus_type=kind))
    assert foci(camera)[kind].focus_distance_mm == pytest.approx(distance_mm, rel=0, abs=1e-9)


@pytest.mark.parametrize("focal", [(1.2, 1.3, 1.5), (2.3, 1.9, 2.1)])
def test_without_a_type_the_middle_focal_length_is_meant_also_for_keplerian_arrays(focal: tuple[float, ...]) -> None:
    array = dataclasses.replace(rigs.michels_array(3.0), focal_lengths_mm=focal)
    camera = solved(plenoptic(500.0, microlenses=array))
    middle = focal.index(sorted(focal)[1])
    assert foci(camera)[middle].focus_distance_mm == pytest.approx(500.0, rel=0, abs=1e-9)


@pytest.mark.parametrize("focus_mm", [None, 350.0, 600.0])
def test_a_matched_stop_has_no_mismatch(focus_mm: float | None) -> None:
    """The exit pupil's image through a microlens vertex is as wide as the MLA pitch, and nothing else moves."""
    camera = focused(plenoptic(focus_mm, match_stop=True))
    figures = report(camera)
    assert figures["mla"]["f_number_mismatch"] == pytest.approx(1.0, rel=1e-12)
    assert figures["lens"]["stop_diameter_mm"] == pytest.approx(figures["lens"]["matched_stop_diameter_mm"], rel=1e-12)
    assert camera.sensor_distance_mm == solved(plenoptic(focus_mm)).sensor_distance_mm
    if focus_mm is None:
        assert figures["lens"]["stop_diameter_mm"] == pytest.approx(10.586, rel=0, abs=0.5e-3)


def test_what_lies_within_reach_is_solved_and_what_lies_beyond_is_refused_with_the_reach() -> None:
    """The near end is the front focus; the far end brings the sensor or the array to the last vertex."""
    short = dataclasses.replace(rigs.michels_array(3.0), distance_mm=5.0, focal_lengths_mm=(5.3,))
    request = plenoptic(400.0, microlenses=short)
    near, far = reachable(request)
    lens = first_order(request.prescription)
    assert near == lens.front_focus_mm and far < math.inf
    within = [near * 1.001, (near + far) / 2, far * 0.999]
    for distance in within:
        camera = solved(dataclasses.replace(request, focus_distance_mm=distance))
        film = camera.sensor_distance_mm - short.distance_mm
        assert film > camera.prescription.vertices_from_stop_mm[-1]
    for distance in (near * 0.999, near, far, far * 1.001):
        with pytest.raises(CameraError, match="into focus") as caught:
            solved(dataclasses.replace(request, focus_distance_mm=distance))
        assert f"{near:.6g}" in caught.value.hint and f"{far:.6g}" in caught.value.hint


def test_a_conventional_camera_reaches_from_its_front_focus_to_infinity() -> None:
    near, far = reachable(conventional(400.0))
    assert near == first_order(rigs.tronnier()).front_focus_mm and far == math.inf


def test_at_infinity_the_sensor_stands_in_the_rear_focus() -> None:
    """Parallel real rays close to the axis meet there: their miss falls with the third power of the height."""
    asked = dataclasses.replace(conventional(math.inf), near_mm=1e3, far_mm=2e3)
    camera = focused(asked)
    assert foci(camera)[0].focus_distance_mm == math.inf
    assert camera.sensor_distance_mm == -first_order(camera.prescription).rear_focus_mm
    misses = [parallel_miss(camera, height) for height in (2.0, 1.0, 0.5)]
    for coarse, fine in itertools.pairwise(misses):
        assert math.log2(coarse / fine) == pytest.approx(3, rel=0, abs=ORDER)


def parallel_miss(camera: Camera, height_mm: float) -> float:
    """Where a ray that enters parallel to the axis meets the sensor [mm]."""
    position = np.array([[0.0, height_mm, camera.prescription.vertices_from_stop_mm[0] - 10]])
    direction, alive = np.array([[0.0, 0.0, 1.0]]), np.ones(1)
    trace_rays(towards_sensor(camera.prescription), position, direction, alive)
    slope = direction[0, 1] / direction[0, 2]
    return abs(float(position[0, 1] + slope * (camera.sensor_distance_mm - position[0, 2])))


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_a_microlens_type_sees_infinity_with_its_virtual_object_in_the_rear_focus(kind: int) -> None:
    """The virtual object lies f B / (f - B) behind the array."""
    camera = solved(plenoptic(math.inf, focus_type=kind))
    assert foci(camera)[kind].focus_distance_mm == math.inf
    focal, array = camera.microlenses.focal_lengths_mm[kind], camera.microlenses
    film = camera.sensor_distance_mm - array.distance_mm
    behind = focal * array.distance_mm / (focal - array.distance_mm)
    assert film + behind == pytest.approx(-first_order(camera.prescription).rear_focus_mm, rel=0, abs=1e-12)


def test_infinity_is_refused_where_the_array_would_lie_in_the_lens() -> None:
    short = dataclasses.replace(rigs.michels_array(3.0), distance_mm=5.0, focal_lengths_mm=(5.3,))
    with pytest.raises(CameraError, match="brings infinity into focus") as caught:
        solved(plenoptic(math.inf, microlenses=short))
    assert "within reach: distances between" in caught.value.hint


def test_microlenses_one_focal_length_before_the_sensor_focus_the_lens_on_the_array() -> None:
    array = dataclasses.replace(rigs.michels_array(3.0), focal_lengths_mm=(1.7,))
    camera = solved(plenoptic(430.0, microlenses=array))
    image_mm = first_order(camera.prescription).image_mm(430.0)
    assert camera.sensor_distance_mm - 1.7 == pytest.approx(-image_mm, rel=1e-12)
    assert foci(camera)[0].focus_distance_mm == pytest.approx(430.0, rel=1e-9)


def test_a_stop_wider_than_the_lens_lets_through_is_refused() -> None:
    array = dataclasses.replace(rigs.michels_array(3.0), pitch_mm=1.4)
    with pytest.raises(CameraError, match="wider") as caught:
        solved(plenoptic(None, microlenses=array, match_stop=True))
    widest = float(caught.value.hint.split("up to ")[1].split(" mm")[0])
    assert 34.0 < widest < 40.0


def test_a_camera_asks_for_nothing_and_a_request_survives_the_process_border() -> None:
    camera = rigs.plenoptic(3.0)
    assert solved(camera) is camera
    request = plenoptic(430.0, focus_type=2, match_stop=True)
    assert from_plain(FocusRequest, to_plain(request)) == request
    assert isinstance(focused(request), Camera)


def test_a_camera_focused_at_infinity_needs_authored_planes_and_nothing_else() -> None:
    at_infinity = -first_order(rigs.tronnier()).rear_focus_mm
    camera = Camera(prescription=rigs.tronnier(4.5), sensor=SENSOR, sensor_distance_mm=at_infinity)
    with pytest.raises(CameraError, match="infinity"):
        focused(camera)
    planes = dataclasses.replace(camera, near_mm=1e3, far_mm=2e3)
    assert focused(planes) == planes
    assert report(planes)["lens"]["focus_distance_mm"] == math.inf
    assert report(planes)["lens"]["magnification"] == 0


def test_a_camera_focused_inside_its_lens_needs_authored_planes_and_nothing_else() -> None:
    """As a plenoptic camera is of microlenses that see infinity sharp, behind a lens with its front focus in glass."""
    far_behind = Camera(prescription=prescription("retrofocus_28mm_leica"), sensor=SENSOR, sensor_distance_mm=5e3)
    with pytest.raises(CameraError, match="inside the lens"):
        focused(far_behind)
    planes = dataclasses.replace(far_behind, near_mm=1e3, far_mm=2e3)
    assert focused(planes) == planes


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


IDEAL = Surface(focal_length_mm=50.0, semi_diameter_mm=40.0, thickness_mm=12.0)
CONFUSION_PX, PITCH_MM = 2.0, 0.005


def camera_with(stop_semi_mm: float = 3.0, sensor_mm: float = 41.0, **others: object) -> Camera:
    """An ideal lens, a stop behind it, and a sensor; objects at about 800 mm are in focus."""
    lens = Prescription(surfaces=(IDEAL, Surface(semi_diameter_mm=stop_semi_mm, is_stop=True)))
    sensor = Sensor(width_px=64, height_px=48, pitch_mm=PITCH_MM)
    parts = {"prescription": lens, "sensor": sensor, "sensor_distance_mm": sensor_mm}
    return Camera(**parts, circle_of_confusion_px=CONFUSION_PX, **others)


def behind_lens(camera: Camera, object_mm: float) -> tuple[float, float]:
    """Height and slope at the stop, in its plane, of a ray from the axis at a distance before the stop, at slope 1e-3.

    A trace of real rays; through an ideal lens both are linear in the slope.
    """
    slope = 1e-3
    position, direction = np.array([[0.0, 0.0, -object_mm]]), np.array([[0.0, slope, 1.0]])
    direction /= np.linalg.norm(direction)
    trace_rays(towards_sensor(camera.prescription), position, direction, np.ones(1))
    return position[0, 1] / slope, direction[0, 1] / direction[0, 2] / slope


@pytest.mark.parametrize("stop_semi_mm", [1.0, 3.0, 8.0])
def test_at_the_ends_the_sensor_sees_the_circle_of_confusion(stop_semi_mm: float) -> None:
    """The rays through the rim of the stop; in between less, outside more."""
    camera = camera_with(stop_semi_mm)
    near, far = foci(camera)[0].depth_of_field_mm

    def blur_px(object_mm: float) -> float:
        height, slope = behind_lens(camera, object_mm)
        return 2 * stop_semi_mm * abs(1 + camera.sensor_distance_mm * slope / height) / PITCH_MM

    assert near < middle_focus(camera) < far < math.inf
    assert blur_px(near) == pytest.approx(CONFUSION_PX, rel=1e-9)
    assert blur_px(far) == pytest.approx(CONFUSION_PX, rel=1e-9)
    assert blur_px(middle_focus(camera)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("stop_semi_mm", [0.01, 0.005, 0.004, 0.001])
def test_a_narrow_stop_sees_everything_sharply_from_an_end_on(stop_semi_mm: float) -> None:
    """Twice as wide as the circle of confusion, as wide, and narrower, where images are virtual."""
    camera = camera_with(stop_semi_mm)
    near, far = foci(camera)[0].depth_of_field_mm
    height, slope = behind_lens(camera, near)
    blur_px = 2 * stop_semi_mm * abs(1 + camera.sensor_distance_mm * slope / height) / PITCH_MM
    assert near < middle_focus(camera) and far == math.inf
    assert blur_px == pytest.approx(CONFUSION_PX, rel=1e-9)


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_at_the_ends_a_micro_image_has_the_circle_of_confusion(kind: int) -> None:
    """The rays of one object point through the rim of a microlens, which adds offset / f to their slopes."""
    array = MicrolensArray(
        pitch_mm=0.1, focal_lengths_mm=(0.5, 0.6, 0.7), width_mm=1.0, height_mm=1.0, distance_mm=0.45
    )
    camera = camera_with(microlenses=array, sensor_mm=40.0)
    near, far = foci(camera)[kind].depth_of_field_mm

    def blur_px(object_mm: float) -> float:
        height, slope = behind_lens(camera, object_mm)
        before = slope / (height + (camera.sensor_distance_mm - array.distance_mm) * slope)  # slope per height
        return array.pitch_mm * abs(1 + array.distance_mm * (before - 1 / array.focal_lengths_mm[kind])) / PITCH_MM

    assert near < far
    for end in (near, far):
        if math.isfinite(end):
            assert blur_px(end) == pytest.approx(CONFUSION_PX, rel=1e-9)
    assert blur_px(foci(camera)[kind].focus_distance_mm) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("off", [1.0, 1.04])
def test_at_the_ends_a_view_of_an_unfocused_camera_has_the_circle_of_confusion(off: float) -> None:
    """A pixel sees p T / B of the stop through a vertex; the light of a point through that part spreads over so many
    microlenses. At 1.04 times the focal length infinity blurs to 0.8 of a pixel, and views are the same.
    """
    array = MicrolensArray(
        pitch_mm=0.1, focal_lengths_mm=(0.45 * off,), width_mm=1.0, height_mm=1.0, distance_mm=0.45, layout="square"
    )
    few_px = 0.1  # of microlenses, to end before infinity
    camera = dataclasses.replace(camera_with(microlenses=array, sensor_mm=41.0), circle_of_confusion_px=few_px)
    (focus,) = foci(camera)
    to_array = camera.sensor_distance_mm - array.distance_mm

    def blur_px(object_mm: float) -> float:
        height, slope = behind_lens(camera, object_mm)
        return PITCH_MM * to_array / array.distance_mm * abs(1 + to_array * slope / height) / array.pitch_mm

    near, far = focus.depth_of_field_mm
    assert near < focus.focus_distance_mm < far < math.inf
    assert [blur_px(near), blur_px(far)] == pytest.approx([few_px] * 2, rel=1e-9)
    assert blur_px(focus.focus_distance_mm) == pytest.approx(0.0, abs=1e-9)
    assert planes_of(camera)[0] == pytest.approx(min(near, 0.9 * focus.focus_distance_mm), rel=1e-9)


def planes_of(camera: Camera) -> tuple[float, float]:
    found = focused(dataclasses.replace(camera, near_mm=None, far_mm=None))
    assert found.near_mm is not None and found.far_mm is not None
    return found.near_mm, found.far_mm


def test_a_shallow_depth_of_field_lies_within_a_tenth_of_the_focus_distance() -> None:
    camera = camera_with(8.0)
    focus, (first, last) = middle_focus(camera), foci(camera)[0].depth_of_field_mm
    assert 0.95 * focus < first < last < 1.05 * focus
    np.testing.assert_allclose(planes_of(camera), [0.9 * focus, 1.1 * focus], rtol=0, atol=ROUNDING_MM)


def test_a_deep_one_is_spanned_whole() -> None:
    camera = camera_with(0.25)
    focus, ends = middle_focus(camera), foci(camera)[0].depth_of_field_mm
    assert ends[0] < 0.88 * focus and 1.12 * focus < ends[1] < 1.9 * focus
    np.testing.assert_allclose(planes_of(camera), ends, rtol=0, atol=ROUNDING_MM)


def test_one_up_to_infinity_ends_at_twice_the_focus_distance() -> None:
    camera = camera_with(0.04)
    assert foci(camera)[0].depth_of_field_mm[1] == math.inf
    near, far = planes_of(camera)
    assert near < middle_focus(camera)
    assert far == pytest.approx(2 * middle_focus(camera), rel=1e-12)


def test_the_near_plane_stays_before_the_lens() -> None:
    """A macro lens in a tube with a window, 1 mm behind its focus: a tenth of the distance nearer lies inside."""
    camera = camera_with(sensor_mm=400.0)
    window = Surface(semi_diameter_mm=40.0, thickness_mm=56.0)
    lens = dataclasses.replace(camera.prescription, surfaces=(window, *camera.prescription.surfaces))
    camera = dataclasses.replace(camera, prescription=lens)
    front, focus = -lens.vertices_from_stop_mm[0], middle_focus(camera)
    assert 0.9 * focus < front < focus
    assert planes_of(camera)[0] == pytest.approx((front + focus) / 2, rel=1e-12)


def test_several_types_share_planes_that_hold_all_of_their_depths() -> None:
    camera = dataclasses.replace(rigs.plenoptic(2.0), circle_of_confusion_px=1.0)
    ends = [focus.depth_of_field_mm for focus in foci(camera)]
    middle, (near, far) = middle_focus(camera), planes_of(camera)
    assert near == pytest.approx(min(min(first for first, _ in ends), 0.9 * middle), rel=1e-12)
    assert far == pytest.approx(max(max(last for _, last in ends), 1.1 * middle), rel=1e-12)
    assert min(first for first, _ in ends) < 0.9 * middle or max(last for _, last in ends) > 1.1 * middle
