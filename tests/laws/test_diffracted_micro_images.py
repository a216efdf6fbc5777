"""Claim: behind a main lens, images with diffraction are those of scalar waves that pass stop and microlens.

The judge knows the prescription alone: Fresnel's integral from the stop of an ideal lens to a microlens, times its
aperture and phase, and another one to the sensor. Both rigs are in focus, one with its intermediate image behind the
microlenses (Galilei), one before them (Kepler).
"""

import numpy as np
import pytest
from laws.ideal_lens import thin
from laws.test_diffracted_images import GREEN_MM, diffracting

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.rig import Rig
from pipeline.render.imaging import irradiance

FOCAL_MM, STOP_MM, ARRAY_MM, BEHIND_MM, AWAY_MM, CELL_MM, DISC_MM = 50.0, 4.0, 80.0, 3.0, 12.0, 0.15, 0.12
"""Main lens, semi-diameter of its stop, distances of the array, of the sensor behind it, and of the intermediate image
from the array; edge of a cell, diameter of a disc."""
OFF_MM, DOT_MM, PITCH_MM, PX = 0.2, 0.004, 0.004, 33
"""Where the microlens stands off the axis, radius of the image of a round thing, pixels, and their number."""
SAMPLES, FINE = 4096, 16
"""Rays of a pixel; places of the judge in a pixel, along each axis."""
LIGHT, CONTRAST = 0.025, 0.02
"""Largest error of a pixel, over the brightest, and of the contrast [1]."""


def rig(aperture: str, sign: float) -> tuple[Rig, float]:
    """One microlens, and the distance of the object that it shows sharply."""
    disc = {"aperture": "disc", "disc_diameter_mm": DISC_MM} if aperture == "disc" else {}
    array = MicrolensArray(
        layout="square",
        pitch_mm=CELL_MM,
        columns=1,
        rows=1,
        focal_lengths_mm=(1 / (1 / BEHIND_MM - sign / AWAY_MM),),
        distance_mm=BEHIND_MM,
        offset_x_mm=-sign * OFF_MM * BEHIND_MM / AWAY_MM,
        **disc,
    )
    image_mm = ARRAY_MM + sign * AWAY_MM
    camera = Camera(
        prescription=thin(FOCAL_MM, STOP_MM),
        sensor=Sensor(
            width_px=PX, height_px=PX, pitch_mm=PITCH_MM, offset_x_mm=OFF_MM * (1 - sign * BEHIND_MM / AWAY_MM)
        ),
        sensor_distance_mm=ARRAY_MM + BEHIND_MM,
        microlenses=array,
        near_mm=60.0,
        far_mm=500.0,
    )
    return diffracting(camera), 1 / (1 / FOCAL_MM - 1 / image_mm)


def waves(aperture: str, sign: float) -> np.ndarray:
    """Light of a point in FINE x FINE parts of each pixel, of all that passes the microlens, by scalar waves."""
    k, image_mm, count = 2 * np.pi / GREEN_MM, ARRAY_MM + sign * AWAY_MM, 192
    u = ((np.arange(count) + 0.5) / count - 0.5) * CELL_MM
    at = OFF_MM + u
    away = np.hypot(at[:, None], u)
    # From the stop to the microlens: a radial integral of Bessel's function, itself an integral over the angle.
    rho = (np.arange(800) + 0.5) / 800 * STOP_MM
    radii = np.linspace(away.min(), away.max(), 80)
    angle = (np.arange(300) + 0.5) / 300 * np.pi
    bessel = np.stack([np.cos(k * r / ARRAY_MM * np.outer(rho, np.cos(angle))).mean(axis=1) for r in radii])
    field = bessel @ (rho * np.exp(0.5j * k * rho**2 * (1 / ARRAY_MM - 1 / image_mm)))
    field *= np.exp(0.5j * k * radii**2 / ARRAY_MM)
    before = np.interp(away, radii, field.real) + 1j * np.interp(away, radii, field.imag)
    squared = u[:, None] ** 2 + u**2
    open_ = squared <= DISC_MM**2 / 4 if aperture == "disc" else np.ones_like(squared)
    behind = before * open_ * np.exp(-0.5j * k * squared * (1 / BEHIND_MM - sign / AWAY_MM))
    x = (np.arange(PX * FINE) - (PX * FINE - 1) / 2) * PITCH_MM / FINE
    middle = OFF_MM * (1 - sign * BEHIND_MM / AWAY_MM)
    along = np.exp(0.5j * k * (middle + x[:, None] - at) ** 2 / BEHIND_MM)
    across = np.exp(0.5j * k * (x[:, None] - u) ** 2 / BEHIND_MM)
    parts = (CELL_MM / count * PITCH_MM / FINE / GREEN_MM / BEHIND_MM) ** 2
    return parts * np.abs(along @ behind @ across.T) ** 2 / np.sum(np.abs(behind) ** 2)


def spread_over(light: np.ndarray) -> np.ndarray:
    """Pixels where a round thing shines instead of a point; rows along y, and the image upside down."""
    x = (np.arange(light.shape[0]) - light.shape[0] // 2) * PITCH_MM / FINE
    dot = (x[:, None] ** 2 + x**2 <= DOT_MM**2).astype(float)
    wide = np.fft.irfft2(np.fft.rfft2(light) * np.fft.rfft2(np.fft.ifftshift(dot / dot.sum())), light.shape)
    return wide.reshape(PX, FINE, PX, FINE).sum(axis=(1, 3)).T[:, ::-1]


@pytest.mark.parametrize(
    ("aperture", "sign"),
    [
        ("cell", 1.0),
        ("disc", -1.0),
        *(pytest.param(*rest, marks=pytest.mark.heavy) for rest in (("cell", -1.0), ("disc", 1.0))),
    ],
)
def test_a_round_thing_behind_a_microlens_is_that_of_waves(aperture: str, sign: float) -> None:
    camera, object_mm = rig(aperture, sign)
    enlarged = BEHIND_MM / AWAY_MM * (ARRAY_MM + sign * AWAY_MM) / object_mm

    def shines(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        hit = origin + ((object_mm - origin[:, 2]) / direction[:, 2])[:, None] * direction
        return (np.hypot(hit[:, 0], hit[:, 1]) <= DOT_MM / enlarged).astype(float)

    image, sharp = (irradiance(one, SAMPLES, shines) for one in (camera, Rig.of(camera.tracer)))
    found, expected, rays = image / sharp.sum(), spread_over(waves(aperture, sign)), sharp / sharp.sum()
    assert np.abs(found - expected).max() < LIGHT * expected.max()
    for axis in (0, 1):
        of_rays, of_images, of_waves = (
            np.abs(np.fft.rfft(one.sum(axis=axis))) / one.sum() for one in (rays, found, expected)
        )
        assert np.abs(of_images - of_waves).max() < CONTRAST
        assert np.abs(of_rays - of_waves).max() > 10 * CONTRAST, "the stop of the main lens alone leaves it sharp"
