"""Claim: films reflect as interference says, and tables by wavelength and angle are read where the rays are."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from laws import rigs
from naive import films as naive
from tolerances import BISECTED, COATED_ANGLE

from pipeline.optics.prescription import Prescription, PrescriptionError, Surface
from pipeline.optics.rays import traced
from pipeline.optics.table import towards_scene, towards_sensor
from pipeline.optics.transmission import Coating, CoatingData, Film, Losses, fresnel, steepest_deg, transmitted

BK7, MGF2 = 1.5168, 1.38
"""Index n_d of N-BK7 and the textbook index of magnesium fluoride."""
ANGLES = np.radians([0.0, 20.0, 45.0, 56.0, 80.0])


def quarter(index: float, wavelengths: float = 0.25) -> Film:
    """A film whose optical path is a quarter of the wavelength."""
    return Film(index=index, waves=wavelengths / index)


def reflected(stack: tuple[Film, ...], before: float = 1.0, behind: float = BK7, angle: float = 0.0) -> np.ndarray:
    """Share of light that a stack does not let pass, across the plane of incidence and in it."""
    return 1 - Coating(films=stack).passed(before, behind, np.array([math.cos(angle)]))[:, 0]


def test_a_quarter_wave_of_magnesium_fluoride_on_bk7() -> None:
    """((n0 ns - n1^2) / (n0 ns + n1^2))^2: 1.28 % where bare glass has 4.22 %."""
    expected = ((BK7 - MGF2**2) / (BK7 + MGF2**2)) ** 2
    np.testing.assert_allclose(reflected((quarter(MGF2),)), expected, rtol=BISECTED)
    np.testing.assert_allclose(reflected((quarter(MGF2),), before=BK7, behind=1.0), expected, rtol=BISECTED)


@pytest.mark.parametrize("pairs", [1, 3, 8])
def test_a_mirror_of_quarter_waves(pairs: int) -> None:
    """Pairs of high and low index: ((1 - Y) / (1 + Y))^2 with Y = (nH / nL)^(2 N) ns."""
    high, low = 2.35, 1.46
    admittance = (high / low) ** (2 * pairs) * BK7
    expected = ((1 - admittance) / (1 + admittance)) ** 2
    np.testing.assert_allclose(reflected((quarter(high), quarter(low)) * pairs), expected, rtol=BISECTED)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_film_that_cannot_be_seen_is_a_bare_surface(angle: float) -> None:
    """One of the index of the medium before or behind it, or half a wave thick at that angle: Fresnel's equations."""
    bent = math.asin(math.sin(angle) / BK7)
    ways = (np.array([[math.sin(a), 0.0, math.cos(a)]]) for a in (angle, bent))
    expected = 1 - fresnel(1 / BK7, *ways)[:, 0]
    # The path between the two sides of a film is 2 n d cos of the angle in it.
    half = Film(index=2.0, waves=0.5 / (2.0 * math.sqrt(1 - (math.sin(angle) / 2.0) ** 2)))
    for film in (Film(index=BK7, waves=0.4), Film(index=1.0, waves=0.3), half):
        np.testing.assert_allclose(reflected((film,), angle=angle), expected, rtol=0, atol=BISECTED)


def test_matrices_let_pass_what_airys_sums_do_not_reflect() -> None:
    """Random stacks, in both polarisations, also where light only tunnels through a film: no energy is lost or made."""
    rng, tunnelled = np.random.default_rng(5), 0
    for _ in range(300):
        count = int(rng.integers(1, 7))
        indices, waves = rng.uniform(1.0, 2.4, count), rng.uniform(0.02, 0.9, count)
        before, behind = rng.uniform(1.2, 1.9, 2)
        angle = math.asin(rng.uniform(0, 0.97) * min(1.0, behind / before))
        tunnelled += bool((indices < before * math.sin(angle)).any())
        stack = tuple(Film(index=n, waves=w) for n, w in zip(indices, waves, strict=True))
        found = reflected(stack, before, behind, angle)
        nm = [550.0 * w for w in waves]
        expected = naive.reflectance([before, *indices, behind], nm, 550.0, angle)
        np.testing.assert_allclose(found, expected, rtol=0, atol=BISECTED)
        assert (found >= -BISECTED).all() and (found <= 1).all()
    assert tunnelled > 20


def test_a_film_too_thick_to_tunnel_through_reflects_all() -> None:
    """A gap of air between glasses beyond the critical angle, a thousand waves wide."""
    assert (reflected((Film(index=1.0, waves=1e3),), BK7, BK7, math.radians(60)) == 1).all()


