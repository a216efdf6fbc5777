"""Two plain lenses and random rays for slow twins."""

import numpy as np
from naive.textbook import _refract

from pipeline.optics.prescription import Prescription, Surface

SINGLET = Prescription(
    surfaces=(
        Surface(radius_mm=60.0, thickness_mm=8.0, index=1.8, semi_diameter_mm=30.0),
        Surface(radius_mm=-60.0, thickness_mm=5.0, semi_diameter_mm=30.0),
        Surface(semi_diameter_mm=12.0, is_stop=True),
    )
)


BALL = Prescription(
    surfaces=(
        Surface(radius_mm=10.0, thickness_mm=10.0, index=1.9, semi_diameter_mm=10.0),
        Surface(semi_diameter_mm=8.0, thickness_mm=10.0, index=1.9, is_stop=True),
        Surface(radius_mm=-10.0, semi_diameter_mm=10.0),
    )
)


def random_rays(lens: Prescription, behind_mm: float, field_mm: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """From anywhere on a square sensor to anywhere on 1.2 times the rear surface."""
    rng = np.random.default_rng(20)
    rear_mm = -lens.vertices_from_stop_mm[-1]
    start = np.column_stack([rng.uniform(-field_mm, field_mm, (count, 2)), np.full(count, rear_mm - behind_mm)])
    aim_mm = 1.2 * lens.surfaces[-1].semi_diameter_mm
    aim = np.column_stack([rng.uniform(-aim_mm, aim_mm, (count, 2)), np.full(count, rear_mm)])
    way = aim - start
    return start, way / np.linalg.norm(way, axis=1, keepdims=True)


PHONE = Prescription(
    surfaces=(
        Surface(
            radius_mm=30.0,
            conic=-0.8,
            even_coefficients=(0.0, 2e-6, -3e-9, 1e-12),
            thickness_mm=8.0,
            index=1.6,
            semi_diameter_mm=14.0,
        ),
        Surface(radius_mm=-80.0, conic=-2.5, thickness_mm=3.0, semi_diameter_mm=14.0),
        Surface(semi_diameter_mm=9.0, is_stop=True, thickness_mm=8.0),
        # A plate that turns from hollow to bulging: the slope changes sign at half its aperture.
        Surface(
            even_coefficients=(-4e-3, 4e-5, 0.0, 2e-10, 0.0, -1e-14),
            odd_coefficients=(1e-4,),
            thickness_mm=3.0,
            index=1.7,
            semi_diameter_mm=10.0,
        ),
        Surface(radius_mm=-200.0, even_coefficients=(0.0, 1e-5), semi_diameter_mm=10.0),
    )
)
_REACH_MM = 6.0


def sag(surface: Surface, r: np.ndarray) -> np.ndarray:
    """As it is defined, for real and complex heights."""
    c = 1.0 / surface.radius_mm
    z = c * r**2 / (1 + np.sqrt(1 - (1 + surface.conic) * c**2 * r**2))
    for i, a in enumerate(surface.even_coefficients):
        z = z + a * r ** (2 * i + 2)
    for i, a in enumerate(surface.odd_coefficients):
        z = z + a * r ** (2 * i + 3)
    return z


def bisect(surface: Surface, vertex_mm: float, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Points on a surface whose sag points away from the scene, vision frame; NaN where the bracket holds no root."""

    def depth(t: np.ndarray) -> np.ndarray:
        point = position + t[:, None] * direction
        return point[:, 2] - vertex_mm + sag(surface, np.hypot(point[:, 0], point[:, 1]))

    low, high = ((vertex_mm + end - position[:, 2]) / direction[:, 2] for end in (-_REACH_MM, _REACH_MM))
    holds = (depth(low) < 0) & (depth(high) > 0)
    for _ in range(80):
        middle = (low + high) / 2
        behind = depth(middle) < 0
        low, high = np.where(behind, middle, low), np.where(behind, high, middle)
    return np.where(holds[:, None], position + high[:, None] * direction, np.nan)


def bisecting_trace(
    lens: Prescription, position: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on the front surface, directions behind it, and which rays pass."""
    passes = np.ones(len(position), bool)
    for i in reversed(range(len(lens.surfaces))):
        surface = lens.surfaces[i]
        position = bisect(surface, -lens.vertices_from_stop_mm[i], position, direction)
        r = np.hypot(position[:, 0], position[:, 1])
        passes &= r <= surface.semi_diameter_mm
        slope = sag(surface, r + 1e-30j).imag / 1e-30
        normal = -np.column_stack([position[:, :2] * (slope / r)[:, None], np.ones(len(r))])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        direction, refracted = _refract(direction, normal, surface.index / (lens.surfaces[i - 1].index if i else 1.0))
        passes &= refracted
    return position, direction, passes
