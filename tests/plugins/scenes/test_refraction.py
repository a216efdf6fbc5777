"""Glass in a scene: where its light goes, and how much of it; and sheets that light passes straight on, each of which
leaves what it does not cover.
"""

import math

import numpy as np
import pytest
from plugins.scenes.lit import agrees, ball, block, glass, lamp, looked, matt, mesh, plate, scene, sky_on, towards
from tolerances import FURNACE, LIT_ERRORS

from pipeline.plugins.scenes.lighting.records import Finish, Glass, Input, Material
from pipeline.plugins.scenes.lighting.reflection import Paint
from pipeline.plugins.scenes.lighting.refraction import glass_reflected, glass_scattered
from pipeline.targets.mesh import Occluder

SHINING = Material(diffuse_color=Input(value=(0.0,) * 3), ior=1.0, emissive_color=Input(value=(1.0,) * 3))
SLAB = block((-400.0, -400.0, 300.0), (400.0, 400.0, 320.0))
"""A plate of 20 mm, 300 mm before the eye."""
EDGE_MM = 1e-3
"""Distance from an edge at which a ray is surely beside it [mm]: that of rays from the surfaces that they leave."""


def beyond(angle: float, index: float = 1.5) -> float:
    return math.asin(math.sin(angle) / index)


def reflectance(angle: float, index: float = 1.5) -> float:
    """Fresnel's equations as they are printed, with sines and tangents."""
    if angle == 0:
        return ((index - 1) / (index + 1)) ** 2
    inner = beyond(angle, index)
    across = math.sin(angle - inner) / math.sin(angle + inner)
    within = math.tan(angle - inner) / math.tan(angle + inner)
    return (across**2 + within**2) / 2


def of_slab(angle: float, left: float = 1.0) -> tuple[float, float]:
    """Light that a plate lets through and sends back, with all reflections inside; `left` by one way through it."""
    once = reflectance(angle)
    through = (1 - once) ** 2 * left / (1 - (once * left) ** 2)
    return through, once * (1 + through * left)


def turned(thing: Occluder) -> Occluder:
    """A mesh that was written inside out."""
    return mesh(thing.vertices_mm, [(a, c, b) for a, b, c in thing.triangles])


def ball_of_glass(radius_mm: float, index: float) -> tuple[Occluder, Finish]:
    return ball((0.0, 0.0, 100.0), radius_mm, glass(index), 5e-4)


def sees_edge(things, x_mm: float, way, z_mm: float = 500.0, edge_mm: float = EDGE_MM, **more) -> bool:
    """Whether a ray of the camera meets a plane just where a bright half of it ends."""
    lights = []
    for edge in (x_mm - edge_mm, x_mm + edge_mm):
        bright = plate(z_mm, 200.0, edge + 200.0)
        lights.append(looked(scene([*things, (bright, SHINING)], [], **more), way, rays=256)[0])
    return lights[0] > 0.8 and lights[1] < 0.05


@pytest.mark.parametrize("thing", [SLAB, turned(SLAB)])
@pytest.mark.parametrize(("wavelength_nm", "index"), [(450.0, 1.6), (500.0, 1.55), (550.0, 1.5)])
def test_a_plate_shifts_what_is_behind_it_as_snell_says_at_each_wavelength(thing, wavelength_nm, index):
    flint = Glass(wavelengths_nm=(450.0, 550.0), indices=(1.6, 1.5))
    things = [(thing, Material(roughness=Input(value=(0.0,)), glass=flint))]
    angle = math.radians(40.0)
    x_mm = 480.0 * math.tan(angle) + 20.0 * math.tan(beyond(angle, index))
    assert sees_edge(things, x_mm, (math.tan(angle), 0.0, 1.0), wavelength_nm=wavelength_nm)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 56.31, 80.0])
def test_black_glass_reflects_what_fresnel_says(degrees):
    """At Brewster's angle only light that swings across the plane of incidence."""
    black = glass(transmittance=(1e-12,) * 3, thickness_mm=0.1)
    angle = math.radians(degrees)
    look = looked(scene([(SLAB, black)], [lamp("dome")]), (0.0, 0.0, 300.0), (-300.0 * math.tan(angle), 0, 0))
    agrees(look, reflectance(angle), noise=0.05)


