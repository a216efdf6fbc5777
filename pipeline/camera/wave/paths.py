"""Rays from a sensor position through one microlens, or none, and the main lens, with their optical path.

Vision frame; the same models as `camera.tracing.microlens_kernels`, for whole arrays. The path is index times distance,
surface by surface. An ideal thin lens has no thickness that a ray could travel: its path is the one that makes the
light of a point that of the point's image, the phase whose slope is the bend of the rays.
"""

from typing import NamedTuple

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing import microlens_kernels as column
from pipeline.camera.tracing.microlens_kernels import PLAIN, THIN, TWO_PLANE
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.frames import apply, inverse
from pipeline.optics.rays import traced
from pipeline.optics.table import INDEX_RATIO, POSE, TERMS, motion_of
from pipeline.records.shapes import Bool, Float64


class PathRays(NamedTuple):
    """Rays with the way that they have come."""

    # A point of each ray and its unit direction; NaN where it missed a surface
    position_mm: Float64[np.ndarray, "n 3"]
    direction: Float64[np.ndarray, "n 3"]
    passes: Bool[np.ndarray, "n"]  # whether it has passed all apertures; those that have not are carried along
    path_mm: Float64[np.ndarray, "n"]  # optical path from the start to the point
    medium: float = 1.0  # refractive index of the medium that the rays are in, relative to air

    @property
    def slope(self) -> np.ndarray:
        """dx/dz and dy/dz, (n, 2)."""
        return self.direction[:, :2] / self.direction[:, 2:]


def with_path(table: Float64[np.ndarray, "surfaces columns"], rays: PathRays) -> PathRays:
    """Rays behind all surfaces of a table from `optics.table`, on the last one."""
    for row in table:
        position, direction, passes = traced(row[None], rays.position_mm, rays.direction)
        path = rays.path_mm + rays.medium * np.sum((position - rays.position_mm) * rays.direction, axis=1)
        bent = PathRays(position, direction, rays.passes & passes, path, rays.medium / row[INDEX_RATIO])
        if row[TERMS] < 0:
            bent = bent._replace(path_mm=path + _in_its_place(row, bent, rays.direction))
        rays = bent
    return rays


def _in_its_place(row: np.ndarray, bent: PathRays, before: np.ndarray) -> np.ndarray:
    """Path that an ideal thin lens adds, in the frame in which it stands in its place."""
    back = inverse(motion_of(row)) if row[POSE] else np.eye(4)
    offset = apply(back, bent.position_mm)[:, :2]
    slopes = (way @ back[:3, :3].T for way in (before, bent.direction))
    return bent.medium * ideal_path(offset, *(way[:, :2] / way[:, 2:] for way in slopes))


def ideal_path(
    offset_mm: Float64[np.ndarray, "n 2"], before: Float64[np.ndarray, "n 2"], behind: Float64[np.ndarray, "n 2"]
) -> np.ndarray:
    """Path that an ideal thin lens adds to rays that come from one point, 0 in its middle, (n,) [mm].

    With s the slope of a ray at the distance p from the middle and a that of the ray through the middle, which is not
    bent, light of a point has the path (a + s) p / (sqrt(1 + a^2) + sqrt(1 + s^2)) across the plane of the lens.

    `offset_mm`: points where the rays meet the lens, from its middle.
    `before`, `behind`: their slopes.
    """
    known = np.isfinite(before).all(axis=1) & np.isfinite(offset_mm).all(axis=1)
    terms = np.column_stack([np.ones(len(offset_mm)), offset_mm])
    middle = np.linalg.lstsq(terms[known], before[known], rcond=None)[0][0]
    return _path_across(offset_mm, middle, behind) - _path_across(offset_mm, middle, before)


def _path_across(offset: np.ndarray, middle: np.ndarray, slope: np.ndarray) -> np.ndarray:
    roots = np.sqrt(1 + middle @ middle) + np.sqrt(1 + np.sum(slope**2, axis=1))
    return np.sum((middle + slope) * offset, axis=1) / roots


def sent(
    tracer: Tracer, microlens: int, start_mm: Float64[np.ndarray, "2"], direction: Float64[np.ndarray, "n 3"]
) -> PathRays:
    """Rays that leave the camera, on its front surface, with their path from the sensor.

    `microlens`: row of the one that they pass, or `NO_MICROLENS`.
    `start_mm`: start on the sensor.
    `direction`: unit vectors with a positive z.
    """
    count = len(direction)
    point = np.array([*start_mm, tracer.sensor_z_mm])
    rays = PathRays(np.tile(point, (count, 1)), direction, np.ones(count, bool), np.zeros(count))
    with np.errstate(all="ignore"):  # rays that miss a surface go on as NaN
        if microlens != NO_MICROLENS:
            plain = tracer.arrays.elements.model == PLAIN
            rays = _through_plain(tracer, microlens, rays) if plain else _through(tracer, microlens, rays)
        behind = tracer.camera.prescription.surfaces[-1].index
        return with_path(tracer.table, rays._replace(medium=behind))


def _through_plain(tracer: Tracer, microlens: int, rays: PathRays) -> PathRays:
    """Rays behind a thin microlens that is parallel to the sensor."""
    x, y, focal = tracer.arrays.microlenses[microlens, [column.X, column.Y, column.FOCAL]]
    along = (tracer.film_z_mm - rays.position_mm[:, 2]) / rays.direction[:, 2]
    position = rays.position_mm + along[:, None] * rays.direction
    offset, disc = position[:, :2] - [x, y], tracer.arrays.elements.disc_mm
    inside = np.hypot(*offset.T) <= disc if disc > 0 else _in_polygon(tracer.arrays.aperture, offset)
    return _bent_thinly(focal, offset, rays._replace(position_mm=position, path_mm=along, passes=inside))


def _through(tracer: Tracer, microlens: int, rays: PathRays) -> PathRays:
    """Rays before a microlens of any other model."""
    elements, row = tracer.arrays.elements, tracer.arrays.microlenses[microlens]
    kind, turn, vertex = int(row[column.KIND]), elements.turn, row[[column.X, column.Y, column.Z]]
    local = rays._replace(position_mm=(rays.position_mm - vertex) @ turn.T, direction=rays.direction @ turn.T)
    local = with_path(elements.faces[kind], local)
    if elements.model == THIN:
        local = _bent_thinly(row[column.FOCAL], local.position_mm[:, :2], local)
    elif elements.model == TWO_PLANE:
        local = _bent_by_normals(
            elements.bends[kind, column.CURVATURE_OF_NORMALS], elements.bends[kind, column.INDEX], local
        )
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
