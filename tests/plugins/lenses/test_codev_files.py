"""Each command of a CODE V sequence changes the lens as it should, or is known to change nothing, or is refused."""

from functools import partial
from pathlib import Path

import pytest
from plugins.lenses import on_the_spot

from pipeline.app.stages import import_lens
from pipeline.optics.glass.medium import C_UM, D_UM, F_UM
from pipeline.optics.glass.row import medium
from pipeline.plugins.lenses.read import read_lens

read, refused = (partial(act, read_lens) for act in (on_the_spot.read, on_the_spot.refused))

SEQ = """RDM;LEN "VERSION: 11.0"
TITLE 'Singlet'
EPD 10.0
DIM M
WL 587.6
YAN 0.0 5.0
SO 0.0 0.1e14
S 40.0 5.0 1.6:50.0
  CIR 8.0
S -50.0 20.0
  CIR 8.0
S 0.0 10.0
  STO
  CON
  K -1.0
SI 0.0 0.0
GO
"""
EFL_MM = 1 / (0.6 * (1 / 40 + 1 / 50 - 0.6 * 5 / (1.6 * 40 * 50)))
"""Focal length of its two surfaces by the lens-maker's equation."""
RIM_MM = 5 * (1 - 0.6 / 40 * 5 / 1.6) - 20 * 5 / EFL_MM
"""Height at the stop of the ray that enters 5 mm from the axis."""

LATER = SEQ.replace("S 40.0 5.0 1.6:50.0", "S 1 1 AIR").replace("S -50.0 20.0", "S 0 0")
PRIVATE = "PRV\nPWL 656.3 587.6 486.1\n'END1' {}\n'OTHER' HAR 1 2 3\nEND\n"
WAYS = {
    "lower case": SEQ.lower().replace("gl", "GL"),
    "words": SEQ.replace("  STO", "  STOP").replace("DIM M", "DIM MM"),
    "curvatures": SEQ.replace("RDM;", "RDM N;").replace("S 40.0", "S 0.025").replace("S -50.0", "S -0.02"),
    "curvatures by default": SEQ.replace("RDM;", "").replace("S 40.0", "S 0.025").replace("S -50.0", "S -0.02"),
    "radii of programs that write no RDM": SEQ.replace("RDM;", ""),
    "millimetres by default": SEQ.replace("DIM M\n", ""),
    "infinity": SEQ.replace("0.1e14", "inf"),
    "assigned": LATER + "RDY S1 40; THI S1 5; GLA S1 1.6:50; CUY S2 -.02; THI S2 20; STO S1; STO S3; K S3 -1\n",
    "assigned behind a surface": SEQ.replace("S 40.0 5.0", "S 1 1").replace(
        "  CIR 8.0\nS -50", "CIR 8;RDY 40;THI 5\nS -50"
    ),
    "positions": LATER
    + "ZOO 3\nZOO RDY S1 40 41 42\nZOO THI S1 5 6 7\nTHI S1 Z2 9\nTHI S2 Z1 20\nRDY S2 -50;GLA S1 1.6:50\n"
    "ZOO VUY F2 0 .1 .2\nZOO EPD 10 11 12\n",
    "fictitious": SEQ.replace("1.6:50.0", "600000.500000"),
    "private": PRIVATE.format("1.596 1.6 1.608") + SEQ.replace("1.6:50.0", "'end1'"),
    "tilts of nothing": SEQ.replace("  STO", "  STO\n  XDE 0.0; YDE 0.0; ZDE 0.0\n  DAR\n  ADE 0.0; BDE S3 0"),
    "a tilted sensor": SEQ + "ADE SI 5\nTHI SI -0.1\nRDY SI -300\n",
    "labels": SEQ.replace("  CIR 8.0", "  CIR L'rim' 8.0\n  CIR EDG 9\n  SLB 'front'; THC 0; DLR S1 0.1"),
}

RED, BLUE = (
    1.53116 + (n - 1.53116) * (line_nm**-2 - 587.6**-2) / (listed_nm**-2 - 587.6**-2)
    for line_nm, listed_nm, n in ((656.3, 700.0, 1.5247), (486.1, 400.0, 1.5484))
)
WIDE_VD = 0.53116 / (BLUE - RED)
"""Of a table without the lines C and F: straight in the inverse square of the wavelength."""


