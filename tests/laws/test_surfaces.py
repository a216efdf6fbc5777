"""Claim: conics and aspheres obey the laws that tell them from spheres: perfect foci, reversal, conserved etendue; a
field of heights is the surface that it samples; and what cannot be a surface is refused.
"""

import dataclasses
import math

import numpy as np
import pytest
from laws import rigs
from laws.surfaces import BENT, beam, oblique, orders, traced
from tolerances import FOCUS_MM, ORDER, REVERSED_MM, SYMPLECTIC, TEXTBOOK_MM

from pipeline.optics import rays
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription, PrescriptionError, Relief, Surface
from pipeline.optics.table import towards_scene, towards_sensor

HEIGHTS = np.array([0.5, 2.0, 4.0, 6.0, 8.0])


def axis_crossings(position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """z of the point of each ray next to the axis, and an assertion that the ray meets the axis there."""
    t = -np.sum(position[:, :2] * direction[:, :2], axis=1) / np.sum(direction[:, :2] ** 2, axis=1)
    point = position + t[:, None] * direction
    np.testing.assert_allclose(point[:, :2], 0, atol=FOCUS_MM)
    return point[:, 2]


@pytest.mark.parametrize("index", [1.3, 1.5, 1.9])
def test_a_sphere_images_its_aplanatic_points_perfectly(index: float) -> None:
    """Rays that aim at n R behind the centre meet at R / n behind it, at every height (Weierstrass)."""
    radius = 20.0
    lens = Prescription(surfaces=(Surface(radius_mm=radius, index=index, semi_diameter_mm=20.0, is_stop=True),))
    position, _ = beam(2 * HEIGHTS, -5.0)
    way = np.array([0.0, 0.0, radius + index * radius]) - position
    direction = way / np.linalg.norm(way, axis=1, keepdims=True)
    position, direction, alive = traced(towards_sensor(lens), position, direction)
    assert alive.all()
    np.testing.assert_allclose(axis_crossings(position, direction), radius + radius / index, rtol=0, atol=FOCUS_MM)


@pytest.mark.parametrize(("before", "behind"), [(1.0, 1.5), (1.0, 1.9), (1.5, 1.0), (1.9, 1.0), (1.5, 1.49)])
def test_a_cartesian_conic_focuses_a_parallel_beam_perfectly(before: float, behind: float) -> None:
    """k = -(n / n')^2 from index n to n': an ellipsoid into glass, a hyperboloid out of it; focus at n' R / (n' - n).

    Where n' comes close to n it comes close to the paraboloid. Descartes; Hecht, Optics, chapter 5.
    """
    radius = 20.0 if behind > before else -20.0
    bent = Surface(radius_mm=radius, conic=-((before / behind) ** 2), index=behind, semi_diameter_mm=9.0)
    plane = Surface(index=before, thickness_mm=5.0, semi_diameter_mm=9.0, is_stop=True)
    position, direction, alive = traced(towards_sensor(Prescription(surfaces=(plane, bent))), *beam(HEIGHTS, -1.0))
    assert alive.all()
    focus = 5.0 + behind * radius / (behind - before)
    tolerance = FOCUS_MM * abs(focus / 50) ** 2
    np.testing.assert_allclose(axis_crossings(position, direction), focus, rtol=0, atol=tolerance)


def both(one: Surface, other: Surface) -> list[list[np.ndarray]]:
    """The same rays after either surface: positions, directions, flags."""
    lenses = [Prescription(surfaces=(dataclasses.replace(surface, is_stop=True),)) for surface in (one, other)]
    results = [traced(towards_sensor(lens), *oblique(4000, 11.0, 0.6, -3.0)) for lens in lenses]
    assert 0.3 < results[0][2].mean() < 1
    return results


SPHERE = Surface(radius_mm=18.0, index=1.6, semi_diameter_mm=9.0)
CONIC = dataclasses.replace(SPHERE, conic=-1.7)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (SPHERE, dataclasses.replace(SPHERE, conic=0.0, even_coefficients=(0.0, 0.0))),
        (CONIC, dataclasses.replace(CONIC, even_coefficients=(0.0, 0.0, 0.0), odd_coefficients=(0.0,))),
        (Surface(index=1.6, semi_diameter_mm=9.0), Surface(index=1.6, semi_diameter_mm=9.0, conic=-3.0)),
    ],
    ids=["conic 0 is the sphere", "no polynomial is the conic", "a plane has no conic"],
)
def test_a_shape_without_its_extra_terms_is_the_simpler_one_bit_for_bit(one: Surface, other: Surface) -> None:
    for a, b in zip(*both(one, other), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (SPHERE, dataclasses.replace(SPHERE, conic=1e-300)),
        (CONIC, dataclasses.replace(CONIC, even_coefficients=(1e-300,))),
        (CONIC, dataclasses.replace(CONIC, even_coefficients=(0.0,) * 7 + (1e-300,))),
        (CONIC, dataclasses.replace(CONIC, odd_coefficients=(0.0, 1e-300))),
        (
            Surface(radius_mm=18.0, conic=-1.0, index=1.6, semi_diameter_mm=9.0),
            Surface(even_coefficients=(1 / 36.0,), index=1.6, semi_diameter_mm=9.0),
        ),
    ],
    ids=["sphere as conic", "conic as asphere", "many terms", "odd terms", "paraboloid as a2 r^2 on a plane"],
)
def test_two_ways_to_write_one_shape_are_one_shape(one: Surface, other: Surface) -> None:
    """The closed forms and Newton's steps share no line, and agree; also on which rays miss."""
    first, second = both(one, other)
    np.testing.assert_array_equal(first[2], second[2])
    passes = first[2] > 0
    for a, b in zip(first[:2], second[:2], strict=True):
        np.testing.assert_allclose(a[passes], b[passes], rtol=0, atol=TEXTBOOK_MM)


