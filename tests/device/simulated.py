"""What the simulator computes against processors: a process of its own, NUMBA_ENABLE_CUDASIM=1.

`moments` prints the largest difference of a few bundles of each rig, and whether all bits are equal; `rays` the same of
rays of images, which are float32 on a device and float64 on processors, and compares them with compiled float32.
"""

import argparse
import dataclasses
import sys
import warnings
from pathlib import Path

import numpy as np
from laws import rigs

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.ideal_lens import with_ideal_lens
from pipeline.camera.on_device import ImageRays, leaving_rays
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing import bundle_kernels
from pipeline.camera.tracing.records import Leaving, Samples, Squares
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.jit.device import device_name
from pipeline.render.pixel_rays import Band

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from single_rays import single_leaving

SAMPLES, AT_MM = 4, 600.0
"""Rays of a pixel through each microlens, and where they are compared: the rigs focus at 400 to 900 mm."""


def cameras() -> dict[str, Camera]:
    """Cameras of every kind of microlens, acceptance and weight."""
    plenoptic = rigs.plenoptic(extent_mm=2.0)
    array = plenoptic.microlenses
    assert array is not None
    bent = {"index": 1.5, "thickness_mm": 0.05}
    radii = tuple(0.5 * focal for focal in array.focal_lengths_mm)
    faces = {"focal_lengths_mm": (), "front_radii_mm": radii, "rear_radii_mm": (np.inf,) * len(radii)}
    kinds = {
        "thin": {},
        "disc": {"aperture": "disc", "disc_diameter_mm": 0.8 * array.pitch_mm},
        "tilted": {"tilt_x_deg": 0.3},
        "two-plane": {"model": "two-plane", **bent},
        "refractive": {"model": "refractive", **bent, **faces},
    }
    cameras = {
        name: dataclasses.replace(plenoptic, microlenses=dataclasses.replace(array, **kind))
        for name, kind in kinds.items()
    }
    cosine = dataclasses.replace(plenoptic.sensor, acceptance="cosine", acceptance_power=1.5)
    cameras["cosine"] = dataclasses.replace(plenoptic, sensor=cosine, weight="area")
    cameras["conventional"] = rigs.conventional()
    cameras["displaced"] = rigs.displaced(rigs.conventional())
    cameras["aspheric"] = aspheric(rigs.conventional())
    coarse = dataclasses.replace(rigs.conventional(), near_mm=None, far_mm=None)
    cameras["ideal"] = focused(with_ideal_lens(coarse, "thinLens"))
    cameras["Brown"] = focused(with_ideal_lens(coarse, "thinLens", (-8.0, 100.0, 0.01, -0.02, 300.0)))
    return cameras


def aspheric(camera: Camera) -> Camera:
    """The double Gauss of a camera with a conic, and an asphere of high powers."""
    powers = (0.0, 2e-8, -3e-11, 1e-14, 1e-17, 1e-20)
    return rigs.reshaped(camera, {0: {"conic": -0.3}, 2: {"conic": -0.1, "even_coefficients": powers}})


def compare_moments(name: str, camera: Camera, samples: int, square_px: float, count: int = 3) -> None:
    """Print one line: name, samples, square, bundles with light, whether bits are equal, largest difference."""
    tracer, sensor = Tracer(camera, 3), camera.sensor
    i = np.arange(count)
    pixels = np.stack([(i + 1) * sensor.width_px // 4, (i + 1) * sensor.height_px // 5], axis=1)
    positions = tracer.positions_mm(*pixels.T)
    lens = Rig.of(tracer).microlens_at(positions)
    arguments = positions, lens, parallel_planes(400.0, 900.0), samples, pixels, square_px
    expected = tracer.moments(*arguments)
    found = dataclasses.replace(tracer, device=device_name()).moments(*arguments)
    lit = int(np.isfinite(expected[:, 0]).sum())
    same = np.array_equal(found, expected, equal_nan=True)
    print(name, samples, square_px, lit, same, f"{np.nanmax(np.abs(found - expected)):.1e}", flush=True)


def squares_of(rig: Rig) -> Squares:
    """A few squares of a rig, with all microlenses that light them; they take samples behind the first ones."""
    band = Band.of(rig, (20, 22))
    some = np.arange(0, len(band.strata), 17)
    strata = band.strata[some]
    counts = np.where(strata == SKIP, 0, SAMPLES)
    pixels = np.stack([some % band.shape[1], 20 + some // band.shape[1]], axis=1)
    return Squares(pixels, band.positions_mm[some], strata, counts, counts)


def compare_rays(name: str, camera: Camera, diffraction_nm: float | None = None) -> None:
    """Print one line: name, rays, largest difference [mm] and that of shares, nan if other rays pass, equal bits."""
    rig = dataclasses.replace(Rig.of(Tracer(camera, 3)), diffraction_nm=diffraction_nm)
    squares, samples = squares_of(rig), Samples(sobol_bits(2 * SAMPLES), 3, camera.sensor.pitch_mm)
    leaving = Leaving.empty(int(squares.counts.sum()))
    count = bundle_kernels.image_rays(rig.tracer.arrays, samples, squares, rig.diffraction, leaving)
    expected = leaving.first(count)
    rays = ImageRays(device_name(), rig.tracer.arrays, samples, rig.diffraction).started(squares)
    again = Leaving.empty(int(squares.counts.sum()))
    found = again.first(leaving_rays(rays, 0, squares.counts, again))
    twin = single_leaving(rig.tracer.arrays, samples, squares, rig.diffraction)
    same = all(map(np.array_equal, twin, found))
    apart_mm = share = np.nan
    if np.array_equal(found.owner, expected.owner):
        apart_mm = np.abs(crossing(found) - crossing(expected)).max()
        share = np.abs(found.share / expected.share - 1).max()
    print(name, count, f"{apart_mm:.1e}", f"{share:.1e}", same, flush=True)


def crossing(rays: Leaving) -> np.ndarray:
    """Where rays meet the plane at AT_MM, (n, 2) [mm]."""
    path = (AT_MM - rays.origin[:, 2]) / rays.direction[:, 2]
    return (rays.origin + path[:, None] * rays.direction)[:, :2]  # type: ignore[no-any-return]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("moments", "long", "rays"))
    what = parser.parse_args().what
    warnings.simplefilter("ignore")
    if what == "long":  # a bundle of more rays than a packet holds
        compare_moments("conventional", rigs.conventional(), 1024, 0.0, count=1)
    for name, camera in cameras().items() if what != "long" else ():
        if what == "moments":
            compare_moments(name, camera, 16, 1.0 if name == "thin" else 0.0)
        if what == "rays":
            compare_rays(name, camera)
    if what == "rays":
        compare_rays("diffracted", rigs.conventional(1.0), 550.0)
