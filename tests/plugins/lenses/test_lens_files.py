"""Lenses of the library go through the formats of other programs and come back as the same rays."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plugins.lenses import lens_writers as write
from plugins.lenses import on_the_spot
from plugins.lenses.on_the_spot import LENSES, before, stage_prescription
from tolerances import ROUND_TRIP_MM

from pipeline.app.stages import import_lens, write_stage
from pipeline.errors import UsageError
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_sensor
from pipeline.plugins.lenses.read import read_lens

FORMATS = {
    "zemax utf-16": ("lens.zmx", write.zemax),
    "zemax utf-8": ("lens.zmx", lambda lens: write.zemax(lens, "utf-8")),
    "zemax latin-1": ("lens.ZMX", lambda lens: write.zemax(lens, "latin-1")),
    "zemax inches": ("lens.zmx", lambda lens: write.zemax(lens, "utf-16", "IN")),
    "codev radii": ("lens.seq", write.codev),
    "codev curvatures": ("lens.seq", lambda lens: write.codev(lens, curvatures=True)),
    "pbrt after": ("lens.dat", write.pbrt),
    "pbrt before": ("lens.dat", lambda lens: write.pbrt(lens, "before")),
    "blender": ("lens.csv", write.blender),
    "optical bench": ("lens.txt", write.optical_bench),
}
# Without planes in air besides the stop; one of them has no thickness behind its last surface.
read, refused = (partial(act, read_lens) for act in (on_the_spot.read, on_the_spot.refused))
NAMES = ["double_gauss_100mm_tronnier", "double_gauss_99p5mm_zemax", "telephoto_250mm_sigler", "fisheye_10mm_muller"]


def rays(lens: Prescription) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """500 random rays into the front of a lens, traced to its last surface: points, directions, who is alive."""
    rng = np.random.default_rng(7)
    pupil = first_order(lens).entrance_pupil
    spread = rng.uniform(-0.6, 0.6, (500, 2)) * pupil.diameter_mm
    direction = np.column_stack([rng.uniform(-0.1, 0.1, (500, 2)), np.ones(500)])
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    position, alive = before(lens, spread, direction), np.ones(500)
    trace_rays(towards_sensor(lens), position, direction, alive)
    return position, direction, alive


def through(kind: str, lens: Prescription, folder: Path) -> None:
    """Fail unless a lens comes back from the file of another program as the same rays."""
    file_name, writer = FORMATS[kind]
    source, out = folder / file_name, folder / "lens.usda"
    source.write_bytes(writer(lens))
    assert write_stage(import_lens(source).text, out) == []
    (position, direction, alive), again = rays(lens), rays(stage_prescription(out))
    passed = alive == 1
    assert passed.sum() > 100 and np.array_equal(alive, again[2])
    np.testing.assert_allclose(again[0][passed], position[passed], rtol=0, atol=ROUND_TRIP_MM)
    np.testing.assert_allclose(again[1][passed], direction[passed], rtol=0, atol=ROUND_TRIP_MM)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", FORMATS)
def test_a_lens_comes_back_as_the_same_rays(kind: str, name: str, tmp_path: Path) -> None:
    through(kind, stage_prescription(LENSES / f"{name}.usda"), tmp_path)


def zmx(*surface: str) -> str:
    """A Zemax file with one element before a stop; extra lines belong to its first surface."""
    body = ["  CURV 0.02", "  DISZ 4", "  GLAS ___BLANK 1 0 1.5 60", "  DIAM 9 1", *surface]
    middle = ["SURF 2", "  CURV 0", "  DISZ 2", "  DIAM 9 1", "SURF 3", "  STOP", "  DISZ 90", "  DIAM 5 1"]
    return "\n".join(["UNIT MM", "SURF 0", "  DISZ INFINITY", "SURF 1", *body, *middle, "SURF 4", "  CURV 0"]) + "\n"


def test_zemax_names_what_it_cannot_keep(tmp_path: Path) -> None:
    waves = "FTYP 0 0 1 2 0\nWAVM 1 0.4861 1\nWAVM 2 0.5876 1\nWAVM 3 0.55 1\n"
    text = "COAT_FILE x\nVDYN 0.1 0\n" + waves + zmx("  ELAP 3 3").replace("DIAM 5 1", "DIAM 5 0") + "EFLY 1 43 0\n"
    lost = {one.statement.split(":")[0].split(" nm")[0]: one.line for one in read(tmp_path, "a.zmx", text).lost}
    assert lost["COAT_FILE is not read"] == 1
    assert lost["VDYN"] == 2
    assert "EFLY is not read" not in lost  # an operand of the merit function, behind the surfaces
    assert lost["surface 1"] == 15
    assert "surfaces 3 have automatic semi-diameters, for drawing; here they block rays" in lost
    assert "wavelengths 486.1, 587.6" in lost


@pytest.mark.parametrize(
    ("glass", "index", "said"),
    [
        (
            "SK4 0 0 1.7228 56.9",
            1.61272,
            ["schott:N-SK4 (1.61272/58.63) stands for SK4", "1.7228 beside glass SK4"],
        ),
        ("BK7 0 0 1.5168 64.2", 1.51680, ["schott:N-BK7 (1.51680/64.17) stands for BK7"]),
        ("648338 0 0 7734.33 17972.8", 1.648, ["648338 is read as", "index 7734.33 beside glass 648338"]),
        ("S-LAH64 0 0 1.5 40", 1.78800, ["S-LAH64 is in no catalogue that the file names; taken is ohara:S-LAH64"]),
        ("F_SILICA 0 0 1.5 40", 1.45846, ["material:FUSED-SILICA"]),
        ("___BLANK 1 0 1.6 50", 1.6, []),
        ("___BLANK 1 0 0.999712 0", 0.999712, []),
    ],
)
def test_the_name_of_a_zemax_glass_counts_and_a_number_only_without_one(
    glass: str, index: float, said: list[str], tmp_path: Path
) -> None:
    """Published indices of these names; Zemax leaves numbers of a solve beside a name that has replaced a model."""
    lens = read(tmp_path, "a.zmx", "GCAT SCHOTT_2014\n" + zmx(f"  GLAS {glass}"))
    assert lens.surfaces[0].index == pytest.approx(index, abs=6e-6)
    assert len(lens.lost) == len(said)
    assert all(words in one.statement and one.line == 10 for words, one in zip(said, lens.lost, strict=True))


def test_all_unknown_glasses_of_a_file_are_refused_at_once_with_near_names(tmp_path: Path) -> None:
    text = zmx("  GLAS NBK77 0 0 1.6 50").replace("DISZ 2", "DISZ 2\n  GLAS F2 0 0 1.5 40")
    said = refused(tmp_path, "a.zmx", text)
    assert 'surface 1, line 9: no glass "NBK77" is known' in said and "schott:N-BK7 (1.51680/64.17)" in said
    assert 'surface 2, line 13: "F2" is a glass of several makers: cdgm:F2 (1.61293/36.99)' in said


@pytest.mark.parametrize("glass", ["___BLANK 1 0 7734 18000", "___BLANK 1 0 0.5 0", "___BLANK 1 0"])
def test_a_model_glass_has_an_index_of_glass_or_gas(glass: str, tmp_path: Path) -> None:
    assert "a.zmx:9: surface 1: " in refused(tmp_path, "a.zmx", zmx(f"  GLAS {glass}"))


def test_a_lens_of_germanium_has_its_indices_at_the_primary_wavelength(tmp_path: Path) -> None:
    """4.0243 at 4 um, as Icenogle and others measured it (Applied Optics 15, 2348); zinc selenide 2.4331 there."""
    waves = "FTYP 0 0 1 2 0\nWAVM 1 3.5 1\nWAVM 2 4.0 1\nPWAV 2\n"
    text = zmx("  GLAS GERMANIUM 0 0 1.5 40").replace("DISZ 2", "DISZ 2\n  GLAS ZNSE 0 0 1.5 40")
    lens = read(tmp_path, "a.zmx", waves + text)
    assert [surface.index for surface in lens.surfaces[:2]] == pytest.approx([4.0243, 2.4331], abs=1e-3)
    assert lens.wavelength_nm == 4000
    assert "material:GERMANIUM is known from 2500 to 12000 nm, not at 587" in refused(tmp_path, "a.zmx", text)


def test_a_gap_of_gas_is_traced_and_is_no_element(tmp_path: Path) -> None:
    """Thick-lens formula with the gas behind; glass of that thickness would be warned of."""
    text = zmx().replace("1.5 60", "1.5168 64.2").replace("DISZ 2", "DISZ 0.05\n  GLAS ___BLANK 1 0 0.999712 0")
    (tmp_path / "a.zmx").write_text(text.replace("  CURV 0\n  DISZ 0.05", "  CURV -5e-4\n  DISZ 0.05"))
    assert write_stage(import_lens(tmp_path / "a.zmx").text, tmp_path / "a.usda") == []
    front, rear = 0.5168 * 0.02, (0.999712 - 1.5168) * -5e-4
    efl_mm = 1 / (front + rear - 4 / 1.5168 * front * rear)
    assert first_order(stage_prescription(tmp_path / "a.usda")).efl_mm == pytest.approx(efl_mm, rel=1e-12)


def test_configurations_surroundings_and_what_is_of_no_concern_are_said_rightly(tmp_path: Path) -> None:
    text = "ENVD 2.0E+1 1 0\n" + zmx("  COAT AR", "  LUID 23") + "MNUM 3 2\n"
    (many, rest) = (one.statement for one in read(tmp_path, "a.zmx", text).lost)
    assert many == "3 configurations; this lens is number 2, which was current when the file was saved"
    assert rest == "of no concern to the lens: COAT, LUID"
    (warm,) = (one.statement for one in read(tmp_path, "a.zmx", "ENVD 60 1 1\n" + zmx()).lost)
    assert warm.startswith("ENVD 60 1: ")


def test_roundings_are_planes_and_no_gaps_and_a_tilt_of_a_surface_is_refused(tmp_path: Path) -> None:
    assert read(tmp_path, "a.zmx", zmx("  DISZ -1.8e-9")).surfaces[0].thickness_mm == 0
    assert np.isinf(read(tmp_path, "a.zmx", zmx("  CURV 6.268e-18")).surfaces[0].radius_mm)
    assert "surface 1 is tilted" in refused(tmp_path, "a.zmx", zmx("  SCBD 1 0 0 0 0 90 0 0"))


def test_a_circular_aperture_of_zemax_stands_above_the_semi_diameter(tmp_path: Path) -> None:
    lens = read(tmp_path, "a.zmx", zmx("  CLAP 1 7.5 0"))
    assert (lens.surfaces[0].semi_diameter_mm, lens.surfaces[0].inner_semi_diameter_mm) == (7.5, 1)


STOP_OF_PUPIL = 1 - 0.5 * 0.02 * (4 / 1.5 + 2)
"""Height at the stop of `zmx` over that of a parallel ray at its first vertex: paraxial, by hand."""
EFL_OF_ZMX_MM = 1 / (0.5 * 0.02)


@pytest.mark.parametrize(
    ("said", "pupil_mm"), [("ENPD 6", 6.0), ("FNUM 20 0", EFL_OF_ZMX_MM / 20), ("FNUM 20 1", EFL_OF_ZMX_MM / 20)]
)
def test_the_system_aperture_of_zemax_opens_the_stop(said: str, pupil_mm: float, tmp_path: Path) -> None:
    """The stop prints an automatic DIAM 5, for drawing: it would be f/9.53."""
    lens = read(tmp_path, "a.zmx", f"{said}\n" + zmx().replace("DIAM 5 1", "DIAM 5 0"))
    rim_mm = pupil_mm / 2 * STOP_OF_PUPIL
    assert [surface.semi_diameter_mm for surface in lens.surfaces] == [9, 9, pytest.approx(rim_mm, rel=1e-12)]
    (lost,) = lens.lost
    asked, there = EFL_OF_ZMX_MM / pupil_mm, EFL_OF_ZMX_MM / (10 / STOP_OF_PUPIL)
    assert lost.line == 1
    assert lost.statement == (
        f"{said[:7].strip()} is f/{asked:.3g}: the stop, surface 3, gets semi-diameter {rim_mm:.6g} mm"
        f" in place of 5 mm, f/{there:.3g}"
    )


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("ENPD 6\nFLOA\n" + zmx(), []),  # "float by stop size"
        (f"ENPD {10 / STOP_OF_PUPIL!r}\n" + zmx(), []),
        ("ENPD 0\n" + zmx(), []),
        ("ENPD 20\n" + zmx().replace("DIAM 5 1", "DIAM 5 1\n  CLAP 0 5 0"), ["is a ring of semi-diameter 5 mm"]),
        ("FNUM 20 1\n" + zmx().replace("DISZ INFINITY", "DISZ 500"), ["the object distance", "a working f-number"]),
    ],
)
def test_the_stop_of_a_zemax_file_stays_where_it_decides(text: str, named: list[str], tmp_path: Path) -> None:
    lens = read(tmp_path, "a.zmx", text)
    assert lens.surfaces[2].semi_diameter_mm == 5
    assert len(lens.lost) == len(named)
    assert all(words in one.statement for words, one in zip(named, lens.lost, strict=True))


def test_a_ring_of_codev_stays_where_it_is_smaller_than_the_system_aperture(tmp_path: Path) -> None:
    """EPD 10 of the sequence opens the stop to 4.7 mm or so."""
    text = SEQ.replace("  STO", "  STO\n  CIR {}")
    narrow, wide = (read(tmp_path, "a.seq", text.format(radius)).surfaces[2] for radius in (3, 8))
    assert narrow.semi_diameter_mm == 3
    assert wide.semi_diameter_mm == pytest.approx(5 * (1 - 0.62041 / 50 * (4 / 1.62041 + 2)), rel=1e-12)


def aspheric(**first: Any) -> Prescription:
    """A singlet before its stop, with a conic asphere in front and a conic behind; `first` changes the front."""
    front = {"conic": -0.6, "even_coefficients": (0.0, -3e-6, 2e-9, 0.0, 1e-14), **first}
    return Prescription(
        surfaces=(
            Surface(radius_mm=30.0, thickness_mm=6.0, semi_diameter_mm=12.0, index=1.5, **front),
            Surface(radius_mm=-80.0, thickness_mm=4.0, semi_diameter_mm=12.0, conic=-2.5),
            Surface(semi_diameter_mm=8.0, is_stop=True, inner_semi_diameter_mm=2.0),
        )
    )


ASPHERES = {
    "even": aspheric(),
    "vertex": aspheric(even_coefficients=(2e-3, -3e-6)),
    "odd": aspheric(odd_coefficients=(1e-5, 0.0, -2e-9)),
    "rectangle": aspheric(half_widths_mm=(9.0, 6.0)),
}
KEPT = [(kind, name) for kind in FORMATS for name in ASPHERES if "zemax" in kind]
KEPT += [(kind, name) for kind in FORMATS for name in ("even", "rectangle") if "codev" in kind]


@pytest.mark.parametrize(("kind", "name"), KEPT)
def test_conics_aspheres_and_apertures_come_back_as_the_same_rays(kind: str, name: str, tmp_path: Path) -> None:
    lens = ASPHERES[name]
    through(kind, lens, tmp_path)
    (position, _, alive) = rays(lens)
    spheres = rays(Prescription(surfaces=tuple(replace(s, conic=0, even_coefficients=()) for s in lens.surfaces)))
    assert not (alive == 1).all()
    assert np.abs(spheres[0] - position)[alive == 1].max() > 1e3 * ROUND_TRIP_MM  # the terms matter


def test_the_unit_of_a_coefficient_is_a_power_of_the_unit_of_the_file(tmp_path: Path) -> None:
    text = zmx("  TYPE EVENASPH", "  CONI -0.5", "  PARM 1 0", "  PARM 2 1e-6").replace("UNIT MM", "UNIT CM")
    first, *_ = read(tmp_path, "a.zmx", text).surfaces
    assert (first.conic, first.asphere) == (-0.5, ((4, 1e-6 * 10.0**-3),))


def test_a_tip_at_the_vertex_is_refused(tmp_path: Path) -> None:
    read(tmp_path, "a.zmx", zmx("  TYPE ODDASPHE", "  PARM 1 1e-3"))
    with pytest.raises(UsageError, match=r"surface 1: the term r\^1 of its asphere makes the vertex a tip"):
        import_lens(tmp_path / "a.zmx")


def test_a_rectangle_alone_decides_how_far_a_surface_reaches(tmp_path: Path) -> None:
    """An automatic semi-diameter of Zemax is a drawing."""
    text = zmx("  SQAP 3 4 0").replace("DIAM 9 1\n  SQAP", "DIAM 2 0\n  SQAP")
    first, *_ = read(tmp_path, "a.zmx", text).surfaces
    assert (first.semi_diameter_mm, first.half_widths_mm) == (5, (3, 4))


def test_obstructions_that_leave_a_hole_are_named(tmp_path: Path) -> None:
    lost = [one.statement for one in read(tmp_path, "a.zmx", zmx("  OBSC 1 2 0")).lost]
    assert "surface 1: an obstruction from 1 to 2, which leaves a hole inside" in lost


SEQ = "RDM\nDIM M\nEPD 10\nYAN 0 14\nSO 0 1e13\nS 50 4 620410.603236\nS 0 2\nS 0 90\n  STO\nSI 0 -0.4\nGO\n"


def test_codev_fills_in_what_the_beam_needs_and_says_so(tmp_path: Path) -> None:
    """Marginal ray 5 mm at the first vertex; the chief ray passes the stop 4 / 1.62 + 2 mm behind it or so."""
    lens = read(tmp_path, "a.seq", SEQ)
    first, _, stop = lens.surfaces
    assert (first.index, first.abbe) == (1.62041, pytest.approx(60.3236))
    power = 0.62041 / 50
    behind = 4 / 1.62041 + 2
    assert stop.semi_diameter_mm == pytest.approx(5 * (1 - power * behind), rel=1e-12)
    slope = np.tan(np.radians(14))
    assert first.semi_diameter_mm == pytest.approx(5 + slope * behind / (1 - power * behind), rel=1e-12)
    said = [one.statement for one in lens.lost]
    assert any("surfaces 1, 2, 3 have no semi-diameter" in what for what in said)
    assert any("a defocus of -0.4" in what for what in said)


def test_vignetting_factors_become_semi_diameters(tmp_path: Path) -> None:
    """A field that loses a tenth of the pupil at either edge needs 0.5 mm less of the first surface."""
    plain = read(tmp_path, "a.seq", SEQ).surfaces[0].semi_diameter_mm
    text = SEQ.replace("YAN 0 14", "YAN 0 14\nVUY 0 0.1\nVLY 0 0.1")
    assert read(tmp_path, "a.seq", text).surfaces[0].semi_diameter_mm == pytest.approx(plain - 0.5, rel=1e-12)


def test_codev_private_glasses_have_their_index_in_the_file(tmp_path: Path) -> None:
    private = "PRV\nPWL 656.3 587.6 486.1\n'mine' 1.50 1.51 1.52\nEND\n"
    first, *_ = read(tmp_path, "a.seq", private + SEQ.replace("620410.603236", "'mine'")).surfaces
    assert (first.index, first.abbe, first.glass) == (1.51, pytest.approx(0.51 / 0.02), "")


ROWS = "50 4 1.5 18\n-50 2 1 18\n0 3 0 10\n-40 3 1.6 18\n-60 {last} 1 18\n"


def test_pbrt_says_how_it_read_the_thicknesses(tmp_path: Path) -> None:
    after = read(tmp_path, "a.dat", ROWS.format(last=0))
    assert "the space after each surface (the last row has thickness 0)" in after.lost[0].statement
    before = read(tmp_path, "a.dat", "50 0 1.5 18\n-50 4 1 18\n0 2 0 10\n-40 3 1.6 18\n-60 3 1 18\n")
    assert "the space before each surface (the first row has thickness 0)" in before.lost[0].statement
    assert before.surfaces == after.surfaces
    assert before.surfaces[2].is_stop and before.surfaces[0].semi_diameter_mm == 9


def test_pbrt_asks_when_both_readings_are_possible(tmp_path: Path) -> None:
    text = ROWS.format(last=7)
    said = refused(tmp_path, "a.dat", text)
    assert "can be the spaces before or after each surface" in said and "--spacing after" in said
    told = read(tmp_path, "a.dat", text, spacing="before")
    assert [surface.thickness_mm for surface in told.surfaces] == [2, 3, 3, 7, 0]


def test_pbrt_decides_by_surfaces_that_would_cross(tmp_path: Path) -> None:
    text = "20 6 1.5 18\n-20 0.1 1 18\n0 9 0 10\n-40 3 1.6 18\n-60 7 1 18\n"
    lens = read(tmp_path, "a.dat", text)
    assert lens.lost[0].statement.endswith('the space after each surface (read as "before", surfaces would cross)')


def test_pbrt_planes_in_glass_are_no_stops_and_two_stops_are_refused(tmp_path: Path) -> None:
    plane = "0 4 1.5 18\n-50 2 1 18\n0 3 0 10\n-40 3 1.6 18\n-60 0 1 18\n"
    stops = [surface.is_stop for surface in read(tmp_path, "a.dat", plane).surfaces]
    assert stops == [False, False, True, False, False]
    assert refused(tmp_path, "a.dat", "0 1 1 5\n" + plane).startswith("a.dat:4: 2 rows of radius 0 are in air")
    assert refused(tmp_path, "a.dat", "1 2 3\n").startswith("a.dat:1: a row has 3 columns, not 4")


BLENDER = "radius;thickness;material;index;v-no;sa\n50;4;BK7;1.5168;64.1;9\n;2;air;;;9\n;80;air;0;;5\n"


def test_blender_takes_the_second_of_two_air_rows_for_the_stop(tmp_path: Path) -> None:
    lens = read(tmp_path, "a.csv", BLENDER)
    assert [surface.is_stop for surface in lens.surfaces] == [False, False, True]
    assert (lens.surfaces[0].glass, lens.surfaces[0].abbe, lens.nominal_bfd_mm) == ("BK7", 64.1, 80)


def test_files_of_other_kinds_are_refused(tmp_path: Path) -> None:
    for name in ("a.zip", "camera.js"):
        with pytest.raises(UsageError, match=r'has the reader "lens..*"\n.*camera.js, lens.csv.*lens.zmx'):
            import_lens(tmp_path / name)
    assert "a camera of the add-on" in refused(tmp_path, "a.csv", "prop_wavelength;587.6\n")
    assert refused(tmp_path, "a.zmx", b"PK\0\1").startswith("a.zmx: is no text")
    assert "for lens tables of pbrt" in refused(tmp_path, "a.zmx", zmx(), spacing="after")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.zmx", zmx("  TYPE BICONICX"), "a.zmx:9: surface 1 is of type BICONICX"),
        ("a.zmx", zmx("  CURV x"), 'a.zmx:9: CURV must be a number, not "x"'),
        ("a.zmx", zmx("  GLAS NOSUCH 0 0 1.5 40"), 'a.zmx: surface 1, line 9: no glass "NOSUCH"'),
        ("a.zmx", zmx("UNIT METER\n  TYPE EVENASPH\n  PARM -200 1"), "a.zmx: holds numbers from which no lens can be"),
        ("a.seq", SEQ.replace("EPD 10\n", ""), "a.seq: surfaces 1, 2, 3 have no semi-diameter"),
        ("a.seq", SEQ.replace("620410.603236", "NO_SCHOTT"), 'a.seq: surface 1, line 6: no glass "NO" is known'),
        ("a.seq", SEQ.replace("S 0 2", "S 0 2\n  YDE 0.1;BEN"), "a.seq:7: BEN: only mirrors bend the axis"),
        ("a.seq", SEQ.replace("S 0 2", "REX 3\nS 0 2"), "a.seq:6: surface 1 has REX, and a rectangle needs REX and"),
        ("a.csv", BLENDER.replace("radius;", "r;"), "a.csv: 0 rows are marked as the aperture stop"),
        ("a.csv", BLENDER.replace("1.5168", ""), "a.csv:2: glass BK7 has no index"),
        ("a.csv", BLENDER.replace("50;4", "50;four"), 'a.csv:2: "thickness" must be a number, not "four"'),
    ],
)
def test_what_cannot_be_read_is_refused_with_file_and_line(name: str, text: str, said: str, tmp_path: Path) -> None:
    assert refused(tmp_path, name, text).startswith(said)
