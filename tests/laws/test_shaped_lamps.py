"""Lamps that are shaped: closed forms of what UsdLux says of focus, cone, profile and picture."""

import math

import numpy as np
import pytest
from laws.lit import lamp, looked, matt, plate, scene, towards
from tolerances import LIT_ERRORS, PROFILE_FLUX

from pipeline.files.ies import read_ies
from pipeline.render.lighting.emitting import COLUMNS, PROFILE, emitting_of, shape_of, shaped
from pipeline.render.lighting.records import Lamp, Shaping

SPOT = (30.0, -20.0, 500.0)
"""The point of a matt plate that is looked at [mm]."""
EYE = (400.0, -10.0, 495.0)
"""A place below all lamps that sees it."""
ABOVE = towards((0.0, 0.0, -1.0), (SPOT[0], SPOT[1], 490.0))
"""Pose of a lamp 10 mm above the spot that shines onto it: seen from there, a large one fills the sky."""


def irradiance(light, **more) -> tuple[float, float]:
    mean, error = looked(scene([(plate(500.0, 9e3), matt(0.5))], [light], **more), SPOT, EYE)
    return math.pi / 0.5 * mean, math.pi / 0.5 * error


def agrees(light, expected: float, **more) -> None:
    found, error = irradiance(light, **more)
    assert expected > 0
    assert abs(found - expected) <= LIT_ERRORS * error + 1e-9, (found, expected, error)
    assert LIT_ERRORS * error < 0.2 * expected


@pytest.mark.parametrize("angle", [0.3, 0.7, 1.2])
def test_a_cone_of_a_lamp_that_fills_the_sky_lights_by_the_sine_of_its_angle_squared(angle):
    agrees(lamp("disk", (60.0, 0.0), ABOVE, shaping=Shaping(cone=angle)), math.pi * math.sin(angle) ** 2)


@pytest.mark.parametrize(("kind", "cone"), [("sphere", math.pi), ("sphere", 0.4), ("disk", math.pi / 2)])
def test_a_small_lamp_beside_its_axis_lights_by_the_power_of_its_cosine_or_not_at_all(kind, cone):
    """From 400 mm a lamp of 2 mm is a point but for 2e-5 of its light."""
    for turn in (0.2, 0.5, 1.0):
        pose = towards((math.sin(turn), 0.0, -math.cos(turn)), (SPOT[0], SPOT[1], 100.0))
        found, error = irradiance(lamp(kind, (2.0, 0.0), pose, shaping=Shaping(focus=3.0, cone=cone)))
        across = 1.0 if kind == "sphere" else math.cos(turn)
        expected = math.pi * 4.0 / 400.0**2 * math.cos(turn) ** 3 * across if turn < cone else 0.0
        assert abs(found - expected) <= LIT_ERRORS * error + 1e-4 * expected


@pytest.mark.parametrize(("focus", "tint"), [(1.0, 0.0), (4.0, 0.0), (4.0, 0.25), (4.0, 1.0)])
def test_a_focused_lamp_that_fills_the_sky_lights_by_the_integral_of_its_power(focus, tint):
    """The integral of cos^(n + 1) over the hemisphere is 2 pi / (n + 2); the tint is what stays beside the axis."""
    expected = math.pi * tint + (1.0 - tint) * 2.0 * math.pi / (focus + 2.0)
    # Of a disk seen under 87 degrees 0.2 % of the light of an endless one is missing, of a focused one less.
    light = lamp("disk", (2000.0, 0.0), ABOVE, shaping=Shaping(focus=focus, focus_tint=(tint,) * 3))
    found, error = looked(scene([(plate(500.0, 9e3), matt(0.5))], [light]), SPOT, EYE, 1 << 17)
    assert abs(2.0 * math.pi * found - expected) <= LIT_ERRORS * 2.0 * math.pi * error + 0.003 * expected


@pytest.mark.parametrize("softness", [0.3, 1.0])
def test_a_soft_cone_lights_by_the_integral_of_its_smooth_step(softness):
    cone = 1.0
    angle = (np.arange(20_000) + 0.5) / 20_000 * cone
    x = np.clip((angle - (1.0 - softness) * cone) / (softness * cone), 0.0, 1.0)
    light = 1.0 - x * x * (3.0 - 2.0 * x)
    expected = 2.0 * math.pi * np.mean(light * np.sin(angle) * np.cos(angle)) * cone
    agrees(lamp("disk", (60.0, 0.0), ABOVE, shaping=Shaping(cone=cone, softness=softness)), expected)


def ies(polar, around, candela, factor: float = 1.0) -> bytes:
    """A file of type C; `candela` by angle around, then by polar angle."""
    lines = ["IESNA:LM-63-2002", "[TEST] made here", "TILT=NONE"]
    lines += [f"1 1000 {factor} {len(polar)} {len(around)} 1 2 0 0 0", "1 1 40"]
    rows = [polar, around, *candela]
    return "\n".join([*lines, *(" ".join(f"{value:.6g}" for value in row) for row in rows)]).encode()


