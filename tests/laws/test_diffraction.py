"""Claim: the image of a point by diffraction is that of the traced wavefront: Airy's pattern where rays are perfect,
Maréchal's Strehl ratio near there, and Huygens's sum over rays everywhere. Images with diffraction show edges as the
aperture spreads them, and depend on seeds as others do.
"""

import dataclasses
import functools
import math

import numpy as np
import pytest
from laws import rigs
from laws.rigs import F_MM, thin
from laws.surfaces import BENT
from naive import huygens
from naive.kinds import KINDS, camera_with
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import uniform_filter
from scipy.special import j1
from shorter import few, few_cases, one_in
from tolerances import (
    AIRY,
    DIFFRACTED_EDGE,
    HEXAGON,
    HUYGENS,
    MALUS_MM,
    MARECHAL,
    SIGMAS,
    SPOT_MM,
    SPREAD_ENERGY,
    TWO_PLANE_MM,
)

from pipeline.camera.focusing.depth_of_field import foci, middle_focus
from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave import wavefront as wavefronts
from pipeline.camera.wave.spread import full_image, intensity, strehl_ratio, transfer
from pipeline.camera.wave.wavefront import View, Wavefront, sent, wavefront
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription, Surface
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance, pictures
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

GREEN_NM, GREEN_MM = 550.0, 550e-6
INDEX = 1.5168
HYPERBOLA = Prescription(
    surfaces=(
        Surface(semi_diameter_mm=5.0, is_stop=True),
        Surface(semi_diameter_mm=20.0, thickness_mm=6.0, index=INDEX),
        Surface(radius_mm=-30.0, conic=-(INDEX**2), semi_diameter_mm=20.0),
    )
)
"""A plane and a hyperboloid: light along the axis meets in one point, to all orders (Descartes)."""
SENSOR = Sensor(width_px=64, height_px=64, pitch_mm=0.005)


def on_axis(prescription: Prescription, distance_mm: float, object_mm: float = math.inf) -> Wavefront:
    camera = Camera(prescription=prescription, sensor=SENSOR, sensor_distance_mm=distance_mm)
    return wavefront(Tracer(camera), View(np.zeros(2), NO_MICROLENS, object_mm), GREEN_NM)


@functools.cache
def perfect_lenses() -> list[tuple[Wavefront, float]]:
    """Wavefronts of two lenses without any error, and their numerical apertures by the sine of the marginal ray."""
    radius, focal = 30.0, 30.0 / (INDEX - 1)
    # The rim ray leaves parallel to the axis at 5 mm: its slope behind the hyperboloid from that point to the focus.
    sag = radius_to_sag(5.0, -radius, -(INDEX**2))
    return [
        (on_axis(thin(F_MM, 3.0), F_MM), math.sin(math.atan(3.0 / F_MM))),
        (on_axis(HYPERBOLA, 6.0 + focal), math.sin(math.atan(5.0 / (focal - sag)))),
    ]


def radius_to_sag(height: float, radius: float, conic: float) -> float:
    c = 1 / radius
    return c * height**2 / (1 + math.sqrt(1 - (1 + conic) * c**2 * height**2))


@pytest.mark.parametrize("which", [0, 1], ids=["ideal", "hyperboloid"])
def test_a_perfect_lens_makes_airys_pattern(which: int) -> None:
    """[2 J1(v) / v]^2 pi NA^2 / lambda^2 with v = 2 pi NA r / lambda, its first dark ring at 0.61 lambda / NA."""
    front, aperture = perfect_lenses()[which]
    assert front.error_waves[1] < 1e-6
    radius_mm = np.linspace(0.01, 3, 40) * GREEN_MM / aperture
    v = 2 * np.pi * aperture * radius_mm / GREEN_MM
    peak = np.pi * aperture**2 / GREEN_MM**2
    light = intensity(front, radius_mm, np.zeros(1))[0]
    np.testing.assert_allclose(light / peak, (2 * j1(v) / v) ** 2, rtol=0, atol=AIRY)
    near = np.linspace(0.59, 0.63, 401) * GREEN_MM / aperture
    dark = near[np.argmin(intensity(front, np.zeros(1), near)[:, 0])]
    assert dark == pytest.approx(0.6098 * GREEN_MM / aperture, rel=2e-3)
    assert strehl_ratio(front) == pytest.approx(1, abs=AIRY)


