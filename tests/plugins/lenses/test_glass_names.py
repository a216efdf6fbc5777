"""Names of glasses in lens files: what stands for old ones, makers by their catalogues, codes."""

import math

import pytest
from tolerances import BISECTED

from pipeline.optics.glass.catalogue import find, rows_of
from pipeline.optics.glass.medium import GlassError
from pipeline.optics.glass.row import MAX_ABBE_DIFFERENCE, MAX_INDEX_DIFFERENCE
from pipeline.plugins.lenses import names
from pipeline.plugins.lenses.names import maker, model, named

CLOSE, CLOSE_ABBE = 1e-4, 0.2
"""Differences of n_d and V_d up to which a glass of another name stands for an old one [1], as README.md there says."""


def test_what_stands_for_a_name_has_the_numbers_that_its_maker_printed() -> None:
    """A maker's own successor, N-SK16 for SK16, may be off by as much as a printed glass may; materials are named."""
    rows = rows_of("names.csv.gz", names.__file__)
    rows = [row for row in rows if row["stands"] and row["nd"] and "material:" not in row["stands"]]
    assert len(rows) > 700
    for row in rows:
        if row["stands"] == "water":
            continue
        glass, nd, vd = find(row["stands"]), float(row["nd"]), float(row["Vd"])
        heir = glass.vendor == row["vendor"] and glass.name.casefold().replace("-", "")[1:] == row["glass"].casefold()
        assert abs(glass.nd - nd) <= (MAX_INDEX_DIFFERENCE if heir else CLOSE), row
        assert abs(glass.vd - vd) <= (MAX_ABBE_DIFFERENCE if heir else CLOSE_ABBE) + 0.005, row  # V_d has two decimals


@pytest.mark.parametrize(
    ("name", "catalogues", "nd", "vd"),
    [
        ("BK7", ["SCHOTT"], 1.51680, 64.17),
        ("SK16", ["SCHOTT"], 1.62041, 60.32),
        ("LAK11", ["SCHOTT"], 1.65830, 57.26),
        ("F5", ["CDGM-ZEMAX202206"], 1.62435, 35.94),
        ("F2", ["HIKARI", "SCHOTT"], 1.62004, 36.33),
        ("F2", ["SCHOTT", "CDGM"], 1.62004, 36.37),
        ("F2", ["CDGM", "SCHOTT"], 1.61293, 36.99),
        ("SK51", ["OLD_SCHO"], 1.62090, 60.31),
        ("BAF2", ["SCHOTT", "INFRARED"], 1.47448, 81.61),
        ("BAF2", ["CDGM"], 1.56970, 49.45),
        ("N15", ["MISC"], 1.5, None),
        ("NSSK2", ["SCHOTT"], 1.62229, 53.27),
        ("517642", [], 1.517, 64.2),
        ("003283", [], 2.003, 28.3),
        ("620410.603236", [], 1.62041, 60.3236),
        ("1.5168:64.17", [], 1.5168, 64.17),
    ],
)
def test_names_and_codes_are_the_glasses_of_their_makers(
    name: str, catalogues: list[str], nd: float, vd: float | None
) -> None:
    found = named(name, catalogues)
    assert found.medium.nd == pytest.approx(nd, abs=4e-5)
    assert found.medium.vd is None if vd is None else found.medium.vd == pytest.approx(vd, abs=0.14)


@pytest.mark.parametrize("name", ["F2", "BAF2"])
def test_a_name_of_several_makers_is_refused_without_a_catalogue(name: str) -> None:
    with pytest.raises(GlassError, match=f'"{name}" is a glass of several makers: cdgm:'):
        named(name, ["LACROIX"] if name == "F2" else [])


def test_the_maker_of_a_dated_catalogue_is_known_by_its_name() -> None:
    texts = "SCHOTT_2014 CDGM-ZEMAX202206 SUMITA_AUG2011 HOYA20220711 OLD_SCHO NIKON-HIKARI_201911 CORNIN"
    makers = ["schott", "cdgm", "sumita", "hoya", "schott", "hikari", "corning"]
    assert [maker(text) for text in texts.split()] == makers
    assert {maker(text) for text in ("MISC", "INFRARED", "SPECIAL", "LACROIX")} == {""}


@pytest.mark.parametrize("nd", [7734.33, 5.1, 1.1, 0.5, math.nan])
def test_no_medium_has_such_an_index(nd: float) -> None:
    with pytest.raises(GlassError):
        model(nd, 50.0)


@pytest.mark.parametrize(
    ("name", "wavelength_nm", "index", "within"),
    [
        ("material:FUSED-SILICA", 587.5618, 1.458464, 1e-6),  # Malitson 1965, table 1
        ("material:FUSED-SILICA", 1060.0, 1.449678, 3e-6),
        ("material:CALCIUM-FLUORIDE", 587.5618, 1.43384, 2e-5),  # Malitson 1963
        ("material:GERMANIUM", 10600.0, 4.0043, 1e-3),  # Icenogle, Platt and Wolfe 1976
        ("material:ZINC-SELENIDE", 10600.0, 2.4028, 2e-4),  # Raytran's data sheet
        ("material:SAPPHIRE-O", 587.5618, 1.76817, 1e-5),  # Malitson and Dodge 1972
        ("material:MAGNESIUM-FLUORIDE-O", 587.5618, 1.37774, 1e-5),  # Dodge 1984
        ("schott:B270", 546.07, 1.5251, 6e-5),  # Schott's data sheet of 1993, to four decimals
        ("lzos:LZ_K8", 404.66, 1.52982, 1.1e-5),  # the maker's table
    ],
)
def test_materials_have_their_published_indices(name: str, wavelength_nm: float, index: float, within: float) -> None:
    assert find(name).index(wavelength_nm) == pytest.approx(index, abs=within)


def test_a_code_is_the_normal_line_and_says_which_glass_is_near() -> None:
    found = named("517642")
    assert found.glass == "" and found.medium.nd == pytest.approx(1.517, rel=BISECTED)
    assert "the nearest glass is cdgm:H-K9L (1.51680/64.20): n_d -0.00020, V_d +0.00" in found.remark
