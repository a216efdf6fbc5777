"""Bundles on a dense polar grid: the edge bisected in thousands of directions, no corners looked for, textbook rays.

With 4,096 evenly spaced directions the corners of an edge leave errors of (2 pi / 4096)^2 / 12 = 2e-7 of a blur.
"""

from collections.abc import Callable

import numpy as np
from naive import textbook

from pipeline.camera.parts.camera import Camera
from pipeline.optics.prescription import Prescription

_BISECTIONS = 36
Trace = Callable[[Prescription, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""As `textbook.trace`, which knows spheres only."""


def mean_hit(
    camera: Camera,
    start_mm: np.ndarray,
    pose: np.ndarray,
    lens: tuple[np.ndarray, float] | None = None,
    directions: int = 4096,
    radii: int = 16,
    trace: Trace = textbook.trace,
) -> tuple[np.ndarray, float]:
    """J of a sensor point (2,) on a target's plane, in the target frame, and the weight that leaves.

    `lens`, vertex and focal length, is a microlens of a hexagonal array whose cells face +x.
    """
    rear_mm = -camera.prescription.vertices_from_stop_mm[-1]
    array = camera.microlenses
    plane_mm = rear_mm if array is None else array.distance_mm - camera.sensor_distance_mm
    ahead = plane_mm + camera.sensor_distance_mm
    vertex, focal = (np.zeros(2), np.inf) if lens is None else lens

    def send(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        slope = (points - start_mm) / ahead
        direction = np.column_stack([slope - (points - vertex) / focal, np.ones(len(points))])
        position, direction, passes = trace(
            camera.prescription, np.column_stack([points, np.full(len(points), plane_mm)]), direction
        )
        if array is not None:
            normals = np.stack([np.cos(np.pi * np.arange(6) / 3), np.sin(np.pi * np.arange(6) / 3)])
            passes &= ((points - vertex) @ normals <= array.pitch_mm / 2).all(axis=1)
        return position, direction, passes

    half = 1.5 * camera.prescription.surfaces[-1].semi_diameter_mm if array is None else 0.6 * array.pitch_mm
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-half, half, 101)]), axis=-1).reshape(-1, 2) + vertex
    inner = grid[send(grid)[2]].mean(axis=0)
    angle = 2 * np.pi * np.arange(directions) / directions
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low, high = np.zeros(directions), np.full(directions, 3 * half)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        passes = send(inner + middle[:, None] * along)[2]
        low, high = np.where(passes, middle, low), np.where(passes, high, middle)
    node, share = np.polynomial.legendre.leggauss(radii)
    radius = low[:, None] * (node + 1) / 2
    points = (inner + radius[..., None] * along[:, None]).reshape(-1, 2)
    position, direction, passes = send(points)
    assert passes.all()
    squared = 1 + (((points - start_mm) / ahead) ** 2).sum(axis=1)
    measure = (radius * low[:, None] * share / 2).ravel() * 2 * np.pi / directions
    weight = measure if camera.weight == "area" else measure / (ahead * squared) ** 2
    return weight @ textbook.at_plane(position, direction, pose) / weight.sum(), float(weight.sum())