@pytest.mark.parametrize("along", [(1.0, 0.0), (0.6, 0.8)])
def test_a_circle_has_the_transfer_function_of_two_shifted_circles(along: tuple[float, float]) -> None:
    front, aperture = perfect_lenses()[0]
    s = np.linspace(0, 1.1, 23)
    shifted = np.minimum(s, 1)
    expected = 2 / np.pi * (np.arccos(shifted) - shifted * np.sqrt(1 - shifted**2))
    found = transfer(front, s * 2 * aperture / GREEN_MM, np.array(along))
    np.testing.assert_allclose(np.abs(found), expected, rtol=0, atol=AIRY)


def test_no_light_is_lost() -> None:
    """The integral over the sensor is 1 for a lens with aberrations, too (Parseval)."""
    tracer = Tracer(rigs.conventional(9.0))
    x_mm, image = full_image(wavefront(tracer, View(np.array([1.5, 1.0]), NO_MICROLENS, 434.0), GREEN_NM))
    assert image.sum() * (x_mm[1] - x_mm[0]) ** 2 == pytest.approx(1, abs=SPREAD_ENERGY)


@pytest.mark.parametrize("waves", [0.25, 1.0])
def test_defocus_dims_the_middle_by_sinc_squared(waves: float) -> None:
    """With W waves of defocus at the rim the light on the axis is (sin(pi W) / (pi W))^2: dark at one wave."""
    # The light of a point at z lags behind that of infinity by semi^2 / (2 z) at the rim.
    semi_mm = 1.0
    front = on_axis(thin(F_MM, semi_mm), F_MM, semi_mm**2 / (2 * waves * GREEN_MM))
    light = intensity(front, np.zeros(1), np.zeros(1)) / intensity(front.perfect(), np.zeros(1), np.zeros(1))
    assert light[0, 0] == pytest.approx((math.sin(math.pi * waves) / (math.pi * waves)) ** 2, abs=1e-3)


@pytest.mark.parametrize("position", few([(2.0, 1.2)], (0.0, 0.0)))
def test_the_strehl_ratio_is_marechals(position: tuple[float, float]) -> None:
    """exp(-(2 pi rms)^2), up to the third moment of the phase."""
    camera = rigs.conventional(4.5)
    front = wavefront(Tracer(camera), View(np.array(position), NO_MICROLENS, middle_focus(camera)), 587.56)
    variance = (2 * math.pi * front.error_waves[0]) ** 2
    assert variance > 0.03
    assert strehl_ratio(front) == pytest.approx(math.exp(-variance), abs=MARECHAL)


@pytest.mark.parametrize(
    ("semi_mm", "position", "object_mm"),
    few_cases(
        [(1.2, (1.0, 0.5), 350.0)], (9.0, (4.0, 3.0), 433.0), (4.5, (0.0, 0.0), 434.36), (9.0, (0.0, 5.0), 440.0)
    ),
)
def test_rays_backwards_and_huygens_forwards_agree(
    semi_mm: float, position: tuple[float, float], object_mm: float
) -> None:
    """Reciprocity: a slow twin traces from the object point and adds spherical waves."""
    camera = rigs.conventional(semi_mm)
    tracer, view = Tracer(camera), View(np.array(position), NO_MICROLENS, object_mm)
    front = wavefront(tracer, view, GREEN_NM)
    # The object point of the view: the mean of the crossings of its rays, whose gradient the wavefront is.
    reach = 3 * 0.61 * GREEN_MM / front.numerical_aperture
    x_mm, y_mm = np.linspace(-reach, reach, 7), np.linspace(-reach, reach, 5)
    found = intensity(front, x_mm, y_mm) / (np.pi * front.numerical_aperture**2 / GREEN_MM**2)
    point = object_point(tracer, view, front)
    places = [(position[0] + x, -(position[1] + y), camera.sensor_distance_mm) for y in y_mm for x in x_mm]
    prescription = camera.prescription
    vision = np.array([point[0], -point[1], -object_mm])
    expected = huygens.image(prescription, vision, GREEN_MM, np.array([places[17], *places]), 501)[1:]
    np.testing.assert_allclose(found.ravel(), expected, rtol=0, atol=HUYGENS)


