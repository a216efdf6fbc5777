"""Claim: the truth of a colour channel is that of all its wavelengths together, each refracted by its own indices."""

import dataclasses
import math

import numpy as np
import pytest
from colour.characterisation import SDS_COLOURCHECKERS
from laws import rigs
from laws.meshes import mesh
from laws.rigs import at, in_light
from laws.solving import board, case_of, off_axis, rig_of, saddles, solved
from naive import polar
from tolerances import CENTROID_PX, DIRECT_PX, LATERAL_COLOUR, SADDLE_PX, SIGMAS

import pipeline
from pipeline.camera.integrals import Bundles, integrals, random_integrals
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.spectrum import Channel, SpectralNode, alone
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.moments import WEIGHT
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.prescription import Prescription, Surface
from pipeline.render.glow import GlowingView, TargetLight
from pipeline.render.imaging import over_wavelengths, pictures_in_lights, white_parts
from pipeline.render.spectral.nodes import gauss_nodes, points_of, slices_of
from pipeline.render.spectral.prints import Print, Spectrum
from pipeline.render.spectral.spectra import illuminant, reflectance
from pipeline.render.surroundings import Surroundings
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.patterns.circles import CircleGrid
from pipeline.targets.target import Target
from pipeline.truth.positions.centroid import centroid
from pipeline.truth.visibility import PointBundles, shares

RED = {600.0: 0.3, 640.0: 0.5, 680.0: 0.2}
BLUE = {430.0: 0.25, 460.0: 0.5, 500.0: 0.25}


def test_red_and_blue_differ_as_textbook_rays_of_all_wavelengths_say() -> None:
    """J of a channel at a solution, from polar grids of textbook rays at each of its wavelengths, is the point."""
    pattern, pose, places = Checkerboard(columns=2, rows=1, square_mm=6.0), rigs.facing(436.0, 12.0, 24.0, 9.0), []
    for light in (RED, BLUE):
        camera = in_light(off_axis(8.0), light)
        rig = rig_of(camera)
        found = solved(rig, pattern, pose).solutions
        x = found.xy_px[0]
        places.append(x)
        start = rig.tracer.positions_mm(*x[:, None])[0]
        parts = [polar.mean_hit(at(off_axis(8.0), nm), start, pose, directions=1024) for nm in light]
        weight = np.array([share * w for share, (_, w) in zip(light.values(), parts, strict=True)])
        j = weight @ np.array([hit for hit, _ in parts]) / weight.sum()
        missed_mm = np.abs(j - pattern.points_mm()[found.point[0], :2])
        assert missed_mm.max() / 434.4 * 131.81 / 0.005 < 2 * DIRECT_PX + 1e-4  # magnified onto the sensor
    assert np.hypot(*(places[0] - places[1])) > 0.3


def test_random_rays_judge_channels_as_quadrature_does_also_in_a_notebook() -> None:
    camera, pose = in_light(off_axis(8.0), RED), rigs.facing(436.0, 12.0, 24.0, 9.0)
    tracer, plane = Tracer(camera), target_plane(pose)
    bundle = Bundles(np.array([[3300.0, 2300.0]]), np.array([NO_MICROLENS]), np.stack([plane, plane])[None])
    exact, random = integrals(tracer, bundle, 2), random_integrals(tracer, bundle, 1 << 16)
    apart = np.abs(exact.moments[0, :2] - random.moments[0, :2])
    assert (apart < SIGMAS * random.error_mm[0] + exact.error_mm[0]).all()
    assert exact.moments[0, WEIGHT] == pytest.approx(random.moments[0, WEIGHT], rel=1e-4)
    shown = Bundles(bundle.x_px, bundle.microlens, parallel_planes(436.0, 446.0)[None])
    mean = pipeline.bundle(camera, 3300.0, 2300.0, samples=1 << 16).mean_at(436.0)
    expected = integrals(tracer, shown, 2).moments[0, :2]
    assert mean == pytest.approx(expected, abs=2e-5)  # a blur of some 0.1 mm, scrambled Sobol points


