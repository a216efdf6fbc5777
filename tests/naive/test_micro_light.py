"""Claim: centroids and outlines of micro-images are those of rays traced one by one, and of closed forms."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from laws import rigs
from naive import slow_microlens, textbook
from naive.kinds import KINDS, camera_with, vertex_of
from shorter import few_cases
from tolerances import MICRO_IMAGE_PX, SIGMAS

from pipeline.camera.micro_images.centres import micro_images
from pipeline.camera.micro_images.light import OUTLINE_DEG, MicroLight, micro_light
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.tracer import Tracer
from pipeline.optics.prescription import Prescription, Surface

FOCAL_MM = 1.9


def along() -> np.ndarray:
    """Directions of outlines in the vision frame: the image is turned by 180 degrees."""
    angle = np.deg2rad(OUTLINE_DEG)
    return -np.stack([np.cos(angle), np.sin(angle)], axis=1)


def lit_alone(camera: Camera, x_mm: float, y_mm: float) -> tuple[Tracer, MicroLight, np.ndarray]:
    """The camera with one microlens at (x, y) of the sensor frame, before a sensor that holds all of its light."""
    array = dataclasses.replace(camera.microlenses, offset_x_mm=x_mm, offset_y_mm=y_mm, width_mm=0.01, height_mm=0.01)
    sensor = dataclasses.replace(camera.sensor, width_px=4000, height_px=4000)
    tracer = Tracer(dataclasses.replace(camera, microlenses=array, sensor=sensor))
    assert len(tracer.vertices_mm) == 1
    return tracer, micro_light(tracer, micro_images(tracer)), tracer.vertices_mm[0]


def wide_open() -> Camera:
    return dataclasses.replace(rigs.plenoptic(), prescription=rigs.tronnier(17.1))


CASES = {
    "vignetted": (wide_open(), 8.0, -5.0),
    "displaced": (rigs.displaced(rigs.plenoptic()), -6.0, 7.0),
    "as printed": (rigs.plenoptic(), 3.0, 9.0),
}


def corners(camera: Camera) -> np.ndarray:
    """Of a cell whose edges face +x and every 60 degrees, the first one twice, (7, 2)."""
    angle = np.deg2rad(30 + 60 * np.arange(7))
    return camera.microlenses.pitch_mm / math.sqrt(3) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def passes(camera: Camera, start: np.ndarray, through: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """Whether rays from sensor positions through points of a thin microlens' plane leave the lens, (n,)."""
    through = np.broadcast_to(through, start.shape)
    return textbook.sent(camera, start, through, (through - vertex) / FOCAL_MM)[2]


def pinholes(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Points of the cell and their weights: six triangles, Strang and Fix's rule of the fourth degree on each."""
    points, weights = [], []
    for a, b in itertools.pairwise(corners(camera)):
        for side, weight in ((0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322)):
            for u, v in ((side, side), (side, 1 - 2 * side), (1 - 2 * side, side)):
                points.append(u * a + v * b)
                weights.append(weight / 6)
    return np.array(points), np.array(weights)


@pytest.mark.parametrize(("name", "directions"), few_cases([("vignetted", 240)], ("displaced", 48), ("as printed", 48)))
def test_the_centroid_is_that_of_many_pinholes(name: str, directions: int) -> None:
    """36 points of the cell instead of 7, many directions without regard to corners, the textbook's trace."""
    camera, x, y = CASES[name]
    _, found, vertex = lit_alone(camera, x, y)
    gap, turn = camera.microlenses.distance_mm, 2 * np.pi * np.arange(directions) / directions
    direction = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    node, share = np.polynomial.legendre.leggauss(6)
    total, moment = 0.0, np.zeros(2)
    for point, weight in zip(*pinholes(camera), strict=True):
        # The centroid, moved with the pinhole: an inner point of the image that the pinhole projects.
        base = found.centroid_mm[0] + 0.2 * point
        low, high = np.zeros(directions), np.full(directions, 1.0)
        for _ in range(20):
            middle = (low + high) / 2
            ok = passes(camera, base + middle[:, None] * direction, vertex + point, vertex)
            low, high = np.where(ok, middle, low), np.where(ok, high, middle)
        r = low[:, None] * (node + 1) / 2
        start = base + r[..., None] * direction[:, None]
        light = weight * r * low[:, None] * share / (gap**2 + ((vertex + point - start) ** 2).sum(axis=-1)) ** 2
        total += light.sum()
        moment += (light[..., None] * (start - found.centroid_mm[0])).sum(axis=(0, 1))
    assert np.abs(moment / total).max() < MICRO_IMAGE_PX * camera.sensor.pitch_mm


@pytest.mark.parametrize("name", CASES)
def test_the_pupil_outline_is_where_rays_through_the_vertex_stop_passing(name: str) -> None:
    camera, x, y = CASES[name]
    _, found, vertex = lit_alone(camera, x, y)
    for off_px, expected in ((-MICRO_IMAGE_PX, True), (MICRO_IMAGE_PX, False)):
        radius = found.pupil_mm[0] + off_px * camera.sensor.pitch_mm
        ok = passes(camera, found.centroid_mm[0] + radius[:, None] * along(), vertex, vertex)
        assert np.all(ok == expected)


@pytest.mark.parametrize("name", CASES)
def test_no_light_lies_beyond_the_outline_and_some_right_inside(name: str) -> None:
    """Rays through 1,200 points of the rim, where the last light passes, along every direction."""
    camera, x, y = CASES[name]
    _, found, vertex = lit_alone(camera, x, y)
    share, corner = np.arange(200)[:, None] / 200, corners(camera)
    rim = np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(corner)]) * (1 - 1e-9)
    for off_px, expected in ((-MICRO_IMAGE_PX, True), (MICRO_IMAGE_PX, False)):
        radius = found.light_mm[0] + off_px * camera.sensor.pitch_mm
        start = np.repeat(found.centroid_mm[0] + radius[:, None] * along(), len(rim), axis=0)
        ok = passes(camera, start, vertex + np.tile(rim, (len(radius), 1)), vertex)
        assert np.all(ok.reshape(-1, len(rim)).any(axis=1) == expected)