def object_point(tracer: Tracer, view: View, front: Wavefront) -> np.ndarray:
    """Mean crossing of the rays of a view with the plane of its object, (2,)."""
    a, b = np.meshgrid(*front.cosines)
    way = np.column_stack([a.ravel(), b.ravel(), np.sqrt(1 - a.ravel() ** 2 - b.ravel() ** 2)])
    rays = sent(tracer, view.microlens, view.position_mm, way)
    crossing = rays.position_mm[:, :2] + (view.object_mm - rays.position_mm[:, 2:]) * rays.slope
    lit = front.share.ravel() > 0
    return np.average(crossing[lit], axis=0, weights=front.share.ravel()[lit])


def lenses() -> dict[str, Camera]:
    """Cameras with every kind of surface and of microlens."""
    bent = Camera(prescription=BENT, sensor=SENSOR, sensor_distance_mm=60.0)
    ideal = thin(60.0, 6.0).surfaces[0]
    behind = dataclasses.replace(ideal, focal_length_mm=40.0, is_stop=False, tilt_deg=(2.0, 1.0), decentre_mm=(0.3, 0))
    two = Prescription(surfaces=(dataclasses.replace(ideal, thickness_mm=5.0), behind))
    return {
        "aspheres": bent,
        "displaced": rigs.displaced(rigs.conventional(4.5)),
        "ideal": Camera(prescription=two, sensor=SENSOR, sensor_distance_mm=45.0),
        **{f"microlens {name}": camera_with(name) for name in KINDS if "c" not in name[:1] or "convex" in name},
    }


@pytest.mark.parametrize("name", one_in(3, lenses()))
def test_paths_obey_malus(name: str) -> None:
    """Rays are normals of their wavefronts: where the end of a ray moves, its path grows by the way along the ray.

    Between ends P and Q of two rays of one point, with directions p and q, the paths differ by (p + q) (Q - P) / 2, up
    to the cube of their distance.
    """
    camera = lenses()[name]
    tracer = Tracer(camera)
    row, position = NO_MICROLENS, np.array([0.05, -0.08])
    if camera.microlenses:
        row = int(np.argmin(np.hypot(*tracer.vertices_mm.T)))
        position = micro_images(tracer).centre_mm[row] + [0.01, -0.02]
    centre, width = wavefronts._pupil(tracer, View(position, row, math.inf))
    errors = []
    for parts in (40, 80):
        a = centre[0] + np.linspace(-0.4, 0.4, parts + 1) * width
        b = centre[1] + 0.2 * width * np.cos(np.linspace(0, 3, parts + 1))
        rays = sent(tracer, row, position, np.column_stack([a, b, np.sqrt(1 - a * a - b * b)]))
        step = np.diff(rays.position_mm, axis=0)
        along = np.sum(step * (rays.direction[1:] + rays.direction[:-1]) / 2, axis=1)
        errors.append(np.abs(np.diff(rays.path_mm) - along).sum())
    assert errors[1] < max(errors[0] / 3.8, TWO_PLANE_MM if "two-plane" in name else MALUS_MM)
    assert errors[1] < 1e-5


def test_the_gradient_of_the_error_is_where_rays_go() -> None:
    """Spots of rays traced forwards from the object point lie where the derivatives of the wavefront say."""
    camera, object_mm = rigs.conventional(9.0), 433.0
    tracer, view = Tracer(camera), View(np.array([4.0, 3.0]), NO_MICROLENS, object_mm)
    front = wavefront(tracer, view, GREEN_NM)
    point = object_point(tracer, view, front)
    aims = np.column_stack([np.random.default_rng(1).uniform(-6, 6, (400, 2)), np.full(400, -50.0)])
    start = np.array([point[0], -point[1], -object_mm])
    position, direction, _, passes = huygens.forward(camera.prescription, start, aims)
    spot = position + ((camera.sensor_distance_mm - position[:, 2]) / direction[:, 2])[:, None] * direction
    a, b = front.cosines
    # From the sensor to the scene, vision frame: the lens frame with y and z turned round, backwards.
    place = np.column_stack([direction[:, 1], -direction[:, 0]])
    crossing = RegularGridInterpolator((b, a), front.crossings_mm, bounds_error=False)(place)
    share = RegularGridInterpolator((b, a), uniform_filter(front.share, 9), bounds_error=False)(place)
    inner = passes & (share > 0.999)
    assert inner.sum() > 100
    found = crossing[inner]
    expected = np.column_stack([spot[inner, 0] - 4.0, -spot[inner, 1] - 3.0])
    assert np.abs(expected).max() > 0.005
    np.testing.assert_allclose(found, expected, rtol=0, atol=SPOT_MM)