def test_the_other_sheet_of_a_conic_is_a_miss() -> None:
    """A hyperboloid's second sheet and an ellipsoid's far side lie on the ray, too, and are never taken."""
    for conic, z_limit in ((-4.0, math.inf), (2.0, 20.0 / 3.0)):
        surface = Surface(radius_mm=20.0, conic=conic, semi_diameter_mm=11.0, index=1.5, is_stop=True)
        lens = Prescription(surfaces=(surface,))
        position, _, alive = traced(towards_sensor(lens), *oblique(4000, 30.0, 2.0, -1.0))
        hit = alive > 0
        assert 50 < hit.sum() < len(hit)
        assert np.all(position[hit, 2] >= 0) and np.all(position[hit, 2] <= z_limit)
        sag = [surface.sag_mm(float(r)) for r in np.hypot(*position[hit, :2].T)]
        np.testing.assert_allclose(position[hit, 2], sag, rtol=0, atol=TEXTBOOK_MM)


@pytest.mark.parametrize("lens", [BENT, rigs.tronnier()], ids=["aspheres", "double Gauss"])
def test_the_lagrange_invariant_of_any_two_rays_near_each_other_is_kept(lens: Prescription) -> None:
    """dx dp' - dx' dp + dy dq' - dy' dq with p, q the direction cosines: the Jacobian between planes is symplectic."""
    step, form = 1e-4, np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(2))
    for start in ([1.0, 2.0, 0.05, -0.03], [-3.0, 1.0, 0.02, 0.06], [0.5, -4.0, -0.04, 0.01]):
        shifts = np.concatenate([np.eye(4), -np.eye(4)]) * [step, step, step / 10, step / 10]
        rows = np.array(start) + shifts
        cosine = np.sqrt(1 - np.sum(rows[:, 2:] ** 2, axis=1))
        position = np.column_stack([rows[:, :2], np.full(8, -40.0)])
        direction = np.column_stack([rows[:, 2:], cosine])
        start = position + 10.0 * direction / cosine[:, None]
        position, direction, alive = traced(towards_scene(lens), start, direction)
        assert alive.all()
        position += ((60.0 - position[:, 2]) / direction[:, 2])[:, None] * direction
        states = np.column_stack([position[:, :2], direction[:, :2]])
        jacobian = (states[:4] - states[4:]).T / (2 * np.diag(shifts[:4]))
        np.testing.assert_allclose(jacobian.T @ form @ jacobian, form, rtol=0, atol=SYMPLECTIC)