@pytest.mark.parametrize("place", [(0.0, 0.0), (2.5, -4.0)])
@pytest.mark.parametrize("layout", ["hexagonal", "square"])
def test_behind_an_ideal_lens_micro_images_are_discs(layout: str, place: tuple[float, float]) -> None:
    """Pupil radius R at the distance D before the array, B to the sensor, discs of radius r and focal length f.

    A ray from s through a point a of the disc at the vertex v meets the lens at v + a + D ((v + a - s) / B - a / f).
    So light through a fills a disc of radius R B / D about v (1 + B / D) + m a with m = 1 + B / D - B / f, and all
    light one of radius R B / D + |m| r. The centroid is the mean over both discs with the weight cos^4.
    """
    pupil, before, behind, disc, focal = 6.0, 80.0, 1.5, 0.09, 1.1
    lens = Prescription(surfaces=(Surface(focal_length_mm=60.0, semi_diameter_mm=pupil, is_stop=True),))
    array = MicrolensArray(
        layout=layout,
        pitch_mm=0.2,
        focal_lengths_mm=(focal,),
        width_mm=0.01,
        height_mm=0.01,
        distance_mm=behind,
        aperture="disc",
        disc_diameter_mm=2 * disc,
    )
    sensor = Sensor(width_px=400, height_px=400, pitch_mm=0.01)
    camera = Camera(prescription=lens, sensor=sensor, sensor_distance_mm=before + behind, microlenses=array)
    _, found, vertex = lit_alone(camera, *place)
    middle = vertex * (1 + behind / before)
    for radii, expected in (
        (found.pupil_mm[0], pupil * behind / before),
        (found.light_mm[0], pupil * behind / before + abs(1 + behind / before - behind / focal) * disc),
    ):
        reached = np.hypot(*(found.centroid_mm[0] + radii[:, None] * along() - middle).T)
        np.testing.assert_allclose(reached, expected, rtol=0, atol=MICRO_IMAGE_PX * sensor.pitch_mm)
    assert found.pupil_area_mm2[0] == pytest.approx(np.pi * (pupil * behind / before) ** 2, rel=1e-5)
    (a, aw), (s, sw) = disc_nodes(disc), disc_nodes(pupil * behind / before)
    start = (1 + behind / before - behind / focal) * a[:, None] + s + middle
    light = aw[:, None] * sw / (behind**2 + ((vertex + a[:, None] - start) ** 2).sum(axis=-1)) ** 2
    centroid = (light[..., None] * start).sum(axis=(0, 1)) / light.sum()
    np.testing.assert_allclose(found.centroid_mm[0], centroid, rtol=0, atol=MICRO_IMAGE_PX * sensor.pitch_mm)


def disc_nodes(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a disc and their weights: 8 nodes along the radius, 16 around."""
    node, weight = np.polynomial.legendre.leggauss(8)
    turn = 2 * np.pi * np.arange(16) / 16
    r = radius * (node + 1) / 2
    points = r[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return points.reshape(-1, 2), np.repeat(r * weight, 16)


@pytest.mark.parametrize(
    "kind",
    [kind if kind == "tilted" else pytest.param(kind, marks=pytest.mark.heavy) for kind in KINDS],
)
def test_centroids_behind_other_microlenses_are_those_of_slow_rays(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every model, tilted, discs and cells: rays one by one, and none of them lies beyond the outline. The microlens is
    (17, -9), whether its light reaches the image or not."""
    groups, rays = 8, 20_000
    tracer = Tracer(camera_with(kind))
    grid, pitch = tracer.lattice, tracer.camera.sensor.pitch_mm
    row = np.flatnonzero((grid.k == 17) & (grid.l == -9))
    monkeypatch.setattr("pipeline.camera.micro_images.light.reaching", lambda *_: row)
    found = micro_light(tracer, micro_images(tracer))
    rng, half, means, beyond = np.random.default_rng(6), 1.02 * found.light_mm.max(), [], []
    for _ in range(groups):
        start = found.centroid_mm[0] + rng.uniform(-half, half, (rays, 2))
        left = slow_microlens.leaving(
            tracer.camera, start, vertex_of(tracer, row[0]), int(grid.type[row[0]]), rays, rng
        )
        off = (start - found.centroid_mm[0])[left.number]
        means.append(left.weight @ off / left.weight.sum() / pitch)
        turn = np.rad2deg(np.arctan2(-off[:, 1], -off[:, 0]))
        beyond.append((np.hypot(*off.T) / np.interp(turn, OUTLINE_DEG, found.light_mm[0], period=360)).max())
    error = np.std(means, axis=0, ddof=1) / math.sqrt(groups)
    assert np.all(np.abs(np.mean(means, axis=0)) < SIGMAS * error)
    assert error.max() < 0.1
    # Between two directions a circle bulges by 1 - cos(7.5 degrees).
    assert 0.95 < max(beyond) < 1 / math.cos(math.radians(7.5)) + MICRO_IMAGE_PX
