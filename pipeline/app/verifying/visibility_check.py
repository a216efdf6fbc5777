"""Visibility of a sample of rows, determined again with other rays."""

import numpy as np

from pipeline.app.verifying.judged_camera import Scene
from pipeline.camera.rig import Rig
from pipeline.files.tables import Table
from pipeline.tasks.artefacts.surroundings import surroundings_of
from pipeline.tasks.certificate import rows_of
from pipeline.truth.judging.judged import sample
from pipeline.truth.visibility import visibility

_SAME_SHARE = 0.02
"""Tolerance of the visibility: a thousand rays may be wrong by some thousandths at an edge."""


def wrong_visibilities(rig: Rig, scenes: list[tuple[Scene, Table]], seed: int) -> list[str]:
    """Faults in the visibility of up to `truth.judging.judged.ROWS` rows of a camera, drawn from all frames."""
    found, first = [], 0
    drawn = sample(np.zeros(sum(len(table.columns["visibility"]) for _, table in scenes), bool), seed)
    for scene, table in scenes:
        targets = scene.view.targets
        surroundings = surroundings_of(targets, scene.view.occluders)
        names = np.array(table.columns["target"], str)
        for number, (planes, cell, x_px, _) in enumerate(rows_of(rig, targets, table)):
            here = drawn[(drawn >= first) & (drawn < first + len(cell))] - first
            first += len(cell)
            stated = table.numbers("visibility")[names == targets[number].name][here]
            share, _ = visibility(rig, surroundings, number, rig.microlens(cell[here]), x_px[here], planes[here])
            wrong = ~np.isclose(share, stated, rtol=0, atol=_SAME_SHARE, equal_nan=True)
            if wrong.any():
                worst = f"{stated[wrong][0]:.3g} in place of {share[wrong][0]:.3g}"
                which = f"{int(wrong.sum())} of {len(here)} rows of {targets[number].name}"
                found.append(f"frame {scene.truth.frame}: {which} state another visibility, {worst}")
    return found