@pytest.mark.parametrize("way", WAYS)
def test_a_lens_is_the_same_in_whatever_way_it_is_written(way: str, tmp_path: Path) -> None:
    first, second, stop = read(tmp_path, "a.seq", WAYS[way]).surfaces
    assert (first.radius_mm, second.radius_mm, stop.radius_mm) == (pytest.approx(40), pytest.approx(-50), float("inf"))
    assert [first.thickness_mm, second.thickness_mm, stop.thickness_mm] == [5, 20, 10]
    assert (first.index, first.abbe, second.index) == (1.6, pytest.approx(50), 1)
    assert [first.semi_diameter_mm, second.semi_diameter_mm] == [8, 8]
    assert [first.is_stop, second.is_stop, stop.is_stop] == [False, False, True]
    assert (stop.conic, stop.semi_diameter_mm) == (-1, pytest.approx(RIM_MM))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("SCA 2", "SCA may change the lens, and is not read"),
        ("DEL S1", "DEL may change the lens, and is not read"),
        ("INS S1", "INS may change the lens, and is not read"),
        ("RET S1", "RET may change the lens, and is not read"),
        ("RDX S1 30", "RDX: a surface of another kind"),
        ("AUT", "AUT may change the lens, and is not read"),
        ("^x == 3", "^X may change the lens"),
        ("EVA (EFL)", "EVA may change the lens"),
        ("LEN NEW", "LEN may change the lens"),
        ("THI S9 5", "THI S9: there is no surface of that name yet"),
        ("THI S1..2 5", "THI S1..2: there is no surface of that name yet"),
        ("THI SA 5", "THI SA: there is no surface of that name yet"),
        ("THI S1 5 6", 'THI must be a number, not "5 6"'),
        ("THI S1 (THI S2)*2", "THI must be a number"),
        ("S2 30 5", "S2 stands where S4 is due"),
        ("RMD S1 REFL", "RMD may change the lens"),
        ("YAN F0 3 4", 'YAN must be a number, not "F0"'),
    ],
)
def test_what_may_change_a_lens_is_obeyed_or_refused(line: str, said: str, tmp_path: Path) -> None:
    assert refused(tmp_path, "a.seq", f"{SEQ}{line}\n").startswith(f"a.seq:{SEQ.count(chr(10)) + 1}: {said}")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("SO 0.0", "K 1\nSO 0.0", "a.seq:7: K 1: there is no surface of that name yet"),
        ("0.1e14", "0.1e14 WATER", "a.seq:7: the object is in WATER; a lens begins in air"),
        ("1.6:50.0", "1.6 50 3", "a.seq: surface 1, line 8: no glass"),
        ("20.0\n", "1e13\n", "a.seq:10: surface 2 is infinitely far"),
        ("1.6:50.0", "'OTHER'", "a.seq:2: private glass OTHER: HAR is not read"),
    ],
)
def test_what_is_no_lens_is_refused_where_it_stands(old: str, new: str, said: str, tmp_path: Path) -> None:
    private = PRIVATE.format(1.5).replace("PRV\n", "PRV;").replace("'END1' 1.5\n", "")
    text = private + SEQ if "OTHER" in new else SEQ
    assert refused(tmp_path, "a.seq", text.replace(old, new)).startswith(said)


def test_what_is_decided_or_left_out_is_said(tmp_path: Path) -> None:
    text = (
        SEQ.replace("RDM;", "").replace("DIM M\n", "").replace("0.1e14", "500")
        + "ZOO 3\nTEM 20\nVUX 0 0\nTEM 40\nPIM\n"
    )
    said = [
        one.statement for one in read(tmp_path, "a.seq", text.replace("EPD 10.0", "FNO 4").replace("STO", "CIR 3")).lost
    ]
    assert said == [
        "no RDM: the numbers of surfaces are radii; as curvatures they make no lens",
        "TEM: a temperature; the lens is that of its indices",
        "PIM: a solve; values are taken as written",
        "the object distance of 500: a dataset says where its targets are",
        "FNO 4, an F-number at that distance; the stop decides",
        "3 zoom positions; the first one is read",
        "no STO: surface 1 is the stop, CODE V's default",
        "no DIM: lengths are millimetres, CODE V's default",
        "surface 1: 1.6:50.0 is read as the normal line through 1.6/50",
    ]


def test_private_glasses_are_read_by_their_equation_or_their_table(tmp_path: Path) -> None:
    """Laurent's coefficients of the optical cement NOA61, as lens makers print them: n_d 1.5596 by hand."""
    laurent = "LAU 2.36390625 0.0 0.025493134 -0.000580235 -0.349933e-5 0.445404e-7"
    w = D_UM * D_UM
    by_hand = 2.36390625 + 0.025493134 / w - 0.000580235 / w**2 - 0.349933e-5 / w**3 + 0.445404e-7 / w**4
    first, *_ = read(tmp_path, "a.seq", PRIVATE.format(laurent) + SEQ.replace("1.6:50.0", "END1")).surfaces
    assert first.index**2 == pytest.approx(by_hand, rel=1e-6)
    entry = medium(glass=first.glass, index=first.index, abbe=None, wavelength_nm=587.56)
    blue, red = entry.dispersion.index(F_UM), entry.dispersion.index(C_UM)
    assert (entry.dispersion.index(D_UM) - 1) / (blue - red) == pytest.approx(entry.vd)
    import_lens(tmp_path / "a.seq")
    one = read(tmp_path, "b.seq", "PRV\nPWL 587.6\n'ONE' 1.51\nEND\n" + SEQ.replace("1.6:50.0", "ONE"))
    assert (one.surfaces[0].index, one.surfaces[0].glass) == (1.51, "constant(1.51)")
    assert "surface 1: private glass ONE is n_d 1.51, V_d None" in [one.statement for one in one.lost]
    wide = "PRV\nPWL 700.0 587.6 400.0\n'ONE' 1.5247 1.53116 1.5484\nEND\n" + SEQ.replace("1.6:50.0", "ONE")
    assert read(tmp_path, "b.seq", wide).surfaces[0].abbe == pytest.approx(WIDE_VD)
