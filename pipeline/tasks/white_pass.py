"""Task `white_pass`: one more pass over some rows of the image of a white scene, unless the noise is low enough."""

from pathlib import Path

import numpy as np

from pipeline.render.in_lights import in_all, known_white_parts, white_parts
from pipeline.render.passes import Batch
from pipeline.tasks.artefacts.cameras import Inputs, imaged_rig
from pipeline.tasks.artefacts.passes import hand_on, is_over, means_of, write_pass
from pipeline.tasks.params.images import WhitePass as Params


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write the white images of all replicas, (replicas, 2, h, w, wavelengths) as of `white_parts`, and facts."""
    if is_over(params.number, inputs):
        hand_on(inputs, out)
        return
    rig = imaged_rig(inputs, params.exposure)
    known = known_white_parts(rig, params.rows) if params.is_smooth else None

    def parts(batch: Batch) -> np.ndarray:
        return white_parts(rig, batch, params.rows) if known is None else known

    means = means_of(params.number, params.exposure.samples, inputs, parts)
    seen = in_all(rig.tracer, means[:, 0])
    write_pass(out, means, seen, params.number + 1, float(seen.mean(axis=0).sum()))
