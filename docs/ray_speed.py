"""Time and error of the rays of all pixels, by patches and one by one: camera of example 01.

python docs/ray_speed.py

docs/evidence.md quotes it. One by one, 4,000 random pixels are traced; seconds
are those of the processor.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import pipeline
from pipeline.exports.ray_patches import bands, rows_of_rays

ROOT = Path(__file__).resolve().parents[1]
SOME, ROWS = 4000, 128


class Counting:
    """A camera that counts the rays that it is asked for."""

    def __init__(self, camera):
        self.camera, self.traced = camera, 0

    def rays(self, x_px, y_px):
        """Rays of positions."""
        self.traced += len(x_px)
        return self.camera.rays(x_px, y_px)


def main() -> None:
    """Print both speeds, and the largest difference."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    camera = pipeline.ready(ROOT / "examples/01_conventional/dataset.usda")
    width, height = camera.camera.sensor.width_px, camera.camera.sensor.height_px
    camera.rays([0.0], [0.0])  # compiles, and finds what all rays share
    counting, start = Counting(camera), time.process_time()
    parts = [rows_of_rays(counting, width, rows, camera.planes_mm) for rows in bands(height, ROWS)]
    patches_s = time.process_time() - start
    origin, direction = (np.concatenate(one) for one in zip(*parts, strict=True))
    x, y = np.random.default_rng(1).integers(0, [[width], [height]], (2, SOME))
    start = time.process_time()
    exact = camera.rays(x, y)
    each_s = time.process_time() - start
    beside, worst = camera.rays(x + 0.1, y), 0.0
    for z_mm in camera.planes_mm:
        there = exact.at_distance(z_mm)
        found = origin[y, x] + (z_mm - origin[y, x, 2:]) / direction[y, x, 2:] * direction[y, x]
        step_mm = np.linalg.norm(beside.at_distance(z_mm) - there, axis=1) / 0.1
        worst = max(worst, float((np.linalg.norm(found - there, axis=1) / step_mm).max()))
    print(f"traced {counting.traced:,} of {width * height:,} rays: {width * height / patches_s:.3g} rays/s")
    print(f"one by one: {SOME / each_s:.3g} rays/s")
    bound_px = 10.0 ** np.ceil(np.log10(worst))
    print(f"largest difference of {SOME:,} rays: less than {bound_px:g} px")


if __name__ == "__main__":
    main()
