"""Claim: a warm lens is the prescribed one with other indices and scaled lengths, and nothing else.

Judged by scaling, by the focal length of a thin lens in closed form, and by the tasks of a lens that is not warm.
"""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from stage_text import tiny_text

from pipeline.app.build import project
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.lattice import lattice
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Relief, Surface
from pipeline.scene.load import load
from pipeline.scene.temperature import scaled, scaled_array

SHAPES = ("even_coefficients", "odd_coefficients", "relief")
GLASSES = ("S1", "S3", "S4", "S7", "S8", "S10")
ALUMINIUM = 23.6


def over(name: str, *lines: str) -> str:
    return "\n".join([f'over "{name}"', "{", *(f"uniform double plen:{line}" for line in lines), "}", ""])


def stage(folder: Path, celsius: float | None, *overs: str, mount: float = ALUMINIUM) -> Path:
    path, sensor = folder / f"at_{celsius}.usda", '        over "Sensor"\n'
    lines = [] if celsius is None else [f"double plen:temperature = {celsius}"]
    lines += [] if celsius is None else [f"uniform double plen:mountExpansion = {mount}"]
    lens = "\n".join(['over "Lens"', "{", *lines, *overs, "}", ""])
    path.write_text(tiny_text("conventional", (sensor, lens + sensor)), encoding="utf-8")
    return path


def camera(path: Path) -> Camera:
    loaded = load(path)
    assert not loaded.errors, loaded.errors
    return loaded.cameras[0].camera


def known(slope: float, expansion: float) -> list[str]:
    return [over(name, f"indexSlope = {slope}", f"expansion = {expansion}") for name in GLASSES]


def test_a_lens_at_the_temperature_of_its_prescription_has_the_tasks_of_one_without(tmp_path):
    plain, same, warm = (project(stage(tmp_path, celsius, *known(2.0, 7.0))).graph for celsius in (None, 20.0, 20.001))
    assert {name: plain[name] for name in plain} == {name: same[name] for name in same}
    assert any(plain[name] != warm[name] for name in plain)


def test_a_lens_that_warms_up_is_a_camera_at_each_temperature(tmp_path):
    cold, warm = (camera(stage(tmp_path, celsius, *known(2.0, 7.0))) for celsius in (20.0, 40.0))
    path = stage(tmp_path, 20.0, *known(2.0, 7.0))
    text = path.read_text(encoding="utf-8").replace("temperature = 20.0", "temperature.timeSamples = { 1: 20, 2: 40 }")
    path.write_text(text, encoding="utf-8")
    assert [of.camera for of in load(path).dataset.cameras] == [cold, warm]


def test_what_expands_alike_is_the_same_camera_larger(tmp_path):
    """The microscope of similar triangles: all lengths of the lens, and the distance of the sensor."""
    cold, warm = (camera(stage(tmp_path, celsius, *known(0.0, 23.6))) for celsius in (20.0, 70.0))
    growth = 1 + 23.6e-6 * 50
    lengths = [first_order(of.prescription) for of in (cold, warm)]
    assert lengths[1].efl_mm == pytest.approx(growth * lengths[0].efl_mm, rel=1e-13)
    assert lengths[1].bfd_mm == pytest.approx(growth * lengths[0].bfd_mm, rel=1e-13)
    assert warm.sensor_distance_mm == pytest.approx(growth * cold.sensor_distance_mm, rel=1e-15)
    for before, after in zip(cold.prescription.surfaces, warm.prescription.surfaces, strict=True):
        assert after.index == before.index
        assert after.semi_diameter_mm == pytest.approx(growth * before.semi_diameter_mm, rel=1e-15)


FACES = [
    "uniform double plen:index = 1.5",
    "uniform double plen:thickness = 0.4",
    "uniform double[] plen:frontRadii = [1.25, 1.45, 1.68]",
    "uniform double[] plen:rearRadii = [-4.0, -4.0, -4.0]",
]
MODELS = {"thin": [], "two-plane": FACES[:2], "refractive": FACES}


