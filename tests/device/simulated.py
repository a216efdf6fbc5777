"""Moments of a few bundles in the simulator against those of processors: a process of its own, NUMBA_ENABLE_CUDASIM=1.

Prints the largest difference of each rig, and whether all bits are equal.
"""

import argparse
import dataclasses
import warnings

import numpy as np
from laws import rigs

from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.jit.device import device_name


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
    found = {
        name: dataclasses.replace(plenoptic, microlenses=dataclasses.replace(array, **kind))
        for name, kind in kinds.items()
    }
    cosine = dataclasses.replace(plenoptic.sensor, acceptance="cosine", acceptance_power=1.5)
    found["cosine"] = dataclasses.replace(plenoptic, sensor=cosine, weight="area")
    found["conventional"] = rigs.conventional()
    found["displaced"] = rigs.displaced(rigs.conventional())
    return found


def compare(name: str, camera: Camera, samples: int, square_px: float) -> None:
    """Print one line."""
    tracer, count, sensor = Tracer(camera, 3), 3, camera.sensor
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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--long", action="store_true", help="also a bundle of more rays than a packet holds")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    for name, camera in cameras().items():
        compare(name, camera, 16, 1.0 if name == "thin" else 0.0)
    if chosen.long:
        compare("conventional", rigs.conventional(), 1024, 0.0)
