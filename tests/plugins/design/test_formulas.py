"""Claim: a designed plenoptic camera has what its formulas promise: near the axis by the thin-lens equation, with a
real lens by real rays; and what cannot be is refused with a number that helps.
"""

import math
import re

import numpy as np
import pytest
from laws import rigs

from pipeline.camera.bundle import bundle
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.micro_images.light import micro_light
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import FirstOrder, Pupil, first_order
from pipeline.optics.prescription import Prescription, Surface
from pipeline.plugins.design.formulas import PlenopticDesign, PlenopticWish, designed, refocused_mm
from pipeline.render.imaging import irradiance

SENSOR = Sensor(width_px=160, height_px=120, pitch_mm=0.01)
NEAR, FAR, FOCAL = 380.0, 480.0, 100.0
RANGE = {"near_mm": NEAR, "far_mm": FAR}


def thin(f_number: float = 2.0) -> Prescription:
    semi_mm = FOCAL / f_number / 2
    return Prescription(surfaces=(Surface(focal_length_mm=FOCAL, semi_diameter_mm=semi_mm, is_stop=True),))


def image_mm(object_mm: float) -> float:
    return 1 / (1 / FOCAL - 1 / object_mm)


def parts(design: PlenopticDesign) -> tuple[float, float, float, tuple[float, ...]]:
    """T, B, P, focal lengths of a design with a thin lens."""
    array = design.camera.microlenses
    to_array = design.camera.sensor_distance_mm - array.distance_mm
    return to_array, array.distance_mm, array.pitch_mm, array.focal_lengths_mm


@pytest.mark.parametrize("others", [{}, {"f_number": 9.0}, {"virtual_depth": 2.5}, {"types": 1}, {"blur_px": 1.2}])
def test_a_focused_camera_behind_a_thin_lens_blurs_to_the_circle_of_confusion_where_ranges_join(others) -> None:
    """P |1 - B / f - B / a| of every type at both of its ends, which are those of the next ones and of the range."""
    wish = PlenopticWish(**RANGE, **others)
    design = designed(thin(), SENSOR, wish)
    to_array, gap, pitch, focal = parts(design)
    ends = [design.depth_of_field_mm[0][0], *(far for _, far in design.depth_of_field_mm)]
    np.testing.assert_allclose([ends[0], ends[-1]], [NEAR, FAR], rtol=1e-6)
    np.testing.assert_allclose([near for near, _ in design.depth_of_field_mm], ends[:-1], rtol=1e-6)
    for kind, f in enumerate(focal):
        for end in ends[kind : kind + 2]:
            blur_mm = pitch * abs(1 - gap / f - gap / (image_mm(end) - to_array))
            assert blur_mm == pytest.approx(wish.blur_px * SENSOR.pitch_mm, rel=1e-5)
    assert pitch == pytest.approx(wish.image_px * SENSOR.pitch_mm, rel=1e-9)
    assert pitch / gap == pytest.approx(FOCAL / design.f_number / to_array, rel=1e-7)  # F-numbers match
    least = (image_mm(FAR) - to_array) / gap
    assert design.virtual_depths[0] == pytest.approx(least, rel=1e-6)
    assert design.f_number == pytest.approx(others["f_number"]) if "f_number" in others else True
    if "f_number" not in others:
        assert least == pytest.approx(others.get("virtual_depth", 2.0), rel=1e-6)


@pytest.mark.parametrize("blur_px", [1.0, 1.5])
def test_an_unfocused_camera_behind_a_thin_lens_sees_both_ends_as_sharply(blur_px: float) -> None:
    """The pupil of a view of one pixel, p T / B, blurs them over as many pitches of the array, on either side of it."""
    wish = PlenopticWish(**RANGE, types=1, unfocused=True, image_px=8.0, blur_px=blur_px)
    design = designed(thin(), SENSOR, wish)
    to_array, gap, pitch, focal = parts(design)
    assert focal == (gap,)
    for end, side in ((NEAR, 1.0), (FAR, -1.0)):
        image = image_mm(end)
        assert SENSOR.pitch_mm * to_array / gap * (image - to_array) / image == pytest.approx(
            side * blur_px * pitch, rel=1e-6
        )
    np.testing.assert_allclose(design.range_mm, (NEAR, FAR), rtol=1e-6)
    shifts = [refocused_mm(lens_of(0.0, 0.0, FOCAL), design.camera, shift) for shift in (-blur_px, blur_px)]
    np.testing.assert_allclose(shifts, (NEAR, FAR), rtol=1e-6)