def plenoptic(folder: Path, model: str, celsius: float, sensor: float | None, array: float | None) -> Camera:
    """Microlenses of a model before a sensor, both with an expansion or without, and a lens all of ALUMINIUM's."""
    place, path = '        over "Sensor"\n        {\n', folder / f"{model}_{celsius}_{sensor}_{array}.usda"
    own = [[] if of is None else [f"uniform double plen:expansion = {of}"] for of in (sensor, array)]
    heat = [f"double plen:temperature = {celsius}", f"uniform double plen:mountExpansion = {ALUMINIUM}"]
    lens = ['over "Lens"', "{", *heat, *known(0.0, ALUMINIUM), "}"]
    lenses = ['over "Microlenses"', "{", f'uniform token plen:model = "{model}"', *MODELS[model], *own[1], "}"]
    text = tiny_text("plenoptic", (place, "\n".join([*lens, *lenses, "", place, *own[0], ""])))
    path.write_text(text, encoding="utf-8")
    return camera(path)


LENGTHS = sorted(
    {field.name for field in fields(MicrolensArray) if "_mm" in field.name} - {"offset_x_mm", "offset_y_mm"}
)
"""All lengths of an array but its place on the sensor, which is an error of assembly."""


@pytest.mark.parametrize("model", MODELS)
def test_a_plenoptic_camera_that_expands_alike_is_the_same_one_larger(tmp_path, model):
    """Focal lengths of faces, too, which nobody states; the same microlenses are on the array."""
    cold, warm = (plenoptic(tmp_path, model, celsius, ALUMINIUM, ALUMINIUM) for celsius in (20.0, 70.0))
    growth = 1 + ALUMINIUM * 1e-6 * 50
    before, after = cold.microlenses, warm.microlenses
    for name in LENGTHS:
        pair = (np.array(getattr(of, name) or 0.0) for of in (after, before))
        np.testing.assert_allclose(next(pair), growth * next(pair), rtol=1e-12, err_msg=name)
    assert warm.sensor.pitch_mm == pytest.approx(growth * cold.sensor.pitch_mm, rel=1e-15)
    assert warm.sensor_distance_mm == pytest.approx(growth * cold.sensor_distance_mm, rel=1e-15)
    assert after.index == before.index
    assert np.array_equal(lattice(after).k, lattice(before).k)


def test_discs_and_pitches_of_two_sizes_expand_too():
    both = {"cross_pitch_mm": 0.21, "aperture": "disc", "disc_diameter_mm": 0.19, "columns": 9, "rows": 8}
    array = MicrolensArray(pitch_mm=0.2, focal_lengths_mm=(2.0,), distance_mm=1.7, offset_x_mm=0.1, **both)
    scaled = scaled_array(array, 1.1)
    for name in LENGTHS:
        np.testing.assert_allclose(
            getattr(scaled, name) or 0.0, 1.1 * np.array(getattr(array, name) or 0.0), rtol=1e-14
        )
    assert replace(scaled, **{name: getattr(array, name) for name in LENGTHS}) == array


def test_parts_expand_by_their_own_coefficients_and_those_without_do_not(tmp_path):
    cold, warm = (plenoptic(tmp_path, "thin", celsius, 2.6, None) for celsius in (20.0, 70.0))
    assert warm.sensor.pitch_mm / cold.sensor.pitch_mm == pytest.approx(1 + 2.6e-6 * 50, rel=1e-15)
    assert warm.microlenses == cold.microlenses
    array = plenoptic(tmp_path, "thin", 70.0, None, 7.0).microlenses
    assert array.focal_lengths_mm[1] == pytest.approx(2.1 * (1 + 7e-6 * 50), rel=1e-15)
    assert array.distance_mm == pytest.approx(1.7 * (1 + 7e-6 * 50), rel=1e-15)


ROWS = tuple(tuple(0.01 * (i * i - 3 * j + i * j) for i in range(5)) for j in range(5))
LEFT = {"decentre_mm", "focal_length_mm", "image_distance_mm"}
"""Lengths that temperature leaves: errors of assembly, and those of ideal lenses."""