def test_a_channel_of_one_wavelength_is_the_camera_in_that_light() -> None:
    assert in_light(off_axis(8.0), {640.0: 1.0}) == at(off_axis(8.0), 640.0)


def test_a_split_wavelength_changes_nothing() -> None:
    board_, pose = Checkerboard(columns=2, rows=1, square_mm=6.0), rigs.facing(436.0, 12.0, 24.0, 9.0)
    middle = in_light(off_axis(8.0), {550.0: 1.0, 550.0000001: 1e-9}).spectrum[0]
    halves = tuple(SpectralNode(wavelength_nm=550.0, weight=w, indices=middle.indices) for w in (0.25, 0.75))
    split = off_axis(8.0).in_light(Channel(name="", middle=middle, nodes=halves))
    both = [solved(rig_of(camera), board_, pose) for camera in (split, at(off_axis(8.0), 550.0))]
    np.testing.assert_allclose(both[0].solutions.x_px, both[1].solutions.x_px, rtol=0, atol=1e-9)
    np.testing.assert_allclose(both[0].blur_px2, both[1].blur_px2, rtol=1e-9)
    np.testing.assert_allclose(both[0].hit_fraction, both[1].hit_fraction, rtol=1e-12)


def test_lateral_colour_of_a_singlet_is_the_paraxial_one() -> None:
    """A thick singlet behind a pinhole stop: image heights of two indices by matrices of paraxial optics."""
    radius, thickness, before, behind = 60.0, 8.0, 30.0, 60.0
    indices = {486.13: 1.5224, 656.27: 1.5143}

    def camera(index: float) -> Camera:
        surfaces = (
            Surface(semi_diameter_mm=0.02, thickness_mm=before, is_stop=True),
            Surface(radius_mm=radius, thickness_mm=thickness, semi_diameter_mm=25.0, index=index),
            Surface(radius_mm=-radius, thickness_mm=behind, semi_diameter_mm=25.0),
        )
        sensor = Sensor(width_px=2001, height_px=2001, pitch_mm=0.001)
        return rigs.bare(Prescription(surfaces=surfaces), sensor, before + thickness + behind, (900.0, 1100.0))

    def height(index: float, slope: float) -> float:
        y, u = slope * before, slope
        u = (u - y * (index - 1) / radius) / index
        y += thickness * u
        u = index * u - y * (index - 1) / radius
        return y + behind * u

    point_mm, away_mm = 4.0, 1000.0
    target = Checkerboard(columns=2, rows=1, square_mm=2 * point_mm)
    found = {nm: solved(rig_of(camera(n)), target, rigs.facing(away_mm), 1e-5).solutions for nm, n in indices.items()}
    traced = [(one.x_px.max() - one.x_px.min()) / 2 for one in found.values()]
    paraxial = [abs(height(n, point_mm / away_mm)) / 0.001 for n in indices.values()]
    assert abs(paraxial[0] - paraxial[1]) > 1
    assert traced[0] / traced[1] - 1 == pytest.approx(paraxial[0] / paraxial[1] - 1, rel=LATERAL_COLOUR)


def test_the_centroid_of_a_channel_is_that_of_the_light_of_its_wavelengths() -> None:
    """Light of discs adds, so their centroids are averaged by it: exactly."""
    target, pose = (
        Target(CircleGrid(columns=2, rows=1, spacing_mm=8.0, diameter_mm=3.0)),
        rigs.facing(436.0, 12.0, 24.0),
    )
    whole = case_of(in_light(off_axis(4.5), RED), target, pose)
    point = int(whole.solutions.point[0])

    def found(rig: Rig) -> np.ndarray:
        return centroid(rig, 0, whole.j_px[0], whole.planes[point], 1.5).x_px

    alone = np.array([found(Rig.of(light.tracer)) for light in whole.rig.tracer.lights])
    joined = found(whole.rig)
    shares = np.array(list(RED.values()))
    assert np.abs(alone - joined).max() > 20 * CENTROID_PX  # else the test would show nothing
    # Transmission and magnification change by a few per mille from wavelength to wavelength.
    assert joined == pytest.approx(shares @ alone / shares.sum(), abs=0.01 * np.ptp(alone, axis=0).max())


