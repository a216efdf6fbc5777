"""Models fitted to exact rays: what they reproduce, and what none of them can."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from fits.pixel_rays import lit_rays
from fits.test_models import SPHERES
from laws import rigs
from laws.rigs import thin

import pipeline
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.fits.field import FieldRays, field_rays
from pipeline.fits.fitting import MODELS, fitted
from pipeline.optics.first_order import first_order
from pipeline.plugins.fits.pupil import pupil_curve
from pipeline.plugins.fits.result import ALL, by_distance, document, fit_camera, worst
from pipeline.plugins.fits.thin_plenoptic import positions_mm, thin_plenoptic

OPENCV = ("pinhole", "brown", "rational", "thin-prism", "tilted")


@pytest.fixture(scope="module")
def field(conventional) -> FieldRays:
    return field_rays(pipeline.ready(conventional))


@pytest.fixture(scope="module")
def wide(tronnier) -> FieldRays:
    """The double Gauss before a sensor of 30 x 24 mm: five degrees of distortion and pupil walk."""
    sensor = Sensor(width_px=300, height_px=240, pitch_mm=0.1)
    camera = focused(Camera(prescription=rigs.tronnier(5.0), sensor=sensor, sensor_distance_mm=108.0))
    return field_rays(pipeline.ready(camera))


def central(name: str, p: np.ndarray) -> FieldRays:
    """Rays that meet in the centre of a model, at the positions that it gives them."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.25, 0.25, 15), np.linspace(-0.2, 0.2, 13)))
    slope = np.column_stack([x, y, np.ones(len(x))])
    x_px = MODELS[name].project(p[3:], slope)
    rays, start = lit_rays(*x_px.T, p[:3] - p[2] * slope, slope), np.array([880.0, 300.0, 250.0, 0.0])
    return FieldRays(x_px=x_px, rays=rays, planes_mm=(400.0, 600.0), size_px=(640, 480), lit_share=1.0, start=start)


@pytest.mark.parametrize(
    ("name", "p"),
    [
        ("brown", [0.3, -0.2, -6.0, 900, 905, 321.5, 239.25, -0.2, 0.1, 1e-3, -2e-3, 0.3]),
        ("fisheye", [0.3, -0.2, -6.0, 900, 905, 321.5, 239.25, -0.05, 0.3, -0.2, 0.1]),
        ("kannala-brandt", [0.3, -0.2, -6.0, 321.5, 239.25, 900, -30, 12, -40]),
        ("ftheta", [0.3, -0.2, -6.0, 321.5, 239.25, 1.1e-3, -1e-8, 2e-10, 1e-13]),
    ],
)
def test_a_camera_that_is_a_model_is_found_again(name, p):
    found = fitted(central(name, np.array(p)), name)
    assert found.max_px < 1e-7
    np.testing.assert_allclose(found.parameters, p, rtol=1e-4, atol=1e-6)
    assert all(row["max_px"] < 1e-6 for row in by_distance(found, central(name, np.array(p))))


@pytest.mark.parametrize("name", SPHERES)
def test_a_fisheye_that_is_a_model_of_spheres_is_found_again(name):
    """Rays up to 115 degrees; a position that is moved by 0.1 px leaves a residual."""
    theta, azimuth = (axis.ravel() for axis in np.meshgrid(np.radians(np.linspace(0, 115, 12)), np.arange(12) * 0.55))
    ways = np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], axis=1)
    p = np.array([0.3, -0.2, 28.0, *SPHERES[name]])
    x_px = MODELS[name].project(p[3:], ways)
    seen = central("pinhole", np.array([0.0, 0, 0, 150, 150, 250, 250]))
    rays = dataclasses.replace(lit_rays(*x_px.T, p[:3], ways), direction=ways)
    field = dataclasses.replace(seen, x_px=x_px, rays=rays, start=np.array([p[3] / 2, 260.0, 250.0, 20.0]))
    found = fitted(field, name)
    assert found.max_px < 1e-6  # what holds coefficients moves them by as much
    np.testing.assert_allclose(found.parameters, p, rtol=1e-6, atol=1e-6)
    moved = dataclasses.replace(field, x_px=x_px + 0.1 * (np.arange(len(ways)) == 50)[:, None])
    assert fitted(moved, name).max_px > 0.08


@pytest.mark.parametrize("name", OPENCV)
def test_the_largest_residual_is_where_it_is_said_to_be(wide, name):
    found = fitted(wide, name)
    np.testing.assert_array_equal(found.residual_px, [found.at_distance(wide, z_mm) for z_mm in wide.planes_mm])
    at = worst(found, wide)
    here = (wide.x_px == [at["x_px"], at["y_px"]]).all(axis=1)
    assert np.linalg.norm(found.at_distance(wide, at["z_mm"])[here][0]) == pytest.approx(found.max_px, rel=1e-9)


def test_more_coefficients_explain_no_less(wide):
    errors = [fitted(wide, name).rms_px for name in OPENCV]
    assert all(later <= before * (1 + 1e-6) for before, later in pairwise(errors))
    assert errors[1] < errors[0] / 10