def test_magnification_and_f_number_of_the_paper_give_the_camera_of_the_paper() -> None:
    """Michels, Petersen and Koch 2019: 1.7 mm before the sensor, 123.3 mm behind the stop of the Tronnier lens, cells
    of 21.73 px, focal lengths of 1.9, 2.1 and 2.3 mm; a stop of 10.59 mm matches. Their ranges overlap, so that ours,
    which only join, need focal lengths a little farther apart.
    """
    image_z, middle = 123.3 + 1.7 / (1 - 1.7 / 2.1), 1 - 1.7 / 2.1
    lens = rigs.tronnier(10.59 / 2)
    figures = first_order(lens)
    wish = PlenopticWish(
        magnification=(image_z + figures.rear_focus_mm) / figures.efl_mm,
        virtual_depth=1 / (middle + 3 / 21.73),
        image_px=21.73,
    )
    design = designed(lens, SENSOR, wish)
    array = design.camera.microlenses
    assert array.distance_mm == pytest.approx(1.7, rel=1e-3)
    assert design.camera.sensor_distance_mm - array.distance_mm == pytest.approx(123.3, abs=0.01)
    shortest, middle, longest = array.focal_lengths_mm
    assert middle == pytest.approx(2.1, rel=1e-3)
    assert 1.88 < shortest < 1.9 and 2.3 < longest < 2.38


def lens_of(front: float, rear: float, focal: float, pupil_z: float = 0.0) -> FirstOrder:
    """First-order figures of principal planes, an exit pupil, and nothing else."""
    pupil = Pupil(z_mm=pupil_z, diameter_mm=1.0, magnification=1.0)
    planes = {"front_principal_mm": front, "rear_principal_mm": rear}
    foci = {"front_focus_mm": front + focal, "rear_focus_mm": rear - focal, "bfd_mm": focal}
    return FirstOrder(efl_mm=focal, **planes, **foci, entrance_pupil=pupil, exit_pupil=pupil)


def test_refocusing_agrees_with_the_published_test_of_plenoptisign() -> None:
    """hahnec/plenoptisign, unit_test.py: f_U 193.2935, planes -65.5563 apart, exit pupil 111.0324 before microlenses of
    pitch 0.125 and focal length 2.75, pixels of 0.009; focused at infinity its shift a = 1 is at 962.7459 mm from the
    microlenses. Its shift counts the other way."""
    focal, gap = 193.2935, 2.75
    array = MicrolensArray(
        pitch_mm=0.125, focal_lengths_mm=(gap,), width_mm=1.0, height_mm=1.0, distance_mm=gap, layout="square"
    )
    sensor = Sensor(width_px=10, height_px=10, pitch_mm=0.009)
    camera = Camera(prescription=thin(), sensor=sensor, sensor_distance_mm=focal + gap, microlenses=array)
    lens = lens_of(-65.5563, 0.0, focal, 111.0324 - focal)
    assert refocused_mm(lens, camera, -1.0) + focal == pytest.approx(962.7459, abs=1e-4)
    assert refocused_mm(lens, camera, 0.0) == refocused_mm(lens, camera, 0.5) == math.inf


@pytest.mark.parametrize("others", [{}, {"types": 1, "unfocused": True, "image_px": 8.0}])
def test_micro_images_behind_a_real_lens_neither_overlap_nor_leave_more_than_the_stated_gap(others) -> None:
    """Widths of the light through vertices, along the line to the neighbour; of an ideal lens it is the gap."""
    for lens, tolerance_px in ((thin(), 1e-3), (rigs.tronnier(), 0.04)):
        design = designed(lens, SENSOR, PlenopticWish(**RANGE, **others))
        tracer = Tracer(focused(design.camera))
        images = micro_images(tracer)
        light = micro_light(tracer, images)
        centre, pitch = images.centre_mm[light.rows], SENSOR.pitch_mm
        first = int(np.argmin(np.hypot(*centre.T)))
        away = np.hypot(*(centre - centre[first]).T)
        along_x = np.flatnonzero((away > 0) & (away < 1.2 * design.camera.microlenses.pitch_mm))
        second = along_x[np.argmin(centre[along_x, 0])]  # to the right in the image, whose x is turned round
        gap_px = (away[second] - light.pupil_mm[first, 0] - light.pupil_mm[second, 12]) / pitch
        assert gap_px == pytest.approx(design.gap_px, abs=tolerance_px)
        assert -0.01 < gap_px < design.gap_px + 1e-3


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_real_rays_from_the_ends_of_the_range_spread_over_the_circle_of_confusion(kind: int) -> None:
    """Rays of one position through a hexagonal aperture, its flats across x: as wide at the end as a pixel is there."""
    wish = PlenopticWish(**RANGE)
    design = designed(rigs.tronnier(), SENSOR, wish)
    camera = focused(design.camera)
    rig = Rig.of(Tracer(camera))
    x, y = rig.tracer.pixels_at(np.array([rig.middles[kind][:2]]))[0]
    beams = bundle(camera, x, y), bundle(camera, x + 0.5, y), bundle(camera, x - 0.5, y)
    for end in design.depth_of_field_mm[kind]:
        here, right, left = (beam.at_distance(end) for beam in beams)
        per_px_mm = abs(right[:, 0].mean() - left[:, 0].mean())
        assert np.ptp(here[:, 0]) / per_px_mm == pytest.approx(wish.blur_px, rel=0.1)