@pytest.mark.parametrize(
    "shape",
    [
        {"radius_mm": 20.0, "conic": -0.3},
        {"radius_mm": -30.0, "even_coefficients": (1e-4, 2e-6, 3e-9)},
        {"odd_coefficients": (1e-4, -2e-6)},
        {"radius_mm": 20.0, "is_cylinder": True, "inner_semi_diameter_mm": 1.0},
        {"half_widths_mm": (3.0, 2.0)},
        {"relief": Relief(heights_mm=ROWS, spacing_mm=2.0)},
    ],
)
def test_a_larger_surface_has_the_same_shape(shape):
    """All of its lengths, sags included; a length that is added to surfaces has to be decided on here."""
    surface, growth = Surface(semi_diameter_mm=4.0, thickness_mm=2.0, **shape), 1.7
    grown = scaled(surface, growth, growth)
    for height_mm in (1.0, 2.5, 4.0):
        assert grown.sag_mm(growth * height_mm) == pytest.approx(growth * surface.sag_mm(height_mm), rel=1e-12)
    lengths = {field.name for field in fields(Surface) if field.name.endswith("_mm")} - LEFT
    for name in lengths:
        before, after = (np.array(getattr(of, name) or 0.0) for of in (surface, grown))
        assert np.allclose(after, growth * before, rtol=1e-14)
    assert replace(grown, **{name: getattr(surface, name) for name in (*lengths, *SHAPES)}) == surface


def test_the_cell_of_a_surface_decides_with_what_it_expands(tmp_path):
    """Glass behind a surface, else before it; the stop and gaps of air go with the mount."""
    cold, warm = (camera(stage(tmp_path, celsius, *known(0.0, 7.0))) for celsius in (20.0, 70.0))
    pairs = list(zip(cold.prescription.surfaces, warm.prescription.surfaces, strict=True))
    glass, mount = 1 + 7e-6 * 50, 1 + ALUMINIUM * 1e-6 * 50
    for (before, after), radius, thickness in (
        (pairs[0], glass, glass),  # S1: the front of an element
        (pairs[1], glass, mount),  # S2: its back, and air behind it
        (pairs[5], mount, mount),  # Stop
    ):
        assert after.semi_diameter_mm / before.semi_diameter_mm == pytest.approx(radius, rel=1e-15)
        assert after.thickness_mm / before.thickness_mm == pytest.approx(thickness, rel=1e-15)


def test_a_thin_lens_changes_its_focal_length_as_in_closed_form(tmp_path):
    """f (1 + a dT) / (1 + b dT / (n - 1)), by the thermal constant of optics: all glass but one element is air here."""
    no_glass = 'uniform string plen:glass = ""\n}\n'
    others = ("S3", "S4", "S5", *GLASSES[3:], "S9", "S11")
    air = [over(name, "index = 1", "radius = inf").replace("}\n", no_glass) for name in others]
    small = "semiDiameter = 0.01"
    element = (
        over("S1", "indexSlope = 3", "expansion = 7", "thickness = 2e-6", small),
        over("S2", "radius = -160", small),
    )
    cold, warm = (first_order(camera(stage(tmp_path, c, *element, *air)).prescription) for c in (20.0, 70.0))
    expected = (1 + 7e-6 * 50) / (1 + 3e-6 * 50 / 0.67)
    assert warm.efl_mm / cold.efl_mm == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("source", ["printed", "catalogue"])
def test_a_melt_is_off_its_glass_by_what_is_stated(tmp_path, source):
    """Beyond 5e-4, too, to which a printed index is compared with the catalogue: a melt is another number."""
    token = f'uniform token plen:indexSource = "{source}"'
    cold, melt = (camera(stage(tmp_path, None, token, *overs)) for overs in ([], [over("S1", "indexOffset = 0.001")]))
    indices = [[surface.index for surface in of.prescription.surfaces] for of in (cold, melt)]
    assert indices[1][0] - indices[0][0] == pytest.approx(1e-3, rel=1e-9)
    assert indices[1][1:] == indices[0][1:]


def test_a_glass_of_which_nothing_is_known_is_refused(tmp_path):
    """hikari:BAF10 has no constants in the table."""
    errors = load(stage(tmp_path, 30.0)).errors
    assert {(problem.code, problem.at) for problem in errors} == {
        ("unknown-thermal", "/TinyConventional/Rig/Lens/S1.plen:glass")
    }
