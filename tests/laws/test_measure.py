"""Claim: images, J and hit fractions weigh rays alike, by irradiance or by area, and who mixes both weights is caught.

At f/2, 45 degrees and 20 mm out of focus the weights are 1.16 px of 5 micrometres apart, as polar grids of textbook
rays say alone.
"""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from laws.rigs import PIXEL_MM, POINT_MM, acceptance_of, fast
from laws.solving import STEPS, by_quadrature, judged_rows, rig_of, solved
from naive import polar
from shorter import one_in
from tolerances import CLOSED_FORM, DIRECT_PX, NOISY_PX, ORDER

from pipeline.camera.parts.camera import WEIGHTS, Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.parts.polygon import regular
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.acceptance import region_weight
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT
from pipeline.render.imaging import irradiance
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.judging import certify
from pipeline.truth.planes import tangent_planes

ODD = {"irradiance": "area", "area": "irradiance"}


def weighed(camera: Camera, weight: str) -> Camera:
    return dataclasses.replace(camera, weight=weight)


def test_a_hole_weighs_its_area() -> None:
    """On the axis: weight pi R^2 and <r^2> = R^2 / 2, whatever the distance; and so from everywhere."""
    for semi, h in ((1.0, 50.0), (10.0, 20.0)):
        camera = rigs.bare(rigs.hole(semi), Sensor(width_px=9, height_px=9, pitch_mm=0.01), h, (10.0, 20.0))
        starts = np.array([[0.0, 0.0], [3.0, -2.0]])
        rows = by_quadrature(weighed(camera, "area"), starts, parallel_planes(1e-9, h), (12, 64))
        assert rows[:, WEIGHT] == pytest.approx(math.pi * semi**2, rel=CLOSED_FORM)
        assert rows[:, COVARIANCE] + rows[:, COVARIANCE + 4] == pytest.approx(semi**2 / 2, rel=CLOSED_FORM)


def test_a_hole_without_a_lens_lights_all_pixels_alike() -> None:
    """By area there is no cos^4 law: at 40 degrees, where irradiance falls to a third, a pixel is as bright as any.

    The edge of the hole cuts n^(1/2) of n strata, each off by a part of itself.
    """
    sensor, rays = Sensor(width_px=5, height_px=5, pitch_mm=2.4), 16_384
    camera = rigs.bare(rigs.hole(0.5), sensor, 8.0, (100.0, 200.0))
    dark, flat = (irradiance(Rig.of(Tracer(weighed(camera, weight))), rays, None) for weight in WEIGHTS)
    assert dark[0, 0] < 0.5
    np.testing.assert_allclose(flat, 1.0, rtol=0, atol=4 * rays**-0.75)


@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 2.0, 3.0, 17.0])
def test_a_cosine_acceptance_has_closed_forms(power: float, weight: str) -> None:
    """2 pi (1 - cos^a) / a over a cone, a = n + 2, Lambert's law; by area times h^2, and a = n - 2: polygons of ever
    more sides converge to it by the fourth."""
    exponent, scale = (power - 2, 16) if weight == "area" else (power + 2, 1)
    expected = 2 * math.pi * scale * (-math.log(0.8) if exponent == 0 else (1 - 0.8**exponent) / exponent)
    accepted = acceptance_of(power, weight=weight)
    errors = [region_weight(regular(n, 3.0, 5.0), n, 0.0, 0.0, 4.0, accepted) - expected for n in (16, 32, 64)]
    assert np.all(np.abs(np.log2(np.array(errors[:-1]) / errors[1:])[1:] - 2) < ORDER)


@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("aside", [0.0, 0.3, 1.4])
def test_a_cone_takes_what_lies_in_it(aside: float, weight: str) -> None:
    """A wide region loses all beyond the cone: pi sin^2, by area pi h^2 tan^2, and with a roll-off the integral of
    their changes over its angles."""
    wide, cone, area = 40.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]), 20.0, weight == "area"
    hard = region_weight(wide, 4, aside, -aside, 2.0, acceptance_of(0.0, cone, 0.0, weight))
    angle = math.radians(cone)
    assert hard == pytest.approx(math.pi * (4 * math.tan(angle) ** 2 if area else math.sin(angle) ** 2), rel=1e-13)
    soft = region_weight(wide, 4, aside, -aside, 2.0, acceptance_of(0.0, cone, 10.0, weight))
    node, share = np.polynomial.legendre.leggauss(40)
    theta = np.radians(25 + 5 * node)
    change = 8 * np.tan(theta) / np.cos(theta) ** 2 if area else np.sin(2 * theta)
    beyond = math.radians(5) * share @ ((np.radians(30) - theta) / math.radians(10) * change * math.pi)
    assert soft == pytest.approx(hard + beyond, rel=1e-12)