def test_behind_a_microlens_its_own_aperture_counts() -> None:
    """A disc of 0.12 mm, 0.9 mm before the sensor: the first dark ring is at 0.61 wavelength over its sine."""
    array = MicrolensArray(
        pitch_mm=0.15,
        focal_lengths_mm=(0.9,),
        width_mm=1.5,
        height_mm=1.5,
        distance_mm=0.9,
        aperture="disc",
        disc_diameter_mm=0.12,
    )
    camera = Camera(prescription=thin(F_MM, 6.0), sensor=SENSOR, sensor_distance_mm=52.0, microlenses=array)
    tracer = Tracer(camera)
    row = int(np.argmin(np.hypot(*tracer.vertices_mm.T)))
    front = wavefront(tracer, View(micro_images(tracer).centre_mm[row], row, math.inf), GREEN_NM)
    aperture = math.sin(math.atan(0.06 / 0.9))
    near = np.linspace(0.57, 0.65, 401) * GREEN_MM / aperture
    dark = near[np.argmin(intensity(front, near, np.zeros(1))[0])]
    assert dark == pytest.approx(0.6098 * GREEN_MM / aperture, rel=5e-3)


@pytest.mark.parametrize("object_mm", few([600.0], 430.0))
def test_defocus_behind_a_microlens_is_that_of_vergences(object_mm: float) -> None:
    """r^2 / 2 (1 / a - 1 / a0), a the distance of the image from the array; rms over a circle: 1 / sqrt(12) of it."""
    camera = rigs.plenoptic(1.0)
    tracer, lens = Tracer(camera), first_order(camera.prescription)
    row = int(np.argmin(np.hypot(*tracer.vertices_mm.T)))
    focus_mm = foci(camera)[int(tracer.lattice.type[row])].focus_distance_mm
    front = wavefront(tracer, View(micro_images(tracer).centre_mm[row], row, object_mm), GREEN_NM)
    radius_mm = front.numerical_aperture * camera.microlenses.distance_mm
    ahead = [1 / (lens.image_mm(z) - tracer.film_z_mm) for z in (object_mm, focus_mm)]
    waves = abs(radius_mm**2 / 2 * (ahead[0] - ahead[1])) / GREEN_MM / math.sqrt(12)
    assert front.error_waves[0] == pytest.approx(waves, rel=HEXAGON)


def diffracting(camera: Camera, seed: int = 0) -> Rig:
    return dataclasses.replace(Rig.of(Tracer(camera, seed)), diffraction_nm=GREEN_NM)


def airy_edge(x_mm: np.ndarray, aperture: float, pixel_mm: float) -> np.ndarray:
    """Light of a half plane, bright at positive x, by the transfer function of a circle and of a pixel."""
    limit = 2 * aperture / GREEN_MM
    per_mm = (np.arange(4000) + 0.5) / 4000 * limit
    s = per_mm / limit
    contrast = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2)) * np.sinc(per_mm * pixel_mm)
    waves = np.sin(2 * np.pi * np.outer(x_mm, per_mm)) / (np.pi * per_mm)
    return 0.5 + waves @ contrast * limit / 4000


