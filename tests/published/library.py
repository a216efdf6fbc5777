"""Lenses of the library by name, and lenses as optiland's."""

from pathlib import Path
from typing import Any

import numpy as np
from places import ROOT
from pxr import Usd

from pipeline.optics.prescription import Prescription
from pipeline.scene.lens import read_prescription


def path_of(name: str) -> Path:
    return ROOT / f"stages/lenses/{name}.usda"


def prescription(name: str) -> Prescription:
    stage = Usd.Stage.Open(path_of(name).as_posix())
    return read_prescription(stage.GetDefaultPrim())


def optic_of(lens: Prescription) -> Any:
    """A lens as optiland's, for an object at infinity; its image surface is the last vertex."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic

    optic = Optic()
    optic.surfaces.add(index=0, thickness=np.inf)
    for number, surface in enumerate(lens.surfaces, start=1):
        optic.surfaces.add(
            index=number,
            radius=surface.radius_mm,
            thickness=surface.thickness_mm if number < len(lens.surfaces) else 0.0,
            material=IdealMaterial(n=surface.index),
            is_stop=surface.is_stop,
        )
    optic.surfaces.add(index=len(lens.surfaces) + 1)
    optic.set_aperture("EPD", 1.0)
    optic.fields.set_type("angle")
    optic.fields.add(y=0)
    optic.wavelengths.add(value=0.5876, is_primary=True)
    return optic