def test_coefficients_that_the_field_does_not_tell_stay_small(field):
    """A field of three degrees: eight coefficients would else be millions that cancel."""
    values = fitted(field, "rational").values
    corner = np.hypot(*((np.array(field.size_px) - 1) / 2)) / values["fx"]
    effects = [values[f"k{n}"] * corner ** (2 * power + 1) * values["fx"] for n, power in ((3, 3), (6, 3), (4, 1))]
    assert np.abs(effects).max() < 0.1


def test_brown_is_the_equivalent_pinhole(conventional, field):
    """Its parameters are those of camera.json, found on other positions by another program."""
    found, known = fitted(field, "brown").values, pinhole(conventional)
    assert found["centre_z_mm"] == pytest.approx(known.centre_mm[2], abs=1e-3)
    assert found["fx"] == pytest.approx(known.distorted.principal_distance_px, rel=1e-6)
    assert found["fx"] == pytest.approx(found["fy"], rel=1e-9)


def test_no_centre_explains_all_distances(wide):
    """The residual is smallest between the planes that were fitted, and grows away from them."""
    found = fitted(wide, "brown")
    rows = by_distance(found, wide)
    middle = [row["rms_px"] for row in rows if wide.planes_mm[0] < row["z_mm"] < wide.planes_mm[1]]
    assert rows[0]["rms_px"] == pytest.approx(np.sqrt((found.residual_px[0] ** 2).sum(axis=1).mean()))
    assert min(middle) < rows[0]["rms_px"] / 10 and rows[-1]["rms_px"] > 2 * rows[0]["rms_px"]


def test_the_entrance_pupil_begins_at_the_paraxial_one_and_walks():
    """With a pinhole of a stop, whose mean ray is the chief ray."""
    sensor = Sensor(width_px=300, height_px=240, pitch_mm=0.1)
    camera = Camera(prescription=rigs.tronnier(0.05), sensor=sensor, sensor_distance_mm=108.0)
    ready = pipeline.ready(dataclasses.replace(camera, near_mm=400.0, far_mm=700.0))
    found = pupil_curve(field_rays(ready))
    walk = np.polynomial.Polynomial.fit(found.angle_deg**2, found.z_mm, 3)
    assert walk(0.0) == pytest.approx(first_order(camera.prescription).entrance_pupil.z_mm, abs=1e-3)
    assert abs(found.z_mm[-1] - found.z_mm[0]) > 0.05 and found.aside_mm.max() < 1e-9


@pytest.fixture(scope="module")
def libplenos_camera() -> Camera:
    """A thin lens before microlenses with pinholes for apertures."""
    array = MicrolensArray(
        pitch_mm=0.13,
        focal_lengths_mm=(1.6, 1.8, 2.0),
        width_mm=3.0,
        height_mm=2.4,
        distance_mm=1.2,
        aperture="disc",
        disc_diameter_mm=1e-4,
        rotation_deg=2.0,
        offset_x_mm=0.02,
    )
    sensor = Sensor(width_px=300, height_px=240, pitch_mm=0.01)
    lens = thin(semi_mm=4.0)
    camera = Camera(prescription=lens, sensor=sensor, microlenses=array, sensor_distance_mm=54.7)
    return dataclasses.replace(camera, near_mm=380.0, far_mm=520.0)


def test_a_thin_lens_before_pinholes_is_found_again(libplenos_camera):
    found = thin_plenoptic(pipeline.ready(libplenos_camera))
    values = found.values
    assert len(found.residual_px) > 200 and found.max_px < 1e-4
    assert values["focal_mm"] == pytest.approx(49.9, rel=1e-5) and values["lens_z_mm"] == pytest.approx(0, abs=1e-2)
    assert values["sensor_mm"] == pytest.approx(1.2, rel=1e-5)
    assert values["main_lens_mm"] == pytest.approx(53.5, rel=1e-5)


def test_its_equation_is_a_straight_line_through_image_and_vertex():
    """Point, image by 1/f = 1/s + 1/s', vertex and position on the sensor, by the cross product."""
    p = np.zeros(12)
    p[:4] = 50.0, 3.0, 56.0, 1.2
    point, vertex = np.array([[20.0, -9.0, 430.0]]), np.array([[0.4, 0.3]])
    away = 427.0
    image_mm = 1 / (1 / 50 - 1 / away)
    image = np.append(-point[0, :2] * image_mm / away, 3 - image_mm)
    seen = np.append(positions_mm(p, point, vertex)[0], 3 - 57.2)
    centre = np.append(vertex[0], 3 - 56.0)
    np.testing.assert_allclose(np.cross(centre - image, seen - image), 0, atol=1e-12)


def test_all_models_make_a_document(conventional):
    found = document(fit_camera(pipeline.ready(conventional), [ALL]))
    assert [model["name"] for model in found["models"]] == list(MODELS)
    for model in found["models"]:
        field = np.array([model["field"]["near_px"], model["field"]["far_px"]])
        assert model["max_px"] == np.linalg.norm(field, axis=-1).max()