def test_an_edge_is_as_soft_as_airys_pattern() -> None:
    """An ideal lens at F/25: the light of a half plane at infinity, pixel by pixel."""
    pitch_mm, semi_mm = 0.004, 1.0
    sensor = Sensor(width_px=64, height_px=16, pitch_mm=pitch_mm)
    camera = Camera(prescription=thin(F_MM, semi_mm), sensor=sensor, sensor_distance_mm=F_MM)

    def half_plane(_: np.ndarray, direction: np.ndarray) -> np.ndarray:
        return (direction[:, 0] > 0).astype(float)

    image = irradiance(diffracting(camera), 1024, half_plane).mean(axis=0)
    x_mm = (np.arange(64) - 31.5) * pitch_mm  # of the image: turned round twice
    expected = airy_edge(x_mm, np.sin(np.arctan(semi_mm / F_MM)), pitch_mm)
    assert np.abs(image - (x_mm > 0)).max() > 0.3
    np.testing.assert_allclose(image, expected, rtol=0, atol=DIFFRACTED_EDGE)


def test_a_row_alone_is_the_row_of_the_image() -> None:
    """Numbers depend on the pixel, not on what else is computed; and no light is lost in a white scene."""
    camera = rigs.conventional(4.5, width_px=24, height_px=12)
    rig = diffracting(camera)
    whole = irradiance(rig, 64, None)
    np.testing.assert_array_equal(irradiance(rig, 64, None, (5, 7)), whole[5:7])
    assert whole.mean() == pytest.approx(irradiance(Rig.of(rig.tracer), 64, None).mean(), rel=1e-4)


def test_pixels_that_are_not_sampled_see_no_edge_by_diffraction_either() -> None:
    """What is judged to be of one colour agrees with the mean of sampled images, within their noise."""
    camera = rigs.conventional(3.0, width_px=30, height_px=24, pitch_mm=0.03)
    board = Target(Checkerboard(columns=4, rows=3, square_mm=0.8))
    scene = TargetLight([(board, rigs.facing(434.0))], 0.5)
    images = []
    for seed in range(12):
        rig = diffracting(camera, seed)
        images.append(irradiance(rig, 64, scene.radiance))
    rig = diffracting(camera, 99)
    white = np.stack([irradiance(rig, 1024, None), np.zeros((24, 30))])
    found = pictures(rig, 1024, [scene], white)[0]
    error = np.std(images, axis=0, ddof=1) / np.sqrt(len(images))
    assert 0.05 < (np.abs(found / white[0] - np.round(2 * found / white[0]) / 2) < 1e-12).mean() < 0.9
    assert np.abs((np.mean(images, axis=0) - found) / (error + 2e-3)).max() < SIGMAS


FOCAL_MM, STOP_MM, ARRAY_MM, BEHIND_MM, AWAY_MM, CELL_MM, DISC_MM = 50.0, 4.0, 80.0, 3.0, 12.0, 0.15, 0.12
"""Main lens, semi-diameter of its stop, distances of the array, of the sensor behind it, and of the intermediate image
from the array; edge of a cell, diameter of a disc."""
OFF_MM, DOT_MM, PITCH_MM, PX, FINE = 0.2, 0.004, 0.004, 33, 16
"""Where the microlens stands off the axis, radius of the image of a round thing, pixels, their number, and
the parts of each in which the judge looks at the light."""
LIGHT, CONTRAST = 0.025, 0.02
"""Largest error of a pixel of 4,096 rays, over the brightest, and of the contrast [1]."""


def rig(aperture: str, sign: float) -> Rig:
    disc = {"aperture": "disc", "disc_diameter_mm": DISC_MM} if aperture == "disc" else {}
    moved_mm, power = sign * OFF_MM * BEHIND_MM / AWAY_MM, 1 / BEHIND_MM - sign / AWAY_MM
    array = MicrolensArray(
        layout="square",
        pitch_mm=CELL_MM,
        columns=1,
        rows=1,
        focal_lengths_mm=(1 / power,),
        distance_mm=BEHIND_MM,
        offset_x_mm=-moved_mm,
        **disc,
    )
    sensor = Sensor(width_px=PX, height_px=PX, pitch_mm=PITCH_MM, offset_x_mm=OFF_MM - moved_mm)
    lens, away = thin(FOCAL_MM, STOP_MM), {"near_mm": 60.0, "far_mm": 500.0}
    camera = Camera(
        prescription=lens, sensor=sensor, sensor_distance_mm=ARRAY_MM + BEHIND_MM, microlenses=array, **away
    )
    return Rig.of(Tracer(camera))


