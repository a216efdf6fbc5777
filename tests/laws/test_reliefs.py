"""Claim: a field of heights is the surface that it samples, met and bent as Snell's law has it."""

import dataclasses

import numpy as np
import pytest
from laws.surfaces import oblique, traced
from tolerances import TEXTBOOK_MM

from pipeline.optics import rays
from pipeline.optics.prescription import Prescription, PrescriptionError, Relief, Surface
from pipeline.optics.table import towards_scene, towards_sensor

SEMI_MM = 10.0
STOP = Surface(semi_diameter_mm=30.0, is_stop=True)


def relief(height, count: int = 9, wide: int = 11, reach_mm: float = 12.0) -> Relief:
    """A field of heights of a function of x and y, more along x than along y."""
    spacing = 2 * reach_mm / (count - 1)
    x, y = ((np.arange(n) - (n - 1) / 2) * spacing for n in (wide, count))
    rows = [[float(height(u, v)) for u in x] for v in y]
    return Relief(heights_mm=tuple(map(tuple, rows)), spacing_mm=spacing)


def pane(**front: object) -> Prescription:
    """A piece of glass whose front has some shape, before a wide stop."""
    surfaces = (
        Surface(semi_diameter_mm=SEMI_MM, thickness_mm=6.0, index=1.5, **front),
        Surface(semi_diameter_mm=20.0, thickness_mm=5.0),
        STOP,
    )
    return Prescription(surfaces=surfaces)


def apart(one: Prescription, other: Prescription) -> float:
    """Largest difference of points [mm] and directions behind two lenses, of rays that pass both, either way."""
    start, off = oblique(400, 8.0, 0.1, -30.0), []
    for towards in (towards_scene, towards_sensor):
        (*here, passes), (*there, also) = traced(towards(one), *start), traced(towards(other), *start)
        both = (passes > 0) & (also > 0)
        assert both.sum() > 150
        off += [np.abs(a - b)[both].max() for a, b in zip(here, there, strict=True)]
    return float(max(off))


def test_heights_of_a_plane_are_a_plane_that_is_tilted():
    """About y and about x, so that an exchange of rows and columns, or of up and down, shows."""
    tilt_deg = (3.0, -5.0)
    normal = np.array([np.sin(np.radians(tilt_deg[1])), 0.0, np.cos(np.radians(tilt_deg[1]))])
    about_x = np.radians(tilt_deg[0])
    normal = np.array([normal[0], -np.sin(about_x) * normal[2], np.cos(about_x) * normal[2]])

    def height(x: float, y: float) -> float:
        return float(-(normal[0] * x + normal[1] * y) / normal[2])

    wide = {"semi_diameter_mm": 12.0}
    flat = pane()
    expected = dataclasses.replace(flat.surfaces[0], tilt_deg=tilt_deg, **wide)
    tilted = dataclasses.replace(flat, surfaces=(expected, *flat.surfaces[1:]))
    uneven = dataclasses.replace(flat.surfaces[0], relief=relief(height), **wide)
    by_heights = dataclasses.replace(flat, surfaces=(uneven, *flat.surfaces[1:]))
    assert apart(by_heights, tilted) < TEXTBOOK_MM
    assert apart(by_heights, flat) > 0.1


def test_a_sphere_by_heights_is_met_the_better_by_the_fourth_power_of_their_spacing():
    radius = 60.0
    sphere, errors = pane(radius_mm=radius), []
    for count in (9, 17, 33):
        heights = relief(lambda x, y: radius - np.sqrt(radius**2 - x * x - y * y), count, count + 2)
        errors.append(apart(pane(relief=heights), sphere))

    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.6)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4, abs=0.6)


def test_a_cubic_by_heights_bends_rays_as_snell_s_law_has_it_in_vectors():
    def height(x, y):
        return 0.05 * x - 0.03 * y + 2e-3 * x * y + 1e-3 * y * y - 5e-5 * x**3 + 4e-5 * x * y * y

    lens = Prescription(surfaces=(Surface(semi_diameter_mm=SEMI_MM, index=1.5, relief=relief(height)), STOP))
    table = towards_sensor(lens)[:1]
    start, way = oblique(300, 7.0, 0.3, -20.0)
    point, bent, passes = traced(table, start, way)
    x, y = point[:, :2].T
    slope = np.stack([0.05 + 2e-3 * y - 15e-5 * x**2 + 4e-5 * y * y, -0.03 + 2e-3 * x + 2e-3 * y + 8e-5 * x * y])
    normal = np.column_stack([-slope[0], -slope[1], np.ones(len(x))])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    lit = passes > 0

    assert lit.sum() > 200
    np.testing.assert_allclose(point[lit, 2], table[0, 0] + height(x, y)[lit], atol=TEXTBOOK_MM)
    np.testing.assert_allclose(np.cross(point - start, way)[lit], 0.0, atol=TEXTBOOK_MM)
    np.testing.assert_allclose(np.cross(1.5 * bent - way, normal)[lit], 0.0, atol=1e-13)
    again = rays.traced(table, start, way)
    np.testing.assert_array_equal(again.passes, lit)
    np.testing.assert_allclose(again.position[lit], point[lit], atol=TEXTBOOK_MM)
    np.testing.assert_allclose(again.direction[lit], bent[lit], atol=1e-13)


def test_heights_that_cannot_be_a_surface_are_refused():
    heights = relief(lambda x, y: 0.0)
    for wrong, words in (
        ({"radius_mm": 50.0, "relief": heights}, "another shape"),
        ({"relief": heights, "semi_diameter_mm": 12.5}, "beyond its heights"),
    ):
        with pytest.raises(PrescriptionError, match=words):
            Surface(**{"semi_diameter_mm": 5.0, **wrong})
    with pytest.raises(PrescriptionError, match="four rows of four"):
        Relief(heights_mm=((0.0,) * 4,) * 3, spacing_mm=1.0)
