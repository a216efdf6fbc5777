"""What single precision of the trace alone moves J by: the trace through camera and lens once more, in NumPy.

Its arrays are float32 or float64, from the same random numbers. Spheres and planes only. Vision frame, mm.
"""

import numpy as np
from corners import Corners

from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.camera.tracing.microlens_kernels import FOCAL
from pipeline.camera.tracing.moments import FIRST, NORMAL, ORIGIN, SECOND
from pipeline.camera.tracing.sampling_bounds import outlines_around
from pipeline.optics.table import CONIC, CURVATURE, INDEX_RATIO, POSE, SEMI_DIAMETER_SQUARED, TERMS, VERTEX
from pipeline.truth.grid.position_image import on_target

WAYS = ("image", "two-plane", "two-plane, met in float32")
"""What is compared: rays that meet the board; J_near and J_far, whose mean ray meets it in float64, or in float32."""
_SEED = 32


def moved_px(corners: Corners, number: int, rays: int) -> np.ndarray:
    """Distances of J at a corner in float32 from J in float64, sums of both in float64, (len(WAYS),)."""
    tracer, pose = corners.rig.tracer, corners.pose[number]
    planes = target_plane(pose), *parallel_planes(tracer.camera.near_mm, tracer.camera.far_mm)
    (microlens,) = corners.rig.microlens(corners.cell[number : number + 1])
    started = start(tracer, corners.x_px[number], int(microlens), rays)
    points, directions, alive = zip(*(trace(tracer, *started, kind) for kind in (np.float64, np.float32)), strict=True)
    both = alive[0] & alive[1]
    means = [
        [met(plane, p[both], d[both]).astype(float).mean(axis=0) for plane in planes]
        for p, d in zip(points, directions, strict=True)
    ]
    z_mm = tracer.camera.near_mm, tracer.camera.far_mm
    by_two = [on_target(near, far, *z_mm, pose) for _, near, far in means]
    single = [np.float32(value) for value in means[1][1:]]
    ray = np.append(single[0], np.float32(z_mm[0])), np.append(single[1] - single[0], np.float32(z_mm[1] - z_mm[0]))
    rounded = met(planes[0], ray[0][None], ray[1][None])[0]
    moved = means[1][0] - means[0][0], by_two[1] - by_two[0], rounded - by_two[0]
    return np.array([np.hypot(*np.linalg.solve(corners.jacobian[number], shift)) for shift in moved])


def start(tracer: Tracer, x_px: np.ndarray, microlens: int, rays: int) -> tuple[np.ndarray, np.ndarray, int]:
    """A sensor position, and random points (rays, 2) of its microlens, or else of the outline for it."""
    position = tracer.positions_mm(*x_px)
    polygon = outlines_around(tracer.arrays, position[None])[0]
    if microlens >= 0:
        polygon = tracer.arrays.aperture + tracer.vertices_mm[microlens]
    middle, random = polygon.mean(axis=0), np.random.default_rng(_SEED)
    a, b = polygon - middle, np.roll(polygon, -1, axis=0) - middle
    areas = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    triangle = random.choice(len(polygon), rays, p=areas / areas.sum())
    along, out = random.random((rays, 1)), np.sqrt(random.random((rays, 1)))
    return position, middle + out * ((1 - along) * a[triangle] + along * b[triangle]), microlens


def trace(
    tracer: Tracer, position: np.ndarray, aim: np.ndarray, microlens: int, kind: type
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays from a sensor position through points of the plane that the lens sees: points, directions, alive."""
    plane_mm, a = tracer.arrays.optics.sampling_z_mm, aim.astype(kind)
    slope = (a - position.astype(kind)) / kind(plane_mm - tracer.sensor_z_mm)
    if microlens >= 0:
        focal_mm = kind(tracer.arrays.microlenses[microlens, FOCAL])
        slope -= (a - tracer.vertices_mm[microlens].astype(kind)) / focal_mm
    direction = np.column_stack([slope, np.ones(len(a), kind)])
    direction /= np.sqrt((direction**2).sum(axis=1, keepdims=True))
    return through(tracer.table.astype(kind), np.column_stack([a, np.full(len(a), kind(plane_mm))]), direction)


def through(table: np.ndarray, point: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays behind all surfaces, with the precision of the table: points, directions, alive."""
    assert not table[:, [CONIC, TERMS, POSE]].any()
    kind, p, d, alive = table.dtype.type, point.copy(), direction, np.ones(len(point), bool)
    for row in table:
        k, mu = row[CURVATURE], row[INDEX_RATIO]
        p[:, 2] -= row[VERTEX]
        p -= (p[:, 2] / d[:, 2])[:, None] * d
        # From the vertex plane on t solves k |p + t d|^2 = 2 (p + t d)_z, in the form that cancels nothing.
        before, rest = d[:, 2] - k * (p * d).sum(axis=1), k * (p * p).sum(axis=1) - 2 * p[:, 2]
        square = before**2 - k * rest
        cosine = np.sqrt(np.maximum(square, 0))
        p += (rest / (before + cosine))[:, None] * d
        sine_2 = mu**2 * (1 - cosine**2)
        alive &= (square > 0) & (p[:, 0] ** 2 + p[:, 1] ** 2 <= row[SEMI_DIAMETER_SQUARED]) & (sine_2 < 1)
        normal = np.column_stack([-k * p[:, 0], -k * p[:, 1], 1 - k * p[:, 2]])
        d = mu * d + (np.sqrt(np.maximum(1 - sine_2, 0)) - mu * cosine)[:, None] * normal
        p[:, 2] += row[VERTEX]
    assert p.dtype == d.dtype == kind
    return p, d, alive


def met(plane: np.ndarray, point: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Where rays meet a plane, in its own axes, with their precision, (n, 2)."""
    plane = plane.astype(point.dtype)
    to_origin = plane[ORIGIN] - point
    hit = ((to_origin @ plane[NORMAL]) / (direction @ plane[NORMAL]))[:, None] * direction - to_origin
    return np.stack([hit @ plane[FIRST], hit @ plane[SECOND]], axis=1)
