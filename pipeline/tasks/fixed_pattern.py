"""Task `fixed_pattern`: differences from pixel to pixel of the sensor of a camera, the truth behind its raw images."""

from pathlib import Path

import numpy as np

from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.render.sensor.fixed_pattern import fixed_pattern
from pipeline.tasks.artefacts.cameras import Inputs
from pipeline.tasks.params.exposing import MAPS
from pipeline.tasks.params.exposing import FixedPattern as Params

_CHANNELS = ("dark_e", "hot_e_per_s", "response")


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write fixed_pattern.exr."""
    width = params.shape[1]

    def rows(first: int, end: int) -> dict[str, np.ndarray]:
        maps = fixed_pattern(params.spread, params.camera, (first, 0), (end - first, width))
        return {name: getattr(maps, name) for name in _CHANNELS}

    attributes: dict[str, str | float | int] = {
        "content": "DSNU dark_e [e-], PRNU response [1, 0: dead], further dark current hot_e_per_s [e-/s]",
        "specimen": params.spread.specimen,
    }
    part = BandedPart(name="fixed_pattern", shape=params.shape, channels=_CHANNELS, rows=rows, attributes=attributes)
    write_bands(out / MAPS, [part])
