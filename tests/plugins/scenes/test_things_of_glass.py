"""Materials with PlenGlassAPI as they are read, and what is said about those that are no glass."""

import numpy as np
import pytest
from plugins.scenes.lit import block, looked, plate
from plugins.scenes.stage_materials import material_text
from plugins.scenes.test_lighting import SUN, lit, loaded
from tolerances import LIT_ERRORS

from pipeline.plugins.scenes.reading import solids
from pipeline.targets.mesh import Occluder, is_closed

BALL = """
    def Sphere "Ball" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        rel material:binding = </Scene/Clear>
        double radius = 50
        double3 xformOp:translate = (0, 0, -500)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
""" + material_text(
    "/Scene/Clear", "float inputs:opacity = 0.1", "float inputs:roughness = 0", "%s", own="%s", schemas="PlenGlassAPI"
)
SKY = """
    def DomeLight "Sky"
    {
    }
"""


def glass_of(folder, more: str = "", surface: str = ""):
    found = loaded(folder, SUN + BALL % (more, surface))
    assert found.errors == [], [str(problem) for problem in found.errors]
    return found.dataset.occluders[0].finish.materials[0].glass


@pytest.mark.parametrize(
    ("more", "surface", "index"),
    [
        ('uniform string plen:glass = "schott:N-BK7"', "", 1.5168),  # as the maker prints it
        ('uniform string plen:glass = "sellmeier(1.1819, 0.011313)"', "", 1.4906),  # acrylic, as published
        ("", "float inputs:ior = 1.33", 1.33),
        ("", "", 1.5),
    ],
)
def test_glass_has_the_index_of_its_name_its_formula_or_its_surface(tmp_path, more, surface, index):
    glass = glass_of(tmp_path, more, surface)
    assert np.interp(587.56, glass.wavelengths_nm, glass.indices) == pytest.approx(index, abs=5e-5)
    blue, red = np.interp([486.13, 656.27], glass.wavelengths_nm, glass.indices)
    assert (blue > red) == bool(more)


def test_glass_absorbs_what_its_stage_says(tmp_path):
    glass = glass_of(
        tmp_path,
        "uniform double3 plen:internalTransmittanceColor = (0.5, 1, 1)\n"
        "uniform double plen:internalTransmittanceThickness = 3",
    )
    assert (glass.transmittance, glass.thickness_mm) == ((0.5, 1.0, 1.0), 3.0)


def test_a_solid_of_glass_is_a_body(tmp_path):
    """Nothing is seen of it below an even sky."""
    scene = lit(tmp_path, SKY + BALL % ("", ""))
    found, error = looked(scene, (30.0, 0.0, 500.0))
    assert abs(found - 1.0) <= LIT_ERRORS * error + 1e-9


@pytest.mark.parametrize(
    ("more", "surface", "code", "at"),
    [
        ('uniform string plen:glass = "schott:N-BK77"', "", "unknown-glass", "Clear.plen:glass"),
        ('uniform string plen:glass = "cauchy(one)"', "", "glass-formula", "Clear.plen:glass"),
        ('uniform string plen:glass = "constant(99)"', "", "unreadable-value", "Clear.plen:glass"),
        ("", "float inputs:ior = 0.7", "unreadable-value", "Clear/Surface.inputs:ior"),
        ("uniform double3 plen:internalTransmittanceColor = (0, 1, 1)", "", "out-of-range", "Clear.plen:internal"),
    ],
)
def test_glass_that_does_not_exist_is_an_error_with_its_place(tmp_path, more, surface, code, at):
    (error,) = loaded(tmp_path, SUN + BALL % (more, surface)).errors
    assert error.code == code
    assert error.at.startswith(f"/Scene/{at}")
    assert error.line


def test_points_behind_glass_and_what_it_does_not_draw_are_warned_of(tmp_path):
    told = loaded(tmp_path, SUN + BALL % ("", "float inputs:metallic = 1")).problems
    texts = [str(problem) for problem in told if problem.code == "not-drawn"]
    assert len(texts) == 2
    assert any("no ground truth" in text and "</Scene/Ball>" in text for text in texts)
    assert any("without its metallic" in text for text in texts)
    open_one = (SUN + BALL % ("", "")).replace('Sphere "Ball"', 'Plane "Ball"').replace("double radius = 50", "")
    assert any("drawn as panes" in str(problem) for problem in loaded(tmp_path, open_one).problems)


def test_solids_but_planes_are_closed_and_so_is_a_box_with_a_seam():
    for solid in (solids.sphere(5, 0.1), solids.frustum(3, 0, 5, 0.1), solids.capsule(1, 1, 3, 0.1), solids.cube(1)):
        assert is_closed(solid.points, solid.triangles)
    plane = solids.plane(1, 2)
    assert not is_closed(plane.points, plane.triangles)
    box = block((-1.0, -1.0, 0.0), (1.0, 1.0, 3.0))
    corners = tuple(map(tuple, box.corners_mm().reshape(-1, 3).tolist()))
    apart = Occluder(vertices_mm=corners, triangles=tuple((3 * k, 3 * k + 1, 3 * k + 2) for k in range(12)))
    assert box.is_closed()
    assert apart.is_closed()
    assert not Occluder(vertices_mm=corners, triangles=apart.triangles[1:]).is_closed()
    assert not plate(1.0).is_closed()
