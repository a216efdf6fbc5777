"""Clear coats: they lose no light that they should not, and return what walks on their facets return."""

import math

import numpy as np
import pytest
from laws.lit import lamp, looked, plate, scene
from laws.microfacet_walk import albedo
from tolerances import ALL_REFLECTIONS, COAT_OVER_METAL, COAT_OVER_PLASTIC, FURNACE, LIT_ERRORS

from pipeline.render.lighting.records import Input, Material
from pipeline.render.lighting.reflection import Paint, reflected, scattered, tabled_layers

MIDDLE = (0.0, 0.0, 500.0)
"""The middle of the plate that is looked at [mm]."""
EYES = ((0.0, 0.0, 0.0), (700.0, 0.0, 100.0), (2500.0, 300.0, 200.0))
"""Places that see the middle face on, obliquely, and at a grazing angle [mm]."""
PAINTS = [Paint(0.7, 0.0, 0.0, 1.0, 0.1), Paint(0.4, 0.04, 0.2, 0.6, 0.03), Paint(0.0, 0.9, 0.3, 1.0, 0.5)]


def coated(coat: float, roughness_of_coat: float, reflectance: float = 1.0, **base) -> Material:
    return Material(
        diffuse_color=Input(value=(reflectance,) * 3),
        clearcoat=Input(value=(coat,)),
        clearcoat_roughness=Input(value=(roughness_of_coat,)),
        **base,
    )


def seen(material: Material, eye=EYES[0]) -> tuple[float, float]:
    """Radiance of a plate below an even sky of radiance 1."""
    return looked(scene([(plate(500.0), material)], [lamp("dome")]), MIDDLE, eye)


@pytest.mark.parametrize("roughness", [0.03, 0.3, 0.8])
@pytest.mark.parametrize(
    "base", [{"ior": 1.0}, {"ior": 1.5, "roughness": Input(value=(0.4,))}], ids=["matt", "plastic"]
)
def test_white_paint_below_a_coat_is_white_in_a_furnace_as_far_as_the_base_is_rough(roughness, base):
    """Of what goes to the paint nothing is lost; of what single facets below reflect some hundredths are."""
    for eye in EYES:
        found, error = seen(coated(1.0, roughness, **base), eye)
        assert found <= 1.0 + LIT_ERRORS * error + FURNACE, (eye, found, error)
        lost = 0.0 if base["ior"] == 1.0 else COAT_OVER_PLASTIC
        assert found >= 1.0 - lost - LIT_ERRORS * error - FURNACE, (eye, found, error)


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
def test_a_white_metal_below_a_coat_returns_no_more_than_it_gets(roughness):
    metal = coated(1.0, 0.1, metallic=Input(value=(1.0,)), roughness=Input(value=(roughness,)))
    for eye in EYES:
        found, error = seen(metal, eye)
        assert 1.0 - COAT_OVER_METAL < found <= 1.0 + LIT_ERRORS * error + FURNACE, (eye, found, error)


@pytest.mark.parametrize("roughness", [0.1, 0.5])
@pytest.mark.parametrize("cosine", [1.0, 0.6, 0.2])
@pytest.mark.parametrize("reflectance", [0.0, 0.6])
def test_a_coated_paint_returns_what_walks_on_the_coat_and_the_paint_below_return(roughness, cosine, reflectance):
    """The coat returns a share, on a part of the surface, and the paint its reflectance of the rest."""
    eye, part = (500.0 * math.tan(math.acos(cosine)), 0.0, 0.0), 0.7
    coat = part * float(albedo(roughness, cosine, np.array([0.04]), 200_000)[0])
    expected = coat + reflectance * (1.0 - coat)
    found, error = seen(coated(part, roughness, reflectance, ior=1.0), eye)
    assert abs(found - expected) <= LIT_ERRORS * error + ALL_REFLECTIONS * coat, (found, error, expected)


@pytest.mark.parametrize("paint", PAINTS)
def test_reflection_of_a_coated_surface_is_reciprocal(paint):
    one, other = (0.3, 0.2, math.sqrt(0.87)), (-0.5, 0.6, math.sqrt(0.39))
    there, back = (reflected.function(tabled_layers(), paint, a, b)[0] / b[2] for a, b in ((one, other), (other, one)))
    assert there == pytest.approx(back, rel=1e-12) and there > 0


@pytest.mark.parametrize("paint", PAINTS)
def test_directions_from_a_coated_surface_are_chosen_with_the_density_that_is_stated(paint):
    """Means over chosen directions of 1 / density count the solid angle of a part of the sky."""
    table, total = tabled_layers(), []
    for pair in np.random.default_rng(1).random((1 << 13, 2)):
        lit = scattered(table, paint, (0.5, 0.1, math.sqrt(0.74)), (pair[0], pair[1]))
        density = reflected(table, paint, (0.5, 0.1, math.sqrt(0.74)), lit)[1]
        total.append(1.0 / density if lit[2] > 0.5 and lit[0] > 0.0 and density > 0 else 0.0)
    assert abs(np.mean(total) - math.pi / 2) <= LIT_ERRORS * np.std(total) / math.sqrt(len(total))