@pytest.mark.heavy
@pytest.mark.parametrize("light", [{600.0: 0.3, 616.0: 0.7}, {600.0: 0.3, 608.0: 0.5, 616.0: 0.2}])
def test_the_saddle_of_a_channel_lies_between_those_of_its_wavelengths(light: dict[float, float]) -> None:
    """Wavelengths so near to each other that images of a corner differ by a shift: the mean of the shifts."""
    target, pose = board(6.0), rigs.facing(436.0, 12.0, 24.0)
    joined = saddles(case_of(in_light(off_axis(4.5), light), target, pose))[0]
    alone = np.array([saddles(case_of(at(off_axis(4.5), nm), target, pose))[0] for nm in light])
    spread = np.ptp(alone, axis=0).max()
    assert spread > 20 * SADDLE_PX
    assert joined == pytest.approx(np.array(list(light.values())) @ alone, abs=0.05 * spread + SADDLE_PX)


def small(stop_semi_mm: float = 4.5) -> Camera:
    return rigs.conventional(stop_semi_mm, 24, 18, 0.2)


def test_a_white_scene_is_the_white_image_in_every_light() -> None:
    rig = rig_of(in_light(small(), RED))
    white = white_parts(rig, 64)
    scene = TargetLight([], 1.0, [])
    image = pictures_in_lights(rig, 64, [scene], white)[0]
    np.testing.assert_allclose(image, over_wavelengths(rig.tracer, white)[0], rtol=1e-12)
    middle = image[9, 12]
    assert middle == pytest.approx(1.0, abs=0.01)


def test_the_image_of_a_channel_is_that_of_its_wavelengths_by_their_light() -> None:
    camera = in_light(small(), RED)
    scene = TargetLight([(Target(Checkerboard(columns=3, rows=2, square_mm=14.0)), rigs.facing(434.4))], 0.2, [])
    whole = rig_of(camera)
    joined = pictures_in_lights(whole, 4096, [scene], white_parts(whole, 4096))[0]
    alone, weight = [], []
    for nm, share in RED.items():
        rig = rig_of(at(small(), nm), seed=5)
        alone.append(pictures_in_lights(rig, 4096, [scene], white_parts(rig, 4096))[0])
        weight.append(share * rig.tracer.reference_weight_sr)
    expected = np.tensordot(np.array(weight) / math.fsum(weight), np.array(alone), axes=1)
    assert np.abs(joined - expected).max() < 0.01  # of 4096 stratified samples a pixel
    assert np.ptp(joined) > 0.5


def test_images_of_wavelengths_add_by_share_and_reference_bundle() -> None:
    """Light of one wavelength alone: what it has of the white scene in all light."""
    tracer = rig_of(in_light(small(), RED)).tracer
    weight = np.array([share * Tracer(at(small(), nm)).reference_weight_sr for nm, share in RED.items()])
    np.testing.assert_allclose(over_wavelengths(tracer, np.eye(3)), weight / weight.sum(), rtol=1e-12)


def test_the_visibility_of_a_channel_is_that_of_its_wavelengths_by_their_light() -> None:
    """An edge through the bundle, before the board, which hides a little more of one colour than of the other."""
    camera, pose = in_light(off_axis(8.0), {430.0: 0.6, 680.0: 0.4}), rigs.facing(436.0)
    x_px, behind = np.array([[3300.0, 2300.0]]), np.array([NO_MICROLENS])
    plane, target = target_plane(pose), Target(Checkerboard(columns=2, rows=1, square_mm=6.0))
    bundle = Bundles(x_px, behind, np.stack([plane, plane])[None])
    edge_mm = pipeline.bundle(camera, *x_px[0], samples=4096).mean_at(300.0)[0]
    wall = mesh([(edge_mm, -90.0, 300.0), (90.0, -90.0, 300.0), (90.0, 90.0, 300.0), (edge_mm, 90.0, 300.0)])
    around, rig = Surroundings([(target, pose)], [(wall, np.eye(4))]), rig_of(camera)
    points = PointBundles(behind, x_px, plane[None])
    joined = shares(rig, around, 0, points, 1 << 12)[0]
    alone = np.array([shares(Rig.of(light.tracer), around, 0, points, 1 << 12)[0] for light in rig.tracer.lights])
    weight = [light.share * integrals(light.tracer, bundle, 2).moments[:, WEIGHT] for light in rig.tracer.lights]
    assert np.ptp(alone) > 5e-4  # else the test would show nothing
    assert joined == pytest.approx(np.average(alone, axis=0, weights=weight), abs=2e-5)


