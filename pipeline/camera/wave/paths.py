"""Rays from a sensor position through one microlens, or none, and the main lens, with their optical path.

Vision frame. The same models as `camera.tracing.microlens_kernels`, for whole arrays.
"""

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.microlens_kernels import (
    CURVATURE_OF_NORMALS,
    DISC,
    FOCAL,
    INDEX,
    KIND,
    MODEL,
    PLAIN,
    THIN,
    TURN,
    TWO_PLANE,
    X,
    Y,
    Z,
)
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave.optical_path import PathRays, ideal_path, with_path
from pipeline.records.shapes import Float64


def sent(
    tracer: Tracer, microlens: int, start_mm: Float64[np.ndarray, "2"], direction: Float64[np.ndarray, "n 3"]
) -> PathRays:
    """Rays that leave the camera, on its front surface, with their path from the sensor.

    Parameters
    ----------
    microlens : int
        Row of the one that they pass, or `NO_MICROLENS`.
    start_mm : (2,) float64
        Start on the sensor.
    direction : (n, 3) float64
        Unit vectors with a positive z.
    """
    count = len(direction)
    point = np.array([*start_mm, tracer.sensor_z_mm])
    rays = PathRays(np.tile(point, (count, 1)), direction, np.ones(count, bool), np.zeros(count))
    with np.errstate(all="ignore"):  # rays that miss a surface go on as NaN
        if microlens != NO_MICROLENS:
            plain = tracer.arrays.mosaic.detail[MODEL] == PLAIN
            rays = _through_plain(tracer, microlens, rays) if plain else _through(tracer, microlens, rays)
        behind = tracer.camera.prescription.surfaces[-1].index
        return with_path(tracer.table, rays._replace(medium=behind))


def _through_plain(tracer: Tracer, microlens: int, rays: PathRays) -> PathRays:
    """Rays behind a thin microlens that is parallel to the sensor."""
    x, y, focal = tracer.arrays.lenses[microlens, [X, Y, FOCAL]]
    along = (tracer.film_z_mm - rays.position_mm[:, 2]) / rays.direction[:, 2]
    position = rays.position_mm + along[:, None] * rays.direction
    offset, disc = position[:, :2] - [x, y], tracer.arrays.mosaic.detail[DISC]
    inside = np.hypot(*offset.T) <= disc if disc > 0 else _in_polygon(tracer.arrays.aperture, offset)
    return _bent_thinly(focal, offset, rays._replace(position_mm=position, path_mm=along, passes=inside))


def _through(tracer: Tracer, microlens: int, rays: PathRays) -> PathRays:
    """Rays before a microlens of any other model."""
    detail, faces, bends, _ = tracer.arrays.mosaic
    row = tracer.arrays.lenses[microlens]
    kind, turn = int(row[KIND]), detail[TURN : TURN + 9].reshape(3, 3)
    vertex = row[[X, Y, Z]]
    local = rays._replace(position_mm=(rays.position_mm - vertex) @ turn.T, direction=rays.direction @ turn.T)
    local = with_path(faces[kind], local)
    if detail[MODEL] == THIN:
        local = _bent_thinly(row[FOCAL], local.position_mm[:, :2], local)
    elif detail[MODEL] == TWO_PLANE:
        local = _bent_by_normals(bends[kind, CURVATURE_OF_NORMALS], bends[kind, INDEX], local)
    return local._replace(position_mm=local.position_mm @ turn + vertex, direction=local.direction @ turn)


def _bent_thinly(focal_mm: float, offset: np.ndarray, rays: PathRays) -> PathRays:
    slope = rays.slope - offset / focal_mm
    bent = np.column_stack([slope, np.ones(len(slope))])
    path = rays.path_mm + ideal_path(offset, rays.slope, slope)
    return rays._replace(direction=bent / np.linalg.norm(bent, axis=1, keepdims=True), path_mm=path)


def _bent_by_normals(curvature: float, mu: float, rays: PathRays) -> PathRays:
    """Snell's law at a plane with the normals of a sphere, for rays that leave a medium of index mu.

    The tangents of the waves change by -curvature * offset * step; the path is the integral of that from the vertex,
    with the step, which hardly varies, as a plane and a paraboloid of the offset.
    """
    offset = rays.position_mm[:, :2]
    squared = np.sum(offset**2, axis=1)
    normal = np.column_stack([-curvature * offset, np.sqrt(1 - curvature**2 * squared)])
    cosine = np.sum(normal * rays.direction, axis=1)
    step = np.sqrt(1 - mu * mu * (1 - cosine * cosine)) - mu * cosine
    terms, known = np.column_stack([np.ones(len(step)), offset, squared]), np.isfinite(step)
    fitted = np.linalg.lstsq(terms[known], step[known], rcond=None)[0]
    mean_step = terms @ (fitted * [1 / 2, 1 / 3, 1 / 3, 1 / 4])
    return rays._replace(
        direction=mu * rays.direction + step[:, None] * normal,
        passes=rays.passes & known,
        path_mm=rays.path_mm - curvature * squared * mean_step,
        medium=1.0,
    )


def _in_polygon(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points lie in a convex polygon, counter-clockwise."""
    edge = np.roll(corners, -1, axis=0) - corners
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    return (points @ normal.T <= np.sum(normal * corners, axis=1)).all(axis=1)
