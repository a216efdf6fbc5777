"""Light that a rig of the library gets through its lens: photons of a white scene, and what surfaces take of them."""

import argparse
import dataclasses
from pathlib import Path

from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import first_order
from pipeline.optics.transmission import Losses
from pipeline.render.radiometry import axial_transmission, photon_rate
from pipeline.render.sensor.irradiation import Radiance
from pipeline.scene.load import load

RIG = Path(__file__).resolve().parents[1] / "stages" / "rigs" / "conventional_100mm.usda"
LIGHT = Radiance(w_per_m2_sr=1.0, wavelength_nm=587.56)
SEMI_DIAMETERS_MM = (4.0, 8.0, 17.0)
COATING = 0.005
"""Reflectance of the coated surfaces: a number to compare with, not a maker's."""


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    camera = load(RIG).cameras[0].camera
    print("| stop, mm | F-number | bundle, sr | photons/s per W m^-2 sr^-1 | bare | coated, 0.5 % |")
    print("|---|---|---|---|---|---|")
    for semi_mm in SEMI_DIAMETERS_MM:
        row(opened(camera, semi_mm))


def row(camera: Camera) -> None:
    """Print one stop."""
    tracer, surfaces = Tracer(camera), camera.prescription.surfaces
    clear = (1.0,) * len(surfaces)
    bare = axial_transmission(tracer, Losses(reflectance=(None,) * len(surfaces), per_mm=clear))
    coats = tuple(0.0 if surface.is_stop else COATING for surface in surfaces)
    coated = axial_transmission(tracer, Losses(reflectance=coats, per_mm=clear))
    number = first_order(camera.prescription).f_number
    diameter = 2 * camera.prescription.stop.semi_diameter_mm
    light = f"{tracer.reference_weight_sr:.5f} | {photon_rate(camera, LIGHT):.3g}"
    print(f"| {diameter:g} | {number:.2f} | {light} | {bare:.3f} | {coated:.3f} |")


def opened(camera: Camera, stop_semi_mm: float) -> Camera:
    """The same camera with another stop."""
    surfaces = tuple(
        dataclasses.replace(one, semi_diameter_mm=stop_semi_mm) if one.is_stop else one
        for one in camera.prescription.surfaces
    )
    return dataclasses.replace(camera, prescription=dataclasses.replace(camera.prescription, surfaces=surfaces))


if __name__ == "__main__":
    main()