def test_transmission_is_the_same_either_way_through_a_lens() -> None:
    """Rays from the sensor, and the same rays turned round, which meet films in the opposite order: bare, coated and
    absorbing parts."""
    prescription = rigs.displaced(rigs.conventional(9.0)).prescription
    stack = (quarter(1.63), quarter(2.1, 0.5), quarter(MGF2))
    table = Coating(reflectance=(0.01, 0.05, 0.4), angles_deg=(0.0, 20.0, 60.0))
    coatings = (Coating(films=stack), table, None, Coating(films=stack[::-1]), table, *(None,) * 6)
    turned = tuple(one and dataclasses.replace(one, films=one.films[::-1]) for one in coatings)
    rng = np.random.default_rng(3)
    start = np.column_stack([rng.uniform(-5, 5, (200, 2)), np.full(200, -131.0)])
    way = np.column_stack([rng.uniform(-0.1, 0.1, (200, 2)), np.ones(200)])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    per_mm = (0.99, 1.0, 0.98, *(1.0,) * 5, 0.97, 1.0, 1.0)
    # Seen from the sensor, the medium behind a surface is that of the surface before it.
    from_sensor = Losses(coatings=turned[::-1], per_mm=(*per_mm[-2::-1], 1.0))
    there = transmitted(towards_scene(prescription), start, way, from_sensor)
    end, direction, passes = traced(towards_scene(prescription), start, way)
    flip = np.array([1.0, -1.0, -1.0])
    losses = Losses(coatings=coatings, per_mm=per_mm)
    back = transmitted(towards_sensor(prescription), (end + direction) * flip, -direction * flip, losses)
    assert passes.sum() > 50 and not there[~passes].any()
    np.testing.assert_allclose(back[passes], there[passes], rtol=1e-9)


def test_films_of_the_index_of_their_glass_leave_a_lens_bare() -> None:
    """So the angles at displaced surfaces by their shapes are those by which light is bent there."""
    prescription = rigs.displaced(rigs.conventional(9.0)).prescription
    indices = [1.0, *(surface.index for surface in prescription.surfaces)]
    unseen = tuple(Coating(films=(Film(index=max(pair), waves=0.3),)) for pair in pairwise(indices))
    start = np.column_stack([np.linspace(-8, 8, 50), np.full(50, 3.0), np.full(50, -60.0)])
    way = np.tile([0.05, -0.02, 1.0] / np.linalg.norm([0.05, -0.02, 1.0]), (50, 1))
    bare, coated = (
        transmitted(towards_sensor(prescription), start, way, Losses(coatings=coats, per_mm=(1.0,) * 11))
        for coats in ((None,) * 11, unseen)
    )
    assert (bare > 0).sum() > 20
    np.testing.assert_allclose(coated, bare, rtol=1e-9)


def plate(tilt_deg: float = 0.0, index: float = 1.6) -> Prescription:
    """A plane-parallel plate of glass, whose front may be tilted, and the stop behind it."""
    return Prescription(
        surfaces=(
            Surface(thickness_mm=10.0, semi_diameter_mm=50.0, index=index, tilt_deg=(tilt_deg, 0.0)),
            Surface(thickness_mm=1.0, semi_diameter_mm=50.0),
            Surface(semi_diameter_mm=50.0, is_stop=True),
        )
    )


def through(prescription: Prescription, angle_deg: float, coatings: tuple[Coating | None, ...]) -> float:
    """Share of the light of one ray from air, `angle_deg` from the axis in its plane x = 0."""
    way = np.array([[0.0, math.sin(math.radians(angle_deg)), math.cos(math.radians(angle_deg))]])
    start = np.array([[0.0, 0.0, -15.0]])
    return float(transmitted(towards_sensor(prescription), start, way, Losses(coatings=coatings, per_mm=(1.0,) * 3))[0])


RISING = Coating(reflectance=(0.0, 0.9), angles_deg=(0.0, 90.0))
"""A reflectance of one hundredth of the angle in degrees."""
CLEAR = Coating(reflectance=(0.0,))


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 50.0])
def test_angles_of_a_table_are_those_in_air_before_and_behind_glass(angle_deg: float) -> None:
    for coatings in ((RISING, CLEAR, CLEAR), (CLEAR, RISING, CLEAR), (CLEAR, CLEAR, RISING)):
        assert through(plate(), angle_deg, coatings) == pytest.approx(1 - angle_deg / 100, abs=COATED_ANGLE)


def test_a_tilted_surface_is_met_at_its_own_angle() -> None:
    assert through(plate(tilt_deg=20.0), 0.0, (RISING, CLEAR, CLEAR)) == pytest.approx(0.8, abs=COATED_ANGLE)


def test_a_surface_without_change_of_index_has_angles_too() -> None:
    assert through(plate(index=1.0), 35.0, (RISING, CLEAR, CLEAR)) == pytest.approx(0.65, abs=COATED_ANGLE)


