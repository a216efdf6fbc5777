"""Claim: a pixel's photons lose what its own rays lose, wherever it lies: by Fresnel, by its ways through glass."""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from laws.rigs import in_light
from tolerances import BISECTED, FIELD_TRANSMISSION

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.tracer import Tracer
from pipeline.optics.prescription import Group, Prescription, Surface
from pipeline.optics.rays import traced
from pipeline.optics.table import towards_scene
from pipeline.optics.transmission import Coating, Losses, transmitted
from pipeline.render.radiometry import axial_transmission, field_transmission, photon_rate
from pipeline.render.sensor.response import Radiance

pytestmark = pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
"""A stop behind a window has no focal length."""
INDEX, THICKNESS_MM, PER_MM = 1.6, 3.0, 0.98
WINDOW = Losses(coatings=(None,) * 3, per_mm=(PER_MM, 1.0, 1.0))
SENSOR = Sensor(width_px=41, height_px=31, pitch_mm=0.5, offset_x_mm=1.3, offset_y_mm=-0.7)
LOSSY = Losses(
    coatings=(None, Coating(reflectance=(0.01, 0.05), angles_deg=(0.0, 40.0)), *(None,) * 9),
    per_mm=(0.998, 1.0, 0.997, *(1.0,) * 5, 0.996, 0.999, 1.0),
)
"""Of the double Gauss of the proofs: bare surfaces, a table by angle, and glass that absorbs."""


def window(tilt_deg: float) -> Camera:
    """A plane plate before a hole, far from a large sensor."""
    plate = Surface(thickness_mm=THICKNESS_MM, index=INDEX, semi_diameter_mm=90.0)
    rear = Surface(thickness_mm=40.0, semi_diameter_mm=90.0)
    groups = (Group(name="window", first=0, count=2, tilt_deg=(tilt_deg, 0.0)),) if tilt_deg else ()
    surfaces = (plate, rear, Surface(semi_diameter_mm=0.02, is_stop=True))
    return Camera(
        prescription=Prescription(surfaces=surfaces, groups=groups),
        sensor=SENSOR,
        sensor_distance_mm=10.0,
        near_mm=100.0,
        far_mm=200.0,
    )


def through_a_plate(cosine: np.ndarray) -> np.ndarray:
    """Fresnel's shares of both polarisations through front and rear, and the way between them."""
    sine = np.sqrt(1 - cosine**2)
    inside = np.sqrt(1 - (sine / INDEX) ** 2)
    s = ((cosine - INDEX * inside) / (cosine + INDEX * inside)) ** 2
    p = ((INDEX * cosine - inside) / (INDEX * cosine + inside)) ** 2
    return ((1 - s) ** 2 + (1 - p) ** 2) / 2 * PER_MM ** (THICKNESS_MM / inside)


@pytest.mark.parametrize("tilt_deg", [pytest.param(0.0, marks=pytest.mark.heavy), 15.0])
def test_a_window_before_a_hole_has_fresnels_shares_pixel_by_pixel(tilt_deg: float) -> None:
    """Every pixel sees the plate at its own angle, up to 60 degrees off its normal; on the tilted one about another."""
    field = field_transmission(window(tilt_deg), (WINDOW,))
    assert field is not None and field.error < FIELD_TRANSMISSION
    columns, rows = np.meshgrid(np.arange(41) - 20, np.arange(31) - 15)
    x, y = columns * 0.5 - SENSOR.offset_x_mm, rows * 0.5 - SENSOR.offset_y_mm
    way = np.stack([-x, -y, np.full(x.shape, 10.0)], axis=-1) / np.sqrt(x**2 + y**2 + 100)[..., None]
    tilt = math.radians(tilt_deg)
    expected = through_a_plate(way @ [0.0, math.sin(tilt), math.cos(tilt)])
    assert expected.max() / expected.min() > 1.05
    np.testing.assert_allclose(field.axis * field.relative_rows(0, 31, 41), expected, rtol=FIELD_TRANSMISSION)
    assert field.axis == pytest.approx(through_a_plate(np.array(math.cos(tilt))), rel=FIELD_TRANSMISSION)


def test_what_is_the_same_at_all_angles_is_the_same_in_all_pixels() -> None:
    losses = Losses(coatings=(Coating(reflectance=(0.01,)),) * 11, per_mm=(1.0,) * 11)
    camera = rigs.conventional(8.0)
    for one in (camera, rigs.displaced(camera)):
        field = field_transmission(one, (losses,))
        assert field is not None
        assert field.axis == pytest.approx(0.99**11, rel=BISECTED)
        np.testing.assert_allclose(field.relative_rows(0, 72, 96), 1.0, rtol=BISECTED)


