"""Rays through one microlens of any kind, the slow way: trial rays all over a wide square, one formula after the other.

No bounds, no tables, no packets. Vertices are counted from the basis of CONVENTIONS.md; cells are what lies nearest to
the vertex among its neighbours; spheres are met by the quadratic of their centre, conics by bisection; tilts are
rotation matrices from SciPy.
"""

import math
from typing import NamedTuple

import numpy as np
from naive import textbook
from scipy.spatial.transform import Rotation

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.microlens_array import MicrolensArray


def rays_before(
    camera: Camera,
    start_mm: np.ndarray,
    vertex_mm: np.ndarray,
    kind: int,
    count: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rays from sensor points, (2,) or (count, 2), through the microlens with a vertex (3,), vision frame.

    Positions and directions (count, 3); weights, 0 for rays that the microlens blocks, whose sum is the integral of
    A cos(theta) d omega [sr]; and the same for all rays through the aperture that counts.
    """
    array = camera.microlenses
    assert array is not None
    sensor_mm, half = -camera.sensor_distance_mm, 0.75 * array.pitch_mm
    slab = (array.thickness_mm or 0.0) / (array.index or 1.0) if array.model != "thin" else 0.0
    slab = (
        slab if array.model == "two-plane" or (array.rear_radii_mm and math.isinf(array.rear_radii_mm[kind])) else 0.0
    )
    ahead = vertex_mm[2] - sensor_mm + slab
    points = vertex_mm[:2] + rng.uniform(-half, half, (count, 2))
    slope = (points - start_mm) / ahead
    cosine = 1 / np.sqrt(1 + np.sum(slope**2, axis=1))
    weight = (2 * half) ** 2 / count * acceptance(camera, np.arccos(cosine))
    if camera.weight == "irradiance":
        weight *= cosine**4 / ahead**2
    start = np.column_stack([np.broadcast_to(start_mm, (count, 2)), np.full(count, sensor_mm)])
    turn = vision_from_array(array)
    position = (start - vertex_mm) @ turn
    direction = np.column_stack([slope, np.ones(count)]) * cosine[:, None] @ turn
    with np.errstate(invalid="ignore", divide="ignore"):
        position, direction, first, passes = _through(array, kind, position, direction)
    return (
        position @ turn.T + vertex_mm,
        direction @ turn.T,
        np.where(first & passes, weight, 0.0),
        np.where(first, weight, 0.0),
    )


class Leaving(NamedTuple):
    """Rays that leave the camera: positions and directions (n, 3), weights (n,), their numbers among all that were
    drawn (n,); and the weight of all through the microlens's aperture."""

    position_mm: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    number: np.ndarray
    entered: float


def leaving(
    camera: Camera, start_mm: np.ndarray, vertex_mm: np.ndarray, kind: int, count: int, rng: np.random.Generator
) -> Leaving:
    """Those of `rays_before` that pass the microlens, and then the main lens, by the textbook."""
    position, direction, weight, entered = rays_before(camera, start_mm, vertex_mm, kind, count, rng)
    number = np.flatnonzero(weight > 0)
    position, direction, passes = textbook.trace(camera.prescription, position[number], direction[number])
    number = number[passes]
    return Leaving(position[passes], direction[passes], weight[number], number, entered.sum())


HALF_TURN = Rotation.from_euler("z", 180, degrees=True)
"""The sensor frame is the vision frame turned by 180 degrees about z."""


def vertex(camera: Camera, k: int, l: int) -> np.ndarray:
    """Vertex of microlens (k, l), (3,), vision frame [mm]."""
    array, sensor = camera.microlenses, camera.sensor
    assert array is not None
    a, b = _basis(array)
    in_plane = Rotation.from_euler("z", array.rotation_deg, degrees=True)
    place = _tilt(array).apply(in_plane.apply([*(k * a + l * b), 0.0]))
    place += [array.offset_x_mm - sensor.offset_x_mm, array.offset_y_mm - sensor.offset_y_mm, 0.0]
    return HALF_TURN.apply(place) + np.array([0.0, 0.0, array.distance_mm - camera.sensor_distance_mm])


def vision_from_array(array: MicrolensArray) -> np.ndarray:
    return (HALF_TURN * _tilt(array) * HALF_TURN.inv()).as_matrix()


def _tilt(array: MicrolensArray) -> Rotation:
    """In the sensor frame: first about x, then about its y, which stays where it is."""
    about_x, about_y = Rotation.from_rotvec([[array.tilt_x_deg, 0, 0], [0, array.tilt_y_deg, 0]], degrees=True)
    return about_y * about_x


def _basis(array: MicrolensArray) -> tuple[np.ndarray, np.ndarray]:
    """From lens (0, 0) to (1, 0) and (0, 1), before the rotation [mm]."""
    p, q, root = array.pitch_mm, array.cross_pitch_mm or array.pitch_mm, math.sqrt(3) / 2
    basis = {
        "hexagonal": ((p, 0), (p / 2, q * root)),
        "hexagonal-columns": ((q * root, p / 2), (0, p)),
        "square": ((p, 0), (0, q)),
    }
    a, b = basis[array.layout]
    return np.array(a), np.array(b)


def acceptance(camera: Camera, theta: np.ndarray) -> np.ndarray:
    """Share of the light that pixels take under an angle [rad]."""
    sensor = camera.sensor
    if sensor.acceptance == "cosine":
        return np.cos(theta) ** sensor.acceptance_power
    if sensor.acceptance == "cone":
        first = sensor.acceptance_half_angle_deg
        last = first + max(sensor.acceptance_roll_off_deg, 1e-12)
        return np.interp(np.degrees(theta), [first, last], [1.0, 0.0])
    return np.ones_like(theta)


def in_aperture(array: MicrolensArray, points: np.ndarray) -> np.ndarray:
    """Whether points (n, 2) around a vertex, in the array's plane, lie in its aperture."""
    if array.disc_diameter_mm is not None:
        return np.hypot(*points.T) <= array.disc_diameter_mm / 2
    a, b = _basis(array)
    angle = math.radians(array.rotation_deg)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    others = [turn @ (k * a + l * b) for k in (-2, -1, 0, 1, 2) for l in (-2, -1, 0, 1, 2) if k or l]
    own = np.hypot(*points.T)
    return np.all([own <= np.hypot(*(points - other).T) for other in others], axis=0)


def _through(
    array: MicrolensArray, kind: int, position: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    everywhere = np.ones(len(position), bool)
    if array.model == "thin":
        position = _to_plane(position, direction, 0.0)
        slope = direction[:, :2] / direction[:, 2:] - position[:, :2] / array.focal_lengths_mm[kind]
        direction = np.column_stack([slope, np.ones(len(slope))])
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return position, direction, in_aperture(array, position[:, :2]), everywhere
    assert array.index is not None
    assert array.thickness_mm is not None
    if array.model == "two-plane":
        position = _to_plane(position, direction, 0.0)
        up = np.tile([0.0, 0.0, -1.0], (len(position), 1))
        direction, _ = textbook._refract(direction, up, 1 / array.index)
        position = _to_plane(position, direction, array.thickness_mm)
        radius = array.focal_lengths_mm[kind] * (array.index - 1)
        centre = np.array([0.0, 0.0, array.thickness_mm])
        normal = np.column_stack(
            [position[:, :2] / radius, np.sqrt(1 - np.sum((position[:, :2] / radius) ** 2, axis=1))]
        )
        direction, out = textbook._refract(direction, -normal, array.index)
        assert np.all(np.abs((position - centre)[:, 2]) < 1e-12)
        return position, direction, in_aperture(array, position[:, :2]), out
    rear, front = array.rear_radii_mm[kind], array.front_radii_mm[kind]
    conics = ((array.rear_conics or (0.0,) * 9)[kind], (array.front_conics or (0.0,) * 9)[kind])
    position, normal, met = _to_conic(position, direction, 0.0, -rear, conics[0])
    inside_rear = met & (in_aperture(array, position[:, :2]) if math.isfinite(rear) else everywhere)
    direction, _ = textbook._refract(direction, normal, 1 / array.index)
    position, normal, met = _to_conic(position, direction, array.thickness_mm, -front, conics[1])
    inside_front = met & (in_aperture(array, position[:, :2]) if math.isfinite(front) else everywhere)
    direction, out = textbook._refract(direction, normal, array.index)
    if math.isfinite(rear):
        return position, direction, inside_rear, inside_front & out
    return position, direction, inside_front, out


def _to_plane(position: np.ndarray, direction: np.ndarray, z: float) -> np.ndarray:
    return position + ((z - position[:, 2]) / direction[:, 2])[:, None] * direction


def _to_conic(
    position: np.ndarray, direction: np.ndarray, vertex: float, radius: float, conic: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Meet z = vertex + sag by bisection along the ray; the normal points against it."""
    on_plane = _to_plane(position, direction, vertex)
    if math.isinf(radius):
        return on_plane, np.tile([0.0, 0.0, -1.0], (len(position), 1)), np.ones(len(position), bool)

    def height(t: np.ndarray) -> np.ndarray:
        point = on_plane + t[:, None] * direction
        squared = np.sum(point[:, :2] ** 2, axis=1) / radius**2
        sag = radius * squared / (1 + np.sqrt(1 - (1 + conic) * squared))
        return point[:, 2] - vertex - sag

    low, high = np.full(len(position), -0.3 * abs(radius)), np.full(len(position), 0.3 * abs(radius))
    for _ in range(50):  # to the last bit of what they begin with
        middle = (low + high) / 2
        above = height(middle) > 0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    point = on_plane + ((low + high) / 2)[:, None] * direction
    # The gradient of z - sag: with s = sqrt(1 - (1 + k) r^2 / R^2) the slope of the sag is r / (R s).
    s = np.sqrt(1 - (1 + conic) * np.sum(point[:, :2] ** 2, axis=1) / radius**2)
    normal = np.column_stack([point[:, :2] / (radius * s[:, None]), -np.ones(len(point))])
    return point, normal / np.linalg.norm(normal, axis=1, keepdims=True), np.abs(height((low + high) / 2)) < 1e-9
