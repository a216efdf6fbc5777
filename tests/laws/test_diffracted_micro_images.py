"""Claim: behind a main lens, images with diffraction are those of scalar waves that pass stop and microlens.

The judge knows the prescription alone: Fresnel's integral from the stop of an ideal lens to a microlens, times its
aperture and phase, and another one to the sensor. Rigs are in focus, with the intermediate image behind the microlens
(1) or before it (-1).
"""

import dataclasses

import numpy as np
import pytest
from laws.ideal_lens import thin

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.render.imaging import irradiance

FOCAL_MM, STOP_MM, ARRAY_MM, BEHIND_MM, AWAY_MM, CELL_MM, DISC_MM = 50.0, 4.0, 80.0, 3.0, 12.0, 0.15, 0.12
"""Main lens, semi-diameter of its stop, distances of the array, of the sensor behind it, and of the intermediate image
from the array; edge of a cell, diameter of a disc."""
GREEN_MM, OFF_MM, DOT_MM, PITCH_MM, PX, FINE = 550e-6, 0.2, 0.004, 0.004, 33, 16
"""Wavelength, where the microlens stands off the axis, radius of the image of a round thing, pixels, their number, and
the parts of each in which the judge looks at the light."""
LIGHT, CONTRAST = 0.025, 0.02
"""Largest error of a pixel of 4,096 rays, over the brightest, and of the contrast [1]."""


def rig(aperture: str, sign: float) -> Rig:
    """One microlens, its micro-image in the middle of the sensor."""
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


@pytest.mark.parametrize(("aperture", "sign"), [("cell", 1.0), ("cell", -1.0), ("disc", 1.0), ("disc", -1.0)])
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