PIXELS = (95, 20), (0, 0), (30, 71)


@pytest.mark.parametrize(
    ("displaced", "pixels"),
    [(False, PIXELS[:1]), *(pytest.param(is_off, PIXELS, marks=pytest.mark.heavy) for is_off in (False, True))],
)
def test_a_pixel_off_the_axis_has_the_mean_of_many_random_rays(
    displaced: bool, pixels: tuple[tuple[int, int], ...]
) -> None:
    """Points drawn evenly over the rear of the lens, each weighted by cos^2 / distance^2, traced towards the scene."""
    camera = wide(displaced)
    field = field_transmission(camera, (LOSSY,))
    assert field is not None and field.error < FIELD_TRANSMISSION
    for x_px, y_px in pixels:
        found = field.axis * field.relative_rows(y_px, y_px + 1, 96)[0, x_px]
        assert found == pytest.approx(by_random_rays(camera, x_px, y_px), rel=FIELD_TRANSMISSION)
    assert field.relative_rows(0, 1, 96)[0, 0] < 0.998


def wide(displaced: bool) -> Camera:
    """A double Gauss at f/2.8 whose corner is 23 mm off the axis and vignetted; displaced at f/4 and less wide."""
    if displaced:
        return rigs.displaced(rigs.conventional(8.0, pitch_mm=0.25))
    return rigs.conventional(12.0, pitch_mm=0.38)


def by_random_rays(camera: Camera, x_px: int, y_px: int) -> float:
    """Mean share of a pixel's rays that passes, weighted by the projected solid angle: no code of images is used."""
    table, tracer, rng = towards_scene(camera.prescription), Tracer(camera), np.random.default_rng(7)
    start = np.append(tracer.positions_mm(x_px, y_px), tracer.sensor_z_mm)
    rear_mm, count = table[0, 0], 200_000
    radius, azimuth = 24.0 * np.sqrt(rng.random(count)), 2 * math.pi * rng.random(count)
    way = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(count, rear_mm)]) - start
    distance = np.linalg.norm(way, axis=1, keepdims=True)
    way /= distance
    weight = way[:, 2] ** 2 / distance[:, 0] ** 2
    from_sensor = Losses(coatings=LOSSY.coatings[::-1], per_mm=(*LOSSY.per_mm[-2::-1], 1.0))
    starts = np.broadcast_to(start, way.shape)
    passes = traced(table, starts, way)[2]
    share = transmitted(table, starts, way, from_sensor)
    assert passes.sum() > 10_000
    return float(np.average(share[passes], weights=weight[passes]))


def test_the_axis_is_what_it_is_alone_and_no_row_depends_on_its_neighbours() -> None:
    camera = rigs.conventional(8.0, width_px=97, height_px=73)
    field = field_transmission(camera, (LOSSY,))
    assert field is not None
    assert field.axis == pytest.approx(axial_transmission(Tracer(camera), LOSSY), rel=1e-9)
    whole = field.relative_rows(0, 73, 97)
    assert whole[36, 48] == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_array_equal(whole, np.concatenate([field.relative_rows(row, row + 1, 97) for row in range(73)]))


def test_no_pixel_gets_more_light_than_comes() -> None:
    """Also where the spline between nodes that are 1, or next to it, could rise above it."""
    clear = Coating(reflectance=(0.0, 0.0, 0.02), angles_deg=(0.0, 8.0, 30.0))
    camera = wide(displaced=False)
    field = field_transmission(camera, (Losses(coatings=(clear,) * 11, per_mm=(1.0,) * 11),))
    assert field is not None
    share = field.axis * field.relative_rows(0, 72, 96)
    assert 0.9 < share.min() < 0.9999 and share.max() <= 1.0


def test_a_channel_has_the_mean_of_its_wavelengths_by_their_light() -> None:
    """On the axis photons with losses are photons without them times this mean."""
    camera = in_light(rigs.conventional(8.0), {450.0: 0.3, 650.0: 0.7})
    dim = Losses(coatings=(Coating(reflectance=(0.1,)),) * 11, per_mm=(1.0,) * 11)
    losses = (dim, LOSSY)
    field = field_transmission(camera, losses)
    assert field is not None
    light = Radiance(channel="", w_per_m2_sr=2.0, effective_nm=550.0, losses=losses)
    ideal = dataclasses.replace(light, losses=(None, None))
    assert photon_rate(camera, light) / photon_rate(camera, ideal) == pytest.approx(field.axis, rel=FIELD_TRANSMISSION)


def test_an_ideal_lens_has_no_such_factor() -> None:
    assert field_transmission(rigs.conventional(8.0), (None,)) is None
