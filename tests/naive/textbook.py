"""A second ray tracer, written for reading: spheres as centres and radii, Snell's law as vectors, NumPy, no packets.

It shares with the kernels only the prescription, and works in the vision frame: origin at the stop, z towards the
scene, rays from the sensor forwards. Source of both formulas: Glassner (ed.), An Introduction to Ray Tracing, 1989,
chapters 2 and 4.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.camera.parts.camera import Camera
from pipeline.optics.prescription import Prescription

Trace = Callable[[Prescription, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""As `trace`, which knows spheres only."""


def trace(
    prescription: Prescription, position_mm: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on the front surface, unit directions behind it, and which rays pass every edge, (n, 3), (n, 3), (n,)."""
    position, direction = position_mm.copy(), direction / np.linalg.norm(direction, axis=1, keepdims=True)
    passes = np.ones(len(position), bool)
    surfaces = prescription.surfaces
    with np.errstate(invalid="ignore"):
        for i in reversed(range(len(surfaces))):
            surface, vertex = surfaces[i], np.array([0.0, 0.0, -prescription.vertices_from_stop_mm[i]])
            ahead = surfaces[i - 1].index if i else 1.0
            turn, shift = displacement(prescription, i)
            # Rows times a matrix: the inverse of a turn, because rays come to the surface.
            position, direction = (position - shift) @ turn, direction @ turn
            position, normal, hit = _meet(surface.radius_mm, vertex, position, direction)
            passes &= hit & (np.hypot(position[:, 0], position[:, 1]) <= surface.semi_diameter_mm)
            direction, refracted = _refract(direction, normal, surface.index / ahead)
            passes &= refracted
            position, direction = position @ turn.T + shift, direction @ turn.T
    return position, direction, passes


def displacement(prescription: Prescription, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Turn and shift that take surface i from its place in the centred lens to where it stands, vision frame.

    Euler angles, as SciPy defines intrinsic ones, in the camera frame: y and z point the other way there.
    """
    camera = np.diag([1.0, -1.0, -1.0])
    turn, shift = np.eye(3), np.zeros(3)
    vertices = prescription.vertices_from_stop_mm
    mounts = [(prescription.surfaces[i], vertices[i])]
    mounts += [(group, vertices[group.first] + group.pivot_mm) for group in prescription.groups if i in group.members]
    for mount, pivot_mm in mounts:
        about = Rotation.from_euler("XY", mount.tilt_deg, degrees=True).as_matrix()
        pivot = np.array([0.0, 0.0, pivot_mm])
        turn, shift = about @ turn, about @ (shift - pivot) + pivot + [*mount.decentre_mm, 0.0]
    return camera @ turn @ camera, camera @ shift


def sent(
    camera: Camera, start_mm: np.ndarray, points: np.ndarray, bend: np.ndarray | float = 0.0, trace: Trace = trace
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`trace` of rays from sensor points, (2,) or (n, 2), through points of the plane of thin microlenses, which take
    `bend` off their slopes, or of the rear vertex; and cos(theta) d omega of 1 mm^2 of that plane [sr], (n,)."""
    array = camera.microlenses
    gap = (
        camera.sensor_distance_mm - camera.prescription.vertices_from_stop_mm[-1]
        if array is None
        else array.distance_mm
    )
    slope = (points - start_mm) / gap
    position = np.column_stack([points, np.full(len(points), gap - camera.sensor_distance_mm)])
    found = trace(camera.prescription, position, np.column_stack([slope - bend, np.ones(len(points))]))
    return *found, (gap * (1 + (slope**2).sum(axis=1))) ** -2


def in_hexagon(points: np.ndarray, pitch_mm: float) -> np.ndarray:
    """Whether points lie in a lattice cell around the origin whose edges face +x and every 60 degrees."""
    normals = np.stack([np.cos(np.pi * np.arange(6) / 3), np.sin(np.pi * np.arange(6) / 3)])
    return (points @ normals <= pitch_mm / 2).all(axis=1)


def _meet(
    radius_mm: float, vertex: np.ndarray, position: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where rays meet a surface, its normal against the ray, and whether they do.

    A positive radius has its centre towards the sensor, at smaller z. Of a sphere's two intersections the one on the
    vertex' half of the sphere counts.
    """
    if math.isinf(radius_mm):
        t = (vertex[2] - position[:, 2]) / direction[:, 2]
        return position + t[:, None] * direction, np.tile([0.0, 0.0, -1.0], (len(t), 1)), np.ones(len(t), bool)
    centre = vertex - [0.0, 0.0, radius_mm]
    offset = position - centre
    along = _dot(offset, direction)
    squared = along**2 - _dot(offset, offset) + radius_mm**2
    roots = np.stack([-along - np.sqrt(squared), -along + np.sqrt(squared)])
    points = position + roots[..., None] * direction
    point = np.where((points[0, :, 2] - centre[2])[:, None] * radius_mm > 0, points[0], points[1])
    other = np.where((points[1, :, 2] - centre[2])[:, None] * radius_mm > 0, points[1], points[0])
    point = np.where((np.abs(point[:, 2] - vertex[2]) <= np.abs(other[:, 2] - vertex[2]))[:, None], point, other)
    normal = (point - centre) / radius_mm
    return point, np.where((_dot(normal, direction) > 0)[:, None], -normal, normal), squared >= 0


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar products of vectors (n, 3), a third of the time of a sum over so short an axis."""
    return np.einsum("ij,ij->i", a, b)


def _refract(direction: np.ndarray, normal: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Snell's law as vectors, and whether there is no total reflection; `ratio` is index before over index behind."""
    cosine = -_dot(direction, normal)
    squared = 1 - ratio**2 * (1 - cosine**2)
    behind = ratio * direction + (ratio * cosine - np.sqrt(squared))[:, None] * normal
    return behind, squared >= 0


def at_plane(position: np.ndarray, direction: np.ndarray, vision_from_target: np.ndarray) -> np.ndarray:
    """Crossings with a target's plane, in whose frame it is z = 0, (n, 2)."""
    turn, middle = vision_from_target[:3, :3], vision_from_target[:3, 3]
    with np.errstate(invalid="ignore"):  # rays that do not pass
        # Rows times a matrix: the inverse of a turn.
        place, way = (position - middle) @ turn, direction @ turn
        return place[:, :2] - place[:, 2:] / way[:, 2:] * way[:, :2]
