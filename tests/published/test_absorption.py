"""Claim: the absorption of glasses that ships is what their makers print.

Printed internal transmittances of N-BK7: data sheet of Schott for 517642.251, for 10 and 25 mm. Its catalogue file,
from which the shipped table comes, holds those of 25 mm.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from tolerances import BISECTED, PRINTED_3_SHARE

from pipeline.optics.glass.absorption import Absorption, measured
from pipeline.optics.glass.catalogue import Glass, catalogue, find
from pipeline.optics.glass.medium import GlassError

PRINTED = {
    2500: (0.665, 0.360),
    2325: (0.793, 0.560),
    1970: (0.933, 0.840),
    1530: (0.992, 0.980),
    1060: (0.999, 0.997),
    700: (0.998, 0.996),
    660: (0.998, 0.994),
    620: (0.998, 0.994),
    580: (0.998, 0.995),
    546: (0.998, 0.996),
    500: (0.998, 0.994),
    460: (0.997, 0.993),
    436: (0.997, 0.992),
    420: (0.997, 0.993),
    405: (0.997, 0.993),
    400: (0.997, 0.992),
    390: (0.996, 0.989),
    380: (0.993, 0.983),
    370: (0.991, 0.977),
    365: (0.988, 0.971),
    350: (0.967, 0.920),
    334: (0.905, 0.780),
    320: (0.770, 0.520),
    310: (0.574, 0.250),
}
"""Internal transmittances of N-BK7 by wavelength [nm]: of 10 mm, of 25 mm. At 300 nm 25 mm have 0.05, two digits."""


@pytest.mark.parametrize("nm", PRINTED)
def test_nbk7_lets_pass_what_its_data_sheet_prints(nm: int) -> None:
    glass = measured(find("schott:N-BK7"))
    assert glass is not None
    found = [glass.share_per_mm(nm) ** thickness for thickness in (10, 25)]
    np.testing.assert_allclose(found, PRINTED[nm], rtol=0, atol=PRINTED_3_SHARE)


def test_nbk7_has_its_colour_code() -> None:
    """33: 10 mm with both surfaces let 80 % pass at 330 nm, printed in tens of nanometres."""
    glass, medium = measured(find("schott:N-BK7")), find("schott:N-BK7")
    assert glass is not None
    nm = np.arange(320.0, 345.0, 0.1)
    reflected = np.array([((medium.index(one) - 1) / (medium.index(one) + 1)) ** 2 for one in nm])
    share = (1 - reflected) ** 2 * np.array([glass.share_per_mm(one) for one in nm]) ** 10
    assert round(float(np.interp(0.8, share, nm)) / 10) == 33


def test_every_shipped_absorption_is_one_without_gaps() -> None:
    """Positive everywhere: 0 stands for a gap in the source, and glasses with gaps are left out."""
    found = _shipped()
    assert len(found) == 1505
    for _, one in found:
        assert (np.diff(one.wavelengths_nm) > 0).all() and min(one.coefficients_per_mm) > 0


def _shipped() -> list[tuple[Glass, Absorption]]:
    found = []
    for glass in catalogue():
        try:
            one = measured(glass)
        except GlassError:
            continue
        assert one is not None
        found.append((glass, one))
    return found


@pytest.mark.heavy  # optiland carries a copy of the same database
def test_every_entry_is_that_of_the_database() -> None:
    optiland = pytest.importorskip("optiland")
    shelf = Path(optiland.__file__).parent / "database" / "data-nk" / "glass"
    for glass, found in _shipped():
        text = (shelf / glass.vendor / f"{glass.name}.yml").read_text(encoding="utf-8")
        assert "public domain" in text
        tabulated = text.partition("tabulated k")[2]
        pairs = np.array(re.findall(r"^\s+([\d.]+) ([\d.E+-]+)\s*$", tabulated, re.MULTILINE), float)
        np.testing.assert_allclose(found.wavelengths_nm, 1000 * pairs[:, 0], rtol=BISECTED)
        share = [np.exp(-4 * np.pi * k / (um * 1e-3)) for um, k in pairs]
        np.testing.assert_allclose([found.share_per_mm(nm) for nm in found.wavelengths_nm], share, rtol=BISECTED)
