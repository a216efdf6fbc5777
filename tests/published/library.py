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


def optic_of(
    lens: Prescription, behind_mm: float = 0.0, fields_deg: tuple[float, ...] = (0.0,), wavelength_nm: float = 587.6
) -> Any:
    """A lens as optiland's, for objects at infinity; its image surface lies behind the last vertex."""
    from optiland.materials import IdealMaterial
    from optiland.optic import Optic

    optic = Optic()
    optic.surfaces.add(index=0, thickness=np.inf)
    for number, surface in enumerate(lens.surfaces, start=1):
        optic.surfaces.add(
            index=number,
            radius=surface.radius_mm,
            thickness=surface.thickness_mm if number < len(lens.surfaces) else behind_mm,
            material=IdealMaterial(n=surface.index),
            is_stop=surface.is_stop,
        )
    optic.surfaces.add(index=len(lens.surfaces) + 1)
    optic.set_aperture("float_by_stop_size", 2 * lens.stop.semi_diameter_mm)
    optic.fields.set_type("angle")
    for angle in fields_deg:
        optic.fields.add(y=angle)
    optic.wavelengths.add(value=wavelength_nm / 1e3, is_primary=True)
    return optic
