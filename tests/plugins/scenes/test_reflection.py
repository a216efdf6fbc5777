"""Surfaces, clear coats among them, lose no light that they should not: white furnaces, facets and reciprocity, and
light to and fro between plates.
"""

import math

import numpy as np
import pytest
from colour import MSDS_CMFS, RGB_COLOURSPACES, SDS_ILLUMINANTS, SpectralShape
from laws.rigs import facing
from plugins.scenes.lit import agrees, lamp, looked, matt, named, plate, scene, sky_on, towards
from plugins.scenes.microfacet_walk import albedo
from shorter import few
from tolerances import (
    ALL_REFLECTIONS,
    COAT_OVER_METAL,
    COAT_OVER_PLASTIC,
    FURNACE,
    LIT_ERRORS,
    SAME_COLOUR,
)

from pipeline.plugins.scenes.lighting.records import Coat, Input, Material
from pipeline.plugins.scenes.lighting.reflection import Paint, reflected, scattered, tabled_layers, viewed_along
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target

EYES = ((0.0, 0.0, 0.0), (700.0, 0.0, 100.0), (2500.0, 300.0, 200.0))
"""Places that see the middle of a plate face on, obliquely, and at a grazing angle [mm]."""
ALONE = (0.0, 0.0, 500.0)
"""The middle of the plate [mm]."""


def white(roughness: float, metallic: float, **more) -> Material:
    one = Input(value=(1.0, 1.0, 1.0))
    return Material(diffuse_color=one, roughness=Input(value=(roughness,)), metallic=Input(value=(metallic,)), **more)


FURNACES = {
    **{f"roughness {r}, metallic {m}": white(r, m) for r in (0.05, 0.26, 0.3, 0.34, 0.7, 1.0) for m in (0.0, 1.0)},
    "diamond": white(0.4, 0.0, ior=2.4),
    "specular workflow": white(0.5, 0.0, specular_color=Input(value=(0.6, 0.6, 0.6))),
    "matt": matt(1.0),
}


@pytest.mark.parametrize("material", FURNACES.values(), ids=FURNACES)
def test_a_white_furnace_is_white_for_every_material_that_absorbs_nothing(material):
    for eye in EYES:
        agrees(sky_on(material, eye), 1.0, FURNACE)


FACINGS = 0.04, 0.1, 0.3, 0.6, 0.9, 1.0
"""Reflectances of metals face on; the first is that of the coat of plastic."""


@pytest.mark.parametrize("roughness", few([0.5], 0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0))
@pytest.mark.parametrize("cosine", few([1.0, 0.2], 0.6))
def test_a_metal_returns_what_walks_on_its_facets_return(roughness, cosine):
    """Below an even sky, seen at an angle: single reflections and all further ones, each of which absorbs."""
    eye = (500.0 * math.tan(math.acos(cosine)), 0.0, 0.0)
    walked = albedo(roughness, cosine, np.array(FACINGS), 300_000)
    for face_on, expected in zip(FACINGS, walked, strict=True):
        metal = Material(
            diffuse_color=Input(value=(face_on,) * 3), roughness=Input(value=(roughness,)), metallic=Input(value=(1.0,))
        )
        found, error = sky_on(metal, eye, 1 << 15)
        assert abs(found / expected - 1.0) <= ALL_REFLECTIONS, (face_on, found, error, expected)


def coated(coat: float, roughness_of_coat: float, reflectance: float = 1.0, **base) -> Material:
    return Material(
        diffuse_color=Input(value=(reflectance,) * 3),
        clearcoat=Input(value=(coat,)),
        clearcoat_roughness=Input(value=(roughness_of_coat,)),
        **base,
    )