@pytest.mark.parametrize("degrees", [0.0, 50.0])
def test_a_plate_lets_through_what_it_neither_reflects_nor_absorbs(degrees):
    angle = math.radians(degrees)
    left = 0.5 ** (20.0 / 10.0 / math.cos(beyond(angle)))
    grey = glass(transmittance=(0.5,) * 3, thickness_mm=10.0)
    for front, expected in zip((False, True), of_slab(angle, left), strict=True):
        floor, eye = (plate(600.0 if not front else 100.0, 4e4), SHINING), (0.0, 0.0, 200.0)
        at = (100.0 * math.tan(angle), 0.0, 300.0)
        agrees(looked(scene([(SLAB, grey), floor], []), at, eye), expected)


@pytest.mark.parametrize("degrees", [0.0, 50.0])
def test_a_mesh_that_is_not_closed_is_a_pane(degrees):
    """It lets through what a plate does, and does not shift it."""
    angle = math.radians(degrees)
    pane, floor = (plate(300.0), glass()), (plate(500.0, 4e4), SHINING)
    agrees(looked(scene([pane, floor], []), (math.tan(angle), 0.0, 1.0)), of_slab(angle)[0])
    assert sees_edge([pane], 500.0 * math.tan(angle / 2), (math.tan(angle / 2), 0.0, 1.0))


def test_light_that_meets_a_side_face_from_inside_is_totally_reflected():
    """It leaves on the other side as if the block were folded there, and nothing comes from the lamp beside it."""
    thing, angle = block((-400.0, -400.0, 300.0), (10.0, 400.0, 400.0)), math.radians(30.0)
    beside = lamp("rect", (30.0, 30.0), towards((1.0, 0.0, 0.0), (50.0, 0.0, 350.0)), (1e3,) * 3)
    eye = (5.0 - 300.0 * math.tan(angle), 0.0, 0.0)
    lit = scene([(thing, glass()), (plate(500.0, 4e4, -4e4), SHINING)], [beside])
    agrees(looked(lit, (5.0, 0, 300), eye), of_slab(angle)[0])


@pytest.mark.parametrize("off_mm", [0.5, 12.0, 17.0])
def test_a_ball_images_as_its_rays_say(off_mm):
    """Upside down. A ray passes the centre as far off behind the ball as before it, turned by twice what a face bends;
    near the axis as by a thin lens of the focal length n R / 2 (n - 1), here 30 mm."""
    radius_mm, index, aim = 20.0, 1.5, math.asin(off_mm / 100.0)
    out = aim - 2 * (math.asin(off_mm / radius_mm) - math.asin(off_mm / index / radius_mm))
    x_mm = (off_mm + 100.0 * math.sin(out)) / math.cos(out)
    assert off_mm > 1.0 or x_mm == pytest.approx(off_mm + 100.0 * off_mm * (1 / 100.0 - 1 / 30.0), rel=1e-3)
    assert sees_edge([ball_of_glass(radius_mm, index)], x_mm, (math.tan(aim), 0.0, 1.0), 200.0, edge_mm=0.1)


def test_a_ball_of_glass_is_not_seen_where_light_is_the_same_everywhere():
    lit = scene([ball_of_glass(20.0, 1.8)], [lamp("dome")])
    for at in ((0.0, 0.0, 100.0), (12.0, 0.0, 100.0), (19.9, 0.0, 100.0)):
        agrees(looked(lit, at), 1.0, 1e-9)


@pytest.mark.parametrize(("roughness", "lost"), [(0.1, 0.002), (0.3, 0.02), (0.5, 0.11)])
def test_a_rough_plate_loses_no_more_than_its_page_says(roughness, lost):
    """Light that goes from facet to facet; none comes from nowhere."""
    found, error = looked(scene([(SLAB, glass(roughness=roughness))], [lamp("dome")], bounces=30), (0.0, 0.0, 1.0))
    assert 1 - lost < found < 1 + LIT_ERRORS * error


def mean_of_slab(nodes: int = 400) -> float:
    """Mean of the light that a plate lets through, over a hemisphere."""
    sines = (np.arange(nodes) + 0.5) / nodes
    return float(np.mean([of_slab(math.asin(math.sqrt(square)))[0] for square in sines]))


