"""Image positions by the chief ray, a single ray; the mean of the bundle may put the point elsewhere.

Without microlenses it is the ray through the centre of the stop. Behind a microlens, whose bundle is thin, it is the
ray through the vertex of the microlens, or of that face which has the aperture. Apertures do not block it.
"""

import numpy as np

from pipeline.camera.integrating.polar_bundle import single_hits
from pipeline.camera.micro_images.centres import vertex_aims
from pipeline.camera.pupil.chief_ray import chief_crossings
from pipeline.camera.tracer import Tracer
from pipeline.optics.table import unbounded
from pipeline.records.shapes import Float64, Int64

_STEPS = 20
"""Most steps: the derivative is kept, so each step reduces the error by the same large factor."""
_DONE_PX, _ACCEPTED_PX = 1e-10, 1e-7
"""Largest last step that ends the search of all points, and largest last step of a point that counts as found [px]:
rounding may keep a point from the former; the latter is a ten-thousandth of the default claim.
"""
_DIFFERENCE_PX = 0.05
"""Half the step of difference quotients [px]: chief rays bend little over it, and rounding costs few digits."""


def chief_points(
    tracer: Tracer,
    microlens: Int64[np.ndarray, "n"],
    x_px: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> np.ndarray:
    """Positions whose chief ray meets the origin of a plane, (n, 2) [px]; NaN if there is none.

    Parameters
    ----------
    microlens : (n,) int64
    x_px : (n, 2) float64
        Start positions.
    planes : (n, 4, 3) float64
        Tangent planes with their target points as origins.
    """
    x = x_px.copy()
    miss = _chief_hits(tracer, microlens, x, planes)
    jacobian = chief_jacobian(tracer, microlens, x, planes)
    with np.errstate(invalid="ignore"):
        regular = np.abs(np.linalg.det(jacobian)) > 0
    inverse = np.linalg.inv(np.where(regular[:, None, None], jacobian, np.nan))
    step = np.full(x.shape, np.nan)
    for _ in range(_STEPS):
        # The derivative hardly changes between two positions of one point.
        step = -np.einsum("nij,nj->ni", inverse, miss)
        x = x + step
        if not (np.abs(step) > _DONE_PX).any():
            break
        miss = _chief_hits(tracer, microlens, x, planes)
    return np.where((np.abs(step) < _ACCEPTED_PX).all(axis=1)[:, None], x, np.nan)


def chief_jacobian(
    tracer: Tracer,
    microlens: Int64[np.ndarray, "n"],
    x_px: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> np.ndarray:
    """Derivatives of the hits of chief rays by the image position, (n, 2, 2) [mm per px]; NaN if there is no chief
    ray.
    """
    change = [
        _chief_hits(tracer, microlens, x_px + step, planes) - _chief_hits(tracer, microlens, x_px - step, planes)
        for step in _DIFFERENCE_PX * np.eye(2)
    ]
    return np.stack(change, axis=2) / (2 * _DIFFERENCE_PX)


def _chief_hits(tracer: Tracer, microlens: np.ndarray, x_px: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Hits of the chief rays of image positions on their planes, (n, 2) [mm]."""
    hits = np.full(x_px.shape, np.nan)
    known = np.flatnonzero(np.isfinite(x_px).all(axis=1))
    positions = tracer.positions_mm(*x_px[known].T)
    if tracer.lattice is None:
        aims = chief_crossings(tracer.table, tracer.stop_row, tracer.on_film(positions))
    else:
        aims = vertex_aims(tracer, microlens[known], positions)
    aimed = np.isfinite(aims).all(axis=1)
    known, positions, aims = known[aimed], positions[aimed], aims[aimed]
    arrays = tracer.arrays._replace(table=unbounded(tracer.arrays.table))
    if len(known):
        hits[known] = single_hits(arrays, positions, microlens[known], aims, planes[known])
    return hits
