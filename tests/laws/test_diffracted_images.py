"""Claim: images with diffraction show edges as the aperture spreads them, and depend on seeds as others do."""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.rigs import F_MM, thin
from shorter import few_cases
from tolerances import DIFFRACTED_EDGE, SIGMAS

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import irradiance, pictures
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

GREEN_NM, GREEN_MM = 550.0, 550e-6


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
