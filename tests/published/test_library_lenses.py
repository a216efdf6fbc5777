"""Claim: every lens of the library has the focal length and the back focal distance that its file states.

library_lenses.json holds what the sources state and what another program computed from their tables.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from published.library import ROOT, optic_of, prescription
from tolerances import NOMINAL_EFL, PRINTED_4_MM, PRINTED_BFD_MM

from pipeline.optics.first_order import first_order

LENSES = json.loads((Path(__file__).parent / "library_lenses.json").read_text(encoding="utf-8"))["lenses"]
FAR_FROM_NOMINAL = {  # and said to be, in the README of the library
    "double_gauss_50mm_canon",
    "double_gauss_100mm_mandler",
    "double_gauss_100mm_matsubara",
    "double_meniscus_100mm_protar",
    "double_meniscus_100mm_topogon",
}


def test_every_file_is_in_the_table_and_the_readme() -> None:
    found = {path.stem for path in (ROOT / "stages/lenses").glob("*.usda")}
    listed = re.findall(r"^\| (\w+) \| [^|]+ \| \d", (ROOT / "stages/lenses/README.md").read_text(), re.MULTILINE)
    assert found == set(LENSES)
    assert found == set(listed)


@pytest.mark.parametrize("name", LENSES)
def test_first_order_values_are_those_of_another_program(name: str) -> None:
    found, expected = first_order(prescription(name)), LENSES[name]["independent"]
    assert found.efl_mm == pytest.approx(expected["efl_mm"], rel=0, abs=PRINTED_4_MM)
    assert found.bfd_mm == pytest.approx(expected["bfd_mm"], rel=0, abs=PRINTED_4_MM)


@pytest.mark.parametrize("name", LENSES)
def test_nominal_values_are_kept_or_known_not_to_be(name: str) -> None:
    found, nominal = first_order(prescription(name)), LENSES[name]["nominal"]
    assert (abs(found.efl_mm / nominal["efl_mm"] - 1) > NOMINAL_EFL) == (name in FAR_FROM_NOMINAL)
    if nominal["bfd_mm"] is not None:
        assert found.bfd_mm == pytest.approx(nominal["bfd_mm"], rel=0, abs=PRINTED_BFD_MM)


@pytest.mark.heavy  # imports optiland
def test_every_lens_of_the_library_has_the_focal_lengths_that_optiland_computes() -> None:
    pytest.importorskip("optiland")
    wrong = {}
    for name, lens in LENSES.items():
        paraxial = optic_of(prescription(name)).paraxial
        found = {"efl_mm": float(np.ravel(paraxial.f2())[0]), "bfd_mm": float(np.ravel(paraxial.F2())[0])}
        if any(abs(found[key] - lens["independent"][key]) > PRINTED_4_MM for key in found):
            wrong[name] = found
    assert not wrong
