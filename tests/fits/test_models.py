"""Projection models say what the programs say that they are named after."""

import cv2
import numpy as np
import pytest

from pipeline.fits.fitting import CENTRE, MODELS

RANDOM = np.random.default_rng(11)
POINTS = np.column_stack([RANDOM.uniform(-200, 200, (60, 2)), RANDOM.uniform(380, 500, 60)])
CENTRE_MM = np.array([0.3, -0.2, -6.0])
MATRIX = np.array([[900.0, 0, 321.5], [0, 905.0, 239.25], [0, 0, 1]])
COEFFICIENTS = np.array([-0.2, 0.1, 1e-3, -2e-3, 0.02, 0.05, -0.03, 0.01, 2e-3, -1e-3, 3e-3, 5e-4, 0.04, -0.03])
OPENCV = {"pinhole": 0, "brown": 5, "rational": 8, "thin-prism": 12, "tilted": 14}


def own(count: int) -> np.ndarray:
    return np.array([900.0, 905.0, 321.5, 239.25, *COEFFICIENTS[:count]])


@pytest.mark.parametrize(("name", "count"), OPENCV.items())
def test_they_are_opencvs(name, count):
    found = MODELS[name].positions(np.concatenate([CENTRE_MM, own(count)]), POINTS)
    none = np.zeros(3)
    expected = cv2.projectPoints(POINTS - CENTRE_MM, none, none, MATRIX, COEFFICIENTS[:count] if count else None)[0]
    np.testing.assert_allclose(found, expected[:, 0], rtol=0, atol=1e-9)


def test_the_fisheye_is_opencvs():
    wide = POINTS * [4.0, 4.0, 1.0]
    found = MODELS["fisheye"].positions(np.concatenate([CENTRE_MM, own(0), COEFFICIENTS[:4]]), wide)
    none = np.zeros(3)
    expected = cv2.fisheye.projectPoints((wide - CENTRE_MM)[:, None], none, none, MATRIX, COEFFICIENTS[:4])[0]
    np.testing.assert_allclose(found, expected[:, 0], rtol=0, atol=1e-9)


def test_the_angle_of_ftheta_is_the_stated_polynomial():
    """Of angles up to 80 degrees, by NumPy's own polynomials."""
    angle = np.deg2rad(np.linspace(0, 80, 9))
    points = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    b = [2.2e-3, -1e-7, 2e-10, -1e-13]
    found = MODELS["ftheta"].project(np.array([320.0, 240.0, *b]), points)
    np.testing.assert_allclose(np.polynomial.Polynomial([0, *b])(found[:, 0] - 320), angle, rtol=0, atol=1e-12)


@np.errstate(invalid="ignore")
def unprojected(name: str, p: np.ndarray, x_px: np.ndarray) -> np.ndarray:
    """Directions of image positions, (n, 3), in the closed form of the papers and of Basalt; NaN: none."""
    m = (x_px - p[2:4]) / p[:2]
    r2 = np.sum(m**2, axis=1)
    if name == "eucm":
        alpha, beta = p[4:]
        z = (1 - alpha**2 * beta * r2) / (alpha * np.sqrt(1 - (2 * alpha - 1) * beta * r2) + 1 - alpha)
        return np.column_stack([m, z])
    xi, alpha = p[4:]
    z = (1 - alpha**2 * r2) / (alpha * np.sqrt(1 - (2 * alpha - 1) * r2) + 1 - alpha)
    stretch = (z * xi + np.sqrt(z**2 + (1 - xi**2) * r2)) / (z**2 + r2)
    return stretch[:, None] * np.column_stack([m, z]) - [0.0, 0.0, xi]


SPHERES = {
    # Calibrations of a fisheye of TUM VI and of one of 200 degrees, from the tests of the headers of Basalt
    "eucm": np.array([191.14799816648748, 191.13150946585135, 254.95857715, 256.88154662, 0.62910608, 1.04180674]),
    "double-sphere": np.array([402.5, 400.0, 505.0, 509.0, -0.075347, 0.743925]),
}


@pytest.mark.parametrize("name", SPHERES)
def test_models_of_spheres_invert_the_published_unprojection_also_behind_90_degrees(name):
    p = SPHERES[name]
    alpha, beta = (p[4], p[5]) if name == "eucm" else (p[5], 1.0)
    edge = 1 / np.sqrt((2 * alpha - 1) * beta)  # where the image of either ends
    radius, azimuth = np.linspace(0.0, 0.99 * edge, 33) * p[0], 2.4 * np.arange(33)
    x_px = p[2:4] + radius[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    ways = unprojected(name, p, x_px)
    assert (ways[:, 2] < 0).any()
    np.testing.assert_allclose(MODELS[name].project(p, 70.0 * ways), x_px, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", MODELS)
def test_they_are_analytic(name):
    """A complex step gives the derivative that differences give, also of a point on the axis."""
    model = MODELS[name]
    p = np.array([{"fx": 900.0, "fy": 905.0, "k0": 900.0}.get(n, 0.013) for n in model.parameters])
    if name == "ftheta":
        p[len(CENTRE) + 2 :] = 1e-3, 1e-8, 1e-11, 1e-14
    points = np.vstack([POINTS[:8], p[:3] + np.array([0, 0, 400.0])])
    for number in range(len(p)):
        step = 1e-4 * abs(p[number]) * np.eye(len(p))[number]
        difference = (model.positions(p + step, points) - model.positions(p - step, points)) / (2 * step[number])
        exact = model.positions(p + 1e-30j * np.eye(len(p))[number], points).imag / 1e-30
        np.testing.assert_allclose(exact, difference, rtol=1e-4, atol=1e-4 * np.abs(difference).max())


def test_models_of_wide_fields_go_on_behind_90_degrees():
    """Kannala and Brandt, equation 6, with the angle as it was chosen; a pinhole does not."""
    theta, azimuth = np.radians([5.0, 60.0, 89.0, 90.0, 91.0, 110.0, 150.0]), np.arange(7.0)
    way = np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], axis=1)
    k = (120.0, -3.0, 1.5, -0.2)
    seen = MODELS["kannala-brandt"].positions(np.array([1.0, 2.0, 3.0, 10.0, 20.0, *k]), 70.0 * way + [1.0, 2.0, 3.0])
    radius = sum(value * theta ** (2 * i + 1) for i, value in enumerate(k))
    expected = np.stack([10 + radius * np.cos(azimuth), 20 + radius * np.sin(azimuth)], axis=1)
    np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-10)