BOARD = Target(Checkerboard(columns=2, rows=1, square_mm=40.0))
LOW, HIGH = 500.0, 600.0
"""Ends of a flat response [nm]."""
PRINT = Print(
    ink=Spectrum(wavelengths_nm=(LOW, HIGH), reflectance=(0.3, 0.1)),
    paper=Spectrum(wavelengths_nm=(LOW, HIGH), reflectance=(0.2, 0.8)),
)


def mean_nm() -> float:
    return (HIGH**3 - LOW**3) / 3 / ((HIGH**2 - LOW**2) / 2)


def test_a_channel_is_the_integral_of_light_reflectance_and_response() -> None:
    """A reflectance that is linear over a flat response, in light of equal energy, is that at the mean wavelength."""
    points = points_of((np.array([LOW, HIGH]), np.ones(2)), illuminant("E"), counts_photons=True)
    light = dict(zip(*(values.tolist() for values in gauss_nodes(points, 5)), strict=True))
    sensor = Sensor(width_px=4, height_px=2, pitch_mm=0.4)
    camera = in_light(rigs.bare(rigs.tronnier(4.5), sensor, 131.81, (400.0, 480.0)), light)
    # The middle of the sensor sees the column of squares in the middle: black above, white below, or the other way.
    colours = PRINT.colours(BOARD, slices_of(points, np.array(list(light.values()))))
    views = [GlowingView([(BOARD, rigs.facing(434.4, y_mm=20.0 * s))], 0.0, (), [colours]) for s in (1, -1)]
    rig = Rig.of(Tracer(camera))
    white = white_parts(rig, 64)
    images = pictures_in_lights(rig, 64, views, white)
    whole = np.average(white[0], axis=-1, weights=list(light.values()))
    expected = sorted(np.interp(mean_nm(), one.wavelengths_nm, one.reflectance) for one in (PRINT.ink, PRINT.paper))
    found = sorted((images / whole).mean(axis=(1, 2)))
    np.testing.assert_allclose(found, expected, rtol=1e-3)  # bundles of the wavelengths differ by less


def test_without_a_spectrum_a_target_keeps_its_colours_and_white_scales_both() -> None:
    assert Print().colours(BOARD, (alone(550.0),)) == ()
    bright = dataclasses.replace(BOARD, pattern=dataclasses.replace(BOARD.pattern, white=2.0, black=0.5))
    lights = alone(LOW), alone(HIGH)
    np.testing.assert_allclose(Print(paper=PRINT.paper).colours(bright, lights), [[[0.5, 0.4]], [[0.5, 1.6]]])
    np.testing.assert_allclose(Print(ink=PRINT.ink).colours(bright, lights[1:]), [[[0.2, 2.0]]])


@pytest.mark.parametrize("patch", ["cyan", "red", "neutral 5 (.70 D)"])
def test_a_patch_of_the_colorchecker_reflects_what_another_laboratory_measured(patch: str) -> None:
    """The average of BabelColor, in steps of 10 nm, of other specimens."""
    other = SDS_COLOURCHECKERS["BabelColor Average"][patch]
    found = np.interp(other.wavelengths, *reflectance(patch))
    assert np.abs(found - other.values).max() < 0.05
    assert np.ptp(other.values) > 0.1 or patch.startswith("neutral")