@pytest.fixture(scope="module")
def tilted() -> tuple[Checkerboard, np.ndarray]:
    """A point 20 mm out of focus on a board at 45 degrees, seen at about (7, 4) mm of the sensor."""
    return Checkerboard(columns=2, rows=1, square_mm=1.0), rigs.facing(454.36, 45.0, -21.0, -12.0)


def test_at_f2_the_weights_are_most_of_a_pixel_apart(tilted: tuple[Checkerboard, np.ndarray]) -> None:
    """J of both by quadrature is that of polar grids of textbook rays, which are 1.16 px apart."""
    pose, means = tilted[1], {}
    for weight in WEIGHTS:
        camera = weighed(fast(17.1), weight)
        hits = by_quadrature(camera, STEPS + POINT_MM, np.stack([target_plane(pose)] * 2), (8, 32))
        px_per_mm = np.linalg.inv(np.stack([hits[1] - hits[2], hits[3] - hits[4]], axis=1)[:2] / 0.1) / PIXEL_MM
        means[weight], total = polar.mean_hit(camera, POINT_MM, pose, directions=1024)
        assert np.linalg.norm(px_per_mm @ (hits[0, :2] - means[weight])) < DIRECT_PX
        assert hits[0, WEIGHT] == pytest.approx(total, rel=1e-5)
    apart = np.linalg.norm(px_per_mm @ (means["area"] - means["irradiance"]))
    assert apart == pytest.approx(1.16, rel=0, abs=0.5001e-2)


def pixel_at(camera: Camera, x_px: np.ndarray) -> Camera:
    x, y = Tracer(camera).positions_mm(*x_px)
    return dataclasses.replace(
        camera, sensor=Sensor(width_px=1, height_px=1, pitch_mm=PIXEL_MM, offset_x_mm=float(x), offset_y_mm=float(y))
    )


def seen_mm(camera: Camera, plane: np.ndarray) -> np.ndarray:
    """Mean place that a pixel's light comes from, by rendering: ramps of light on the target over a white scene."""

    def ramp(axis: int):
        def radiance(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
            along = ((plane[0] - origin) @ plane[3]) / (direction @ plane[3])
            return (origin + along[:, None] * direction - plane[0]) @ plane[1 + axis]

        return radiance

    tracer = Tracer(camera)
    x, y, white = (irradiance(Rig.of(tracer), 1 << 17, light)[0, 0] for light in (ramp(0), ramp(1), None))
    return np.array([x, y]) / white


@pytest.mark.parametrize("weight", one_in(len(WEIGHTS), WEIGHTS))
def test_an_image_and_a_truth_of_different_weights_are_caught(weight: str, tilted) -> None:
    """Rendered light of a pixel at a row's position comes from the row's point on average, if both weigh alike.

    An image is linear in the light of the scene: ramps of light tell the mean place that a pixel sees.
    """
    board, pose = tilted
    rig = rig_of(weighed(fast(17.1), weight))
    rows, planes = solved(rig, board, pose).solutions, tangent_planes(pose, board.points_mm())
    assert len(rows.point) == 2
    x = rows.xy_px[0]
    off = {
        other: np.linalg.norm(
            np.linalg.inv(rows.jacobian[0]) @ seen_mm(pixel_at(weighed(fast(17.1), other), x), planes[0])
        )
        for other in WEIGHTS
    }
    assert off[weight] < NOISY_PX
    assert off[ODD[weight]] > 10 * NOISY_PX


@pytest.mark.parametrize("weight", WEIGHTS)
def test_a_certificate_judges_by_the_weight_of_the_camera(weight: str, tilted) -> None:
    """Both rules of integration agree for either weight; a judge who weighs otherwise objects."""
    board, pose = tilted
    camera, planes = weighed(fast(17.1), weight), tangent_planes(pose, board.points_mm())
    rows = solved(rig_of(camera), board, pose).solutions
    judged = judged_rows(rows, planes, False)
    own, other = (certify(rig_of(weighed(camera, by)), judged, 2, 1e-3) for by in (weight, ODD[weight]))
    assert own["passed"] is True
    assert other["passed"] is False and other["max_px"] > 0.8
    small = weighed(rigs.plenoptic(1.0, 48, 40), weight)
    rig, pose = rig_of(small, 3), rigs.facing(420.0, 20.0)
    rows, planes = solved(rig, board, pose).solutions, tangent_planes(pose, board.points_mm())
    verdict = certify(rig, judged_rows(rows, planes, True), len(rows.point), 1e-3)
    assert len(rows.point) > 3 and verdict["passed"] is True


def test_an_unknown_weight_is_refused() -> None:
    with pytest.raises(CameraError, match='no weight "lambert"'):
        weighed(rigs.conventional(), "lambert")