POLAR, QUARTER = (0.0, 20.0, 50.0, 90.0, 130.0, 180.0), (0.0, 45.0, 90.0)
TABLE = np.array([[9, 7, 3, 2, 1, 0.5], [9, 6, 5, 1, 1, 0.5], [9, 2, 1, 4, 0, 0.5]])


def profiled(content: bytes, **more) -> tuple:
    """Arguments of `shaped` for a sphere with a profile: pictures on lamps, and its line of the table."""
    shape = Shaping(cone=math.pi, profile="it", **more)
    line = np.zeros(COLUMNS)
    line[18:21], line[21:] = (1.0, 0.0, 0.0), shape_of(Lamp(kind="sphere", radiance=(1.0, 0.0, 0.0), shaping=shape))
    line[PROFILE] = 0
    return emitting_of([lamp("sphere", (1.0, 0.0), shaping=shape)], {"it": read_ies(content)}).numbers, line


def towards_light(polar: float, around: float) -> tuple[float, float, float]:
    """Direction to a lamp from where its light goes at a polar angle from -z, and an angle about it from +x to +y."""
    side = math.sin(polar)
    return -side * math.cos(around), -side * math.sin(around), math.cos(polar)


@pytest.mark.parametrize("around", [QUARTER, (0.0, 90.0, 180.0), (0.0, 120.0, 360.0), (90.0, 180.0, 270.0), (0.0,)])
def test_the_flux_of_a_lamp_is_the_integral_of_its_table(around):
    """A sum over directions against the mean that is stated; normalised, lamps of all profiles have the same flux."""
    table = TABLE.copy()
    if around[-1] == 360.0:
        table[2] = table[0]
    content = ies(POLAR, around, table[: len(around)], 2.0)
    for more, expected in (({}, float(read_ies(content)[0, 0, 3])), ({"is_normalized": True}, 1.0)):
        arguments, total, weight = profiled(content, **more), 0.0, 0.0
        for polar in (np.arange(90) + 0.5) / 90 * math.pi:
            for turn in (np.arange(72) + 0.5) / 72 * 2.0 * math.pi:
                total += math.sin(polar) * shaped.function(*arguments, towards_light(polar, turn), 0.0, 0.0)
                weight += math.sin(polar)
        assert total / weight == pytest.approx(expected, rel=PROFILE_FLUX)


def test_a_profile_is_symmetric_as_its_angles_say_and_linear_between_them():
    arguments = profiled(ies(POLAR, QUARTER, TABLE))
    for turn in (30.0, 150.0, 210.0, 330.0):
        there = towards_light(math.radians(35.0), math.radians(turn))
        expected = 0.5 * ((7 + 3) / 3 + 2 * (6 + 5) / 3)
        assert shaped.function(*arguments, there, 0.0, 0.0) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("scale", "polar", "asked"), [(0.5, 20.0, 40.0), (1.5, 60.0, 40.0), (-0.5, 150.0, 120.0)])
def test_the_angle_scale_stretches_a_profile_from_one_of_its_ends(scale, polar, asked):
    stretched, plain = (
        profiled(ies(POLAR, (0.0,), TABLE[:1]), angle_scale=scale),
        profiled(ies(POLAR, (0.0,), TABLE[:1])),
    )
    one, other = (towards_light(math.radians(angle), 0.3) for angle in (polar, asked))
    assert shaped.function(*stretched, one, 0, 0) == pytest.approx(shaped.function(*plain, other, 0, 0), rel=1e-6)


def test_a_luminaire_lights_by_its_profile_and_the_inverse_square():
    """A small sphere with the angles of its frame: -z is the nadir, +x the plane of 0 degrees, +y that of 90."""
    content = ies(POLAR, (0.0, 90.0, 180.0, 270.0, 360.0), [TABLE[0], TABLE[1], TABLE[2], TABLE[1] + 2, TABLE[0]])
    rows = [TABLE[0], TABLE[1], TABLE[2], TABLE[1] + 2, TABLE[0]]
    for k, plane in enumerate((45.0, 135.0, 225.0, 315.0)):
        polar, turn, expected = math.radians(35.0), math.radians(plane), np.mean([row[1:3] for row in rows[k : k + 2]])
        # The plate lies where the light of that direction goes: straight below the lamp, which is turned about.
        down = np.array([math.sin(polar) * math.cos(turn), math.sin(polar) * math.sin(turn), -math.cos(polar)])
        side = np.cross(down, [0.1, 0.7, 0.3])
        side /= np.linalg.norm(side)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = np.stack([side, np.cross(down, side), down]), (SPOT[0], SPOT[1], 100.0)
        light = lamp("sphere", (2.0, 0.0), pose, shaping=Shaping(cone=math.pi, profile="it"))
        found, error = irradiance(light, pictures={"it": read_ies(content)})
        assert abs(found - expected * math.pi * 4.0 / 400.0**2) <= LIT_ERRORS * error + 1e-3 * found


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
    place = towards((0.0, 0.0, -1.0), (SPOT[0], SPOT[1], 100.0))
    agrees(lamp("rect", (2.0, 1.0), place, texture="it"), 6.0 / 8.0 * 8.0 / 400.0**2, pictures={"it": picture})
