"""Error of an image for its rays: plain uniform sampling of the rear element, and our sampler.

    python benchmarks/sampling.py [--small] [--rows N]

Renders the middle rows of frame 3 of example 01. Plain sampling sends, from random points of each pixel, rays to random
points of the rear element, and traces them through the lens here, by NumPy; all rays that start are counted, those that
die among them. Ours are `pictures` for several numbers of samples, with all rays that they and the white image start;
and images to a stated noise, which take four replicas. Errors are root mean squares against an image of many rays.
"""

import argparse
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import pipeline
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.jit.work import work
from pipeline.optics.table import CURVATURE, INDEX_RATIO, SEMI_DIAMETER_SQUARED, VERTEX
from pipeline.products.things import target_poses
from pipeline.render.glow import TargetLight
from pipeline.render.imaging import (
    bands_in_lights,
    colours_in_lights,
    irradiance,
    irradiance_and_crosstalk,
    known_in_lights,
    pictures,
    sampled_in_lights,
    white_parts,
)
from pipeline.render.pixel_rays import Batch

ROOT = Path(__file__).resolve().parent.parent
_FRAME = 2
"""The frame, from 0: its board is tilted, so that edges are sharp and blurred."""
_REFERENCE = 1 << 14
"""Samples of the image that errors are against."""
_PLAIN, _OURS = (16, 64, 256, 1024), (4, 16, 64, 256)
"""Rays per pixel."""
_SEED = 5
"""Seed of plain sampling."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="a tiny stage: does it run at all?")
    parser.add_argument("--rows", type=int, default=16, help="so many rows about the middle of the image")
    options = parser.parse_args()
    stage = ROOT / ("tests/data/tiny_conventional" if options.small else "examples/01_conventional") / "dataset.usda"
    dataset = pipeline.open_dataset(stage)
    entry, frame = dataset.cameras[0], dataset.frames[min(_FRAME, len(dataset.frames) - 1)]
    poses = target_poses(dataset, frame, entry.name)
    light = TargetLight([(one.target, poses[one.name]) for one in dataset.targets], dataset.background)
    tracer = Tracer(focused(entry.camera), entry.sampling.seed)
    middle, half = tracer.camera.sensor.height_px // 2, options.rows // 2
    image = Rows(tracer, light, (middle - half, middle + half))
    reference = image.reference(_REFERENCE if not options.small else 1024)
    print(f"{stage.parent.name}, frame {frame.number}, rows {image.rows[0]} to {image.rows[1]}")
    print("| sampler | samples | rays per pixel | rms error | rays that plain sampling needs | times as many |")
    print("|---|---|---|---|---|---|")
    costs = []
    for rays in _PLAIN:
        pixels, alive = image.plain(rays)
        costs.append(rays * rms(pixels, reference) ** 2)
        print(f"| plain | {rays} | {rays} | {rms(pixels, reference):.4f} | | |")
    print(f"| share of plain rays that leave the camera | {alive:.3f} | | | | |")
    for name, make in (("images", image.ours), ("first pass to a stated noise", image.in_replicas)):
        for samples in _OURS:
            pixels, started = counted(lambda make=make, samples=samples: make(samples))
            error, rays = rms(pixels, reference), started / pixels.size
            needed = np.mean(costs) / error**2  # its error falls with the root of the rays
            print(f"| {name} | {samples} | {rays:.1f} | {error:.4f} | {needed:.0f} | {needed / rays:.0f} |")


def rms(pixels: np.ndarray, reference: np.ndarray) -> float:
    """Root mean square of the deviations."""
    return float(np.sqrt(np.mean((pixels - reference) ** 2)))


def counted(make: Callable[[], np.ndarray]) -> tuple[np.ndarray, int]:
    """An image, and the rays that were started for it."""
    before = work().kernels["image_rays"].rays
    made = make()
    return made, work().kernels["image_rays"].rays - before


class Rows:
    """Some rows of an image, by several samplers."""

    def __init__(self, tracer: Tracer, light: TargetLight, rows: tuple[int, int]) -> None:
        self.tracer, self.light, self.rows, self.rig = tracer, light, rows, Rig.of(tracer)

    def reference(self, samples: int) -> np.ndarray:
        """The image of all rays, with another seed."""
        rig = Rig.of(dataclasses.replace(self.tracer, seed=self.tracer.seed + 77))
        return irradiance(rig, samples, self.light.radiance, self.rows)

    def ours(self, samples: int) -> np.ndarray:
        """The image as it is made without a stated noise."""
        white, foreign = irradiance_and_crosstalk(self.rig, samples, None, self.rows)
        return pictures(self.rig, samples, [self.light], np.array([white - foreign, foreign]), self.rows)[0]

    def in_replicas(self, samples: int) -> np.ndarray:
        """The image after the first pass to a stated noise."""
        batches = [Batch(max(1, samples // REPLICAS), replica=replica) for replica in range(REPLICAS)]
        white = np.mean([white_parts(self.rig, batch, self.rows) for batch in batches], axis=0)
        bands = bands_in_lights(self.rig, self.rows)
        colour = colours_in_lights(bands, [self.light])
        parts = [sampled_in_lights(self.rig, bands, batch, [self.light], white, colour)[0] for batch in batches]
        return np.mean(parts, axis=0) + known_in_lights(self.tracer, white, colour[0])

    def plain(self, rays: int) -> tuple[np.ndarray, float]:
        """The image of so many pseudo-random rays per pixel, and the share of them that leave the camera."""
        random, sensor = np.random.default_rng(_SEED), self.tracer.camera.sensor
        y_px, x_px = (axis.ravel() for axis in np.mgrid[self.rows[0] : self.rows[1], : sensor.width_px])
        total, alive = np.zeros(len(x_px)), 0
        for start, aim, weight in self._starts(x_px, y_px, rays, random):
            origin, direction, passed = through(self.tracer.table, start, aim)
            total[passed] += weight[passed] * self.light.radiance(origin[passed], direction[passed])
            alive += int(passed.sum())
        image = total / rays / self.tracer.reference_weight_sr
        return image.reshape(-1, sensor.width_px), alive / (rays * len(total))

    def _starts(self, x_px: np.ndarray, y_px: np.ndarray, rays: int, random: Any) -> Iterator[tuple[Any, Any, Any]]:
        """One ray of every pixel at a time: its start, its unit direction, and its weight cos(theta) d omega [sr]."""
        table, count = self.tracer.table, len(x_px)
        semi, distance = np.sqrt(table[0, SEMI_DIAMETER_SQUARED]), table[0, VERTEX] - self.tracer.sensor_z_mm
        for _ in range(rays):
            within = random.uniform(-0.5, 0.5, (2, count))
            start = np.column_stack([self.tracer.positions_mm(x_px + within[0], y_px + within[1]), np.zeros(count)])
            start[:, 2] = self.tracer.sensor_z_mm
            radius, angle = semi * np.sqrt(random.random(count)), 2 * np.pi * random.random(count)
            on_rear = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)])
            on_rear[:, 2] = table[0, VERTEX]
            path = on_rear - start
            length = np.linalg.norm(path, axis=1)
            yield start, path / length[:, None], np.pi * semi**2 * distance**2 / length**4


def through(table: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays through centred spheres and planes with round apertures: last points, directions, and whether they pass."""
    passed = np.ones(len(origin), bool)
    with np.errstate(invalid="ignore", divide="ignore"):
        for row in table:
            c, ratio = row[CURVATURE], row[INDEX_RATIO]
            at = origin - [0, 0, row[VERTEX]]
            at = at - direction * (at[:, 2] / direction[:, 2])[:, None]  # on the vertex plane
            b = direction[:, 2] - c * np.einsum("ij,ij->i", at, direction)
            square = b**2 - c**2 * np.einsum("ij,ij->i", at, at)
            step = c * np.einsum("ij,ij->i", at, at) / (b + np.sqrt(square))
            at = at + step[:, None] * direction
            passed &= (square >= 0) & (at[:, 0] ** 2 + at[:, 1] ** 2 <= row[SEMI_DIAMETER_SQUARED])
            normal = np.array([0, 0, 1.0]) - c * at
            cosine = np.einsum("ij,ij->i", normal, direction)
            root = 1 - ratio**2 * (1 - cosine**2)
            passed &= root >= 0
            direction = ratio * direction + (np.sqrt(root) - ratio * cosine)[:, None] * normal
            origin = at + np.array([0, 0, row[VERTEX]])
    return origin, direction, passed


if __name__ == "__main__":
    main()
