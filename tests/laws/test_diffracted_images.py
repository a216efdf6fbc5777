"""Claim: images with diffraction show edges as the aperture spreads them, and depend on seeds as others do."""

import dataclasses

import numpy as np
import pytest
from laws import rigs
from laws.ideal_lens import F_MM, thin
from tolerances import DIFFRACTED_EDGE, SIGMAS

from pipeline.camera.parts.camera import Camera, Sensor
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
