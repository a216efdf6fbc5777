"""Lamps obey the closed forms of radiometry, and of what UsdLux says of focus, cone and picture: the radiance
of a matt plate is its reflectance over pi, times the irradiance.
"""

import math

import numpy as np
import pytest
from laws.rigs import facing
from plugins.scenes.lit import RAYS, agrees, lamp, looked, matt, mesh, plate, scene, towards
from tolerances import LIT_ERRORS

from pipeline.plugins.scenes.lighting.records import Input, Material, Shaping, Texture
from pipeline.targets.mesh import Occluder

SPOT = (30.0, -20.0, 500.0)
"""The point that is looked at [mm]."""
EYE = (15.0, -10.0, 495.0)
"""A place from which it is seen below all lamps [mm]."""
FACING = (0.0, 0.0, 1.0)
"""Direction of the z axis of a lamp that shines towards the camera; the plate faces it."""
DOWN = (0.0, 0.0, -1.0)
"""Direction of the z axis of a lamp that shines away from the camera, onto plates before it."""


def irradiance(lamps, rays: int = RAYS, **more) -> tuple[float, float]:
    """Irradiance of a matt plate across the axis, at the spot, and its standard error."""
    mean, error = looked(scene([(plate(500.0, 9e3), matt(0.5))], lamps, **more), SPOT, EYE, rays)
    return math.pi / 0.5 * mean, math.pi / 0.5 * error


def lights(lamps, expected: float, noise: float | None = None, **more) -> None:
    assert expected > 0
    agrees(irradiance(lamps, **more), expected, 1e-9, noise)


@pytest.mark.parametrize("distance_mm", [40.0, 100.0, 450.0])
def test_a_disk_lights_its_axis_by_the_sine_of_its_angle_squared(distance_mm):
    pose = towards(DOWN, (SPOT[0], SPOT[1], SPOT[2] - distance_mm))
    lights([lamp("disk", (60.0, 0.0), pose)], math.pi * 60.0**2 / (60.0**2 + distance_mm**2))


def test_a_rect_lights_a_point_below_its_corner_by_lamberts_formula():
    """Four quarters of a rect about its normal through the point: E = 2 L (A/.. atan B/.. + ...), once per quarter."""
    a, b, d = 80.0, 50.0, 120.0
    x, y = a / d, b / d
    quarter = 0.5 * (
        x / math.hypot(1, x) * math.atan(y / math.hypot(1, x)) + y / math.hypot(1, y) * math.atan(x / math.hypot(1, y))
    )
    pose = facing(SPOT[2] - d, 0.0, *SPOT[:2])
    lights([lamp("rect", (a, b), pose)], 4 * quarter)


@pytest.mark.parametrize("off_mm", [(0.0, 0.0, -200.0), (150.0, 80.0, -120.0)])
def test_a_sphere_lights_as_a_point_of_its_solid_angle(off_mm):
    centre = np.array(SPOT) + off_mm
    squared = float(np.dot(off_mm, off_mm))
    cosine = -off_mm[2] / math.sqrt(squared)
    lights([lamp("sphere", (25.0, 0.0), towards(DOWN, centre))], math.pi * 25.0**2 / squared * cosine)


def test_a_long_cylinder_lights_as_an_infinite_one():
    """E = pi L r / d for an endless cylinder across the normal, at a distance d of its axis."""
    pose = np.eye(4)
    pose[:3, 3] = SPOT[0], SPOT[1], SPOT[2] - 100.0
    lights([lamp("cylinder", (20000.0, 8.0), pose)], math.pi * 8.0 / 100.0, noise=0.1 * LIT_ERRORS)


@pytest.mark.parametrize("angle_rad", [0.0, 0.1, 0.6])
def test_a_distant_lamp_lights_by_its_projected_solid_angle(angle_rad):
    z = np.array([0.4, 0.3, -1.0])
    cosine = 1.0 / np.linalg.norm(z)
    whole = math.pi * math.sin(angle_rad) ** 2 if angle_rad else 1.0
    lights([lamp("distant", (angle_rad, 0.0), towards(z))], whole * cosine)


def test_a_constant_dome_lights_by_pi():
    lights([lamp("dome")], math.pi)


