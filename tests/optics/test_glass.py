"""Dispersion formulas in closed form, names of glasses, the medium of a row of a prescription, and absorption: Beer and
Lambert's law, tables for a thickness, and the table that ships.
"""

import math

import numpy as np
import pytest
from tolerances import (
    BISECTED,
    MODEL_95,
    MODEL_MEDIAN,
    MODEL_NARROW_95,
    MODEL_NARROW_MEDIAN,
    MODEL_NARROW_WORST,
    MODEL_WORST,
)

from pipeline.optics.glass.absorption import measured, stated
from pipeline.optics.glass.catalogue import catalogue, find, near_names, nearest
from pipeline.optics.glass.medium import (
    C_UM,
    D_UM,
    F_UM,
    Cauchy,
    Constant,
    GlassError,
    NormalLine,
    OutOfRange,
    Polynomial,
    Sellmeier,
)
from pipeline.optics.glass.row import doubt_of, medium
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_sensor
from pipeline.optics.transmission import Coating, Losses, transmitted

D_NM = 587.5618


@pytest.mark.parametrize(
    ("formula", "wavelength_um", "index"),
    [
        (Constant(n=1.5), 0.7, 1.5),
        # 1 + 1.25 w^2 / w^2
        (Sellmeier(terms=((1.25, 0.0),)), 0.3, 1.5),
        # 1 + 0.25 + 0.75 * 1 / (1 - 0.25): the second number is the square of the resonance, not the resonance
        (Sellmeier(constant=0.25, terms=((0.75, 0.25),)), 1.0, 1.5),
        # 2 + 0.5 * 2^2 + 1 * 2^-2
        (Polynomial(constant=2.0, terms=((0.5, 2), (1.0, -2))), 2.0, math.sqrt(4.25)),
        # 1.5 + 0.01 * 4 + 0.001 * 16
        (Cauchy(coefficients=(1.5, 0.01, 0.001)), 0.5, 1.556),
    ],
)
def test_formulas_give_what_a_hand_computes(formula, wavelength_um, index):
    assert formula.index(wavelength_um) == pytest.approx(index, rel=1e-15)


def test_formula_1_prints_resonances_and_formula_2_their_squares():
    """AMTIR-2 at 10 um: n^2 = 1 + 4.9948719 w^2 / (w^2 - 0.24164^2) + ...; N-BK7's terms as its data sheet has them."""
    square = 100.0
    by_hand = 1 + sum(
        b * square / (square - c**2) for b, c in ((4.9948719, 0.24164), (0.1207152, 19), (1.7123685, 0.48328))
    )

    assert find("ami:AMTIR-2").index(10_000) == pytest.approx(math.sqrt(by_hand), rel=1e-15)
    resonances = [c for _, c in find("schott:N-BK7").dispersion.terms]
    assert resonances == [0.00600069867, 0.0200179144, 103.560653]


def test_the_table_holds_1706_glasses_each_with_an_index_throughout_its_range():
    for glass in catalogue():
        for wavelength_nm in (glass.min_nm, (glass.min_nm + glass.max_nm) / 2, glass.max_nm):
            assert (1.02 if glass.vendor == "material" else 1.3) < glass.index(wavelength_nm) < 4.2, glass.label
    assert len(catalogue()) == len({glass.label.casefold() for glass in catalogue()}) == 1706


def test_infrared_glasses_have_no_visible_index():
    glass = find("schott:IRG22")

    assert (glass.nd, glass.vd) == (None, None)
    with pytest.raises(OutOfRange, match=r"schott:IRG22 is known from \d+ to \d+ nm, not at 587.5618 nm"):
        glass.index(D_NM)


def test_a_formula_holds_to_the_ends_of_its_range_and_no_further():
    glass = find("hikari:BAF10")

    assert glass.index(400) > glass.index(700)
    for wavelength_nm in (399.9, 700.1, math.nan):
        with pytest.raises(OutOfRange):
            glass.index(wavelength_nm)


def test_names_are_compared_without_case():
    assert find("SCHOTT:n-bk7") is find("N-BK7") is find("schott:N-BK7")


