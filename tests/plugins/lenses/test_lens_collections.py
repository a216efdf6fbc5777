"""Lenses of FlareSim and of the Optical Bench: what their files lost on the way is found, and nothing is guessed."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from places import ROOT
from plugins.lenses import on_the_spot
from plugins.lenses.on_the_spot import LENSES, stage_prescription
from tolerances import NOMINAL_EFL, PRINTED_3_MM

from pipeline.app.stages import import_lens
from pipeline.errors import UsageError
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.printed import PrintedLens, prescription_of
from pipeline.optics.table import towards_sensor
from pipeline.plugins.lenses.read import read_lens
from pipeline.plugins.lenses.stated import axial_blur_mm, figures

FLARESIM = Path(__file__).with_name("flaresim")
PUBLISHED = json.loads((ROOT / "tests/published/library_lenses.json").read_text())["lenses"]
read, refused = (partial(act, read_lens) for act in (on_the_spot.read, on_the_spot.refused))


def said(lens: PrintedLens) -> str:
    return "\n".join(lost.statement for lost in lens.lost)


@pytest.mark.parametrize(
    ("name", "other"),
    [("canon_rf_50mm_f1p8", "double_gauss_50mm_canon_rf"), ("canon_ef_100mm_f2p8_macro", "macro_100mm_canon")],
)
def test_a_lens_of_another_collection_has_the_same_figures(name: str, other: str) -> None:
    """The same example of the same patent, typed by other people; `independent` was computed by another program."""
    found = first_order(prescription_of(read_lens(FLARESIM / f"{name}.lens")))
    assert found.efl_mm == pytest.approx(PUBLISHED[other]["independent"]["efl_mm"], abs=PRINTED_3_MM)
    assert found.bfd_mm == pytest.approx(PUBLISHED[other]["independent"]["bfd_mm"], abs=PRINTED_3_MM)


@pytest.mark.parametrize(
    ("name", "efl_mm", "f_number"),
    [
        ("nikkor_135mm_f2", 135, 2),
        ("planar_80mm_f2p8", 80, 2.8),
        ("tessar_100mm_f4p5", 100, 4.5),
        ("zoom_nikkor_28mm_f4p5", 28.85, 4.5),
    ],
)
def test_a_lens_is_what_its_file_states(name: str, efl_mm: float, f_number: float) -> None:
    lens = read_lens(FLARESIM / f"{name}.lens")
    found = first_order(prescription_of(lens))
    assert found.efl_mm == pytest.approx(efl_mm, rel=NOMINAL_EFL)
    assert found.f_number == pytest.approx(f_number, rel=0.03)
    assert lens.nominal_bfd_mm == pytest.approx(found.bfd_mm, abs=0.005 * efl_mm)
    assert len(lens.lost) == 1 and "read as diameter" in said(lens)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("canon_rf_50mm_f1p8", "it may have lost aspheric terms"),
        ("nikkor_180mm_f2p8", "the rows have the focal length 198.96 mm, the file states 180 (+10.5 %)"),
        ("nikkor_180mm_f2p8", "the focus lies 69.3171 mm behind the last row, whose thickness is 41.26 mm"),
    ],
)
def test_what_a_file_lost_is_said(name: str, words: str) -> None:
    assert words in said(read_lens(FLARESIM / f"{name}.lens"))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("distagon_35mm_f1p2", "has no stop"),
        ("canon_ef_50mm_f1p0", "can be diameters, as in most such files, or semi-diameters"),
        ("russar_70mm_f8", "surface 2: semi-diameter 22.96 mm reaches beyond a sphere of radius 22.69 mm"),
    ],
)
def test_a_file_that_needs_a_person_is_refused(name: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        import_lens(FLARESIM / f"{name}.lens")


def flaresim(lens: Prescription, factor: float = 2.0, f_number: float | None = None) -> str:
    """A `.lens` file, with `factor` times the semi-diameters in its column."""
    stated = f", f/{f_number}" if f_number else ""
    rows = [
        f"{'stop' if s.is_stop else repr(s.radius_mm if np.isfinite(s.radius_mm) else 0)} {s.thickness_mm!r}"
        f" {s.index!r} 50 {factor * s.semi_diameter_mm!r} 1"
        for s in lens.surfaces
    ]
    head = f"# {len(rows)} surfaces, 6 glass elements{stated}\n\nname: A lens\nfocal_length: 100\n\nsurfaces:\n"
    return head + "\n".join(rows) + "\n"


TRONNIER = stage_prescription(LENSES / "double_gauss_100mm_tronnier.usda")


@pytest.mark.parametrize("factor", [2.0, 1.0])
def test_the_f_number_decides_what_semi_ap_means(factor: float, tmp_path: Path) -> None:
    """Narrow apertures are possible in both readings; the stop is that of one F-number only."""
    narrow = Prescription(
        surfaces=tuple(
            Surface(radius_mm=s.radius_mm, thickness_mm=s.thickness_mm, semi_diameter_mm=s.semi_diameter_mm / 3,
                    index=s.index, is_stop=s.is_stop)
            for s in TRONNIER.surfaces
        )
    )  # fmt: skip
    speed = round(first_order(narrow).f_number, 1)
    lens = read(tmp_path, "a.lens", flaresim(narrow, factor, speed))
    for one, other in zip(prescription_of(lens).surfaces, narrow.surfaces, strict=True):
        assert one.semi_diameter_mm == pytest.approx(other.semi_diameter_mm, rel=1e-15)
        assert (one.radius_mm, one.thickness_mm, one.index, one.is_stop) == (
            other.radius_mm, other.thickness_mm, other.index, other.is_stop)  # fmt: skip
    assert f"only so the stop gives f/{speed:g}" in said(lens)
    assert "--apertures diameter" in refused(tmp_path, "a.lens", flaresim(narrow, factor))
    told = read(tmp_path, "a.lens", flaresim(narrow, factor), apertures="diameter")
    assert told.surfaces[0].semi_diameter_mm == pytest.approx(narrow.surfaces[0].semi_diameter_mm * factor / 2)


def test_the_coating_of_flaresim_may_be_missing(tmp_path: Path) -> None:
    assert len(read(tmp_path, "a.lens", flaresim(TRONNIER).replace(" 1\n", "\n")).surfaces) == len(TRONNIER.surfaces)


def test_the_blur_on_the_axis_is_that_of_traced_rays() -> None:
    """The kernels of the build trace the same 24 heights; the rms radius at the best focus is a parabola of depth."""
    lens = read_lens(FLARESIM / "planar_80mm_f2p8.lens")
    found, prescription = figures(lens), prescription_of(lens)
    assert found is not None
    height = found.entrance_pupil.diameter_mm / 2 * np.sqrt((np.arange(24) + 0.5) / 24)
    start_mm = prescription.vertices_from_stop_mm[0] - 5
    position = np.column_stack([0 * height, height, np.full(24, start_mm)])
    direction = np.tile([0.0, 0.0, 1.0], (24, 1))
    trace_rays(towards_sensor(prescription), position, direction, np.ones(24))
    slope = direction[:, 1] / direction[:, 2]
    at_vertex = position[:, 1] - slope * (position[:, 2] - prescription.vertices_from_stop_mm[-1])
    depths = found.bfd_mm + np.array([-1.0, 0.0, 1.0])
    squares = [np.mean((at_vertex + slope * depth) ** 2) for depth in depths]
    a, b, c = np.polyfit(depths - depths[1], squares, 2)
    assert axial_blur_mm(lens, found) == pytest.approx(np.sqrt(c - b**2 / (4 * a)), rel=1e-6)


BENCH = """[descriptive data]
title\tA bench
[constants]
{constants}[variable distances]
Focal Length\t100\t120
F-Number\t8\t9
d0\tInfinity\t900
d2\t2\t3
Bf\t95\t99
[lens data]
1\t{radius}\t4\t1.5\t18\t60
2\t-50\td2\t\t18
2AS\tAS\t0.5\t\t10
3\tCG\t1\t1.517\t20\t64.2
4\tInfinity\tBf\t\t20
[aspherical data]
1\t50\t-0.6\t{terms}
[figure]
ppmm\t3
"""


def bench(constants: str = "", terms: str = "1e-6\t2e-9", radius: str = "50") -> str:
    return BENCH.format(constants=constants, terms=terms, radius=radius)


def test_the_optical_bench_is_read_as_it_is_written(tmp_path: Path) -> None:
    lens = read(tmp_path, "a.txt", bench())
    assert [s.thickness_mm for s in lens.surfaces] == [4, 2, 0.5, 1, 95]
    assert [s.semi_diameter_mm for s in lens.surfaces] == [9, 9, 5, 10, 10]
    assert [s.index for s in lens.surfaces] == [1.5, 1, 1, 1.517, 1]
    assert [s.is_stop for s in lens.surfaces] == [False, False, True, False, False]
    assert (lens.surfaces[0].conic, lens.surfaces[0].asphere) == (-0.6, ((4, 1e-6), (6, 2e-9)))
    assert (lens.name, lens.nominal_efl_mm, lens.nominal_bfd_mm) == ("A bench", 100, 95)
    assert "scenario 1 of 2 was read (focal lengths 100, 120)" in said(lens)
    other = read(tmp_path, "a.txt", bench(), scenario=2)
    assert (other.surfaces[1].thickness_mm, other.nominal_efl_mm) == (3, 120)
    assert "focused on an object 900 mm away" in said(other)


@pytest.mark.parametrize(
    ("constants", "powers"),
    [
        ("", (4, 6, 8)),
        ("AsphericalA2\t1\n", (2, 4, 6)),
        ("AsphericalOddCount\t1\n", (3, 4, 6)),
        ("AsphericalOddCount\t2\n", (3, 4, 5)),
    ],
)
def test_constants_decide_the_powers_of_an_asphere(constants: str, powers: tuple[int, ...], tmp_path: Path) -> None:
    lens = read(tmp_path, "a.txt", bench(constants, "1e-6\t2e-9\t3e-12"))
    assert [power for power, _ in lens.surfaces[0].asphere] == list(powers)
    assert ("odd powers" in said(lens)) == ("Odd" in constants)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.lens", flaresim(TRONNIER).replace("stop", "0"), "a.lens: has no stop; without one the rows have the focal"),
        ("a.lens", flaresim(TRONNIER).replace(": 100", ": inf"), 'a.lens:4: focal_length must be a number, not "inf"'),
        ("a.lens", flaresim(TRONNIER).replace(" 50 ", " 50 -"), "a.lens:7: a surface has semi_ap -"),
        ("a.lens", flaresim(TRONNIER).replace(" 50 ", " ").replace(" 1\n", "\n"), "a.lens:7: a row has"),
        ("a.txt", bench().replace("2AS\tAS", "2AS\tFS"), "a.txt: 0 rows have AS for a radius"),
        ("a.txt", bench().replace("d2\t2\t3\n", ""), 'a.txt:11: the distance "d2" is not in [variable distances]'),
        ("a.txt", bench().replace("\t50\t-", "\t51\t-"), "a.txt:17: surface 1 has radius 50 mm, and 51 as an asphere"),
        ("a.txt", bench().replace("figure", "diffractive data"), "a.txt:18: [diffractive data] makes surfaces"),
        ("a.txt", bench().replace("1\t50\t-0.6", "1\t\t-0.6"), 'a.txt:17: the radius must be a number, not ""'),
        ("a.txt", bench().replace("1\t50\t-0.6\t1e-6\t2e-9", "1"), 'a.txt:17: the radius must be a number, not ""'),
    ],
)
def test_files_are_refused_with_file_and_line(name: str, text: str, words: str, tmp_path: Path) -> None:
    assert refused(tmp_path, name, text).startswith(words)


def test_a_scenario_that_is_not_there_is_refused(tmp_path: Path) -> None:
    assert "has no scenario 3; its [variable distances] have 2" in refused(tmp_path, "a.txt", bench(), scenario=3)
    assert "has no scenario 0" in refused(tmp_path, "a.txt", bench(), scenario=0)


def test_options_of_one_format_are_refused_for_others(tmp_path: Path) -> None:
    assert "--scenario is for texts of the Optical Bench" in refused(tmp_path, "a.lens", flaresim(TRONNIER), scenario=1)
    assert "--apertures is for lenses of FlareSim" in refused(tmp_path, "a.txt", bench(), apertures="diameter")
