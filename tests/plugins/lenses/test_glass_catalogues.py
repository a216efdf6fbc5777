"""AGF catalogues of makers, and glasses that a user puts in place of those of a file."""

import math
from pathlib import Path

import pytest
from plugins.lenses.on_the_spot import stage_prescription
from tolerances import BISECTED

from pipeline.app.stages import import_lens, write_stage
from pipeline.errors import PipelineError
from pipeline.plugins.lenses.agf import read_agf

BK7 = "1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653"
FILE = """UNIT MM
ENPD 5
SURF 0
  DISZ INFINITY
SURF 1
  STOP
  CURV 0.02
  DISZ 4
  GLAS {} 0 0 1.5 40
  DIAM 9 1
SURF 2
  DISZ 90
  DIAM 9 1
SURF 3
  CURV 0
"""


def catalogue(folder: Path, *glasses: str) -> Path:
    """An AGF file of glasses `name formula n_d | coefficients`."""
    rows = ["CC made for a test"]
    for glass in glasses:
        (name, kind, nd), numbers = (part.split() for part in glass.split("|"))
        rows += [f"NM {name} {kind} 517642 {nd} 64.17 0 1", "ED 7.1 0 2.51", f"CD {' '.join(numbers)}", "LD 0.3 2.5"]
    path = folder / "maker.AGF"
    path.write_text("\n".join(rows) + "\n", encoding="utf-16")
    return path


def powers(constant: float, *terms: tuple[float, int]) -> float:
    """A formula of n^2 in powers of a wavelength of 0.5 um."""
    return math.sqrt(constant + sum(a * 0.5**e for a, e in terms))


@pytest.mark.parametrize(
    ("glass", "index"),
    [
        (
            "1 0 | 2.2 -0.01 0.01 0.002 -1e-4 1e-5",
            powers(2.2, (-0.01, 2), (0.01, -2), (2e-3, -4), (-1e-4, -6), (1e-5, -8)),
        ),
        ("10 0 | 2.2 0 0.01 0 0 0 1e-6 1e-7", powers(2.2, (0.01, -2), (1e-6, -10), (1e-7, -12))),
        ("12 0 | 2.2 0 0.01 0 0 0 1e-4 -1e-4", powers(2.2, (0.01, -2), (1e-4, 4), (-1e-4, 6))),
        ("13 0 | 2.2 -0.01 1e-3 0.01 0 0 0 0 1e-7", powers(2.2, (-0.01, 2), (1e-3, 4), (0.01, -2), (1e-7, -12))),
        ("9 0 | 2.2 0.1 0.01 0.2 100 0", math.sqrt(2.2 + 0.1 * 0.25 / 0.24 + 0.2 * 0.25 / (0.25 - 100))),
        ("2 0 | 1 0.01 0.1 0.02 1 100 0 0", math.sqrt(1 + 0.25 / 0.24 + 0.1 * 0.25 / 0.23 + 0.25 / (0.25 - 100))),
        ("11 0 | 0.2 0.01 0.2 0.01 0.2 0.01 0.2 0.01 0.2 0.01", math.sqrt(1 + 0.25 / 0.24)),
    ],
)
def test_formulas_of_agf_are_those_of_its_manual(glass: str, index: float, tmp_path: Path) -> None:
    """OpticStudio's user guide, "Using Material Catalogs": wavelengths in um."""
    found = read_agf(catalogue(tmp_path, f"MINE {glass}"))["mine"]()
    assert found.medium.index(500.0) == pytest.approx(index, rel=BISECTED)


def test_a_stage_of_a_makers_catalogue_needs_no_catalogue(tmp_path: Path) -> None:
    """N-BK7 under another name: indices of Schott's data sheet at F and d."""
    lens, out = tmp_path / "lens.zmx", tmp_path / "lens.usda"
    lens.write_text(FILE.format("MINE"))
    maker = catalogue(tmp_path, f"MINE 2 1.5168 | {BK7}")
    imported = import_lens(lens, catalogues=[maker])
    assert "MINE of maker.AGF is known from 300 to 2500 nm" in imported.warnings[0]
    text = imported.text.replace("uniform token[]", 'uniform token plen:indexSource = "catalogue"\n    uniform token[]')
    maker.unlink()
    assert write_stage(text, out) == []
    assert stage_prescription(out).surfaces[0].index == pytest.approx(1.51680, abs=5e-6)
    assert stage_prescription(out, 486.1327).surfaces[0].index == pytest.approx(1.52238, abs=5e-6)


def test_a_formula_that_we_lack_or_that_contradicts_its_index_is_named_where_it_is_used(tmp_path: Path) -> None:
    maker = catalogue(tmp_path, "OLD 5 1.5 | 1.5 0.01 0.001", f"WRONG 2 1.6 | {BK7}", f"FINE 2 1.5168 | {BK7}")
    lens = tmp_path / "lens.zmx"
    lens.write_text(FILE.format("FINE"))
    import_lens(lens, catalogues=[maker])
    for name, said in (
        ("OLD", "formula 5, Conrady, which we do not have"),
        ("WRONG", "n_d 1.6 in its line NM and 1.5168"),
    ):
        lens.write_text(FILE.format(name))
        with pytest.raises(PipelineError, match=r"surface 1, line 9: .*maker.AGF:\d+: glass") as refused:
            import_lens(lens, catalogues=[maker])
        assert said in str(refused.value)


@pytest.mark.parametrize(("text", "said"), [("CC none", "holds no glass"), ("CC\nNM X 2", "maker.agf:2: NM has no")])
def test_what_is_no_catalogue_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "maker.agf").write_text(text)
    with pytest.raises(PipelineError, match=said):
        read_agf(tmp_path / "maker.agf")


@pytest.mark.parametrize(
    ("replaced", "index"),
    [("foo=schott:N-BK7", 1.5168), ("FOO=MINE", 1.5168), ("FOO=1.6:50", 1.6), ("Foo=schott:BK7", 1.5168)],
)
def test_a_glass_of_a_file_is_replaced(replaced: str, index: float, tmp_path: Path) -> None:
    lens, out = tmp_path / "lens.zmx", tmp_path / "lens.usda"
    lens.write_text(FILE.format("FOO"))
    imported = import_lens(lens, catalogues=[catalogue(tmp_path, f"MINE 2 1.5168 | {BK7}")], replaced=[replaced])
    write_stage(imported.text, out)
    assert stage_prescription(out).surfaces[0].index == pytest.approx(index, abs=5e-6)
    assert f"{replaced.partition('=')[0]} is replaced by" in imported.warnings[0]


@pytest.mark.parametrize(
    ("replaced", "said"),
    [
        ("BAR=schott:N-BK7", "has no glass BAR"),
        ("FOO", "NAME=vendor:OTHER"),
        ("FOO=schott:N-BK8", 'no glass "schott:N-BK8"'),
    ],
)
def test_a_replacement_that_replaces_nothing_is_refused(replaced: str, said: str, tmp_path: Path) -> None:
    lens = tmp_path / "lens.zmx"
    lens.write_text(FILE.format("FOO"))
    with pytest.raises(PipelineError) as refused:
        import_lens(lens, replaced=[replaced])
    assert said in f"{refused.value} {refused.value.hint}"
