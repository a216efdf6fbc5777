"""Sheets that light passes straight on: each leaves what it does not cover."""

import math

import pytest
from laws.lit import lamp, looked, matt, plate, scene, towards
from tolerances import FURNACE, LIT_ERRORS

from pipeline.render.lighting.records import Input, Material

FLOOR = (0.0, 0.0, 500.0)
"""The point of the floor that is looked at [mm]."""
BELOW = (150.0, 0.0, 480.0)
"""A place below all sheets that sees it [mm]."""


def sheet(opacity: float, **more) -> Material:
    """Black paint, which is there in part."""
    return Material(
        **{"diffuse_color": Input(value=(0.0,) * 3), "ior": 1.0, "opacity": Input(value=(opacity,)), **more}
    )


def sheets(opacity: float, count: int, **more) -> list:
    return [(plate(300.0 + 10.0 * k, 4e4), sheet(opacity, **more)) for k in range(count)]


@pytest.mark.parametrize("presence", [False, True])
@pytest.mark.parametrize(("opacity", "count"), [(0.3, 1), (0.3, 4), (0.1, 12), (0.8, 2)])
def test_sheets_leave_each_their_part_of_what_is_seen_behind_them(opacity, count, presence):
    lit = scene(sheets(opacity, count, is_presence=presence), [lamp("dome")])
    found, error = looked(lit, FLOOR)
    expected = (1.0 - opacity) ** count
    assert abs(found - expected) <= LIT_ERRORS * error, (found, error, expected)
    assert LIT_ERRORS * error < 0.15 * expected


@pytest.mark.parametrize(("kind", "size", "pose"), [
    ("distant", (0.0, 0.0), towards((0.6, 0.0, -1.0))),
    ("disk", (40.0, 0.0), towards((0.0, 0.0, -1.0), (0.0, 0.0, 100.0))),
    ("dome", (0.0, 0.0), None),
])  # fmt: skip
def test_sheets_leave_each_their_part_of_the_light_of_a_lamp(kind, size, pose):
    floor, light = [(plate(500.0, 4000.0), matt(0.5))], [lamp(kind, size, pose)]
    bare, first = looked(scene(floor, light), FLOOR, BELOW)
    found, error = looked(scene(floor + sheets(0.3, 4), light), FLOOR, BELOW)
    assert bare > 0
    assert abs(found - 0.7**4 * bare) <= LIT_ERRORS * (error + first) + 1e-9


def test_sheets_leave_each_their_part_of_the_light_of_a_surface_that_shines():
    """A small one, asked as a lamp; light of the next surface passes them as often."""
    shining = Material(diffuse_color=Input(value=(0.0,) * 3), ior=1.0, emissive_color=Input(value=(50.0,) * 3))
    things = [(plate(500.0, 4000.0), matt(0.5)), (plate(100.0, 10.0), shining)]
    (bare, first), (found, error) = (
        looked(scene(things + veils, [], bounces=1), FLOOR, BELOW) for veils in ([], sheets(0.3, 4))
    )
    assert abs(found - 0.7**4 * bare) <= LIT_ERRORS * (error + first)
    assert LIT_ERRORS * error < 0.05 * found


def test_a_sheet_that_shines_is_as_bright_as_it_is_present():
    for presence, expected in ((True, 0.3), (False, 1.0)):
        glow = sheet(0.3, emissive_color=Input(value=(1.0,) * 3), is_presence=presence)
        things = [(plate(500.0, 4000.0), matt(0.5)), (plate(400.0, 20.0), glow)]
        solid, _ = looked(
            scene([things[0], (things[1][0], sheet(1.0, emissive_color=glow.emissive_color))], []), FLOOR, BELOW
        )
        seen, error = looked(scene(things[1:], []), (0.0, 0.0, 400.0))
        assert abs(seen - expected) <= LIT_ERRORS * error + 1e-9
        light, noise = looked(scene(things, []), FLOOR, BELOW)
        assert abs(light - expected * solid) <= LIT_ERRORS * noise + 0.005 * solid


@pytest.mark.parametrize("more", [{}, {"clearcoat": Input(value=(1.0,)), "clearcoat_roughness": Input(value=(0.2,))}])
def test_white_glass_is_white_in_a_furnace_and_mirrors_where_its_paint_is_clear(more):
    white, eye = (
        {"diffuse_color": Input(value=(1.0,) * 3), "ior": 1.5, "roughness": Input(value=(0.2,)), **more},
        (700.0, 0, 100),
    )
    for opacity in (0.0, 0.4):
        found, error = looked(scene([(plate(500.0), sheet(opacity, **white))], [lamp("dome")]), FLOOR, eye)
        assert abs(found - 1.0) <= LIT_ERRORS * error + FURNACE + 0.01 * bool(more)
    sun = lamp("disk", (60.0, 0.0), towards((0.0, 0.0, -1.0), (0.0, 0.0, -10.0)), (9.0,) * 3)
    mirrored = looked(scene([(plate(500.0), sheet(0.0, **white, is_presence=False))], [sun]), FLOOR)[0]
    absent = looked(scene([(plate(500.0), sheet(0.0, **white, is_presence=True))], [sun]), FLOOR)[0]
    assert mirrored > 0.01
    assert absent == 0.0


def test_opacity_one_is_what_an_opaque_surface_is():
    sun = lamp("distant", (0.0, 0.0), towards((0.6, 0.0, -1.0)))
    solid = Material(diffuse_color=Input(value=(0.5,) * 3), ior=1.0)
    veiled = Material(diffuse_color=Input(value=(0.5,) * 3), ior=1.0, opacity=Input(value=(1.0,)))
    lights = [looked(scene([(plate(500.0), one)], [sun]), FLOOR, rays=8)[0] for one in (solid, veiled)]
    assert lights[0] == lights[1] == pytest.approx(0.5 / math.pi / math.hypot(0.6, 1.0))
