"""Task `white_tile`: some rows of the image of a white scene, for the tasks `white` and `image_tile`."""

from pathlib import Path

import numpy as np

from pipeline.files.npy import write_npy
from pipeline.render.in_lights import known_white_parts, white_parts
from pipeline.tasks.artefacts.cameras import Inputs, imaged_rig
from pipeline.tasks.params.images import White
from pipeline.tasks.params.images import WhiteTile as Params

WHITE, FOREIGN = "white.npy", "foreign.npy"


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write both arrays."""
    white_rows(params, inputs, out, params.rows)


def white_rows(
    params: White | Params, inputs: Inputs, out: Path, rows: tuple[int, int] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Rows from the first to an end, by default all, (h, w, wavelengths) float64 each, written for images: the white
    image, and its part through other microlenses than that of the pixel's cell."""
    rig = imaged_rig(inputs, params.exposure)
    known = known_white_parts(rig, rows) if params.is_smooth else None
    white, foreign = white_parts(rig, params.exposure.samples, rows) if known is None else known
    for name, pixels in ((WHITE, white), (FOREIGN, foreign)):
        write_npy(out / name, np.ascontiguousarray(pixels))
    return white, foreign