@pytest.mark.parametrize("kind", ["dome", "distant"])
def test_a_floor_behind_a_plate_gets_what_that_lets_through(kind):
    """Of an even sky by paths that meet it, of other lamps straight on; and what the plate sends back to the floor."""
    reflectance_of_floor, mean = 0.6, mean_of_slab()
    sun = lamp(kind, (0.0, 0.0), towards((0.6, 0.0, -1.0)) if kind == "distant" else None)
    slope, cosine = math.atan(0.6), 1 / math.hypot(0.6, 1.0)
    light = mean if kind == "dome" else of_slab(slope)[0] * cosine / math.pi
    wide = block((-4e4, -4e4, 300.0), (4e4, 4e4, 310.0))
    lit = scene([(wide, glass()), (plate(400.0, 4e4), matt(reflectance_of_floor))], [sun], bounces=8)
    expected = reflectance_of_floor * light / (1 - reflectance_of_floor * (1 - mean))
    agrees(looked(lit, (0.0, 0.0, 400.0), (100.0, 0.0, 380.0)), expected, 0.002 * expected)


def walter(index: float, alpha: float, seen: np.ndarray, lit: np.ndarray) -> float:
    """Light that arrives along `seen` by a facet from `lit`, times its cosine, as the paper writes it: with indices on
    both sides, masking by tangents and half vectors of length one."""
    cosine_o, cosine_i = seen[2], lit[2]
    index_o, index_i = (1.0, index) if cosine_o > 0 else (index, 1.0)
    is_mirrored = cosine_o * cosine_i > 0
    half = np.sign(cosine_i) * (seen + lit) if is_mirrored else -(index_i * lit + index_o * seen)
    half = half / np.linalg.norm(half)
    glance_i, glance_o = lit @ half, seen @ half
    tangent = (1 - half[2] ** 2) / half[2] ** 2
    spread = alpha**2 / (math.pi * half[2] ** 4 * (alpha**2 + tangent) ** 2) * (half[2] > 0)

    def masked(cosine: float, glance: float) -> float:
        return 2 / (1 + math.sqrt(1 + alpha**2 * (1 - cosine**2) / cosine**2)) * (glance * cosine > 0)

    c, ratio = abs(glance_i), (index if cosine_i > 0 else 1 / index)
    square = ratio**2 - 1 + c * c
    g = math.sqrt(max(square, 0.0))
    share = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2) if square > 0 else 1.0
    shape = spread * masked(cosine_i, glance_i) * masked(cosine_o, glance_o)
    if is_mirrored:
        return share * shape / (4 * abs(cosine_i * cosine_o)) * abs(cosine_i)
    size = index_i * glance_i + index_o * glance_o
    return abs(glance_i * glance_o) * index_o**2 * (1 - share) * shape / (abs(cosine_o) * size**2)


def directions(count: int, seed: int) -> np.ndarray:
    z, turn = np.random.default_rng(seed).uniform(-1, 1, count), np.random.default_rng(seed + 1).uniform(0, 7, count)
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


