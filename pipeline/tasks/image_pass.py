"""Task `image_pass`: one more pass over some rows of an image, unless the noise is low enough."""

from pathlib import Path

import numpy as np

from pipeline.files.npy import read_npy, write_npy
from pipeline.render.in_lights import colours_in_lights, known_in_lights, sampled_in_lights
from pipeline.tasks.artefacts.cameras import Inputs, imaged_rig
from pipeline.tasks.artefacts.passes import COLOURS, MEANS, hand_on, is_over, means_of, write_pass
from pipeline.tasks.image_tile import scene_of
from pipeline.tasks.params.images import ImagePass as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write what is sampled of the image in all replicas, (replicas, h, w), and facts; the first pass writes the
    colours of the rest, (2, h, w, wavelengths) as of `colours_in_lights`.
    """
    if is_over(params.number, inputs):
        hand_on(inputs, out)
        return
    exposure, rows, first = params.exposure, params.rows, params.number == 0
    rig, scene = imaged_rig(inputs, exposure), scene_of(params.view, inputs)
    white = read_npy(inputs["white"][MEANS]).mean(axis=0)
    colour = colours_in_lights(rig, scene, rows) if first else read_npy(inputs["first"][COLOURS])
    means = means_of(
        params.number,
        exposure.samples,
        inputs,
        lambda batch: sampled_in_lights(rig, batch, scene, white, colour, rows),
    )
    if first:
        write_npy(out / COLOURS, colour)
    known = known_in_lights(rig.tracer, white, colour)
    write_pass(out, means, means, params.number + 1, float(np.sum(means.mean(axis=0) + known)))