@pytest.mark.parametrize(
    ("others", "words", "mended"),
    [
        ({"f_number": 22.0}, "virtual depth", "f_number"),
        ({"image_px": 10.0}, "beyond infinity", "image_px"),
        ({"types": 1, "unfocused": True, "image_px": 20.0}, "opens to", "image_px"),
        ({"near_mm": 80.0}, "real image", "near_mm"),
        ({"near_mm": 90.0}, "inside the lens", None),
        ({"near_mm": None, "far_mm": None, "magnification": 0.3, "f_number": 1.5}, "opens to", "f_number"),
    ],
)
def test_what_cannot_be_is_refused_with_a_number_that_helps(others, words, mended) -> None:
    wish = {**RANGE, **others}
    with pytest.raises(CameraError, match=words) as refused:
        designed(rigs.tronnier(), SENSOR, PlenopticWish(**wish))
    if mended is not None:
        number = float(re.search(r"\d+(\.\d+)?", refused.value.hint).group())
        beyond = {"beyond infinity": 6.0, "real image": 200.0}.get(words, 0.0)  # these say what is not enough yet
        designed(rigs.tronnier(), SENSOR, PlenopticWish(**{**wish, mended: number + beyond}))


@pytest.mark.parametrize(
    "wish",
    [
        {"near_mm": 380.0},
        {"near_mm": 480.0, "far_mm": 380.0},
        {**RANGE, "magnification": 0.3},
        {**RANGE, "types": 2},
        {**RANGE, "layout": "square"},
        {**RANGE, "f_number": 8.0, "virtual_depth": 3.0},
        {**RANGE, "types": 1, "unfocused": True, "virtual_depth": 3.0},
        {**RANGE, "types": 1, "unfocused": True, "f_number": 8.0},
    ],
)
def test_demands_that_contradict_each_other_are_refused(wish) -> None:
    with pytest.raises(CameraError):
        designed(thin(), SENSOR, PlenopticWish(**wish))


@pytest.mark.heavy
@pytest.mark.parametrize("kind", [0, 1, 2])
def test_a_rendered_edge_at_the_ends_of_the_range_is_as_blurred_as_promised(kind: int) -> None:
    """One pixel sees an edge that moves past it: the derivative has the variance 5/72 c^2 of a hexagon across flats,
    and 1/12 of the pixel.
    """
    wish = PlenopticWish(**RANGE, blur_px=2.0, image_px=40.0)
    design = designed(rigs.tronnier(), SENSOR, wish)
    camera = focused(design.camera)
    rig = Rig.of(Tracer(camera))
    column, row = np.rint(rig.tracer.pixels_at(np.array([rig.middles[kind][:2]]))[0]).astype(int)
    beams = [bundle(camera, column + step, row) for step in (-0.5, 0.0, 0.5)]
    for end in design.depth_of_field_mm[kind]:
        left, middle, right = (beam.mean_at(end)[0] for beam in beams)
        edges_px, light = np.linspace(-2.5, 2.5, 21), []
        for edge_px in edges_px:
            edge_mm = middle + edge_px * (right - left)

            def radiance(origin, direction, edge_mm=edge_mm, end=end):
                x_mm = origin[:, 0] + (end - origin[:, 2]) * direction[:, 0] / direction[:, 2]
                return (x_mm > edge_mm).astype(float)

            light.append(irradiance(rig, 1024, radiance, (row, row + 1))[0, column])
        spread = np.abs(np.diff(light))
        place = (edges_px[1:] + edges_px[:-1]) / 2
        mean = np.average(place, weights=spread)
        variance = np.average((place - mean) ** 2, weights=spread)
        assert np.sqrt((variance - 1 / 12) * 72 / 5) == pytest.approx(wish.blur_px, rel=0.1)
