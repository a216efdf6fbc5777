"""Rays by patches are those of the tracer, also where the lens begins to vignette and where no light leaves."""

import numpy as np
import pytest
from exports.maps import lit_rays

import pipeline
from pipeline.exports.ray_patches import rows_of_rays

PLANES_MM = (400.0, 500.0)


class Counting:
    """A sight that counts its rays."""

    def __init__(self, rays):
        self.traced, self._rays = 0, rays

    def rays(self, x_px, y_px):
        self.traced += len(x_px)
        return self._rays(np.asarray(x_px, float), np.asarray(y_px, float))


def made_up(bend):
    """Rays through the centre of the stop whose slopes are those of a pinhole of 200 px, and a bend (n, 2)."""

    def rays(x, y):
        slope = np.stack([x - 60, y - 50], axis=1) / 200 + bend(x, y)
        ahead = np.column_stack([slope, np.ones(len(x))])
        return lit_rays(x, y, np.where(np.isnan(ahead[:, :1]), np.nan, np.zeros((len(x), 3))), ahead)

    return rays


def crossings(origin, direction, z_mm):
    return origin + (z_mm - origin[..., 2:]) / direction[..., 2:] * direction


def largest_px(rays, size, traced):
    """Largest difference of all pixels on both planes, in pixels of the pinhole of 200 px; NaN must be where NaN is."""
    width, height = size
    origin, direction = rows_of_rays(traced, width, (0, height), PLANES_MM)
    y, x = np.mgrid[0:height, 0:width].reshape(2, -1)
    exact, worst = rays(x.astype(float), y.astype(float)), 0.0
    for z_mm in PLANES_MM:
        off = crossings(origin, direction, z_mm).reshape(-1, 3) - exact.at_distance(z_mm)
        assert (np.isnan(off[:, 0]) == np.isnan(exact.direction[:, 0])).all()
        worst = max(worst, float(np.nanmax(np.linalg.norm(off, axis=1))) * 200 / z_mm)
    return worst


BENDS = {
    "smooth": lambda x, y: 0.02 * np.stack([np.sin(x / 80) * np.cos(y / 90), np.exp(-(x + y) / 300)], axis=1),
    # The mean ray has a kink where an edge begins to vignette: here the circle of radius 55 px about (60, 50).
    "kink": lambda x, y: 1e-5 * np.maximum(np.hypot(x - 60, y - 50) - 55, 0)[:, None] * np.ones(2),
    "dark": lambda x, y: np.where(np.hypot(x - 60, y - 50) < 70, 0.0, np.nan)[:, None] * np.ones(2),
}


@pytest.mark.parametrize(("bend", "most_traced"), [("smooth", 0.07), ("kink", 1.0), ("dark", 1.0)])
def test_patches_agree_with_rays_traced_one_by_one(bend, most_traced):
    """Smooth rays by one traced in fourteen at most; a kink and an end of the light by as many as it takes."""
    rays, size = made_up(BENDS[bend]), (131, 100)
    traced = Counting(rays)
    assert largest_px(rays, size, traced) < 2e-9
    assert traced.traced < most_traced * size[0] * size[1]


def test_a_real_lens_that_vignettes():
    """A singlet with a far stop: corners of its image lose light by the rim of the lens."""
    singlet = pipeline.Prescription(
        surfaces=(
            pipeline.Surface(radius_mm=50.0, thickness_mm=6.0, semi_diameter_mm=9.0, index=1.5168),
            pipeline.Surface(radius_mm=-50.0, thickness_mm=14.0, semi_diameter_mm=9.0),
            pipeline.Surface(semi_diameter_mm=4.0, is_stop=True),
        )
    )
    sensor = pipeline.Sensor(width_px=160, height_px=64, pitch_mm=0.1)
    camera = pipeline.ready(pipeline.Camera(prescription=singlet, sensor=sensor, sensor_distance_mm=38.0))
    light = camera.rays([80.0, 1.0], [32.0, 1.0]).hit_fraction
    assert light[1] < 0.95 * light[0]
    traced = Counting(camera.rays)
    origin, direction = rows_of_rays(traced, 160, (0, 64), camera.planes_mm)
    y, x = np.divmod(np.arange(0, 160 * 64, 11), 160)
    exact = camera.rays(x.astype(float), y.astype(float))
    ahead = camera.rays(x + 0.1, y.astype(float))
    for z_mm in camera.planes_mm:
        off = crossings(origin[y, x], direction[y, x], z_mm) - exact.at_distance(z_mm)
        px_per_mm = 0.1 / np.linalg.norm(ahead.at_distance(z_mm) - exact.at_distance(z_mm), axis=1)
        allowed_px = 1e-8 + 2 * np.hypot(*exact.error_px.T).max()
        assert (np.linalg.norm(off, axis=1) * px_per_mm).max() < allowed_px
    assert traced.traced < 160 * 64