def test_lamps_add_up_and_hide_each_other():
    """A disk takes from a dome what it covers of it, and leaves a beam that passes beside it."""
    disk = math.pi * 60.0**2 / (60.0**2 + 100.0**2)
    lamps = [
        lamp("disk", (60.0, 0.0), towards(DOWN, (SPOT[0], SPOT[1], 400.0))),
        lamp("dome", radiance=(0.2, 0.2, 0.2)),
        lamp("distant", (0.0, 0.0), towards((1.0, 0.0, -1.0))),
    ]
    lights(lamps, disk + 0.2 * (math.pi - disk) + math.sqrt(0.5))
    lamps[2] = lamp("distant", (0.0, 0.0), towards(DOWN))
    lights(lamps, disk + 0.2 * (math.pi - disk))


@pytest.mark.parametrize("sky", [0.02, 1.0, 20.0])
def test_a_sky_adds_to_a_lamp_what_that_does_not_hide_and_no_noise_if_it_is_faint(sky):
    """Paths that leave a plate meet an open sky anyway: its light is known without a ray, and all rays are for the
    lamp. Were it asked as a lamp is, there would be ten times the noise."""
    disk = lamp("disk", (60.0, 0.0), towards(DOWN, (SPOT[0], SPOT[1], 400.0)))
    alone = math.pi * 60.0**2 / (60.0**2 + 100.0**2)
    found, error = irradiance([disk, lamp("dome", radiance=(sky,) * 3)], rays=4096)
    agrees((found, error), alone + sky * (math.pi - alone))
    assert sky > 0.5 or error < 1.5 * irradiance([disk], rays=4096)[1]


def test_rects_and_disks_shine_from_one_side_only():
    for kind in ("rect", "disk"):
        assert irradiance([lamp(kind, (40.0, 40.0), towards(FACING, (30.0, -20.0, 400.0)))])[0] == 0.0


def test_a_lamp_is_seen_as_bright_as_it_is_and_its_back_is_black():
    for kind, size in (("rect", (40.0, 30.0)), ("disk", (30.0, 0.0)), ("sphere", (30.0, 0.0))):
        lit = scene([(plate(500.0), matt(0.5))], [lamp(kind, size, towards(FACING, (0, 0, 300)), (3.0, 3.0, 3.0))])
        assert looked(lit, (0.0, 0.0, 300.0), rays=4)[0] == pytest.approx(3.0)
    lit = scene([(plate(500.0), matt(0.5))], [lamp("disk", (30.0, 0.0), towards(DOWN, (0, 0, 300))), lamp("dome")])
    assert looked(lit, (0.0, 0.0, 300.0), rays=4)[0] == 0.0


def test_the_edge_of_a_shadow_lies_where_geometry_says():
    """A half plane before a distant lamp without extent: light on one side, none on the other, to 0.01 mm."""
    z = np.array([1.0, 0.0, -1.0])
    things = [(plate(500.0), matt(1.0)), (plate(450.0, 40.0, x_mm=40.0), matt(1.0))]
    lit = scene(things, [lamp("distant", (0.0, 0.0), towards(z))])
    # Light comes from +x: the edge at x = 0, z = 450 throws its shadow to x = -50; the one at x = 80 to x = 30.
    for edge, step in ((-50.0, 1.0), (30.0, -1.0)):
        dark, bright = (
            looked(lit, (edge + side * 0.01, 0.0, 500.0), (edge, 0.0, 470.0), 8)[0] for side in (step, -step)
        )
        assert dark == 0.0
        assert bright == pytest.approx(1.0 / math.sqrt(2.0) / math.pi)


def test_rays_of_a_pixel_are_evenly_spread_over_a_sky_that_is_half_hidden():
    """Half of all light arrives. A point by chance would bring all or nothing, and so add as much noise as light."""
    wall = mesh([(0.0, 900.0, 500.0), (0.0, -900.0, 500.0), (0.0, 0.0, -9e5)], [(0, 1, 2)])
    hidden = scene([(plate(500.0), matt(0.5)), (wall, matt(0.0))], [lamp("dome")])
    mean, error = looked(hidden, (1e-3, 0.0, 500.0), (10.0, 0.0, 400.0), rays=64 * 64, scrambles=64)
    assert mean == pytest.approx(0.25, rel=0.02)
    by_chance = 0.25 / math.sqrt(64 * 64)
    assert error < by_chance / 2


def test_the_nearer_of_two_lamps_is_asked_by_each_place():
    """A ray brings all of its light or none; were both asked alike, those would differ by as much as their mean."""
    lamps = [lamp("sphere", (2.0, 0.0), towards(DOWN, (x_mm, 0.0, 480.0))) for x_mm in (-300.0, 300.0)]
    lit = scene([(plate(500.0), matt(0.5))], lamps)
    for x_mm in (-300.0, 300.0):
        mean, error = looked(lit, (x_mm, 0.0, 500.0), (x_mm - 30.0, 0.0, 400.0), rays=4096, scrambles=4096)
        assert error < 0.5 * mean / math.sqrt(4096)