@pytest.mark.parametrize("roughness", [0.03, 0.3, 0.8])
@pytest.mark.parametrize(
    "base", [{"ior": 1.0}, {"ior": 1.5, "roughness": Input(value=(0.4,))}], ids=["matt", "plastic"]
)
def test_white_paint_below_a_coat_is_white_in_a_furnace_as_far_as_the_base_is_rough(roughness, base):
    """Of what goes to the paint nothing is lost; of what single facets below reflect some hundredths are."""
    for eye in EYES:
        found, error = sky_on(coated(1.0, roughness, **base), eye)
        assert found <= 1.0 + LIT_ERRORS * error + FURNACE, (eye, found, error)
        lost = 0.0 if base["ior"] == 1.0 else COAT_OVER_PLASTIC
        assert found >= 1.0 - lost - LIT_ERRORS * error - FURNACE, (eye, found, error)


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
def test_a_white_metal_below_a_coat_returns_no_more_than_it_gets(roughness):
    metal = coated(1.0, 0.1, metallic=Input(value=(1.0,)), roughness=Input(value=(roughness,)))
    for eye in EYES:
        found, error = sky_on(metal, eye)
        assert 1.0 - COAT_OVER_METAL < found <= 1.0 + LIT_ERRORS * error + FURNACE, (eye, found, error)


@pytest.mark.parametrize("roughness", [0.1, 0.5])
@pytest.mark.parametrize("cosine", [1.0, 0.6, 0.2])
@pytest.mark.parametrize("reflectance", [0.0, 0.6])
def test_a_coated_paint_returns_what_walks_on_the_coat_and_the_paint_below_return(roughness, cosine, reflectance):
    """The coat returns a share, on a part of the surface, and the paint its reflectance of the rest."""
    eye, part = (500.0 * math.tan(math.acos(cosine)), 0.0, 0.0), 0.7
    coat = part * float(albedo(roughness, cosine, np.array([0.04]), 200_000)[0])
    look = sky_on(coated(part, roughness, reflectance, ior=1.0), eye)
    agrees(look, coat + reflectance * (1.0 - coat), ALL_REFLECTIONS * coat)


def spot(reflectance: float, beyond: Material, bounces: int) -> np.ndarray:
    """Radiances of paths from a small matt spot of a wall, which sees a plate and a lamp."""
    light = lamp("sphere", (50.0, 0.0), towards((0.0, 0.0, 1.0), (150.0, 0.0, 300.0)))
    things = [(plate(500.0, 1e-3), matt(reflectance)), (plate(501.0), matt(0.8)), (plate(-100.0), beyond)]
    way = np.tile([0.0, 0.0, 1.0], (1 << 14, 1))
    return scene(things, [light], bounces=bounces).radiance(np.zeros_like(way), way, named(len(way)))


@pytest.mark.parametrize("bounces", [1, 6])
def test_noise_does_not_depend_on_how_dark_the_first_surface_is(bounces):
    """Path by path light is as its first surface reflects it: none ends because it is faint."""
    mirror = Material(
        diffuse_color=Input(value=(0.9,) * 3), roughness=Input(value=(0.1,)), metallic=Input(value=(1.0,))
    )
    light = spot(0.8, mirror, bounces)
    assert light.std() > light.mean()
    np.testing.assert_allclose(spot(0.04, mirror, bounces) / 0.04, light / 0.8, rtol=1e-9)


def test_noise_does_not_depend_on_how_dark_the_second_surface_is():
    dark, light, without = (spot(0.8, matt(beyond), 1) for beyond in (0.04, 0.8, 0.0))
    assert light.mean() > 1.01 * without.mean()
    np.testing.assert_allclose((dark - without) / 0.04, (light - without) / 0.8, atol=1e-9)


def test_a_furnace_is_white_with_a_coated_target_too():
    board = Target(Checkerboard(columns=4, rows=3, square_mm=10.0, white=1.0, black=1.0))
    lit = scene([], [lamp("dome")], targets=[(board, facing(500.0), Coat(roughness=0.2))])
    agrees(looked(lit, (5.0, 5.0, 500.0), (100.0, 0.0, 0.0)), 1.0, FURNACE)


def test_no_surface_returns_more_than_it_gets():
    for roughness in (0.1, 0.6):
        for metallic in (0.3, 0.7):
            found, error = sky_on(white(roughness, metallic), EYES[1])
            assert 0.5 < found < 1.0 + LIT_ERRORS * error


COATED = [Paint(0.7, 0.0, 0.0, 1.0, 0.1), Paint(0.4, 0.04, 0.2, 0.6, 0.03), Paint(0.0, 0.9, 0.3, 1.0, 0.5)]


