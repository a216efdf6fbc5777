"""Claim: white images at other F-numbers are those of the same camera with its stop set, and micro-images follow."""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from tolerances import CLOSED_FORM, MICRO_IMAGE_PX, ORDER, SIGMAS

from pipeline.camera.focusing.focus_request import f_number_in_name, stopped_down
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.micro_images.light import MicroLight, micro_light
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import first_order
from pipeline.render.imaging import irradiance


def one_microlens(camera: Camera, x_mm: float = 0.0, y_mm: float = 0.0) -> Camera:
    array = dataclasses.replace(camera.microlenses, width_mm=0.01, height_mm=0.01, offset_x_mm=x_mm, offset_y_mm=y_mm)
    return dataclasses.replace(camera, microlenses=array)


def light_of(camera: Camera) -> tuple[Tracer, MicroLight]:
    tracer = Tracer(camera)
    return tracer, micro_light(tracer, micro_images(tracer))


def test_a_stopped_down_lens_has_the_f_number_and_keeps_its_focus() -> None:
    camera = rigs.plenoptic()
    for f_number in (2.8, 8.0, 22.0):
        stopped = stopped_down(camera, f_number)
        assert first_order(stopped.prescription).f_number == pytest.approx(f_number, rel=1e-12)
        assert stopped.sensor_distance_mm == camera.sensor_distance_mm
        own = dataclasses.replace(stopped, prescription=camera.prescription)
        assert own == camera
    assert [f_number_in_name(f) for f in (8.0, 2.8, 11.3)] == ["f8", "f2.8", "f11.3"]


def test_a_lens_is_not_opened_wider_than_its_other_surfaces_let_through() -> None:
    with pytest.raises(CameraError, match=r"F/1\.4 needs a stop of 49\.\d+ mm") as refused:
        stopped_down(rigs.plenoptic(), 1.4)
    widest = float(refused.value.hint.rpartition("/")[2])
    assert first_order(stopped_down(rigs.plenoptic(), widest).prescription).f_number == pytest.approx(widest)
    with pytest.raises(CameraError):
        stopped_down(rigs.plenoptic(), widest - 2e-3)


def test_micro_images_shrink_with_the_pupil_whose_aberrations_fall_fourfold() -> None:
    """Half the paraxial radius at twice the F-number; the real one comes nearer to it with the stop's square."""
    excess, radii = [], []
    for f_number in (5.6, 11.2, 22.4):
        camera = one_microlens(stopped_down(rigs.plenoptic(), f_number))
        tracer, found = light_of(camera)
        radii.append(micro_images(tracer).radius_mm)
        excess.append(math.sqrt(found.pupil_area_mm2[0] / math.pi) / radii[-1] - 1)
    np.testing.assert_allclose(radii, radii[0] / np.array([1, 2, 4]), rtol=1e-12)
    assert excess[0] > 1e-3
    assert np.all(np.abs(np.log2(np.array(excess[:-1]) / excess[1:]) - 2) < 2 * ORDER)


def test_an_obstruction_takes_its_own_image_out_of_the_light() -> None:
    """Area of the ring is that of the outer disc less that of the inner one, each as a stop of its own."""
    camera = one_microlens(rigs.plenoptic(), 6.0, 2.0)
    camera = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, width_px=2000, height_px=2000))
    stop = camera.prescription.stop_index
    areas = []
    for values in ({"semi_diameter_mm": 5.0}, {"semi_diameter_mm": 2.0}, {"inner_semi_diameter_mm": 2.0}):
        _, found = light_of(rigs.reshaped(camera, {stop: values}))
        areas.append(found.pupil_area_mm2[0])
    assert areas[2] == pytest.approx(areas[0] - areas[1], rel=CLOSED_FORM)
    assert areas[1] / areas[0] == pytest.approx((2 / 5) ** 2, rel=0.02)


@pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
def test_pixels_of_the_white_image_have_the_same_centroid() -> None:
    """All light of one microlens falls into the image, so that the mean over its pixels is the centroid."""
    camera = one_microlens(rigs.plenoptic(width_px=64, height_px=48), 0.06, -0.04)
    tracer, found = light_of(camera)
    y, x = np.mgrid[:48, :64]
    means = []
    for seed in range(16):
        white = irradiance(Rig(Tracer(camera, seed), micro_images(tracer)), 64, None)
        means.append([(white * x).sum() / white.sum(), (white * y).sum() / white.sum()])
    off = np.mean(means, axis=0) - tracer.pixels_at(found.centroid_mm)[0]
    error = np.std(means, axis=0, ddof=1) / 4
    assert np.all(np.abs(off) < SIGMAS * error + MICRO_IMAGE_PX)
    assert error.max() < 2 * MICRO_IMAGE_PX