def test_the_steepest_angle_is_that_of_the_ray_at_the_rim() -> None:
    """Rays from a point 30 mm before a plate that reach 40 mm from the axis and pass, and some that do not."""
    heights = np.array([0.0, 10.0, 40.0, 70.0])
    way = np.column_stack([heights, np.zeros(4), np.full(4, 30.0)])
    start = np.tile([0.0, 0.0, -41.0], (4, 1))
    found = steepest_deg(towards_sensor(plate(index=1.0)), start, way / np.linalg.norm(way, axis=1, keepdims=True))
    # Without glass the ray to 40 mm would miss the back of the plate: 53.3 mm high behind 10 mm.
    np.testing.assert_allclose(found, math.degrees(math.atan(10 / 30)), atol=COATED_ANGLE)


def test_a_table_that_is_the_same_at_all_angles_is_one_without_angles() -> None:
    data = CoatingData(wavelengths_nm=(500.0, 600.0), reflectance=(0.01, 0.03))
    by_angle = dataclasses.replace(data, angles_deg=(0.0, 30.0, 60.0), reflectance=(0.01, 0.03) * 3)
    cosines = np.cos(np.radians(np.linspace(0, 80, 33)))
    for nm in (500.0, 537.0, 600.0):
        flat, angled = data.at(nm), by_angle.at(nm)
        assert flat is not None and angled is not None
        assert flat.passed(1.0, 1.6, cosines).tobytes() == angled.passed(1.0, 1.6, cosines).tobytes()


def test_a_coating_is_read_between_the_entries_of_its_table() -> None:
    """Linear in wavelength and angle, constant beyond the ends."""
    data = CoatingData(wavelengths_nm=(500.0, 600.0), angles_deg=(10.0, 30.0), reflectance=(0.01, 0.03, 0.05, 0.09))
    for nm, degrees, expected in (
        *((500.0, 10.0, 0.01), (600.0, 10.0, 0.03), (500.0, 30.0, 0.05), (600.0, 30.0, 0.09)),
        *((550.0, 10.0, 0.02), (500.0, 20.0, 0.03), (525.0, 15.0, 0.75 * 0.015 + 0.25 * 0.06)),
        *((450.0, 0.0, 0.01), (700.0, 80.0, 0.09)),
    ):
        coating = data.at(nm)
        assert coating is not None
        passed = coating.passed(1.0, 1.5, np.array([math.cos(math.radians(degrees))]))
        np.testing.assert_allclose(passed, 1 - expected, atol=COATED_ANGLE)
    assert CoatingData().at(550.0) is None


def test_films_have_fewer_waves_in_longer_light() -> None:
    data = CoatingData(film_indices=(MGF2,), film_thicknesses_nm=(100.0,))
    assert [data.at(nm) for nm in (500.0, 1000.0)] == [Coating(films=(Film(index=MGF2, waves=w),)) for w in (0.2, 0.1)]


@pytest.mark.parametrize(
    ("data", "code"),
    [
        ({"wavelengths_nm": (500.0, 600.0), "reflectance": (0.1,)}, "coating"),
        ({"wavelengths_nm": (600.0, 500.0), "reflectance": (0.1, 0.1)}, "coating-wavelengths"),
        ({"wavelengths_nm": (500.0,), "reflectance": (0.1, 0.1), "angles_deg": (30.0, 0.0)}, "coating-angles"),
        ({"wavelengths_nm": (500.0,), "reflectance": (0.1,), "angles_deg": (0.0, 30.0)}, "coating"),
        ({"film_indices": (1.38,), "film_thicknesses_nm": ()}, "coating-films"),
        (
            {
                "film_indices": (1.38,),
                "film_thicknesses_nm": (99.0,),
                "wavelengths_nm": (500.0,),
                "reflectance": (0.1,),
            },
            "coating-films",
        ),
    ],
)
def test_what_is_no_coating_is_refused(data: dict[str, tuple[float, ...]], code: str) -> None:
    with pytest.raises(PrescriptionError) as refused:
        CoatingData(**data)
    assert refused.value.code == code


@pytest.mark.parametrize("seed", range(3))
def test_no_lens_lets_more_light_pass_than_comes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = (
        lambda: None,
        lambda: Coating(films=tuple(Film(index=float(n), waves=0.2) for n in rng.uniform(1.2, 2.5, 3))),
        lambda: Coating(reflectance=tuple(rng.uniform(0, 1, 3).tolist()), angles_deg=(0.0, 20.0, 40.0)),
    )
    coatings = tuple(kinds[int(kind)]() for kind in rng.integers(0, 3, 11))
    losses = Losses(coatings=coatings, per_mm=tuple(rng.uniform(0.9, 1, 11).tolist()))
    start = np.column_stack([rng.uniform(-20, 20, (500, 2)), np.full(500, -60.0)])
    way = np.column_stack([rng.uniform(-0.2, 0.2, (500, 2)), np.ones(500)])
    share = transmitted(
        towards_sensor(rigs.tronnier()), start, way / np.linalg.norm(way, axis=1, keepdims=True), losses
    )
    assert (share > 0).sum() > 50
    assert (share >= 0).all() and (share < 1).all()
