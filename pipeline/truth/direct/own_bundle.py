"""Hit fraction and blur of rows of position images, from their own bundles traced at their own positions.

The nearest position of the grid is not sufficient: in the penumbra of a micro-image its hit fraction is off by 0.1,
and its blur by a quarter of the trace.
"""

import dataclasses

import numpy as np

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.rig import Rig
from pipeline.records.shapes import Float64
from pipeline.truth.direct.direct_rows import blur_of
from pipeline.truth.rows import Correspondences

_LEVEL = 1
"""Level of quadrature: light and blur need fewer digits than positions."""


def with_own_bundles(
    rig: Rig, rows: Correspondences, planes: Float64[np.ndarray, "p 4 3"], min_hit_fraction: float
) -> Correspondences:
    """The same rows with hit fraction and blur of their own bundles; rows with too little light are dropped and
    counted.

    Rows by `direct` have both already.

    Parameters
    ----------
    planes : (p, 4, 3) float64
        Tangent planes at the target points, as in `direct_rows.solve`.
    """
    others = np.flatnonzero(rows.method != "direct")
    solutions = rows.solutions.only(others)
    x_px, on = np.stack([solutions.x_px, solutions.y_px], axis=1), planes[solutions.point]
    wanted = Bundles(x_px, rig.microlens(solutions.cell), np.stack([on, on], axis=1), rig.square_px)
    bundles = integrals(rig.tracer, wanted, _LEVEL)
    blurred, rho, rays = blur_of(rig, solutions.cell, x_px, on, solutions.jacobian, bundles.moments)
    hit_fraction, blur_px2, rho_px = rows.hit_fraction.copy(), rows.blur_px2.copy(), rows.rho_px.copy()
    hit_fraction[others], blur_px2[others], rho_px[others] = rig.hit_fraction(bundles.moments), blurred, rho
    kept = (hit_fraction > 0) & (hit_fraction >= min_hit_fraction)
    counts = {name: count for name, count in rows.counts.items() if name != "rows"}
    counts["dropped_hit_fraction"] = counts.get("dropped_hit_fraction", 0) + int(np.sum(~kept))
    counts |= {"rays_of_bundles": bundles.rays + rays, "rows": int(kept.sum())}
    traced = dataclasses.replace(rows, hit_fraction=hit_fraction, blur_px2=blur_px2, rho_px=rho_px, counts=counts)
    return traced.only(kept)