def test_exactly_28_names_are_used_by_several_vendors_and_none_of_them_is_found_without_one():
    vendors: dict[str, list[str]] = {}
    for glass in catalogue():
        vendors.setdefault(glass.name.casefold(), []).append(glass.vendor)
    shared = {name: found for name, found in vendors.items() if len(found) > 1}

    assert len(shared) == 28
    for name, found in shared.items():
        with pytest.raises(GlassError) as caught:
            find(name)
        assert all(f"{vendor}:" in caught.value.message for vendor in found)
    different = {
        name: np.ptp([find(f"{vendor}:{name}").nd for vendor in found])
        for name, found in shared.items()
        if np.ptp([find(f"{vendor}:{name}").nd for vendor in found]) > 5e-4
    }
    assert sorted(different) == ["baf4", "f1", "f2", "f3", "f5"]


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("BK7", "schott:N-BK7"),
        ("schott:BK7", "schott:N-BK7"),
        ("schot:N-BK7", "schott:N-BK7"),
        ("hoya:N-BK7", "schott:N-BK7"),
        ("N-BK-7", "schott:N-BK7"),
        ("S-LAH-55", "ohara:S-LAH55"),
    ],
)
def test_an_unknown_name_is_an_error_that_lists_near_names(name, near):
    assert near in [glass.label for glass in near_names(name)]
    with pytest.raises(GlassError, match=f'no glass "{name}"') as caught:
        find(name)
    assert near in caught.value.hint


def test_the_nearest_glass_to_its_own_numbers_is_itself():
    glass = find("ohara:LAL11")

    assert nearest(glass.nd, glass.vd, 5e-4, 0.5)[0] is glass


@pytest.mark.parametrize(("nd", "vd"), [(1.5168, 64.17), (1.658, 57.3), (1.717, 48.0), (1.84666, 23.78)])
def test_the_model_returns_the_numbers_that_it_is_made_from(nd, vd):
    model = NormalLine(nd=nd, vd=vd)

    assert model.index(D_UM) == nd
    assert (nd - 1) / (model.index(F_UM) - model.index(C_UM)) == pytest.approx(vd, rel=1e-12)


def test_the_model_goes_through_an_index_that_was_printed_for_another_line():
    assert NormalLine.through(1.62, 36.0, 0.5461).index(0.5461) == pytest.approx(1.62, rel=1e-15)


@pytest.mark.parametrize(
    ("low_nm", "high_nm", "median", "most", "worst"),
    [
        (400, 700, MODEL_MEDIAN, MODEL_95, MODEL_WORST),
        (436, 656, MODEL_NARROW_MEDIAN, MODEL_NARROW_95, MODEL_NARROW_WORST),
    ],
)
def test_the_model_is_as_accurate_as_stated_over_the_whole_catalogue(low_nm, high_nm, median, most, worst):
    wavelengths = np.linspace(low_nm, high_nm, 16)
    errors = [
        max(abs(NormalLine(nd=glass.nd, vd=glass.vd).index(nm / 1000) - glass.index(nm)) for nm in wavelengths)
        for glass in catalogue()
        if glass.vd is not None and glass.holds(low_nm) and glass.holds(high_nm) and glass.vendor != "material"
    ]

    assert len(errors) > 1590
    assert np.median(errors) < median
    assert np.quantile(errors, 0.95) < most
    assert max(errors) < worst


def test_the_model_beats_a_cauchy_formula_through_the_same_numbers_fourfold():
    def cauchy(nd, vd):
        slope = (nd - 1) / vd / (F_UM**-2 - C_UM**-2)
        return Cauchy(coefficients=(nd - slope * D_UM**-2, slope))

    glasses = [glass for glass in catalogue() if glass.vd is not None and glass.holds(400)]
    errors = np.array(
        [
            [abs(kind.index(0.4) - glass.index(400)) for kind in (NormalLine(nd=nd, vd=vd), cauchy(nd, vd))]
            for glass in glasses
            for nd, vd in [(glass.nd, glass.vd)]
        ]
    )

    model, plain = np.median(errors, axis=0)
    assert plain > 4 * model


def test_every_glass_of_the_table_is_found_by_the_label_that_messages_print():
    """Names with brackets too: K-PFK80(M) is no formula."""
    assert all(row(glass.label) is glass for glass in catalogue())
    with pytest.raises(GlassError, match="no glass"):
        row("hartmann(1.5, 0.01)")


def row(glass="", index=None, abbe=None, wavelength_nm=D_NM):
    """The medium of a row of a prescription."""
    return medium(glass=glass, index=index, abbe=abbe, wavelength_nm=wavelength_nm)