@pytest.mark.parametrize("is_inside", [False, True])
def test_rough_glass_is_that_of_the_paper(is_inside):
    """Seen from inside, the frame of the surface and its paint are those of that side."""
    sign, index = (-1.0 if is_inside else 1.0), 1.5
    for seen, lit in zip(directions(200, 1), directions(200, 3), strict=True):
        seen[2], alpha = abs(seen[2]), 0.4
        paint = Paint(0.0, 0.0, alpha, ratio=1 / index if is_inside else index)
        found, _ = glass_reflected(paint, tuple(seen.tolist()), tuple(lit.tolist()))
        assert found == pytest.approx(walter(index, alpha, sign * seen, sign * lit), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("ratio", [1.5, 1 / 1.5])
@pytest.mark.parametrize("cosine", [0.95, 0.4])
def test_directions_of_rough_glass_come_as_densely_as_stated(ratio, cosine):
    """Means over drawn directions are integrals over all of them: of one, and of the light of either side."""
    paint, seen = Paint(0.0, 0.0, 0.4, ratio=ratio), (math.sqrt(1 - cosine**2), 0.0, cosine)
    u, v = np.meshgrid((np.arange(128) + 0.5) / 128, (np.arange(64) + 0.5) / 64)
    dice = np.random.default_rng(1).random((u.size, 2))
    drawn = [
        glass_scattered(paint, seen, (u.flat[k], v.flat[k]), one) for k in range(u.size) for one in dice[k].tolist()
    ]
    total, lit = len(drawn), np.array([each for each in drawn if each[2] != 0.0])
    steps = 180
    angle, turn = np.meshgrid((np.arange(steps) + 0.5) * math.pi / steps, (np.arange(72) + 0.5) * math.pi / 72)
    all_of_them = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=-1)
    each_sr = (2 * np.sin(angle) * (math.pi / steps) * (math.pi / 72)).ravel()
    on_grid, at = (
        np.array([glass_reflected(paint, seen, tuple(one)) for one in some.reshape(-1, 3).tolist()])
        for some in (all_of_them, lit)
    )
    assert each_sr @ on_grid[:, 1] == pytest.approx(len(lit) / total, abs=0.005)
    for side in (1, -1):
        whole = each_sr[(beyond := side * np.cos(angle).ravel() > 0)] @ on_grid[beyond, 0]
        assert whole == pytest.approx((at[:, 0] / at[:, 1])[side * lit[:, 2] > 0].sum() / total, rel=0.03, abs=0.003)


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
    agrees(looked(lit, FLOOR), (1.0 - opacity) ** count, noise=0.15)


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
    agrees((found, error + first), 0.7**4 * bare, 1e-9)


def test_sheets_leave_each_their_part_of_the_light_of_a_surface_that_shines():
    """A small one, asked as a lamp; light of the next surface passes them as often."""
    shining = Material(diffuse_color=Input(value=(0.0,) * 3), ior=1.0, emissive_color=Input(value=(50.0,) * 3))
    things = [(plate(500.0, 4000.0), matt(0.5)), (plate(100.0, 10.0), shining)]
    (bare, first), (found, error) = (
        looked(scene(things + veils, [], bounces=1), FLOOR, BELOW) for veils in ([], sheets(0.3, 4))
    )
    agrees((found, error + first), 0.7**4 * bare)
    assert LIT_ERRORS * error < 0.05 * found


def test_a_sheet_that_shines_is_as_bright_as_it_is_present():
    for presence, expected in ((True, 0.3), (False, 1.0)):
        glow = sheet(0.3, emissive_color=Input(value=(1.0,) * 3), is_presence=presence)
        things = [(plate(500.0, 4000.0), matt(0.5)), (plate(400.0, 20.0), glow)]
        solid, _ = looked(
            scene([things[0], (things[1][0], sheet(1.0, emissive_color=glow.emissive_color))], []), FLOOR, BELOW
        )
        agrees(looked(scene(things[1:], []), (0.0, 0.0, 400.0)), expected, 1e-9)
        agrees(looked(scene(things, []), FLOOR, BELOW), expected * solid, 0.005 * solid)


@pytest.mark.parametrize("more", [{}, {"clearcoat": Input(value=(1.0,)), "clearcoat_roughness": Input(value=(0.2,))}])
def test_white_glass_is_white_in_a_furnace_and_mirrors_where_its_paint_is_clear(more):
    white = {"diffuse_color": Input(value=(1.0,) * 3), "ior": 1.5, "roughness": Input(value=(0.2,)), **more}
    for opacity in (0.0, 0.4):
        agrees(sky_on(sheet(opacity, **white), (700.0, 0, 100)), 1.0, FURNACE + 0.01 * bool(more))
    sun = lamp("disk", (60.0, 0.0), towards((0.0, 0.0, -1.0), (0.0, 0.0, -10.0)), (9.0,) * 3)
    mirrored = looked(scene([(plate(500.0), sheet(0.0, **white, is_presence=False))], [sun]), FLOOR)[0]
    absent = looked(scene([(plate(500.0), sheet(0.0, **white, is_presence=True))], [sun]), FLOOR)[0]
    assert mirrored > 0.01
    assert absent == 0.0
