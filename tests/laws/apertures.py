"""A hexagonal aperture, and what lies inside of one by angles."""

import math

import numpy as np

HEXAGON = {"blades": 6, "aperture_rotation_deg": 30.0}
"""Six blades, turned by 30 deg; 10 mm across corners."""


def inside(shape: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which points of the lens frame lie in an aperture of semi-diameter 5 mm, from angles instead of edges."""
    r, angle = np.hypot(x, y), np.degrees(np.arctan2(y, x))
    if shape == "ring":
        return (r >= 2.0) & (r <= 5.0)
    if shape == "rectangle":
        turned = np.radians(angle - 20.0)
        return (np.abs(r * np.cos(turned)) <= 4.0) & (np.abs(r * np.sin(turned)) <= 2.5) & (r <= 5.0)
    blades, corner = (6, 30.0) if shape == "hexagon" else (3, 0.0)
    from_middle = np.radians((angle - corner) % (360.0 / blades) - 180.0 / blades)
    return r * np.cos(from_middle) <= 5.0 * math.cos(math.pi / blades)