def test_a_row_without_a_name_is_air_or_the_model_and_never_a_guess():
    assert row(index=1.0).index(3000) == 1.0
    assert row().label == "air"
    assert row(index=1.658, abbe=57.3).label == "normal line 1.658/57.3"
    assert row(index=1.658, abbe=57.3).index(D_NM) == pytest.approx(1.658, rel=1e-15)
    with pytest.raises(GlassError, match="nothing is known of the dispersion"):
        row(index=1.658)
    with pytest.raises(OutOfRange):
        row(index=1.658, abbe=57.3).index(710)


def test_a_printed_index_is_compared_at_its_own_wavelength():
    glass = find("schott:F5")

    assert row("schott:F5", glass.index(486.1327), 38.0, 486.1327) is glass
    with pytest.raises(
        GlassError, match=r"schott:F5 has index 1.603420 at 587.5618 nm, printed is 1.61461 \(-0.011192\)"
    ):
        row("schott:F5", glass.index(486.1327), 38.0)


@pytest.mark.parametrize(("dn", "dv", "fits"), [(4.9e-4, 0.49, True), (-5.1e-4, 0, False), (0, 0.51, False)])
def test_the_limits_are_5e_4_of_the_index_and_half_an_abbe_number(dn, dv, fits):
    glass = find("schott:F5")
    if fits:
        assert row("schott:F5", glass.nd + dn, glass.vd + dv) is glass
    else:
        with pytest.raises(GlassError, match="printed is"):
            row("schott:F5", glass.nd + dn, glass.vd + dv)


def test_a_mismatch_names_glasses_that_fit_the_same_name_first():
    with pytest.raises(GlassError, match=r"\+0.021353") as caught:
        row("cdgm:F5", 1.603, 38.0)

    assert caught.value.hint.startswith("1.603/38 fits schott:F5 (1.60342/38.03), hikari:F5")


def test_printed_numbers_do_not_choose_among_vendors():
    """Two of the three F5 are the same glass to five decimals, and one still has to be named."""
    with pytest.raises(GlassError, match="is a glass of 3 vendors"):
        row("F5", 1.62435, 35.94)


@pytest.mark.parametrize(
    ("text", "index"),
    [
        ("constant(1.5)", 1.5),
        ("cauchy(1.5, 0.01, 0.001)", 1.556),
        ("sellmeier(1.25, 0)", 1.5),
        ("Schott(2.25, 0, 0, 0, 0, 0)", 1.5),
    ],
)
def test_a_formula_can_stand_in_place_of_a_name(text, index):
    assert row(text).index(500) == pytest.approx(index, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "constant()",
        "constant(1, 2)",
        "sellmeier(1, 2, 3)",
        "schott(2.25)",
        "cauchy(inf)",
        "cauchy(1;5)",
        "Schott(",
        "cauchy(1.5",
    ],
)
def test_a_formula_that_is_none_is_refused_with_the_ones_that_are(text):
    with pytest.raises(GlassError, match="is no dispersion formula") as caught:
        row(text)

    assert "cauchy(a, b, ...)" in caught.value.hint


@pytest.mark.parametrize("text", ["constant(0.9)", "sellmeier(-3, 0)", "sellmeier(1, 0.25)"])
def test_a_formula_that_gives_no_index_of_a_glass_is_refused_where_it_is_evaluated(text):
    with pytest.raises(GlassError, match="at 500 nm"):
        row(text).index(500)


def test_no_real_glass_that_a_user_writes_as_a_formula_is_doubted_in_the_visible():
    """All Sellmeier formulas of the catalogue, at the wavelengths of their range between 400 and 700 nm."""
    written = [(glass, glass.dispersion) for glass in catalogue() if isinstance(glass.dispersion, Sellmeier)]
    written = [(glass, formula) for glass, formula in written if not formula.constant and glass.holds(C_UM * 1000)]
    assert len(written) > 500
    for glass, formula in written:
        text = f"sellmeier({', '.join(repr(number) for term in formula.terms for number in term)})"
        one = medium(glass=text, index=None, abbe=None, wavelength_nm=587.6)
        for wavelength_nm in np.linspace(max(400.0, glass.min_nm), min(700.0, glass.max_nm), 7):
            assert doubt_of(one, wavelength_nm) is None, glass.label