def test_rays_parallel_to_the_axis_meet_it_in_the_front_focus() -> None:
    """a2 bends the vertex: halve the height of a parallel ray, and its error falls fourfold. With an r^3 term it falls
    by half only, but to the same focus."""
    even = dataclasses.replace(BENT.surfaces[3], odd_coefficients=())
    lens = Prescription(surfaces=(*BENT.surfaces[:3], even, BENT.surfaces[4]))
    for prescription, order in ((rigs.tronnier(), 2), (lens, 2), (BENT, 1)):
        errors = []
        for height in 0.1 * 0.5 ** np.arange(5) * (10.0 if order == 2 else 0.1):
            position, direction, _ = traced(towards_scene(prescription), [[height, 0.0, -40.0]], [[0.0, 0.0, 1.0]])
            crossing = position[0, 2] - position[0, 0] * direction[0, 2] / direction[0, 0]
            errors.append(crossing - first_order(prescription).front_focus_mm)
        assert np.all(np.abs(orders(errors)[1:] - order) < ORDER)


def test_the_sag_is_where_rays_land() -> None:
    """Parallel rays end at the depth that `Surface.sag_mm` states: conic, even and odd terms."""
    surface = dataclasses.replace(BENT.surfaces[3], is_stop=True)
    position, *_ = traced(towards_sensor(Prescription(surfaces=(surface,))), *beam(HEIGHTS, -10.0))
    np.testing.assert_allclose(position[:, 2], [surface.sag_mm(h) for h in HEIGHTS], rtol=0, atol=REVERSED_MM)


def test_a_conic_ends_at_its_equator() -> None:
    """At R / sqrt(1 + k); paraboloids and hyperboloids have none."""
    with pytest.raises(PrescriptionError, match="beyond a conic"):
        Surface(radius_mm=20.0, conic=3.0, semi_diameter_mm=10.01)
    Surface(radius_mm=20.0, conic=3.0, semi_diameter_mm=10.0)
    Surface(radius_mm=20.0, conic=-1.0, semi_diameter_mm=100.0)


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


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ({}, "circular, diameter 10.0 mm"),
        ({"inner_semi_diameter_mm": 2.0}, "annular, diameter 10.0 mm, obstruction 4.0 mm"),
        ({"half_widths_mm": (3.0, 2.0)}, "rectangular, 6.0 x 4.0 mm"),
        ({"blades": 6}, "polygonal, 6 blades, diameter 10.0 mm from corner to corner of its circle"),
    ],
    ids=["circle", "ring", "rectangle", "polygon"],
)
def test_the_aperture_is_named_by_its_shape(shape: dict, words: str) -> None:
    assert Surface(semi_diameter_mm=5.0, **shape).aperture == words


@pytest.mark.parametrize(("index", "is_right"), [(1.0, True), (1.5, False)])
def test_an_ideal_lens_stands_behind_a_surface_in_air_alone(index: float, is_right: bool) -> None:
    before = Surface(semi_diameter_mm=5.0, thickness_mm=2.0, index=index, is_stop=True)
    surfaces = before, Surface(semi_diameter_mm=5.0, focal_length_mm=50.0)
    if is_right:
        assert Prescription(surfaces=surfaces).vertices_mm == (0.0, 2.0)
        return
    with pytest.raises(PrescriptionError, match=r"medium of index 1\.5"):
        Prescription(surfaces=surfaces)