def test_half_a_lamp_lights_half():
    one = lamp("rect", (50.0, 50.0), facing(400.0, 0.0, *SPOT[:2]))
    whole = irradiance([one])
    wall = plate(450.0, 50.0, x_mm=SPOT[0] + 50.0)
    found, error = looked(scene([(plate(500.0), matt(0.5)), (wall, matt(0.0))], [one]), SPOT, EYE)
    agrees((2 * math.pi * found, 2 * math.pi * error + whole[1]), whole[0] / 2)
    assert found > 0


def glowing_square(half_mm: float, beside_mm: float = 0.0) -> Occluder:
    """A square across the axis, 100 mm before the spot, or so far beside that place."""
    x, y, z = SPOT[0] + beside_mm, SPOT[1], SPOT[2] - 100.0
    return mesh([(x + a * half_mm, y + b * half_mm, z) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def shining(emission: Input) -> Material:
    return Material(diffuse_color=Input(value=(0.0,) * 3), emissive_color=emission, ior=1.0)


def to_a_parallel_square(half_mm: float, beside_mm: float, distance_mm: float) -> float:
    """Share of its light that a small surface sends to a parallel square.

    The square is a sum of four corners, each (X / sqrt(1 + X^2) atan(Y / sqrt(1 + X^2)) + the same exchanged) / 2 pi,
    as in Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-3.
    """

    def corner(x: float, y: float) -> float:
        a, b = math.hypot(1.0, x), math.hypot(1.0, y)
        return (x / a * math.atan(y / a) + y / b * math.atan(x / b)) / (2.0 * math.pi)

    left, right = (beside_mm - half_mm) / distance_mm, (beside_mm + half_mm) / distance_mm
    half = half_mm / distance_mm
    return 2.0 * (corner(right, half) - corner(left, half))


@pytest.mark.parametrize("beside_mm", [0.0, 150.0, 200.0, 600.0])
def test_small_bright_surfaces_light_as_a_lamp_does_and_with_as_little_noise(beside_mm):
    """A glowing square of 4 mm and a rect of that size: the light of the closed form, and errors alike, seen face on
    and from beside.

    Each ray is a scramble of its own, so that all of them are independent, and a mean of 16,384 is off by 4.5 errors
    once in 150,000 times. The same points fill two triangles less evenly than one rect. Asked by chance alone, one path
    of 2,000 or fewer would meet the square, and the error of the mean would be a third of it or more.
    """
    expected = 0.5 * to_a_parallel_square(2.0, beside_mm, 100.0)
    mesh = [(plate(500.0, 4000.0), matt(0.5)), (glowing_square(2.0, beside_mm), shining(Input(value=(1.0,) * 3)))]
    rect = lamp("rect", (2.0, 2.0), towards(DOWN, (SPOT[0] + beside_mm, SPOT[1], SPOT[2] - 100.0)))
    looks = [looked(lit, SPOT, EYE, scrambles=RAYS) for lit in (scene(mesh, []), scene(mesh[:1], [rect]))]
    for look in looks:
        agrees(look, expected, 1e-6 * expected, noise=1e-3)  # a bias of a hundredth must show
    assert looks[0][1] < 4.0 * looks[1][1]


def test_a_beam_adds_to_the_light_of_a_surface_that_shines():
    things = [(plate(500.0), matt(0.5)), (glowing_square(2.0), shining(Input(value=(1.0,) * 3)))]
    beam = looked(scene(things, [lamp("distant", (0.0, 0.0), towards((1.0, 0.0, -1.0)))]), SPOT, EYE)
    agrees(beam, 0.5 * to_a_parallel_square(2.0, 0.0, 100.0) + math.sqrt(0.5) * 0.5 / math.pi, 1e-9)


def test_a_surface_that_shines_by_its_picture_lights_by_what_is_there_and_not_by_its_mean():
    """A picture whose mean is 1, on a square where all of it is the texel of 2."""
    picture = np.zeros((1, 2, 4), np.float32)
    picture[0, 0] = 2.0
    glow = [Input(value=(0.0,) * 3, texture=Texture(name="half", wrap=("clamp", "clamp"))), Input(value=(2.0,) * 3)]
    found = [
        looked(
            scene([(plate(500.0), matt(0.5)), (glowing_square(2.0), shining(one))], [], pictures={"half": picture}),
            SPOT,
            EYE,
        )
        for one in glow
    ]
    agrees((found[0][0], math.hypot(found[0][1], found[1][1])), found[1][0])


ABOVE = towards(DOWN, (SPOT[0], SPOT[1], 490.0))
"""Pose of a lamp 10 mm above the spot that shines onto it: seen from there, a large one fills the sky."""


@pytest.mark.parametrize("angle", [0.3, 0.7, 1.2])
def test_a_cone_of_a_lamp_that_fills_the_sky_lights_by_the_sine_of_its_angle_squared(angle):
    lights([lamp("disk", (60.0, 0.0), ABOVE, shaping=Shaping(cone=angle))], math.pi * math.sin(angle) ** 2, 0.2)


@pytest.mark.parametrize(("kind", "cone"), [("sphere", math.pi), ("sphere", 0.4), ("disk", math.pi / 2)])
def test_a_small_lamp_beside_its_axis_lights_by_the_power_of_its_cosine_or_not_at_all(kind, cone):
    """From 400 mm a lamp of 2 mm is a point but for 2e-5 of its light."""
    for turn in (0.2, 0.5, 1.0):
        pose = towards((math.sin(turn), 0.0, -math.cos(turn)), (SPOT[0], SPOT[1], 100.0))
        look = irradiance([lamp(kind, (2.0, 0.0), pose, shaping=Shaping(focus=3.0, cone=cone))])
        across = 1.0 if kind == "sphere" else math.cos(turn)
        expected = math.pi * 4.0 / 400.0**2 * math.cos(turn) ** 3 * across if turn < cone else 0.0
        agrees(look, expected, 1e-4 * expected)


@pytest.mark.parametrize(("focus", "tint"), [(1.0, 0.0), (4.0, 0.0), (4.0, 0.25), (4.0, 1.0)])
def test_a_focused_lamp_that_fills_the_sky_lights_by_the_integral_of_its_power(focus, tint):
    """The integral of cos^(n + 1) over the hemisphere is 2 pi / (n + 2); the tint is what stays beside the axis."""
    expected = math.pi * tint + (1.0 - tint) * 2.0 * math.pi / (focus + 2.0)
    # Of a disk seen under 87 degrees 0.2 % of the light of an endless one is missing, of a focused one less.
    light = lamp("disk", (2000.0, 0.0), ABOVE, shaping=Shaping(focus=focus, focus_tint=(tint,) * 3))
    agrees(irradiance([light], 1 << 17), expected, 0.003 * expected)


@pytest.mark.parametrize("softness", [0.3, 1.0])
def test_a_soft_cone_lights_by_the_integral_of_its_smooth_step(softness):
    cone = 1.0
    angle = (np.arange(20_000) + 0.5) / 20_000 * cone
    x = np.clip((angle - (1.0 - softness) * cone) / (softness * cone), 0.0, 1.0)
    light = 1.0 - x * x * (3.0 - 2.0 * x)
    expected = 2.0 * math.pi * np.mean(light * np.sin(angle) * np.cos(angle)) * cone
    lights([lamp("disk", (60.0, 0.0), ABOVE, shaping=Shaping(cone=cone, softness=softness))], expected, 0.2)


def test_a_picture_on_a_rect_is_upright_from_its_bright_side():
    """The first row is at +y and the first column at +x, as UsdLux says; its colours multiply the light."""
    picture = np.zeros((2, 2, 4), np.float32)
    picture[0, 0, :3], picture[0, 1, :3], picture[1, 0, :3] = 4.0, 2.0, 1.0
    pose = np.diag([-1.0, -1.0, 1.0, 1.0])  # towards the camera, whose y points down
    pose[2, 3] = 500.0
    lit = scene([], [lamp("rect", (40.0, 20.0), pose, texture="it")], pictures={"it": picture})
    seen = [looked(lit, (x, y, 500.0), rays=4)[0] for x, y in ((-30, -15), (30, -15), (-30, 15), (30, 15))]
    assert seen == pytest.approx([4.0, 2.0, 1.0, 0.0], abs=1e-6)


def test_a_rect_with_a_picture_lights_by_the_mean_of_it_from_afar():
    picture = np.zeros((4, 8, 4), np.float32)
    picture[:2, 3:5, :3] = 6.0
    rect = lamp("rect", (2.0, 1.0), towards(DOWN, (SPOT[0], SPOT[1], 100.0)), texture="it")
    lights([rect], 6.0 / 8.0 * 8.0 / 400.0**2, 0.2, pictures={"it": picture})