@pytest.mark.parametrize(
    ("text", "wavelength_nm", "said"),
    [
        ("sellmeier(0.6, 0.23)", 587.6, "resonance at 479.5832 nm"),
        ("sellmeier(1.1, 0.01, 0.9, 0.5)", 760.0, "resonance at 707.1068 nm"),
        ("cauchy(1.6, -0.001)", 587.6, "grows with the wavelength"),
        ("schott(2.3, 0.02, 0, 0, 0, 0)", 587.6, "grows with the wavelength"),
        ("sellmeier(1.1, 0.01, -0.2, 4)", 587.6, None),
        ("constant(1.5)", 587.6, None),
        ("sellmeier(0.6, 0.23)", 900.0, None),
        ("schott:N-BK7", 587.6, None),
    ],
)
def test_a_formula_is_doubted_near_its_resonance_and_where_its_index_grows(text, wavelength_nm, said):
    doubt = doubt_of(medium(glass=text, index=None, abbe=None, wavelength_nm=wavelength_nm), wavelength_nm)
    assert (doubt is None) == (said is None)
    assert said is None or (said in doubt.message and "um" in doubt.hint)


NM, TAU = (400.0, 500.0, 600.0), (0.6, 0.9, 0.98)


def test_a_glass_stated_for_twice_the_thickness_is_the_same_at_every_wavelength() -> None:
    """Twice the way squares what is left (Beer and Lambert), between the entries of the table, too."""
    thin, thick = stated(NM, TAU, 10.0), stated(NM, tuple(tau**2 for tau in TAU), 20.0)
    for nm in np.linspace(400, 600, 41):
        assert thick.share_per_mm(nm) == pytest.approx(thin.share_per_mm(nm), rel=BISECTED)
    for nm, tau in zip(NM, TAU, strict=True):
        assert thin.share_per_mm(nm) ** 10 == pytest.approx(tau, rel=BISECTED)


def test_between_two_entries_is_their_geometric_mean() -> None:
    assert stated(NM, TAU, 10.0).share_per_mm(450.0) ** 10 == pytest.approx(math.sqrt(0.6 * 0.9), rel=BISECTED)


@pytest.mark.parametrize("nm", [399.9, 600.1])
def test_nothing_is_known_beyond_a_table(nm: float) -> None:
    with pytest.raises(OutOfRange, match="known from 400 to 600 nm, not at"):
        stated(NM, TAU, 10.0).share_per_mm(nm)


@pytest.mark.parametrize(
    ("table", "code"),
    [
        (((400.0,), (0.9, 0.9)), "internal-transmittance"),
        (((), ()), "internal-transmittance"),
        (((500.0, 400.0), (0.9, 0.9)), "glass-wavelengths"),
        (((400.0,), (1.1,)), "internal-transmittance"),
        (((400.0,), (0.0,)), "internal-transmittance"),
    ],
)
def test_what_no_glass_has_is_refused(table: tuple[tuple[float, ...], tuple[float, ...]], code: str) -> None:
    with pytest.raises(GlassError) as refused:
        stated(*table, 10.0)
    assert refused.value.code == code


@pytest.mark.parametrize("angle_deg", [0.0, 40.0])
def test_a_ray_loses_by_its_own_way_through_the_glass(angle_deg: float) -> None:
    """A plate: thickness over the cosine of the angle in it."""
    index, tau = 1.6, stated(NM, TAU, 25.0).share_per_mm(450.0)
    glass = Surface(thickness_mm=12.0, semi_diameter_mm=50.0, index=index)
    lens = Prescription(surfaces=(glass, Surface(semi_diameter_mm=50.0, is_stop=True)))
    sine = math.sin(math.radians(angle_deg))
    way = np.array([[sine, 0.0, math.sqrt(1 - sine**2)]])
    losses = Losses(coatings=(Coating(reflectance=(0.0,)),) * 2, per_mm=(tau, 1.0))
    found = transmitted(towards_sensor(lens), np.array([[0.0, 0.0, -20.0]]), way, losses)
    length_mm = 12.0 / math.sqrt(1 - (sine / index) ** 2)
    assert found[0] == pytest.approx((0.6 * 0.9) ** (0.5 * length_mm / 25.0), rel=BISECTED)


def test_air_absorbs_nothing_and_what_the_table_lacks_is_refused() -> None:
    assert measured(medium(glass="", index=1.0, abbe=None, wavelength_nm=587.56)) is None
    for unknown in (
        find("ohara:LAL11"),
        medium(glass="constant(1.5)", index=None, abbe=None, wavelength_nm=587.56),
        medium(glass="", index=1.5168, abbe=64.2, wavelength_nm=587.56),
    ):
        with pytest.raises(GlassError) as refused:
            measured(unknown)
        assert unknown.label in refused.value.message and "plen:internalTransmittance" in (refused.value.hint or "")
