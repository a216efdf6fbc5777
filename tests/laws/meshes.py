"""Occluders of a few triangles."""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.targets.mesh import Occluder


def mesh(points: ArrayLike, triangles: ArrayLike = ((0, 1, 2), (0, 2, 3)), radiance: float = 0.0) -> Occluder:
    """Points (n, 3) and triangles: of four points, unless they are named, those of a quadrangle."""
    corners, faces = np.array(points, float).tolist(), np.array(triangles).tolist()
    return Occluder(vertices_mm=tuple(map(tuple, corners)), triangles=tuple(map(tuple, faces)), radiance=radiance)
