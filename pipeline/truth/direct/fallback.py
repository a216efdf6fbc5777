"""Direct solution of rows for which a position image is not accurate enough, or which it lacks."""

import dataclasses

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.records.shapes import Float64
from pipeline.truth.direct.direct_rows import Guess, guesses, solve
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import TruthSettings

_SIGMAS = 2.0
"""Expected errors of a row that must stay below the claim [1]: only one row in twenty has an error above two of
them.
"""


def polished(
    rig: Rig, estimated: Correspondences, planes: Float64[np.ndarray, "p 4 3"], settings: TruthSettings
) -> Correspondences:
    """Rows of `moments` that keep the claimed accuracy, and all others solved by `direct`.

    Parameters
    ----------
    planes : (p, 4, 3) float64
        Tangent planes at the target points, as in `direct_rows.solve`.
    """
    assert settings.claim_px is not None
    rows = estimated.solutions
    trusted = _SIGMAS * rows.error_px <= settings.claim_px
    doubtful = rows.only(~trusted)
    seeds = Guess(doubtful.point, doubtful.cell, np.stack([doubtful.x_px, doubtful.y_px], axis=1))
    limits = settings.claim_px / 4, settings.min_hit_fraction
    mended = solve(rig, seeds, planes, *limits, doubtful.jacobian)
    everywhere, rays = guesses(rig, planes)
    width = int(max(everywhere.cell.max(initial=0), rows.cell.max(initial=0))) + 1
    new = ~np.isin(everywhere.point * width + everywhere.cell, rows.point * width + rows.cell)
    added = solve(rig, everywhere.only(new), planes, *limits)
    whole = estimated.only(trusted).joined(mended).joined(added)
    counts = {name: count for name, count in estimated.counts.items() if name != "rows"}
    counts |= {
        "kept": int(trusted.sum()),
        "polished": len(mended.solutions.point),
        "added": len(added.solutions.point),
        "inaccurate": mended.counts["inaccurate"] + added.counts["inaccurate"],
        "rows": len(whole.solutions.point),
        "rays_of_direct": mended.counts["rays"] + added.counts["rays"] + rays,
    }
    return dataclasses.replace(whole, counts=counts).sorted_by(rig.axial)
