"""Images of points the slow way: rays forwards from the object point, their paths, and Huygens's spherical waves from
where they leave the lens. Shares the prescription with the program, and nothing else; lens frame, origin at the
stop, z towards the sensor.
"""

import math

import numpy as np

from pipeline.optics.prescription import Prescription


def forward(
    prescription: Prescription, point_mm: np.ndarray, aim_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rays from a point through aims (n, 3) in front of the lens: points behind it, directions, paths, which pass."""
    position = np.tile(point_mm, (len(aim_mm), 1))
    direction = (aim_mm - point_mm) / np.linalg.norm(aim_mm - point_mm, axis=1, keepdims=True)
    path, passes, index = np.zeros(len(aim_mm)), np.ones(len(aim_mm), bool), 1.0
    for surface, vertex in zip(prescription.surfaces, prescription.vertices_from_stop_mm, strict=True):
        if math.isinf(surface.radius_mm):
            along = (vertex - position[:, 2]) / direction[:, 2]
            normal = np.tile([0.0, 0.0, 1.0], (len(position), 1))
        else:
            centre = np.array([0.0, 0.0, vertex + surface.radius_mm])
            off = position - centre
            b, c = np.sum(off * direction, axis=1), np.sum(off**2, axis=1) - surface.radius_mm**2
            root = np.sqrt(b * b - c)
            along = -b - root if surface.radius_mm > 0 else -b + root
            normal = -(off + along[:, None] * direction) / surface.radius_mm
        position, path = position + along[:, None] * direction, path + index * along
        passes &= np.hypot(position[:, 0], position[:, 1]) <= surface.semi_diameter_mm
        ratio, cosine = index / surface.index, np.sum(normal * direction, axis=1)
        behind = np.sqrt(1 - ratio**2 * (1 - cosine**2))
        direction = ratio * direction + (behind - ratio * cosine)[:, None] * normal
        index = surface.index
    return position, direction, path, passes


def image(
    prescription: Prescription, point_mm: np.ndarray, wavelength_mm: float, places_mm: np.ndarray, rays: int
) -> np.ndarray:
    """Light at places (n, 3) on the sensor, 1 if all waves met in step there, from rays x rays of them."""
    front, semi = prescription.vertices_from_stop_mm[0], prescription.surfaces[0].semi_diameter_mm
    low, high = np.full(2, -semi), np.full(2, semi)
    with np.errstate(invalid="ignore"):
        for count in (81, 81, rays):
            x, y = (axis.ravel() for axis in np.meshgrid(*np.linspace(low, high, count).T))
            aims = np.column_stack([x, y, np.full(len(x), front)])
            position, direction, path, passes = forward(prescription, point_mm, aims)
            step = (high - low) / (count - 1)
            low, high = aims[passes, :2].min(axis=0) - 1.5 * step, aims[passes, :2].max(axis=0) + 1.5 * step
        cosines = direction[:, :2].reshape(rays, rays, 2)
        (axx, axy), (ayx, ayy) = (np.moveaxis(np.gradient(cosines, axis=i), -1, 0) for i in (1, 0))
        part = np.abs(axx * ayy - axy * ayx).ravel()  # each ray stands for its part of the direction cosines
    kept = passes & np.isfinite(part)
    wave_number, amplitude = 2 * np.pi / wavelength_mm, []
    # Waves start where the aperture is seen from the sensor, about as far from it as the stop.
    ahead = np.sum((places_mm[0] - position[kept]) * direction[kept], axis=1) - np.linalg.norm(places_mm[0])
    foot = position[kept] + ahead[:, None] * direction[kept]
    phase = path[kept] + ahead
    for place in places_mm:
        distance = np.linalg.norm(place - foot, axis=1)
        amplitude.append(np.sum(part[kept] * np.exp(1j * wave_number * (phase + distance - phase[0]))))
    return np.abs(np.array(amplitude)) ** 2 / part[kept].sum() ** 2
