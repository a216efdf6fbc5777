"""Diffraction in images, by rays that random numbers move, beside the diffraction of the traced wavefront.

The first table is about a circular aperture without aberrations: modulation transfer in closed form, of the picture
from which images draw, and of rays that are bent at the edge of the aperture as Freniere, Gregory and Hassler describe
it (Edge diffraction in Monte Carlo ray tracing, SPIE 3780, 1999). The second is about rigs of the library: by how much
contrast differs between both levels, up to the Nyquist frequency of the pixels, and what rays alone would say.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from pipeline.camera.focusing.depth_of_field import foci
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.records import Diffraction
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave.spread import strehl_ratio, transfer, transfer_of_rays
from pipeline.camera.wave.wavefront import View, wavefront
from pipeline.scene.load import load

STAGES = Path(__file__).resolve().parents[1] / "stages" / "rigs"
WAVELENGTH_NM = 587.56
SHARES = (0.1, 0.25, 0.5, 0.75)
"""Spatial frequencies of the first table, over the limit of the aperture."""
RINGS = 4000
"""Rings of an aperture whose rays are bent: the mean over them is right to a thousandth."""
FOCAL_MM = 100.0


def main() -> None:
    """Print both tables."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    perfect_aperture()
    print()
    rigs_of_the_library()


def perfect_aperture() -> None:
    """The first table: a circular stop on the axis of a rig that is all but perfect when it is stopped down."""
    camera = rig_of("conventional_100mm")
    rig = drawn(camera)
    front = wavefront(rig.tracer, View(np.zeros(2), NO_MICROLENS, foci(camera)[0].focus_distance_mm), WAVELENGTH_NM)
    limit = 2 * front.numerical_aperture / front.wavelength_mm
    shares = np.array(SHARES)
    closed = 2 / np.pi * (np.arccos(shares) - shares * np.sqrt(1 - shares**2))
    pictured = np.abs(of_picture(rig.diffraction, len(rig.diffraction.edge_mm) // 2, shares * limit))
    bent = bent_at_the_edge(front.numerical_aperture, front.wavelength_mm, shares * limit)
    print("| frequency over the limit of the aperture | closed form | images | bent at the edge |")
    print("|---|---|---|---|")
    for row in zip(shares, closed, pictured, bent, strict=True):
        print("| {:.2f} | {:.3f} | {:.3f} | {:.3f} |".format(*row))


def bent_at_the_edge(aperture: float, wavelength_mm: float, per_mm: np.ndarray) -> np.ndarray:
    """Transfer of rays through a circle that are bent by normal random angles, across its edge and along it.

    The tangent of the angle across has the standard deviation wavelength / (4 pi d), with d the distance from the edge;
    along the edge d is half of the chord.
    """
    radius = FOCAL_MM * np.tan(np.arcsin(aperture))
    height = radius * np.sqrt((np.arange(RINGS) + 0.5) / RINGS)
    across, along = radius - height, np.sqrt(radius**2 - height**2)
    azimuth = (np.arange(64) + 0.5) * np.pi / 32
    widths = [FOCAL_MM * wavelength_mm / (4 * np.pi * distance) for distance in (across, along)]
    variance = np.outer(widths[0] ** 2, np.cos(azimuth) ** 2) + np.outer(widths[1] ** 2, np.sin(azimuth) ** 2)
    return np.array([np.exp(-2 * (np.pi * one) ** 2 * variance).mean() for one in per_mm])


def of_picture(diffraction: Diffraction, picture: int, per_mm: np.ndarray) -> np.ndarray:
    """Transfer along x of one of the pictures from which images draw."""
    rows = np.diff(diffraction.rows[picture], prepend=0.0)
    columns = rows @ np.diff(diffraction.cells[picture], axis=1, prepend=0.0)
    edge = diffraction.edge_mm[picture]
    x_mm = (np.arange(len(columns)) - (len(columns) - 1) / 2) * edge
    return np.exp(-2j * np.pi * np.outer(per_mm, x_mm)) @ columns * np.sinc(per_mm * edge)


def rigs_of_the_library() -> None:
    """The second table."""
    print("| camera | field, object | wavefront, waves rms | Strehl | MTF at Nyquist | images | rays alone |")
    print("|---|---|---|---|---|---|---|")
    gauss = rig_of("conventional_100mm")
    for name, camera in (("double Gauss F/9.8", gauss), ("double Gauss F/2.6", opened(gauss, 17.0))):
        focus = foci(camera)[0].focus_distance_mm
        corner = camera.sensor.farthest_corner_mm
        for field, share in (("axis", 0.0), ("0.7 field", 0.7), ("corner", 1.0)):
            _compare(name, field, camera, View(share * corner, NO_MICROLENS, focus))
        for factor in (0.99, 0.97):
            _compare(name, f"axis, {factor:g} focus", camera, View(np.zeros(2), NO_MICROLENS, factor * focus))
    array = rig_of("plenoptic_michels_2019")
    rig = drawn(array)
    for kind, (x, y, row) in enumerate(rig.middles):
        for words, object_mm in (("focus", foci(array)[kind].focus_distance_mm), ("430 mm", 430.0), ("600 mm", 600.0)):
            field = f"type {kind}, {words}"
            _compare("microlenses F/7.8", field, array, View(np.array([x, y]), row, object_mm))


def _compare(name: str, field: str, camera: Camera, view: View) -> None:
    front = wavefront(Tracer(camera), view, WAVELENGTH_NM)
    nyquist = 1 / (2 * camera.sensor.pitch_mm)
    per_mm = np.linspace(0, nyquist, 21)
    worst = {"images": 0.0, "rays": 0.0}
    for along in (np.array([1.0, 0.0]), np.array([0.0, 1.0])):
        exact = np.abs(transfer(front, per_mm, along))
        rays = np.abs(transfer_of_rays(front, per_mm, along))
        images = rays * np.abs(transfer(front.perfect(), per_mm, along))
        for key, transferred in (("images", images), ("rays", rays)):
            difference = transferred - exact
            worst[key] = max(worst[key], difference[np.argmax(np.abs(difference))], key=abs)
    end = np.abs(transfer(front, per_mm[-1:], np.array([1.0, 0.0])))[0]
    figures = f"{front.error_waves[0]:.3f} | {strehl_ratio(front):.3f} | {end:.2f}"
    print(f"| {name} | {field} | {figures} | {worst['images']:+.2f} | {worst['rays']:+.2f} |")


def rig_of(name: str) -> Camera:
    """The camera of a rig of the library."""
    return load(STAGES / f"{name}.usda").cameras[0].camera


def opened(camera: Camera, stop_semi_mm: float) -> Camera:
    """The same camera with another stop."""
    surfaces = tuple(
        dataclasses.replace(one, semi_diameter_mm=stop_semi_mm) if one.is_stop else one
        for one in camera.prescription.surfaces
    )
    return dataclasses.replace(camera, prescription=dataclasses.replace(camera.prescription, surfaces=surfaces))


def drawn(camera: Camera) -> Rig:
    """The camera as images use it."""
    return dataclasses.replace(Rig.of(Tracer(camera)), diffraction_nm=WAVELENGTH_NM)


if __name__ == "__main__":
    main()
