"""Light that lenses of the library let pass: photons of a white scene, and what surfaces and glass take of them."""

import argparse
import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np
from pxr import Usd

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.tracer import Tracer
from pipeline.optics.first_order import first_order
from pipeline.optics.prescription import Prescription
from pipeline.optics.rays import front_grid
from pipeline.optics.table import towards_sensor
from pipeline.optics.transmission import Coating, CoatingData, Losses, steepest_deg, transmitted
from pipeline.render.radiometry import axial_transmission, field_transmission, photon_rate
from pipeline.render.sensor.response import Radiance
from pipeline.scene.lens import ordered_surfaces, read_prescription
from pipeline.scene.load import load
from pipeline.scene.losses import read_losses

STAGES = Path(__file__).resolve().parents[1] / "stages"
RIG = STAGES / "rigs" / "conventional_100mm.usda"
LENS = STAGES / "lenses" / "double_gauss_100mm_codev.usda"
"""Four glasses of today's catalogue of Schott, f/2."""
LIGHT = Radiance(w_per_m2_sr=1.0, effective_nm=587.56)
SEMI_DIAMETERS_MM = (4.0, 8.0, 17.0)
COATING = 0.005
"""Reflectance of the coated surfaces: a number to compare with, not a maker's."""
FILM = CoatingData(film_indices=(1.38,), film_thicknesses_nm=(550 / 4 / 1.38,))
"""A quarter wave of magnesium fluoride at 550 nm, by its textbook index."""
WAVELENGTHS_NM = (380.0, 400.0, 450.0, 550.0, 650.0)
CORNER_MM, PITCH_MM = (18.0, 12.0), 0.01
"""Half of 36 mm x 24 mm, and pixels there."""
_GRID = 201
"""Rays along each side of a grid over the front of the lens."""


def main() -> None:
    """Print the tables."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    camera = load(RIG).cameras[0].camera
    print("| stop, mm | F-number | bundle, sr | photons/s per W m^-2 sr^-1 | bare | coated, 0.5 % |")
    print("|---|---|---|---|---|---|")
    for semi_mm in SEMI_DIAMETERS_MM:
        row(opened(camera, semi_mm))
    print()
    stage = Usd.Stage.Open(str(LENS))
    lens = catalogued(stage)
    print("| nm | glass alone | and bare surfaces | and films | films as tables without angles |")
    print("|---|---|---|---|---|")
    for nm in WAVELENGTHS_NM:
        print(f"| {nm:g} | {' | '.join(f'{share:.4f}' for share in shares(lens, nm))} |")
    print()
    print("| 550 nm | glass alone | and bare surfaces | and films | films as tables without angles |")
    print("|---|---|---|---|---|")
    for name, values in field_shares(lens, 550.0).items():
        print(f"| {name} | {' | '.join(f'{share:.4f}' for share in values)} |")
    rays = from_infinity(read_prescription(lens))
    steepest = steepest_deg(towards_sensor(read_prescription(lens)), *rays).max()
    print(f"\nsteepest ray: {steepest:.1f} degrees")


def row(camera: Camera) -> None:
    """Print one stop."""
    tracer, surfaces = Tracer(camera), camera.prescription.surfaces
    clear = (1.0,) * len(surfaces)
    bare = axial_transmission(tracer, Losses(coatings=(None,) * len(surfaces), per_mm=clear))
    coats = tuple(None if surface.is_stop else Coating(reflectance=(COATING,)) for surface in surfaces)
    coated = axial_transmission(tracer, Losses(coatings=coats, per_mm=clear))
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


def catalogued(stage: Usd.Stage) -> Usd.Prim:
    """The lens of a stage, there with the indices and the absorption of the catalogue of Schott."""
    stage.SetEditTarget(stage.GetSessionLayer())
    lens = stage.GetDefaultPrim()
    for name in ("indexSource", "transmittanceSource"):
        lens.GetAttribute(f"plen:{name}").Set("catalogue")
    for surface in ordered_surfaces(lens):
        glass = surface.GetAttribute("plen:glass")
        if glass.HasAuthoredValue():
            glass.Set(f"schott:{glass.Get()}")
    return lens


def shares(lens: Usd.Prim, nm: float) -> list[float]:
    """Shares of light on the axis from infinity that a lens lets pass, by kind."""
    return [mean(read_prescription(lens, nm), losses) for losses in kinds(lens, nm)]


def kinds(lens: Usd.Prim, nm: float) -> list[Losses]:
    """Losses: absorption alone; bare surfaces, too; films on those against air; in their place tables that hold what
    these films reflect at normal incidence.
    """
    prescription, losses = read_prescription(lens, nm), read_losses(lens, nm)
    media = list(pairwise([1.0, *(surface.index for surface in prescription.surfaces)]))
    film = FILM.at(nm)
    assert film is not None
    films = tuple(film if min(pair) == 1 < max(pair) else None for pair in media)
    coatings = [
        (Coating(reflectance=(0.0,)),) * len(media),
        losses.coatings,
        films,
        tuple(one and at_normal(one, *pair) for one, pair in zip(films, media, strict=True)),
    ]
    return [dataclasses.replace(losses, coatings=one) for one in coatings]


def field_shares(lens: Usd.Prim, nm: float) -> dict[str, list[float]]:
    """Shares by kind on the axis and in the corner of an image of what is at infinity."""
    prescription = read_prescription(lens, nm)
    size = tuple(round(2 * half / PITCH_MM) for half in CORNER_MM)
    sensor = Sensor(width_px=size[0], height_px=size[1], pitch_mm=PITCH_MM)
    focus_mm = -first_order(prescription).rear_focus_mm
    camera = Camera(prescription=prescription, sensor=sensor, sensor_distance_mm=focus_mm)
    fields = [one for losses in kinds(lens, nm) if (one := field_transmission(camera, (losses,)))]
    corners = [one.axis * float(one.relative_rows(0, 1, sensor.width_px)[0, 0]) for one in fields]
    return {"axis": [one.axis for one in fields], "corner": corners}


def at_normal(coating: Coating, before: float, behind: float) -> Coating:
    """A table without angles: what a coating reflects at normal incidence."""
    return Coating(reflectance=(float(1 - coating.passed(before, behind, np.ones(1))[0, 0]),))


def mean(prescription: Prescription, losses: Losses) -> float:
    """Mean share of the rays from infinity that pass all apertures."""
    found = transmitted(towards_sensor(prescription), *from_infinity(prescription), losses)
    return float(found[found > 0].mean())


def from_infinity(prescription: Prescription) -> tuple[np.ndarray, np.ndarray]:
    """Rays along the axis over the front of a lens: points and directions."""
    grid = front_grid(towards_sensor(prescription), _GRID)
    return grid - [0.0, 0.0, 50.0], np.tile([0.0, 0.0, 1.0], (len(grid), 1))


if __name__ == "__main__":
    main()