@pytest.mark.parametrize("paint", [Paint(0.7, 0.04, 0.2), Paint(0.0, 0.9, 0.05), Paint(0.3, 0.5, 1.0), *COATED])
def test_reflection_is_reciprocal(paint):
    one, other = (0.3, 0.2, math.sqrt(0.87)), (-0.5, 0.6, math.sqrt(0.39))
    seen = (viewed_along.function(tabled_layers(), paint, way) for way in (one, other))
    there, back = (
        reflected.function(tabled_layers(), paint, at, lit)[0] / lit[2]
        for at, lit in zip(seen, (other, one), strict=True)
    )
    assert there == pytest.approx(back, rel=1e-12) and there > 0


@pytest.mark.parametrize("paint", [Paint(0.7, 0.04, 0.2), Paint(0.3, 0.5, 0.6), *COATED])
def test_directions_are_chosen_with_the_density_that_is_stated(paint):
    """Means over chosen directions of 1 / density count the solid angle of a part of the sky."""
    table, total = tabled_layers(), []
    seen = viewed_along(table, paint, (0.5, 0.1, math.sqrt(0.74)))
    for pair in np.random.default_rng(1).random((1 << 13, 2)):
        lit = scattered(paint, seen, (pair[0], pair[1]))
        density = reflected(table, paint, seen, lit)[1]
        inside = lit[2] > 0.5 and lit[0] > 0.0
        total.append(1.0 / density if inside and density > 0 else 0.0)
    agrees((np.mean(total), np.std(total) / math.sqrt(len(total))), math.pi / 2)


@pytest.mark.parametrize("bounces", [0, 1, 2, 6])
def test_light_between_two_endless_plates_is_a_geometric_series(bounces):
    """A plate that shines with radiance 1 and reflects a, opposite one that reflects b: what leaves the second one is
    b (1 + ab + ...), each reflection a bounce."""
    a, b = 0.5, 0.8
    shining = Material(diffuse_color=Input(value=(a,) * 3), ior=1.0, emissive_color=Input(value=(1.0, 1.0, 1.0)))
    lit = scene([(plate(500.0, 1e6), matt(b)), (plate(-500.0, 1e6), shining)], [], bounces=bounces)
    # The first plate is one vertex of the path. The path itself meets the light that its gloss reflects.
    expected = sum(b * (a * b) ** (k // 2) for k in range(0, bounces + 1, 2))
    agrees(looked(lit, ALONE), expected, 1e-5 * expected)


def test_a_surface_has_the_colour_in_daylight_that_it_is_given():
    """Radiances at many wavelengths, weighted by daylight and the standard observer, make its colour again."""
    given = (0.7, 0.2, 0.05)
    wavelengths = np.arange(400.0, 701.0, 20.0)
    painted = Material(diffuse_color=Input(value=given), ior=1.0)
    seen = [
        looked(scene([(plate(500.0), painted)], [lamp("dome")], wavelength_nm=nm), ALONE, EYES[1], 4)[0]
        for nm in wavelengths
    ]
    light = SDS_ILLUMINANTS["D65"].copy().align(SpectralShape(400, 700, 20)).values
    observer = MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(SpectralShape(400, 700, 20)).values
    xyz = (np.array(seen) * light) @ observer / (light @ observer[:, 1])
    assert RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ xyz == pytest.approx(given, abs=SAME_COLOUR)


def test_a_smooth_coat_mirrors_a_lamp_with_the_share_of_fresnel():
    """Black ink below a coat shows a lamp at the mirrored place, 0.04 times as bright, and nothing beside it."""
    board = Target(Checkerboard(columns=4, rows=3, square_mm=40.0, white=0.0, black=0.0))
    light = lamp("disk", (60.0, 0.0), towards((0.0, 0.0, -1.0), (40.0, 0.0, -10.0)))
    lit = scene([], [light], targets=[(board, facing(500.0), Coat(roughness=0.03))])
    assert looked(lit, (20.0, 0.0, 500.0))[0] == pytest.approx(0.04, rel=0.02)
    assert looked(lit, (60.0, 0.0, 500.0))[0] < 1e-4
