"""Claim: optiland, a lens-design program, computes the focal lengths that library_lenses.json calls independent.

It is installed by `pip install optiland`; without it there is nothing to compare with.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from published.library import prescription
from tolerances import PRINTED_4_MM

pytestmark = pytest.mark.heavy  # imports optiland

LENSES = json.loads((Path(__file__).parent / "library_lenses.json").read_text(encoding="utf-8"))["lenses"]


def test_every_lens_of_the_library_has_the_focal_lengths_that_optiland_computes() -> None:
    pytest.importorskip("optiland")
    wrong = {}
    for name, lens in LENSES.items():
        paraxial = _optic(name).paraxial
        found = {"efl_mm": float(np.ravel(paraxial.f2())[0]), "bfd_mm": float(np.ravel(paraxial.F2())[0])}
        if any(abs(found[key] - lens["independent"][key]) > PRINTED_4_MM for key in found):
            wrong[name] = found
    assert not wrong


def _optic(name: str) -> Any:
    """A lens of the library as optiland's, for an object at infinity; its image surface is the last vertex."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic

    optic = Optic()
    optic.surfaces.add(index=0, thickness=np.inf)
    surfaces = prescription(name).surfaces
    for number, surface in enumerate(surfaces, start=1):
        optic.surfaces.add(
            index=number,
            radius=1 / surface.curvature_per_mm if surface.curvature_per_mm else np.inf,
            thickness=surface.thickness_mm if number < len(surfaces) else 0.0,
            material=IdealMaterial(n=surface.index),
            is_stop=surface.is_stop,
        )
    optic.surfaces.add(index=len(surfaces) + 1)
    optic.set_aperture("EPD", 1.0)
    optic.fields.set_type("angle")
    optic.fields.add(y=0)
    optic.wavelengths.add(value=0.5876, is_primary=True)
    return optic