def waves(aperture: str, sign: float) -> np.ndarray:
    """Light of a point on the axis in all parts of pixels, of all that passes the microlens."""
    k, count = 2 * np.pi / GREEN_MM, 192
    u = ((np.arange(count) + 0.5) / count - 0.5) * CELL_MM
    x = ((np.arange(PX * FINE) + 0.5) / FINE - PX / 2) * PITCH_MM
    away, squared = np.hypot(OFF_MM + u[:, None], u), u[:, None] ** 2 + u**2
    # Light falls round about the axis: an integral over radii, of Bessel's function, itself one over angles.
    rho, cosine = (np.arange(800) + 0.5) / 800 * STOP_MM, np.cos((np.arange(300) + 0.5) / 300 * np.pi)
    radii = np.linspace(away.min(), away.max(), 80)
    bessel = np.stack([np.cos(k * r / ARRAY_MM * np.outer(rho, cosine)).mean(axis=1) for r in radii])
    curved = 1 / ARRAY_MM - 1 / (ARRAY_MM + sign * AWAY_MM)
    field = bessel @ (rho * np.exp(0.5j * k * curved * rho**2)) * np.exp(0.5j * k * radii**2 / ARRAY_MM)
    field = np.interp(away, radii, field.real) + 1j * np.interp(away, radii, field.imag)
    field *= np.exp(-0.5j * k * squared * (1 / BEHIND_MM - sign / AWAY_MM))
    field *= squared <= (DISC_MM / 2 if aperture == "disc" else CELL_MM) ** 2
    along = np.exp(0.5j * k * (x[:, None] - u - sign * OFF_MM * BEHIND_MM / AWAY_MM) ** 2 / BEHIND_MM)
    across = np.exp(0.5j * k * (x[:, None] - u) ** 2 / BEHIND_MM)
    part = CELL_MM / count * PITCH_MM / FINE / GREEN_MM / BEHIND_MM
    return part**2 * np.abs(along @ field @ across.T) ** 2 / np.sum(np.abs(field) ** 2)


def of_round_thing(light: np.ndarray) -> np.ndarray:
    """Pixels where a round thing shines instead of a point; rows along y, and the image turned round."""
    x = (np.arange(len(light)) - len(light) // 2) * PITCH_MM / FINE
    dot = (x[:, None] ** 2 + x**2 <= DOT_MM**2).astype(float)
    wide = np.fft.irfft2(np.fft.rfft2(light) * np.fft.rfft2(np.fft.ifftshift(dot / dot.sum())), light.shape)
    return wide.reshape(PX, FINE, PX, FINE).sum(axis=(1, 3)).T[:, ::-1]


@pytest.mark.parametrize(
    ("aperture", "sign"), few_cases([("cell", 1.0), ("disc", -1.0)], ("cell", -1.0), ("disc", 1.0))
)
def test_a_round_thing_behind_a_microlens_is_that_of_waves(aperture: str, sign: float) -> None:
    geometric, image_mm = rig(aperture, sign), ARRAY_MM + sign * AWAY_MM
    diffracting = dataclasses.replace(geometric, diffraction_nm=GREEN_MM * 1e6)
    object_mm = 1 / (1 / FOCAL_MM - 1 / image_mm)

    def shines(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        hit = origin + ((object_mm - origin[:, 2]) / direction[:, 2])[:, None] * direction
        return (np.hypot(hit[:, 0], hit[:, 1]) <= DOT_MM * AWAY_MM / BEHIND_MM * object_mm / image_mm).astype(float)

    image, rays = (irradiance(one, 4096, shines) for one in (diffracting, geometric))
    expected = of_round_thing(waves(aperture, sign))
    assert np.abs(image / rays.sum() - expected).max() < LIGHT * expected.max()
    for axis in (0, 1):
        contrast = [np.abs(np.fft.rfft(one.sum(axis=axis))) / one.sum() for one in (image, expected, rays)]
        assert np.abs(contrast[0] - contrast[1]).max() < CONTRAST
        assert np.abs(contrast[2] - contrast[1]).max() > 10 * CONTRAST, "the main lens alone leaves it sharp"
