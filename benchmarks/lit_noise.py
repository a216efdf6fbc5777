"""Noise of lit images, over several seeds: rows of frame 2 of example 04, its left camera, channel green.

    python benchmarks/lit_noise.py [--small]

Prints the root mean square of the noise over the mean of the image, the noise of the median pixel over its own mean,
and the seconds of processor time for an image.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import pipeline
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.plugins.scenes.graph import LitThings
from pipeline.plugins.scenes.tasks.images import lit_view
from pipeline.products.draft import exposure_of
from pipeline.render.imaging import pictures_in_lights, white_parts

STAGE = Path(__file__).resolve().parent.parent / "examples/04_stereo_colour/dataset.usda"
_FRAME, _ROWS = 1, (150, 182)
"""The frame, from 0, in which the softbox mirrors in the board; rows in which wall, shadow, paper and ink are seen."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="two rows and two seeds: does it run at all?")
    small = parser.parse_args().small
    rows, seeds = ((150, 152), 2) if small else (_ROWS, 12)
    dataset = pipeline.open_dataset(STAGE)
    entry = next(one for one in dataset.cameras[0].in_channels if one.channel and one.channel.name == "green")
    assert entry.channel is not None
    frame, things, exposure = dataset.frames[_FRAME], LitThings(dataset, painted=True), exposure_of(entry)
    scene, camera = lit_view(things.view(frame, entry, ()), {}), entry.camera.in_light(entry.channel)
    images, seconds = [], []
    for seed in range(11, 11 + seeds):
        rig = Rig.of(Tracer(camera, seed))
        white = white_parts(rig, exposure.samples, rows)
        start = time.process_time()
        images.append(pictures_in_lights(rig, exposure.samples, [scene], white, rows)[0])
        seconds.append(time.process_time() - start)
    mean, noise = np.mean(images, axis=0), np.std(images, axis=0, ddof=1)
    print(f"{exposure.samples} rays, rows {rows[0]} to {rows[1]}, {seeds} seeds")
    print(f"noise over the mean of the image {np.sqrt(np.mean(noise**2)) / mean.mean():.4f}")
    print(f"noise of the median pixel        {np.median(noise / mean):.4f}")
    print(f"processor time                   {np.median(seconds[1:]):.2f} s")


if __name__ == "__main__":
    main()
